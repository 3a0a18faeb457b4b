"""What a finger could tell apart through the thimble: `python -m tests.benchmarks.figures_told_apart [--page FILE]`.

[S0] 7.2 asked people whether a rod touches the back or the front of their pad, and whether it presses or slides. Here an
ideal observer is asked the same of rendered touches, as it was asked first and as a person's skin would read them. All
is simulated.
"""

# ruff: noqa: E501  the lines of the page

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.comparison.afferents import FRAME, JND, REFERENCE_FORCE, Afferents
from core.comparison.ideal_observer import told
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.devices.thimble import mechanism
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin
from core.skin.sensor import electrode_sensor
from core.skin.stimulus import Stimulus
from core.version import ENGINE
from tests import touches
from tests.thimbles import match_sequence

Array = NDArray[np.float64]

FRICTION = 0.6
REPETITIONS = 8  # Source: [S0] 7.2, 'with 8 slightly different repetitions each'
SECONDS, STEPS = 3.0, 8  # of a touch, Source: [S0] 7.2; from frame to frame
METHODS = ("stress", "electrodes", "force", "geometry")
TITLES = {
    "target": "the real touches",
    "stress": "stress",
    "electrodes": "stress, as 19 electrodes feel it",
    "force": "force only",
    "geometry": "geometry only",
}
PEOPLE = {  # right answers by method [%]. Source: [S0] table 1
    "contact location": {"stress": 82, "force": 51, "geometry": 78},
    "press or slide": {"stress": 73, "force": 53, "geometry": 53},
}
ALONG, ACROSS = "press or slide, along the rod", "press or slide, across the rod"
EARLIER = "98, 51, 100 % of contact locations and in 48, 47, 46 % of press or slide"
HEAD = """# Thimble 3-RRS: discriminability

Everything of ours is **simulated**: a skin, a device, and an ideal observer who wastes nothing. Made by

    python -m tests.benchmarks.figures_told_apart --page presets/devices/thimble_3rrs_told_apart.md

[S0] 7.2 asked people whether a thin rod touches the back or the front of the pad, and whether it presses or slides. Right answers with stress,
force and geometry: 82, 51, 78 % and 73, 53, 53 %. Of the sliding rod the paper shows a drawing: here it slides along its own axis, which
changes nothing of its geometry, and, as this page had it before, across it, which moves the contact on the pad too.

"""
NOTES = """
## How it is read
* *At one instant*: the stress of every element, at the moment at which the two touches differ most, with one noise along any direction: that
  which makes a flat press of 1 N and one of 7 % more d' = 1. This is the observer that this page had first.
* *As skin reads*: {slow:.0f} SA I and {fast:.0f} FA I afferents on the pad (70 and 141 a cm^2), what strains them 0.3 and 1.6 mm deep, in all frames of
  {frame:g} s of the touch; as noisy, each, as makes the same two presses d' = 1. `core/comparison/afferents.py` has constants and sources; they were
  committed before any of these touches was judged, and not changed since.
* *As real*: d' along the difference of the real touches alone: that of one who knows pressing and sliding from life, and has no other clue.
  *Right* is the share of correct answers in a choice of two, 50 % is guessing. *Any difference* counts whatever tells the two apart, whatever it feels like.
* The repetitions differ by up to 0.05 mm in depth and 0.3 mm in place, and their spread stands against the observer as noise does.
* *Stress off* is how far the second touch's rendered stress is from the real one's, all of it, while the rod moves.
* *Roll* is the disc's mean absolute roll while the rod moves; *shear* the root of the mean square of the rendered force across the finger then.
"""


def tests() -> dict[str, tuple[list[touches.Touch], list[touches.Touch]]]:
    """Return the two touches of each test, every one repeated a little differently."""
    rng = np.random.default_rng(20)
    depths, places = 0.8 + rng.uniform(-0.05, 0.05, REPETITIONS), rng.uniform(-0.3, 0.3, REPETITIONS)

    def all_of(y: float, slides: str = "") -> list[touches.Touch]:
        count = int(round(SECONDS / FRAME)) * STEPS + 1
        return [touches.rod_at(y + p, count, d, slides) for d, p in zip(depths, places, strict=True)]

    pressed = all_of(0.0)
    return {
        "contact location": (all_of(-4.0), all_of(4.0)),
        ALONG: (pressed, all_of(0.0, "along")),
        ACROSS: (pressed, all_of(0.0, "across")),
    }


def noise_of_stress(skin: SkinModel, whole: Array) -> float:
    """Return the first observer's standard deviation along any direction of stress, from the published JND."""
    path = PathSolver(Nodes.of(skin.positions, skin.normals, None, skin.compliance), tolerance=1e-7)
    depths = np.linspace(0.0, 1.5e-3, 60)
    zero = 0 * depths
    still = touches.Touch("press", touches.flat(), np.stack([zero, zero, depths], axis=1), zero, zero)
    forces = np.array([path.step(still.bodies(i)).solution.force for i in range(len(depths))])
    total, stress = forces[:, :, 2].sum(axis=1), forces.reshape(len(depths), -1) @ whole.T
    less, more = (
        np.array([np.interp(force, total, column) for column in stress.T])
        for force in (REFERENCE_FORCE, REFERENCE_FORCE * (1 + JND))
    )
    return float(np.linalg.norm(more - less))


def at_one_instant(felt: Sequence[Array], sigma: float) -> float:
    """Return the first observer's d' of stress, each (repetitions, steps, components)."""
    apart = felt[0].mean(axis=0) - felt[1].mean(axis=0)
    at = int(np.linalg.norm(apart, axis=1).argmax())
    size = float(np.linalg.norm(apart[at]))
    along = apart[at] / max(size, 1e-300)
    spread = np.mean([np.var(f[:, at] @ along, ddof=1) for f in felt])
    return size / float(np.sqrt(sigma**2 + spread))


def judged(skin: SkinModel) -> dict[str, Any]:
    """Judge the real touches and what each method renders of them."""
    device, whole, afferents = mechanism(Library().device("thimble_3rrs")), skin.stress_components(), Afferents.of(skin)
    sigma, electrodes = noise_of_stress(skin, whole), electrode_sensor(skin).matrix
    out: dict[str, Any] = {
        "tests": list(tests()),
        "slow": afferents.slow_count.sum(),
        "fast": afferents.fast_count.sum(),
    }
    known: dict[int, Array] = {}  # the pressed rod is in two tests
    for name, both in tests().items():
        forces = []
        for touch in (t for one in both for t in one):
            if id(touch) not in known:
                known[id(touch)] = touch.forces(skin, points=True)
            forces.append(known[id(touch)])
        steps = len(forces[0])
        moving = slice(int(0.3 * steps), int(0.8 * steps))
        row: dict[str, Any] = {}
        real: tuple[Array, Array] | None = None
        for method in ("target", *METHODS):
            felt, rolls = forces, []
            if method != "target":
                how = {"observation_matrix": electrodes} if method == "electrodes" else {}
                name_ = "stress" if method == "electrodes" else method
                found = [match_sequence(device, skin, f, name_, friction=FRICTION, **how) for f in forces]
                felt = [f.force.astype(np.float64) for f in found]
                rolls = [np.degrees(np.abs(f.x[moving, 1]).mean()) for f in found]
            read = np.array([_read(afferents, f) for f in felt])
            halves = read[:REPETITIONS], read[REPETITIONS:]
            real = real or halves
            stress = np.array([f.reshape(steps, -1) @ whole.T for f in felt])
            answer = told(*halves, afferents.noise, real)
            if method == "target":
                wanted = stress
            missed = np.linalg.norm((stress - wanted)[REPETITIONS:, moving]) / np.linalg.norm(
                wanted[REPETITIONS:, moving]
            )
            across = [np.sqrt((f[moving].sum(axis=1)[:, 0] ** 2).mean()) for f in felt]
            row[method] = {
                "at one instant": at_one_instant((stress[:REPETITIONS], stress[REPETITIONS:]), sigma),
                "apart": answer.apart,
                "as real": answer.as_real,
                "right": 100 * answer.right,
                "off": 100 * float(missed),
                "roll": [float(np.mean(rolls[i : i + REPETITIONS])) for i in (0, REPETITIONS)] if rolls else None,
                "shear": [float(np.mean(across[i : i + REPETITIONS])) for i in (0, REPETITIONS)],
            }
        out[name] = row
    return out


def _read(afferents: Afferents, forces: Array) -> Array:
    """Return what is read of a touch of many steps, at the ends and middles of its frames."""
    strain = afferents.strain([Stimulus(afferents.skin, force) for force in forces])
    return afferents.read(strain[:: STEPS // 2])


def page(found: dict[str, Any]) -> str:
    """Return the tables in Markdown."""
    lines = [
        f"Simulated with engine {ENGINE}; skin '{found['level']}', friction {FRICTION:g}, {REPETITIONS} repetitions of {SECONDS:g} s."
    ]
    for name in ("contact location", ALONG, ACROSS):
        people = {} if name == ACROSS else PEOPLE[name.partition(",")[0]]
        lines += ["", f"## {name[0].upper()}{name[1:]}", ""]
        lines += ["| | people [S0], right | at one instant, d' | as skin reads: any difference, d' | as real, d' | right | stress off | roll | shear |"]  # fmt: skip
        lines += ["|---|---|---|---|---|---|---|---|---|"]
        for method in ("target", *METHODS):
            share = f"{people[method]} %" if method in people else "-"
            v = found[name][method]
            roll = "-" if v["roll"] is None else "{:.0f}, {:.0f} deg".format(*v["roll"])
            shear = "{:.2f}, {:.2f} N".format(*v["shear"])
            lines.append(
                f"| {TITLES[method]} | {share} | {v['at one instant']:.1f} | {v['apart']:.1f} | "
                f"{v['as real']:.1f} | {v['right']:.0f} % | {v['off']:.0f} % | {roll} | {shear} |"
            )
    return "\n".join(lines) + "\n"


def in_words(found: dict[str, Any]) -> str:
    """Return what the tables say, before them."""
    where, along = found["contact location"], found[ALONG]
    right = {
        name: [f"{found[name][m]['right']:.0f}" for m in ("stress", "force", "geometry")] for name in found["tests"]
    }
    apart = {m: f"{along[m]['apart']:.1f}" for m in METHODS}
    shear = {m: f"{along[m]['shear'][1]:.2f}" for m in ("target", *METHODS)}
    roll = {m: f"{along[m]['roll'][1]:.0f}" for m in METHODS}
    off = {m: f"{along[m]['off']:.0f}" for m in METHODS}
    order = where["force"]["right"] < min(where[m]["right"] for m in ("stress", "geometry"))
    slides = along["stress"]["right"] > 5.0 + max(along[m]["right"] for m in ("force", "geometry"))
    return "\n".join(
        [
            f"* **Contact location is {'' if order else 'not '}as with people, {'' if order else 'who are '}worst with force**: with stress, force and geometry one who reads as skin does is right in "
            f"{', '.join(right['contact location'])} % (people 82, 51, 78, of which the first and last do not differ significantly). Below 50 % the rendered touches differ the other way round than the real ones.",
            f"* **Press or slide is {'as with people' if slides else 'not'}**: {', '.join(right[ALONG])} % (people 73, 53, 53). Of {shear['target']} N that the rod drags the skin with, the pose "
            f"whose stress is nearest renders {shear['stress']} N, since rolling makes up for the drag but presses elsewhere: all of the stress is then {off['electrodes']} or "
            f"{off['force']} % off instead of {off['stress']}. Matched as 19 electrodes feel it, coarsely, as the paper's 154 tetrahedra may, the disc does roll, by "
            f"{roll['electrodes']} degrees, renders {shear['electrodes']} N, and the touches are told apart (d' {apart['electrodes']} instead of {apart['stress']}), though not as real ones differ.",
            f"* **Force tells them apart, but not as a slide**: it has the whole drag to render, {shear['force']} N, and rolls by {roll['force']} degrees for it, stress by {roll['stress']}. An observer "
            f"who counts any difference notices (d' {apart['force']}). Geometry notices too ({apart['geometry']}): its disc is laid on the contact, "
            "which friction drags along.",
            f"* **Before engine 6** stress, force and geometry were right in {EARLIER}.",
            "",
            "",
        ]
    )


def main() -> None:
    """Compute, print, and write what was asked for."""
    parser = argparse.ArgumentParser(prog="figures_told_apart", description=__doc__)
    parser.add_argument("--level", default="draft", help="accuracy of the skin")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to this file")
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="write the tables as a page")
    options = parser.parse_args()
    found: dict[str, Any] = {"level": options.level, **judged(fingertip_skin(level=options.level))}
    text = page(found)
    print(in_words(found) + text)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    if options.page:
        notes = NOTES.format(slow=found["slow"], fast=found["fast"], frame=FRAME)
        options.page.write_text(HEAD + in_words(found) + text + notes)


if __name__ == "__main__":
    main()
