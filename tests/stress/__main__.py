"""Run the stress suite and print its table: `python3 build_addon.py stress [NAME ...] [--seconds N | --runs N]`."""

from __future__ import annotations

import argparse
import fnmatch
import json
import sys
import time
from contextlib import nullcontext
from pathlib import Path

from core.command_line.workers import tell_unlike
from core.work.executor import JobExecutor
from core.work.processes import ProcessExecutor

from .case import Value, Values
from .families import FAMILIES, TOUCHES, chosen
from .invariances import GROUP, MEASURED
from .job import LINE, TABLE, on_worker
from .run import Failure, Tally, run

WIDE = max(len(family.name) for family in FAMILIES)
FATES = ("failed", "flagged")


def table(tallies: dict[str, Tally]) -> str:
    """Return what became of the cases, in columns."""
    words = (f"{word:>7}" for word in ("tried", "passed", "flagged", "failed", "s/case"))
    head = f"{'family':{WIDE}} {' '.join(words)}  nearest to its limit, of what passed"
    lines, total = [head], Tally()
    for name, tally in tallies.items():
        total.counts.update(tally.counts)
        total.seconds += tally.seconds
        worst = max(tally.worst.items(), key=lambda item: item[1][0], default=None)
        told = (
            f"{worst[0]} {worst[1][1]:.2g} of {worst[1][2]:.2g} (seed {worst[1][3]})" if worst and worst[1][0] else ""
        )
        lines.append(_row(name, tally, told))
    lines.append(_row("all", total, ""))
    if anew := sum(tally.anew["tried"] for tally in tallies.values()):
        lines.append(f"tried anew, and counted nowhere: {anew} cases that failed once")
    return "\n".join(lines)


def _row(name: str, tally: Tally, told: str) -> str:
    count = tally.counts
    numbers = f"{count['tried']:7} {count['passed']:7} {count['flagged']:7} {count['failed']:7}"
    return f"{name:{WIDE}} {numbers} {tally.seconds / max(count['tried'], 1):7.3f}  {told}".rstrip()


def costly(tallies: dict[str, Tally], seed: str) -> str:
    """Return what became of costly touches, per 1,000 of them, by family and in all; and of what is no touch by cases.

    Args:
        seed: that cases were drawn from, in words.
    """
    told = {family.name: tallies[family.name] for family in TOUCHES if family.name in tallies}
    lines, total = [], Tally()
    if told:
        lines.append(f"per 1,000 costly touches\n{'family':{WIDE}} " + " ".join(f"{w:>7}" for w in ("costly", *FATES)))
    for name, tally in told.items():
        total.costly.update(tally.costly)
        numbers = " ".join(f"{per_thousand(tally, fate):>7}" for fate in FATES)
        lines.append(f"{name:{WIDE}} {tally.costly['tried']:7} {numbers}")
    parts = {name: tally.counts for name, tally in tallies.items() if name not in told}
    if parts:
        shares = (f"{name} {count['failed']} of {count['tried']} failed" for name, count in parts.items())
        lines.append(f"no touches: {', '.join(shares)}")
    if told:
        numbers = ", ".join(f"{per_thousand(total, fate)} {fate}" for fate in FATES)
        lines.append(f"per 1,000 costly touches: {numbers}; of {total.costly['tried']}, on {seed}")
    return "\n".join(lines)


def per_thousand(tally: Tally, fate: str) -> str:
    """Return how many of 1,000 costly touches came to something, in words."""
    tried = tally.costly["tried"]
    return f"{1000.0 * tally.costly[fate] / tried:.0f}" if tried else "-"


def invariances(tallies: dict[str, Tally], changed: Values) -> list[str]:
    """Return a line for each invariance: the worst that was measured, and where."""
    families = {family.name: family for family in FAMILIES}
    lines = []
    for name, tally in tallies.items():
        found = [(check, *tally.most[check]) for check in MEASURED if check in tally.most]
        if families[name].group != GROUP or not found:
            continue
        count = tally.counts["tried"]
        worst = [max(found, key=lambda row: row[1])]
        worst += [row for row in found if row[0] == "force" and row != worst[0]]
        told = []
        for check, value, _, seed in worst:
            drawn = {**families[name].values(seed), **changed}
            touch = f"{drawn['shape']} on {drawn['contact']}, friction {drawn['friction']:g}, seed {seed}"
            told.append(f"{value:.2g} {check}, {touch}")
        beyond = f"{count - tally.counts['passed']} of {count} beyond {found[0][2]:g}"
        lines.append(f"{name}: {'; '.join(told)} ({beyond})")
    return lines


def value_of(text: str) -> tuple[str, Value]:
    """Return a name and its value, as `--set` has them."""
    name, _, value = text.partition("=")
    for kind in (int, float):
        try:
            return name, kind(value)
        except ValueError:
            pass
    return name, value


def as_json(tallies: dict[str, Tally], failures: list[Failure]) -> str:
    """Return the same for programs."""
    found = {
        name: {
            **dict(t.counts),
            "costly": dict(t.costly),
            "anew": dict(t.anew),
            "seconds": t.seconds,
            "slowest": t.slowest,
            "worst": t.worst,
            "most": t.most,
        }
        for name, t in tallies.items()
    }
    told = [{"family": f.family, "seed": f.seed, "measured": f.measured, "command": f.command} for f in failures]
    return json.dumps({"families": found, "failures": told}, indent=1)


def executor_of(options: argparse.Namespace) -> JobExecutor | None:
    """Return who judges cases beside this process, None for nobody."""
    if options.scheduler:
        from core.work.cluster import ClusterExecutor

        return ClusterExecutor(options.scheduler, table=TABLE, entry=on_worker)
    return ProcessExecutor(options.workers, table=TABLE, line=LINE) if options.workers else None


def unseen() -> int:
    """Return a seed that nobody has drawn from: milliseconds since 2026, which pass faster than cases are judged."""
    return time.time_ns() // 1_000_000 - 1_767_225_600_000


def repeated(options: argparse.Namespace, seed: int) -> str:
    """Return the command that tries the same cases: with --seconds as many of them as there is time for."""
    words = [*options.names, "--seed", seed]
    words += ["--runs", options.runs] if options.runs is not None else []
    words += ["--seconds", f"{options.seconds:g}"] if options.seconds is not None else []
    words += [word for text in options.set for word in ("--set", text)]
    return " ".join(map(str, ["python3 build_addon.py stress", *words]))


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for; status 1 where something failed."""
    parser = argparse.ArgumentParser(prog="build_addon.py stress", description=__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"families (all but 'invariance_*'): {', '.join(f.name for f in FAMILIES)}",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--seconds", type=float, help="for so long, each family as long as any other")
    how.add_argument("--runs", type=int, help="cases of each family (20)")
    parser.add_argument("--seed", type=int, help="of the first case of each family (one that nobody has seen)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="in place of what is drawn")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file")
    parser.add_argument("--workers", type=int, metavar="N", help="processes that judge cases, with --runs")
    parser.add_argument("--scheduler", metavar="URL", help="a dask scheduler's workers judge them, with --runs")
    parser.add_argument("--as-drawn", action="store_true", help="make no failing case simpler")
    options = parser.parse_args(arguments)
    names = [family.name for family in FAMILIES]
    unknown = [name for name in options.names if not fnmatch.filter(names, name)]
    if unknown:
        parser.error(f"no such family: {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    if options.workers is not None and options.workers < 1:
        parser.error("--workers: at least 1")
    if options.workers and options.scheduler:
        parser.error("a scheduler has workers of its own: leave --workers or --scheduler out")
    if (options.workers or options.scheduler) and options.seconds is not None:
        parser.error("what is judged side by side is counted: give --runs, not --seconds")
    families = chosen(options.names)
    seed, told = options.seed, f"seed {options.seed}, which was given"
    if seed is None:
        seed = unseen()
        told = f"seed {seed}, which nobody has seen"
    changed: Values = dict(map(value_of, options.set))

    def tell(text: str) -> None:
        print(text, flush=True)

    tell(f"cases from {told}; the same again: {repeated(options, seed)}")
    with executor_of(options) or nullcontext() as executor:
        tallies, failures = run(
            families,
            seed,
            runs=options.runs,
            seconds=options.seconds,
            changed=changed,
            tell=tell,
            simplify=not options.as_drawn,
            executor=executor,
        )
        if executor is not None:
            tell_unlike(executor)
    print(table(tallies))
    for text in invariances(tallies, changed):
        print(text)
    print(costly(tallies, told))
    if options.json:
        options.json.write_text(as_json(tallies, failures), encoding="utf-8")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
