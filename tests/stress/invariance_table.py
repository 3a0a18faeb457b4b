"""Measure how much contact changes where it must not, and write the tables of presets/ACCURACY.md.

`python -m tests.stress.invariance_table --runs 60` measures 60 seeds, three of each solid, in a minute each; a run that
was stopped goes on where it was. Without `--runs` the tables are printed, and written, from the stored values.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from core.errors import DermisError
from core.files import read_json, read_text, write_bytes

from .case import Values
from .invariances import FAMILIES
from .placed import draw_without_friction
from .run import judged
from .solids import SHAPES
from .tolerances import INVARIANCE

STORED = Path(__file__).with_name("invariances.json")
PAGE = Path(__file__).resolve().parents[2] / "presets" / "ACCURACY.md"
START, END = "<!-- invariances -->\n", "<!-- end of invariances -->\n"
VERSION = 1
SEED = 900000  # the first: seeds draw the solids in turn, with another friction in each round
# Columns of the table of solids, and the invariances that each takes the worst of.
COLUMNS: dict[str, tuple[str, ...]] = {
    "told otherwise": ("untouched", "stranger", "broad_phase", "order", "names", "chunks", "caches", "processes"),
    "mesh": ("triangles", "welded", "litter", "seam"),
    "placed": ("mirrored", "turned", "scaled"),
    "1 nm to 1 um": ("cracked", "shifted"),
    "start": ("start",),
    "strides": ("strides",),
    "time": ("pace", "span"),
    "240 Hz": ("rate",),
    "60 Hz": ("rates",),
    "way": ("back", "slid"),
    "`press`": ("press",),
    "energy": ("work", "gradient"),
}
FAMILY = {family.name.partition("_")[2]: family for family in FAMILIES}
FIRST = ("force", "work", "gradient")  # channels that the table of solids compares


@dataclass(frozen=True)
class Measured:
    """A seed's touch, and what was measured: invariance -> channel -> change over the peak."""

    values: Values
    changes: Mapping[str, Mapping[str, float]]

    def touch(self, name: str) -> str:
        """Return the touch of an invariance in words."""
        v, friction = self.values, 0.0 if FAMILY[name].draw is draw_without_friction else self.values["friction"]
        return f"{v['shape']} on {v['contact']}, friction {friction:g}"


def measure(seed: int, known: Mapping[str, Mapping[str, float]]) -> Measured:
    """Return what each invariance measures of the touch of a seed, beside those that are known."""
    changes = dict(known)
    for name, family in FAMILY.items():
        if name not in changes:
            verdict = judged(family, family.values(seed))
            changes[name] = {check: value for check, (value, _) in verdict.measured.items()}
    return Measured(FAMILY["names"].values(seed), changes)


def read(path: Path) -> dict[int, Measured]:
    """Return what is stored, by seed.

    Raises:
        DermisError: the file is of another version.
    """
    stored = read_json(path)
    if stored.get("version") != VERSION:
        raise DermisError(
            "measured invariances of an unknown version",
            where=str(path),
            value=stored.get("version"),
            limit=str(VERSION),
            remedy="measure them anew, with --anew",
        )
    return {int(seed): Measured(found["values"], found["changes"]) for seed, found in stored["seeds"].items()}


def write(path: Path, measured: Mapping[int, Measured]) -> None:
    """Store what was measured."""
    rows = []
    for seed in sorted(measured):
        found = {"values": measured[seed].values, "changes": measured[seed].changes}
        rows.append(f'"{seed}": {json.dumps(found)}')
    text = f'{{"version": {VERSION}, "seeds": {{\n' + ",\n".join(rows) + "\n}}\n"
    write_bytes(path, text.encode())


def tables(measured: Mapping[int, Measured]) -> str:
    """Return two tables in Markdown: the worst of each invariance, and by solid the worst change of force."""
    return "\n".join([*_by_invariance(measured), "", *_by_solid(measured), ""])


def _by_invariance(measured: Mapping[int, Measured]) -> Iterable[str]:
    yield "| what must not matter | limit | beyond it | force, worst | any channel, worst |"
    yield "|---|---|---|---|---|"
    for name, family in FAMILY.items():
        tried = {seed: each.changes[name] for seed, each in measured.items() if name in each.changes}
        found = [(change, channel, seed) for seed, each in tried.items() for channel, change in each.items()]
        beyond = {seed for change, _, seed in found if not change <= INVARIANCE[name]}
        force = max((row for row in found if row[1] in FIRST), default=None)
        cells = [f"`{name}`: {family.what}", f"{100.0 * INVARIANCE[name]:g} %", f"{len(beyond)} of {len(tried)}"]
        for worst, more in ((force, ""), (max(found, default=None), "{}: ")):
            if worst is None or not worst[0]:
                cells.append("0" if worst else "")
            else:
                where = measured[worst[2]].touch(name)
                cells.append(f"{more.format(worst[1])}{percent(worst[0])} ({where})")
        yield "| " + " | ".join(cells) + " |"


def percent(change: float) -> str:
    """Return a share in percent, to two digits."""
    if change < 1e-3:
        return "< 0.1 %" if change else "0"
    return f"{100.0 * change:.2g} %" if change < 0.1 else f"{100.0 * change:.0f} %"


def _by_solid(measured: Mapping[int, Measured]) -> Iterable[str]:
    yield f"| solid | {' | '.join(COLUMNS)} |"
    yield "|---" * (len(COLUMNS) + 1) + "|"
    for shape in SHAPES:
        these = [each.changes for each in measured.values() if each.values["shape"] == shape]
        if these:
            worst = [
                max(
                    (each.get(name, {}).get(channel, 0.0) for each in these for name in names for channel in FIRST),
                    default=0.0,
                )
                for names in COLUMNS.values()
            ]
            yield f"| {shape.replace('_', ' ')} | {' | '.join(map(percent, worst))} |"


def page_with(text: str, printed: str) -> str:
    """Return a page with its tables replaced."""
    before, _, rest = text.partition(START)
    return before + START + printed + END + rest.partition(END)[2]


def main(arguments: list[str] | None = None) -> int:
    """Measure what is asked for, print the tables, and write them into the page."""
    parser = argparse.ArgumentParser(prog="tests.stress.invariance_table", description=__doc__)
    parser.add_argument("--runs", type=int, default=0, help="seeds from the first on; what is stored is kept")
    parser.add_argument("--seed", type=int, default=SEED, help=f"the first ({SEED})")
    parser.add_argument("--anew", action="store_true", help="forget the stored values, as after a change of contact")
    options = parser.parse_args(arguments)
    measured = {} if options.anew or not STORED.exists() else read(STORED)
    for seed in range(options.seed, options.seed + options.runs):
        known = measured[seed].changes if seed in measured else {}
        if known.keys() != FAMILY.keys():
            measured[seed] = measure(seed, known)
            write(STORED, measured)
            print(f"seed {seed}: {measured[seed].touch('names')}", file=sys.stderr, flush=True)
    if not measured:
        parser.error("nothing is stored: give --runs")
    printed = tables(measured)
    print(printed)
    write_bytes(PAGE, page_with(read_text(PAGE), printed).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
