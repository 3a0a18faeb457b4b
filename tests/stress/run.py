"""Runs cases: judges them, names what failed, and makes a failing case as simple as it stays failing."""

from __future__ import annotations

import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from core.errors import DermisError
from core.work.executor import JobExecutor
from core.work.spread import Asked, spread

from .case import Family, Value, Values, Verdict
from .facts import costly
from .mended import MENDED

PART = 5  # cases of a job: those of contact take seconds
SHRINKING = 30.0  # [s] that the first case to fail a check is made simpler for
ROOT = Path(__file__).resolve().parents[2]


@dataclass
class Tally:
    """What became of a family's cases that were drawn; mended ones are counted in `anew` alone.

    Attributes:
        counts: 'tried', 'passed', 'flagged', 'failed'. costly: the same of costly touches, see `facts.costly`.
        anew: the same of mended cases. seconds: that those drawn took.
        worst: check -> (value over its limit, value, limit, seed) of the case that came nearest to its limit, of those
            that passed.
        most: check -> (value, limit, seed) of the case with the largest value, passed or not.
    """

    counts: Counter[str] = field(default_factory=Counter)
    costly: Counter[str] = field(default_factory=Counter)
    anew: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    slowest: tuple[float, int] = (0.0, 0)
    worst: dict[str, tuple[float, float, float, int]] = field(default_factory=dict)
    most: dict[str, tuple[float, float, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class Failure:
    """A case that failed.

    Attributes:
        values: that differ from those its seed draws, after it was made simpler.
        measured: check -> what was found, in words.
    """

    family: str
    seed: int
    measured: dict[str, str]
    values: Values

    @property
    def command(self) -> str:
        """What judges it alone."""
        told = "".join(f" --set {name}={value}" for name, value in self.values.items())
        return f"python3 build_addon.py stress {self.family} --seed {self.seed} --runs 1{told}"


def judged(family: Family, values: Values) -> Verdict:
    """Judge a case; an exception, or a warning of arithmetic, is a check that is not passed."""
    verdict = Verdict()
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            verdict = family.judge(values)
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            kind = "refused" if isinstance(error, DermisError) else type(error).__name__
            verdict.hold(f"{kind} at {_place(last.filename)}:{last.lineno}: {str(error)[:120]}", 1, 0)
    for warning in heard:
        if issubclass(warning.category, RuntimeWarning):
            verdict.hold(f"warns at {_place(warning.filename)}: {warning.message}", 1, 0)
    return verdict


def _place(filename: str) -> str:
    path = Path(filename)
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name


def run(
    families: Sequence[Family],
    seed: int = 0,
    *,
    runs: int | None = None,
    seconds: float | None = None,
    changed: Values | None = None,
    tell: Callable[[str], None] = lambda text: None,
    simplify: bool = True,
    again: bool = True,
    executor: JobExecutor | None = None,
) -> tuple[dict[str, Tally], list[Failure]]:
    """Run cases of families.

    Args:
        seed: of the first case of each. runs: cases of each family. seconds: in all, in place of `runs`.
        changed: values in place of those drawn. tell: is told of every failure.
        simplify: make the first case that fails a check simpler.
        again: begin with what failed before, unless one case alone is asked for.
        executor: who judges cases, in place of this process; it knows the job 'judge'. Not with `seconds`.

    Returns:
        What became of each family's cases, and what failed.
    """
    tallies = {family.name: Tally() for family in families}
    failures: list[Failure] = []
    for family in families if again and not changed and runs != 1 else ():
        try_anew(family, tallies[family.name], failures, tell, simplify)
    if executor is not None:
        for family, number, took, verdict in _elsewhere(families, seed, runs, changed or {}, executor):
            values = {**family.values(number), **(changed or {})}
            count(family, number, values, verdict, took, tallies[family.name], failures, tell, simplify)
        order = {family.name: i for i, family in enumerate(families)}
        failures.sort(key=lambda failure: (order[failure.family], failure.seed))  # whoever was done first
    else:
        for family, number in _turns(families, seed, runs, seconds, tallies):
            values = {**family.values(number), **(changed or {})}
            judge_one(family, number, values, tallies[family.name], failures, tell, simplify)
    return tallies, failures


def try_anew(
    family: Family,
    tally: Tally,
    failures: list[Failure],
    tell: Callable[[str], None] = lambda text: None,
    simplify: bool = True,
) -> None:
    """Judge the seeds of a family that are mended."""
    for seed in MENDED.get(family.name, ()):
        judge_one(family, seed, family.values(seed), tally, failures, tell, simplify, drawn=False)


def _turns(
    families: Sequence[Family], seed: int, runs: int | None, seconds: float | None, tallies: dict[str, Tally]
) -> Iterator[tuple[Family, int]]:
    """Yield families with their seeds: all of them so often, or that with the least time so far until time is up."""
    if seconds is None:
        for k in range(runs if runs is not None else 20):
            yield from ((family, seed + k) for family in families)
        return
    ends, nexts = time.monotonic() + seconds, dict.fromkeys((f.name for f in families), seed)
    while time.monotonic() < ends:
        family = min(families, key=lambda f: tallies[f.name].seconds)
        yield family, nexts[family.name]
        nexts[family.name] += 1


def _elsewhere(
    families: Sequence[Family], seed: int, runs: int | None, changed: Values, executor: JobExecutor
) -> Iterator[tuple[Family, int, float, Verdict]]:
    """Let an executor judge cases, some at a time; yield each with its seconds as it is done.

    Raises:
        DermisError: whoever judged them died of it, or has another engine.
    """
    from .job import verdicts_of

    seeds = range(seed, seed + (runs if runs is not None else 20))
    parts = [(family, list(seeds[i : i + PART])) for family in families for i in range(0, len(seeds), PART)]
    asked = (
        (family, Asked("judge", {}, {"family": family.name, "seeds": part, "changed": changed}))
        for family, part in parts
    )
    for item in spread(executor, asked):
        if item is not None:
            for number, took, verdict in verdicts_of(item[1].result()):
                yield item[0], number, took, verdict


def judge_one(
    family: Family,
    seed: int,
    values: Values,
    tally: Tally,
    failures: list[Failure],
    tell: Callable[[str], None] = lambda text: None,
    simplify: bool = True,
    drawn: bool = True,
) -> None:
    """Judge a case, count it, and tell of what failed."""
    started = time.perf_counter()
    verdict = judged(family, values)
    count(family, seed, values, verdict, time.perf_counter() - started, tally, failures, tell, simplify, drawn)


def count(
    family: Family,
    seed: int,
    values: Values,
    verdict: Verdict,
    took: float,
    tally: Tally,
    failures: list[Failure],
    tell: Callable[[str], None],
    simplify: bool,
    drawn: bool = True,
) -> None:
    """Count a case that was judged in so many seconds, and tell of what failed.

    Args:
        drawn: it was drawn, not tried because it failed once.
    """
    failed = verdict.failed
    fate = "failed" if failed else "flagged" if verdict.missed else "passed"
    for counter in (tally.counts, *([tally.costly] if costly(verdict.facts) else ())) if drawn else (tally.anew,):
        counter.update(("tried", fate))
    if drawn:
        tally.seconds += took
        tally.slowest = max(tally.slowest, (took, seed))
        _note_values(verdict, seed, tally)
    if not failed:
        return
    first = not any(failure.family == family.name and failed[0] in failure.measured for failure in failures)
    simpler = simple(family, values, failed[0], SHRINKING if simplify and first else 0.0)
    usual = family.values(seed)
    differ = {name: value for name, value in simpler.items() if usual.get(name) != value}
    found = {check: "{:.3g}, allowed {:.3g}".format(*verdict.measured[check]) for check in failed}
    failure = Failure(family.name, seed, found, differ)
    failures.append(failure)
    tell(f"FAILED {family.name} {seed}: " + "; ".join(f"{c}: {m}" for c, m in found.items()) + f"\n  {failure.command}")


def _note_values(verdict: Verdict, seed: int, tally: Tally) -> None:
    """Note the values of a case that are nearest to their limits, or the largest."""
    for check, (value, limit) in verdict.measured.items():
        share = value / limit if limit else float(value > 0)
        if check not in tally.most or (value, -seed) > (tally.most[check][0], -tally.most[check][2]):
            tally.most[check] = value, limit, seed
        # of equals the first seed: workers return their cases in any order
        if check not in verdict.missed and (
            check not in tally.worst or (share, -seed) > (tally.worst[check][0], -tally.worst[check][3])
        ):
            tally.worst[check] = share, value, limit, seed


def simple(family: Family, values: Values, check: str, seconds: float) -> Values:
    """Return a case that fails the same check with as many of its values as plain as may be."""
    ends, kept = time.monotonic() + seconds, dict(values)
    tries: list[tuple[str, Value]] = [(name, value) for name, value in family.plain.items() if name in kept]
    if isinstance(kept.get("frames"), int):
        tries.append(("frames", max(int(kept["frames"]) // 2, 2)))
    for name, value in tries:
        if time.monotonic() > ends:
            break
        if kept[name] != value and check in judged(family, {**kept, name: value}).failed:
            kept[name] = value
    return kept
