"""Try [S2]'s six interactions on both platforms, draw the figures and write the page 'paper against ours'.

`python -m tests.benchmarks.figures_s2 --out presets` writes pictures/s2_*.png and devices/motors_figures.md there; some
twenty minutes, most of it contact in 300 wobbling touches and tables. Noise, wobble and rule are those of `core.design.interactions`.
With `--law` only the page's section about neo-Hookean tissue is computed, and renewed in the page. Readings of touches and
parts of tables are kept in a folder, so a run that was ended goes on where it was.
"""

# ruff: noqa: E501  the lines of the page

from __future__ import annotations

import argparse
import csv
import functools
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.cache import cache_key
from core.design.collect import collect, reversed_spread
from core.design.interactions import EXPECTED, KNEE, NAMES, NOISE, WOBBLE, Wobble
from core.design.synergies import RULES, knee
from core.design.trial import Verdict, felt, judge, sense
from core.devices.spec import DeviceSpec
from core.files import write_bytes, write_npz
from core.matching.lookup import commands_of, readings_for
from core.matching.readings import FULL_SCALE, Counts, readings_of
from core.matching.table import SkinTable, build, press_of
from core.parameters.error_bands import LINEAR, NEO_HOOKEAN
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin
from core.skin.observation import skin_key
from core.skin.shape import FingertipShape
from core.sweep.motors import verdict_of
from core.sweep.readings import PARTS, read_readings
from core.version import ENGINE, made_by

from . import one_blas_thread
from .bars import Bars
from .bench_motors import FOLDER
from .two_tissues import HEADING, renew

T = TypeVar("T")
Array = NDArray[np.float64]

FIRST, SEEDS = 20, 20  # seeds 0-2 showed the rule that relates to the touch; none of these was looked at before
SHARES = (0.0, 0.5, 2.0)  # of the hand's wobble, as controls
CONTROL_SEEDS = 3
SIZES = (0.9, 1.1)  # of the platforms' dimensions, as controls
ROWS = {"cable_platform": 9261, "hexapod": 4033}  # of those, and of the tables on both tissues
TISSUES = {LINEAR: "linear", NEO_HOOKEAN: "neo-Hookean"}
LAW_SEEDS = 5  # that are judged on both tissues: a touch on neo-Hookean tissue takes longer, and its table far longer
LIMITS = (0.05, 0.08, 0.12, 0.15, 0.2)  # of the rule, beside its own
DEVICES = ("cable_platform", "hexapod")
EARLIER = "With engine 6, whose look-up averaged the eight nearest rows, the same verdicts were as expected by either rule, but by the paper's own 22 in place of 19 on neo-Hookean tissue. One motor of the cable platform lost 34.7 % of the touch on average, as now, one of the hexapod 40.4 instead of 42.6 %; all six of its motors left errors of 112 to 197 counts instead of 88 to 159."
PAPER = {  # mean over the interactions of the error above that of all motors, for k = 1, 2, ... [%]. Source: [S2] V
    "cable_platform": (55.3, 13.4, 0.0),
    "hexapod": (42.5, 15.1, 7.4, 5.1, 2.2, 0.0),
}
TITLES = {"cable_platform": "3 motors", "hexapod": "6 motors"}


@dataclass(frozen=True)
class Played:
    """The look-up's estimate against the simulation, over the six interactions [% of full scale]."""

    mean: float
    worst: float
    moved: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Do all of it."""
    parser = argparse.ArgumentParser(prog="figures_s2", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("presets"), metavar="DIR")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--law", action="store_true", help="only the section about neo-Hookean tissue")
    parser.add_argument("--law-seeds", type=int, default=LAW_SEEDS, help="seeds that are judged on both tissues")
    parser.add_argument("--sweep", type=Path, metavar="CSV", help="take verdicts from the table of s2_trial.toml")
    options = parser.parse_args(arguments)
    started = time.perf_counter()
    seeds, both = range(FIRST, FIRST + options.seeds), range(FIRST, FIRST + options.law_seeds)
    path = options.out / "devices" / "motors_figures.md"
    with one_blas_thread():
        by_law = law_section(*on_both(both), both)
        _say(started, "both tissues")
        if options.law:
            renew(path, "\n".join(line.rstrip() for line in by_law) + "\n")
            return 0
        specs = [Library().device(key) for key in DEVICES]
        tables = {spec.key: _table(spec) for spec in specs}
        _say(started, "tables")
        sizes = {
            f"{spec.key}, {100 * size:g} %": build(_sized(spec, size), _skin(), readings_of(_skin()), ROWS[spec.key])
            for spec in specs
            for size in SIZES
        }
        _say(started, "tables of other sizes")
        swept = {} if options.sweep is None else swept_verdicts(options.sweep)
        found = swept[1.0] if swept else _verdicts(tables, seeds)
        _say(started, "trial")
        few = seeds[:CONTROL_SEEDS]
        controls = {}
        for share in SHARES:
            own = few if share else few[:1]
            controls[share] = of_seeds(swept[share], own) if swept else _verdicts(tables, own, share)
        off_size = _verdicts(sizes, few)
        _say(started, "controls")
        played = {spec.key: _played(spec, tables[spec.key]) for spec in specs}
        spreads = {spec.key: reversed_spread(spec, _skin()) for spec in specs}
    for key in DEVICES:
        _picture(key, found[key], options.out / "pictures" / f"s2_{key}.png")
    page = _page(found, controls, off_size, played, spreads, tables, seeds, by_law)
    text = "\n".join(line.rstrip() for line in page)
    write_bytes(path, (text + "\n").encode())
    _say(started, "done")
    return 0


@functools.cache
def _skin(tissue: str = LINEAR) -> SkinModel:
    return fingertip_skin(level="draft") if tissue == LINEAR else _skin().with_law()


def _table(spec: DeviceSpec) -> SkinTable:
    if spec.key == "cable_platform":
        from .bench_motors import table

        made: SkinTable = table()
        return made
    return _drain(collect(spec, FingertipShape(), FOLDER / "parts", level="draft"))


def _sized(spec: DeviceSpec, size: float) -> DeviceSpec:
    """Return a platform whose base and joints are larger or smaller than its preset's."""
    more = {name: size * float(spec.parameters[name]) for name in ("base_radius", "platform_radius")}
    return replace(spec, parameters={**spec.parameters, **more})


@functools.cache
def _sensed(name: str, seed: int, share: float, tissue: str = LINEAR) -> Counts:
    """Return what is read in an interaction, the hand's wobble being a share of what it is."""
    parts = {part: share * getattr(WOBBLE, part) for part in PARTS}
    touch = felt(_skin(tissue), name, seed, Wobble(**parts, bandwidth=WOBBLE.bandwidth))
    return sense(touch, seed=100 * seed + NAMES.index(name))


def _kept(name: str, seed: int, tissue: str) -> Counts:
    """Return what is read in an interaction on a tissue; it is kept in a folder, by the engine that made it."""
    skin = _skin(tissue)
    what = made_by(), skin_key(skin), repr(skin.material), name, str(seed), repr(1.0)
    path = FOLDER / "readings" / f"{cache_key('dermis-s2-readings 1', *what)[:32]}.npz"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_npz(path, {"counts": _sensed(name, seed, 1.0, tissue)})
    return read_readings(path)


def verdicts_of(seeds: Sequence[int]) -> dict[str, list[Verdict]]:
    """Return the verdicts of both platforms by their whole tables, the six interactions for each seed."""
    return _verdicts({key: _table(Library().device(key)) for key in DEVICES}, seeds)


def _verdicts(tables: Mapping[str, SkinTable], seeds: Sequence[int], share: float = 1.0) -> dict[str, list[Verdict]]:
    heard = {key: table.heard_with(NOISE) for key, table in tables.items()}
    return {
        key: [judge(table, _sensed(name, seed, share), name, seed) for seed in seeds for name in NAMES]
        for key, table in heard.items()
    }


def swept_verdicts(path: Path) -> dict[float, dict[str, list[Verdict]]]:
    """Return the verdicts of a sweep's table by wobble and device, in its order of seeds and touches."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("# ")]
    found: dict[float, dict[str, list[Verdict]]] = {}
    for row in csv.DictReader(lines):
        columns = {key: value for key, value in row.items() if value != ""}
        own = found.setdefault(float(columns["wobble"]), {key: [] for key in DEVICES})
        own[columns["device"]].append(verdict_of(columns))
    return found


def of_seeds(found: Mapping[str, list[Verdict]], seeds: Sequence[int]) -> dict[str, list[Verdict]]:
    """Return the verdicts of some seeds."""
    return {key: [v for v in verdicts if v.seed in seeds] for key, verdicts in found.items()}


def _played(spec: DeviceSpec, table: SkinTable) -> Played:
    """Press every command of the six interactions, and compare with what the table estimates for it."""
    heard, press, sensor = table.heard_with(NOISE), press_of(_skin(), spec), readings_of(_skin())
    off, moved = [], []
    for name in NAMES:
        sensed = _sensed(name, FIRST, 1.0)
        commands = commands_of(heard, sensed)
        loud = heard.from_rest(sensed) > heard.noise_floor
        pressed = press.press(commands[loud])
        exact = np.clip(sensor.counts(pressed.force), 0, FULL_SCALE)
        off.append(np.abs(readings_for(heard, commands[loud]) - exact))
        moved.append(np.abs(exact - sensed[loud]))
    each = np.concatenate(off)
    return Played(*(100.0 / FULL_SCALE * float(v) for v in (each.mean(), each.max(), np.concatenate(moved).mean())))


def on_both(seeds: Sequence[int]) -> tuple[dict[str, dict[str, SkinTable]], dict[str, dict[str, list[Verdict]]]]:
    """Return tables and verdicts by tissue and platform; touch and platform meet the same tissue."""
    tables: dict[str, dict[str, SkinTable]] = {}
    for tissue in TISSUES:
        tables[tissue] = {}
        for key in DEVICES:
            steps = collect(Library().device(key), FingertipShape(), FOLDER / "parts", rows=ROWS[key], tissue=tissue)
            tables[tissue][key] = _drain(steps)
    found = {}
    for tissue, made in tables.items():
        heard = {key: table.heard_with(NOISE) for key, table in made.items()}
        found[tissue] = {
            key: [judge(table, _kept(name, seed, tissue), name, seed) for seed in seeds for name in NAMES]
            for key, table in heard.items()
        }
    return tables, found


def law_section(
    tables: Mapping[str, Mapping[str, SkinTable]], found: Mapping[str, Mapping[str, list[Verdict]]], seeds: range
) -> list[str]:
    """Return the section about neo-Hookean tissue."""
    right = {
        tissue: [sum(v.found[i] == v.expected for own in both.values() for v in own) for i in range(len(RULES))]
        for tissue, both in found.items()
    }
    count = sum(len(own) for own in found[LINEAR].values())
    lines = [
        HEADING,
        "",
        f"**{right[NEO_HOOKEAN][0]} of {count} verdicts are as the paper expects** by the rule that relates to the touch, {right[NEO_HOOKEAN][1]} by the paper's own rule; on linear tissue, with the same seeds and tables of the same size, {right[LINEAR][0]} and {right[LINEAR][1]}.",
        "",
        f"Made, without the rest of the page, by `python -m tests.benchmarks.figures_s2 --law --out presets`. Simulated, as all above, with engine {ENGINE}. A finger is of linear tissue by default, and can follow the neo-Hookean law instead (*Tissue*). Here touches, tables and the sensor's readings are by the law, and beside it the same on linear tissue. Rule, noise, wobble and expected numbers are those that were fixed beforehand; nothing was changed for this tissue.",
        "",
        f"It is a part of the trial above: seeds {seeds[0]}-{seeds[-1]} of {FIRST}-{FIRST + SEEDS - 1}, and for `cable_platform` {ROWS['cable_platform']:,} configurations (the table of the controls by size) instead of the paper's 166,375, which would take hours by the law. The table of `hexapod` is whole.",
        "",
    ]
    for key in DEVICES:
        meta = tables[NEO_HOOKEAN][key].meta
        width = 2 * max(len(seeds), 12) + 2
        lines += [
            f"### {TITLES[key]}: `{key}`",
            "",
            f"Table by the law: {meta['asked']} configurations, {len(tables[NEO_HOOKEAN][key].commands)} rows ({meta['unreached_rows']} are out of the motors' reach, {meta['rest_rows']} touch nothing and are one rest row, {meta['unbalanced_rows']} found no balance and are left out, {meta['saturated_rows']} have a channel at the end of its scale; the law did not converge in {meta['law_unsettled_rows']}).",
            "",
            f"Motors found, seed {seeds[0]} to {seeds[-1]}; every number that differs from the expected one is an exception:",
            "",
            "```",
            f"{'':20}{'of the touch':{2 * width}}the paper's rule",
            f"{'':10}{'expected':10}" + f"{'linear':{width}}{'neo-Hookean':{width}}" * 2,
        ]
        for name in NAMES:
            cells = [
                f"{' '.join(str(v.found[i]) for v in found[tissue][key] if v.name == name):{width}}"
                for i in range(len(RULES))
                for tissue in TISSUES
            ]
            lines.append(f"{name:10}{EXPECTED[name]:<10}{''.join(cells)}")
        n = len(found[LINEAR][key][0].percent[0])
        for i, title in enumerate(("Lost of the touch", "Error above that of all motors")):
            ends = ", and the error with all motors and the touch [counts]" if i == 0 else ""
            lines += [
                "```",
                "",
                f"{title}, mean over the seeds [%]{ends}:",
                "",
                "```",
                f"{'':23}"
                + "".join(f"    k = {k}" for k in range(1, n + 1))
                + ("      all    touch" if i == 0 else ""),
            ]
            for name in (*NAMES, "mean"):
                for tissue, word in TISSUES.items():
                    own = [v for v in found[tissue][key] if name in (v.name, "mean")]
                    cells = [f"{value:9.1f}" for value in np.array([v.percent[i] for v in own]).mean(axis=0)]
                    if i == 0 and name != "mean":
                        cells += [f"{np.mean([v.error for v in own]):9.1f}{np.mean([v.touch for v in own]):9.1f}"]
                    lines.append(f"{name if tissue == LINEAR else '':11}{word:12}" + "".join(cells))
        lines += ["```", ""]
    return lines


def _picture(key: str, verdicts: Sequence[Verdict], path: Path) -> None:
    bars = Bars(
        f"{TITLES[key]}: error of the touch in addition to that of all motors, simulated (line: least to greatest of the seeds)",
        100 * KNEE,
    )
    for name in NAMES:
        rows = np.array([v.percent[0] for v in verdicts if v.name == name])[:, :-1]
        bars.group(f"{name} ({EXPECTED[name]})", rows)
    bars.write(path)


def _page(
    found: Mapping[str, list[Verdict]],
    controls: Mapping[float, Mapping[str, list[Verdict]]],
    off_size: Mapping[str, list[Verdict]],
    played: Mapping[str, Played],
    spreads: Mapping[str, Mapping[str, float]],
    tables: Mapping[str, SkinTable],
    seeds: range,
    by_law: Sequence[str],
) -> list[str]:
    tilt, depth, shift = np.degrees(WOBBLE.tilt), 1e3 * WOBBLE.depth, 1e3 * WOBBLE.shift
    every = [v for verdicts in found.values() for v in verdicts]
    right = [sum(v.found[i] == v.expected for v in every) for i in range(len(RULES))]
    lines = [
        "# How many motors: paper against ours",
        "",
        f"**{right[0]} of {len(every)} verdicts are as the paper expects** by the rule that relates to the touch, {right[1]} by the paper's own rule. {EARLIER}",
        "",
        f"Regenerate with `python -m tests.benchmarks.figures_s2 --out presets` in the benchmarks' environment (some twenty minutes). Made with engine {ENGINE}. Source of the paper's figures: [S2], section V. Everything of ours is simulated: a linear skin of 1,560 tetrahedra, touched and pressed on points of its smooth surface, a virtual sensor, and a hand's wobble that was drawn, not recorded. [Neo-Hookean tissue](#on-neo-hookean-tissue) stands beside it in a section of its own.",
        "",
        f"Fixed and committed before any result was looked at, and not tuned since: noise {NOISE:g} counts in every channel; wobble {tilt:g} degrees of tilt, {depth:g} mm of depth, {shift:g} mm along the surface, {100 * WOBBLE.amplitude:g} % from repetition to repetition. The paper's rule: the fewest motors whose error is less than {100 * KNEE:g} % above that of all. It asks for motors that render the hand's wobble as soon as all motors together leave less than that, so a second rule stands before it: the fewest motors that lose less than {100 * KNEE:g} % of the touch, beyond the error of all. It was found on seeds 0-2; seeds {seeds[0]}-{seeds[-1]}, below, were judged after it was committed. The paper expects 1, 2, 2, 2, 2, 3 motors for flat, back-, tip-, left-, right-flat and complex. No pose of the interactions is in a table: tables are regular sweeps.",
        "",
    ]
    for key in DEVICES:
        verdicts, table = found[key], tables[key]
        asked = [sum(v.found[i] == v.expected for v in verdicts) for i in range(len(RULES))]
        lines += [
            f"## {TITLES[key]}: `{key}`",
            "",
            f"**{asked[0]} of {len(verdicts)} verdicts are as the paper expects**, {asked[1]} by the paper's rule. Table: {table.meta['asked']} configurations, {len(table.commands)} rows ({table.meta['unreached_rows']} are out of the motors' reach, {table.meta['rest_rows']} touch nothing and are one rest row, {table.meta['unbalanced_rows']} found no balance and are left out, {table.meta['saturated_rows']} have a channel at the end of its scale).",
            "",
            f"![Error of the touch in addition to that of all motors](../pictures/s2_{key}.png)",
            "",
            f"Motors found, seed {seeds[0]} to {seeds[-1]}; every number that differs from the expected one is an exception:",
            "",
            "```",
            f"{'':10}{'expected':10}{'of the touch':{2 * max(len(seeds), 6) + 4}}the paper's rule",
        ]
        for name in NAMES:
            own = [v for v in verdicts if v.name == name]
            runs = [" ".join(str(v.found[i]) for v in own) for i in range(len(RULES))]
            lines.append(f"{name:10}{EXPECTED[name]:<10}{runs[0]:{2 * max(len(seeds), 6) + 4}}{runs[1]}")
        lines += ["```", ""]
        n = len(verdicts[0].percent[0])
        for i, title in enumerate(("Lost of the touch", "Error above that of all motors")):
            lines += [
                f"{title}, mean over the seeds [%], {'and the error with all motors and the touch [counts]' if i == 0 else 'the paper beside it'}:",
                "",
                "```",
                f"{'':10}"
                + "".join(f"{'k = ' + str(k):>9}" for k in range(1, n + 1))
                + ("      all    touch" if i == 0 else ""),
            ]
            means = []
            for name in NAMES:
                own = [v for v in verdicts if v.name == name]
                means.append(np.array([v.percent[i] for v in own]).mean(axis=0))
                counts = (
                    f"{np.mean([v.error for v in own]):9.1f}{np.mean([v.touch for v in own]):9.1f}" if i == 0 else ""
                )
                lines.append(f"{name:10}" + "".join(f"{p:9.1f}" for p in means[-1]) + counts)
            lines.append(f"{'mean':10}" + "".join(f"{p:9.1f}" for p in np.mean(means, axis=0)))
            if i == 1:
                lines.append(f"{'paper':10}" + "".join(f"{p:9.1f}" for p in PAPER[key]))
            lines += ["```", ""]
        limits = [_same_answers(verdicts, limit) for limit in LIMITS]
        agree = [f"{100 * limit:g} %: {count}" for limit, count in zip(LIMITS, limits, strict=True)]
        lines += [f"As the paper expects, by another limit than {100 * KNEE:g} % of the touch: {', '.join(agree)}.", ""]
    lines += [
        "## Controls",
        "",
        f"The same rule and noise with another wobble, and with platforms whose base and joints are 10 % smaller or larger ({CONTROL_SEEDS} seeds, one without wobble, each number a seed; tables of the controls by size: {ROWS['cable_platform']:,} and {ROWS['hexapod']:,} configurations).",
        "",
        "```",
        f"{'':32}" + "".join(f"{name:10}" for name in NAMES) + "as expected",
    ]
    lines += [
        _row(f"wobble {100 * share:g} %, {key}", verdicts)
        for share, both in controls.items()
        for key, verdicts in both.items()
    ]
    lines += [_row(title, verdicts) for title, verdicts in off_size.items()]
    lines += [
        "```",
        "",
        "## The estimate, played back",
        "",
        f"Every command of the six interactions pressed in simulation, against the table's estimate: mean over channels and samples in contact, in percent of the 12-bit scale (paper: 1.3 %). Rows are pressed from rest, as the table's; beside it the spread of the reversed sweep, rows reached from one step deeper instead ({int(spreads[DEVICES[0]]['rows'])} and {int(spreads[DEVICES[1]]['rows'])} rows that touch; root mean square over channels).",
        "",
        "```",
        f"{'':18}{'estimate [%]':>14}{'worst [%]':>12}{'rendered, target [%]':>22}{'reversed rms [counts]':>23}{'worst [counts]':>16}",
    ]
    for key in DEVICES:
        p, s = played[key], spreads[key]
        lines.append(f"{key:18}{p.mean:14.2f}{p.worst:12.2f}{p.moved:22.2f}{s['rms']:23.1f}{s['worst']:16.1f}")
    lines += [
        "```",
        "",
        "The third column is the platform's error of the target itself: a small disc under a tilting slab's touch, one contact for another.",
        "",
        *by_law,
        "## What differs",
        "",
        "The paper records a BioTac held by a hand and collects its tables on the built devices; ours are virtual, of chosen dimensions (`cable_platform.json`, `hexapod.json`), with rigid legs where the paper's are compliant wires. The paper's percentages are the mean of percentages; so are ours. Its error counts and ours depend on the sensor's gain, which here is chosen: compare percentages, and those by the paper's rule with care, since they are relative to the error of all motors.",
        "",
        "Recordings of real sensors are judged in their own unit: the answer is the same in any unit, from any zero and with the channels in any order. Where all motors together leave more than 30 % of a touch no number is given. Following a sensor, tables from the built device and playback are described on the page of the [cable platform](cable_platform.md#from-a-recorded-sensor). No public recording has a platform's motors in it. On recordings of a BioTac that slides over materials (github.com/dexrob/BioTac_slide_20_50), with commands made of the measured force (5,000 rows, 7 electrodes), following is 4.80 degrees off in the median and an own look-up 4.82 (`bench follow_platform_error_deg`). In two trials of a BioTac that a tracked plane was pressed against by two persons (github.com/Alexis-Georganopoulos/Robotic-Finger, 4,030 and 4,925 samples of 19 electrodes without their mean), the look-up of one trial in the other tells the contact's normal to 5.95 and 5.12 degrees in the median, as an own look-up of eight neighbours does to .01 (`bench follow_angle_error_deg`); looked up are x and y of the normal, z is the rest of a unit vector (of all three it is 5.94 and 5.14). Playback on a built device was not measured: only on synthetic recordings, and on the virtual device and sensor.",
    ]
    return lines


def _row(title: str, verdicts: Sequence[Verdict]) -> str:
    cells = [" ".join(str(v.found[0]) for v in verdicts if v.name == name) for name in NAMES]
    right = sum(v.found[0] == v.expected for v in verdicts)
    return f"{title:32}" + "".join(f"{cell:10}" for cell in cells) + f"{right} of {len(verdicts)}"


def _same_answers(verdicts: Sequence[Verdict], limit: float) -> int:
    """Return how many verdicts are as expected by another limit of the rule."""
    return sum(knee(np.array(v.percent[0]), limit) == v.expected for v in verdicts)


def _drain(steps: Generator[Any, None, T]) -> T:
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            result: T = stop.value
            return result


def _say(started: float, what: str) -> None:
    print(f"{time.perf_counter() - started:6.0f} s  {what}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
