"""How good any pose of a device could be: `python -m tests.benchmarks.figures_floor [--page FILE]`.

Prints tables in Markdown, and on request writes them as a page. All is simulated; a quiet machine needs some five
minutes.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from core.devices.disc_device import DiscDevice
from core.matching.description import describe
from core.matching.felt_errors import MEASURES, FeltErrors
from core.matching.floor import Floor, floor_of
from core.matching.thimble import Follower, matcher
from core.matching.thimble_use import METHODS, ThimbleUse, prepare
from core.matching.trajectory import trajectory
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin
from core.steps import drain
from core.version import ENGINE
from tests import touches

FRICTION = 0.6  # of every touch, and of both devices: else they would be compared by what they are made of
RIVALS = tuple(m for m in METHODS if m in ("stress", "force", "geometry"))
TOUCHES = (
    touches.flat_press,
    touches.edge_press,
    touches.cup,
    touches.foam,
    touches.ball_roll,
    touches.slide,
    touches.shaken_block,
)
WITHIN = 3.0  # points above the best found that a search of a frame may leave
HEAD = """# Floors: how good any pose of a device could be

Every figure here is **simulated**. Made by

    python -m tests.benchmarks.figures_floor --page presets/devices/floor_figures.md

"""
NOTES = """
## Glossary
* Errors are relative RMS over a whole touch, in per cent, as *whole stress / 154 cells / electrodes*. **Whole stress**
  is of every element and the strictest. **154 cells** is the mean stress in 154 cells of like extent, the number of
  elements that [S0] describes stress with. **Electrodes** are nineteen virtual ones that read how thick the pulp is, as
  the paper's sensor did. Only the last two are of the paper's sort; the page of the thimble
  ([thimble_3rrs_figures.md](thimble_3rrs_figures.md)) has whole stress in its first table and electrodes in its second.
* **As it is**: the method's own search, frame by frame, at any speed of the joints.
* **Best found**: at each frame the best of many poses, reached on several ways with the friction of each. It is the
  result of a search, no proof that there is nothing better, and poses of neighbouring frames may be of different ways.
  It is found by whole stress; in another measure it need not be the best. Friction makes it jump with the number of
  frames: `bench edge_rendered_error` has the edge in 120.
* **With lateral axes**: the same thimble on a stage that moves it 5 mm along both axes of the pad and turns it by 30
  degrees, to either side. Nobody built it; the six legs can do as much by themselves, within their strokes.
* Before engine 6 the thimble left 57.3 % of the edge's whole stress (best found 56.7 %) and 64.7 % of the cup's, six
  legs 31.1 % of the edge's and 30.2 % of the ball's; the other touches were alike within 1 point.
* With engine 6 six legs left 19.9 % of the cup's whole stress as they are, now 17.3 %; with lateral axes the thimble
  left 40.8 %, now 39.5 %. By stress no other touch differs by more than 0.2 points, as it is; by force the thimble left
  127.3 % of the edge's, now 132.7 %. A frame of the thimble took 1.5 to 2.7 ms in the median, on another day, now 0.3
  to 0.5.
* **Several ways**: one way through the touch that was chosen among several by its total error. It needs the whole
  touch beforehand. Times are those of a clock on the wall, beside whatever else ran: compare both sides of an arrow.
* Both devices have friction 0.6 with the skin, as the touches have. Discs are of 8 mm (thimble) and 12 mm (six legs),
  and part of the six legs' advantage is the larger disc.
"""


def three(errors: Any) -> str:
    """Return errors in the three measures."""
    return " / ".join(f"{100 * error:.1f}" for error in errors)


def use_of(key: str, skin: SkinModel) -> ThimbleUse:
    """Return a device matched by stress, with the friction of the touches."""
    use = prepare(Library().device(key), skin, {"platform_method": "stress"})
    return ThimbleUse(use.device, skin, FRICTION, use.hover, "stress", None, None, ())


def rivals(device: DiscDevice, skin: SkinModel, forces: Any, judge: FeltErrors) -> dict[str, Any]:
    """Return errors of the search for stress and of the baselines."""
    out = {}
    for method in RIVALS:
        found = Follower(matcher(device, skin, method, friction=FRICTION), skin, method).follow(forces)
        out[method] = judge.of(forces, found.force)
    return out


def ways(device: DiscDevice, skin: SkinModel, forces: Any, change: float | None) -> tuple[float, float, float, float]:
    """Return whole-stress errors frame by frame and on the best of several ways, and ms a frame of both."""
    matrix, whole = describe(device, skin, FRICTION).observation_matrix, skin.stress_components()
    matching = matcher(device, skin, friction=FRICTION, observation_matrix=matrix, change=change)
    flat = forces.reshape(len(forces), -1)
    out: list[float] = []
    for several in (False, True):
        matching.reset()
        start = time.perf_counter()
        if several:
            frames = drain(trajectory(matching, flat @ matrix.T)).frames
        else:
            frames = [matching.step(target) for target in flat @ matrix.T]
        taken = 1e3 * (time.perf_counter() - start) / len(forces)
        made = np.array([matching.contact.nodal(f.solution).ravel() for f in frames])
        out += [float(np.linalg.norm((made - flat) @ whole.T) / np.linalg.norm(flat @ whole.T)), taken]
    return out[0], out[2], out[1], out[3]


def report(skin: SkinModel, count: int) -> str:
    """Return the tables in Markdown."""
    judge = FeltErrors(skin)
    thimble, legs = use_of("thimble_3rrs", skin), use_of("hexapod", skin)
    rows: dict[str, list[list[str]]] = {"floor": [], "legs": [], "rivals": [], "ways": []}
    above: dict[str, float] = {}
    for make in TOUCHES:
        touch = make(count)
        forces = touch.forces(skin, points=True)
        one: Floor = drain(floor_of(thimble, forces))
        six: Floor = drain(floor_of(legs, forces))
        above[touch.name] = 100 * (one.rendered[0] - one.best[0])
        rows["floor"].append([three(one.rendered), three(one.best), three(one.lateral), str(one.beyond)])
        rows["legs"].append([three(six.rendered), three(six.best), str(six.beyond)])
        both = [rivals(use.device, skin, forces, judge) for use in (thimble, legs)]
        rows["rivals"].append([three(found[method]) for found in both for method in RIVALS])
        speeds = [(use, None if free else use.device.servo_speed / 100.0) for use in (thimble, legs) for free in (1, 0)]
        told = [ways(use.device, skin, forces, change) for use, change in speeds]
        rows["ways"].append(
            [f"{100 * a:.1f} → {100 * b:.1f}" for a, b, _, _ in told] + [f"{t[2]:.1f} → {t[3]:.1f}" for t in told[::2]]
        )
    names = [make(2).name for make in TOUCHES]
    missed = [f"{name} ({points:.1f})" for name, points in above.items() if points > WITHIN]
    said = f"missed on {', '.join(missed)}" if missed else "kept on every touch"
    lines = [
        f"Engine {ENGINE}, skin 'draft', {len(skin.mesh.tetrahedra)} tetrahedra, friction {FRICTION:g}, "
        f"{count} frames a touch.",
        "",
        f"**Within {WITHIN:g} points of the best pose found** (thimble, whole stress): {said}.",
        "",
        *table("Thimble", names, ("as it is", "best found", "with lateral axes", "frames above 100 %"), rows["floor"]),
        *table("Six legs", names, ("as it is", "best found", "frames above 100 %"), rows["legs"]),
        *table("Methods", names, [f"{d}, {m}" for d in ("thimble", "six legs") for m in RIVALS], rows["rivals"]),
        *table(
            "Frame by frame → several ways (whole stress)",
            names,
            (
                *("thimble", "thimble, servos' speed", "six legs", "six legs, legs' speed"),
                *("thimble, ms a frame", "six legs, ms a frame"),
            ),
            rows["ways"],
        ),
        f"Errors are in per cent, as {' / '.join(MEASURES)}. With the joints' speed a frame takes 10 ms.",
    ]
    return "\n".join(lines) + "\n"


def table(title: str, names: list[str], columns: Any, rows: list[list[str]]) -> list[str]:
    """Return one table with a row a touch."""
    head = [f"## {title}", "", "| touch | " + " | ".join(columns) + " |", "|" + "---|" * (1 + len(columns))]
    return [*head, *(f"| {n} | " + " | ".join(row) + " |" for n, row in zip(names, rows, strict=True)), ""]


def main() -> None:
    """Compute, print, and write what was asked for."""
    parser = argparse.ArgumentParser(prog="figures_floor", description=__doc__)
    parser.add_argument("--frames", type=int, default=60, help="of each touch")
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="write the tables as a page")
    options = parser.parse_args()
    text = report(fingertip_skin(level="draft"), options.frames)
    print(text)
    if options.page:
        options.page.write_text(HEAD + text + NOTES)


if __name__ == "__main__":
    main()
