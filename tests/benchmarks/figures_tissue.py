"""Devices on two tissues, one beside the other: `python -m tests.benchmarks.figures_tissue [--page FILE]`.

Prints a table in Markdown, and on request writes it as a page. All is simulated.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from core.matching import pins as pin_matching
from core.matching.deformation import PinSolver
from core.matching.pin_law import PinLook
from core.matching.thimble import matcher
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin
from core.skin.observation import stress_error, stress_vector, touch_of
from core.skin.stimulus import Stimulus
from tests import touches

FRICTION, PIN_LIMIT = 0.6, 0.4
TOUCHES = {"ball, rolled": touches.ball_roll, "edge, turned": touches.edge_press, "plane, slid": touches.slide}
DEVICES = {"thimble_3rrs": "Thimble (stress optimisation)", "pin_array_128": "128 pins (DM2)"}
HEAD = """# Two tissues

Every figure is **simulated**. Made by

    python -m tests.benchmarks.figures_tissue --page presets/devices/tissue_figures.md

Each touch is computed on a finger of linear tissue, and again on the same finger of neo-Hookean tissue. A figure says
how much of the **whole stress**, of every element, a device leaves of the touch: root mean square over all frames,
relative to the touch. 'Linear' is a touch on linear tissue, matched and judged there. The other two are a touch on
neo-Hookean tissue, judged by the law: first with the commands that were found on linear tissue, then with those of the
lagged correction, which evaluates the law for each command. The last column is the mean number of evaluations of the
law in a frame.

A block that is tilted while it presses 1.2 mm deep is left out: touch by the law does not settle in some of its frames,
and goes on from them on a fold of the tissue that it does not reach from rest.

"""
FOOT = """
The pages of the [thimble](thimble_3rrs_figures.md) and of the [pins](pin_array_128_figures.md) set linear tissue beside
the papers, which have linear or corotational tissue. The skin is 'draft'; how far both tissues are from converged
fingers is in [ACCURACY.md](../ACCURACY.md).
"""

Judged = tuple[Stimulus, Stimulus]  # the touch, and what the device made of it


def thimble(law: SkinModel, touch: touches.Touch) -> tuple[list[list[Judged]], list[int]]:
    """Follow a touch with a thimble in three ways; return the stimuli of each frame, and evaluations of the law."""
    from core.devices.thimble import mechanism

    device = mechanism(Library().device("thimble_3rrs"))
    linear = law.linear
    ways = [matcher(device, skin, friction=FRICTION) for skin in (linear, law, law)]
    paths = [touches.solver_on(skin) for skin in (linear, law)]
    found: list[list[Judged]] = [[], [], []]
    looks = []
    for i in range(len(touch.position)):
        soft, stiff = (path.step(touch.bodies(i)) for path in paths)
        felt = touch_of(linear, soft.nodal), touch_of(law, stiff.nodal, stiff.amounts)
        goals = [way.direct.observer.see(felt[k > 0]) for k, way in enumerate(ways)]  # type: ignore[union-attr]
        alone = ways[0].step(goals[0])
        made = alone.minimum
        frames = [
            alone,
            ways[1].step(goals[1], None if made is None else lambda x, limits, made=made: made),  # type: ignore[misc]
            ways[2].step(goals[2]),
        ]
        if all(frame.minimum is not None for frame in frames):
            looks.append(frames[2].looks)
            for k, frame in enumerate(frames):
                own = touch_of(linear, ways[0].contact.nodal(frame.solution)) if frame.felt is None else frame.felt
                found[k].append((felt[k > 0], own))
    return found, looks


def pins(law: SkinModel, touch: touches.Touch) -> tuple[list[list[Judged]], list[int]]:
    """Return the same of pins."""
    spec, linear = Library().device("pin_array_128"), law.linear
    soft, stiff = (pin_matching.setup(skin, spec).matcher for skin in (linear, law))
    ways = [PinSolver(ready, "DM2", force_limit=PIN_LIMIT) for ready in (soft, stiff)]
    paths, held = [touches.solver_on(skin) for skin in (linear, law)], stiff.law.skin()
    found: list[list[Judged]] = [[], [], []]
    looks = []
    for i in range(len(touch.position)):
        steps = [path.step(touch.bodies(i)) for path in paths]
        if not all(step.nodal.any() for step in steps):
            continue
        felt = touch_of(linear, steps[0].nodal), touch_of(law, steps[1].nodal, steps[1].amounts)
        alone = ways[0].step(steps[0].nodal.ravel()).x
        both = ways[1].step(steps[1].nodal.ravel(), steps[1].amounts)
        pressed: PinLook = stiff.law.follow(held, held.save(), lambda less, x=alone: x)  # type: ignore[misc]
        assert both.look is not None
        looks.append(both.look.looks)
        found[0].append((felt[0], touch_of(linear, soft.pressed(alone))))
        found[1].append((felt[1], pressed.felt(law, stiff.pressed(alone))))
        found[2].append((felt[1], both.look.felt(law, stiff.pressed(both.x))))
    return found, looks


def left(judged: list[Judged]) -> float:
    """Return how much of the whole stress is left over all frames, relative to the touch."""
    sizes = np.array([np.linalg.norm(stress_vector(target)) for target, _ in judged])
    errors = np.array([stress_error(target, made) for target, made in judged])
    return float(np.linalg.norm(errors * sizes) / np.linalg.norm(sizes))


def table(law: SkinModel, frames: int) -> str:
    """Return the table in Markdown."""
    lines = [
        f"Skin 'draft', {len(law.mesh.tetrahedra)} tetrahedra, friction {FRICTION:g}, {frames} frames a touch; no pin "
        f"presses with more than {PIN_LIMIT:g} N.",
        "",
        "| device | touch | linear | neo-Hookean, found on linear | neo-Hookean, found by the law | evaluations |",
        "|---|---|---|---|---|---|",
    ]
    follow: dict[str, Callable[..., Any]] = {"thimble_3rrs": thimble, "pin_array_128": pins}
    for device, words in DEVICES.items():
        for name, make in TOUCHES.items():
            found, looks = follow[device](law, make(frames))
            ours = " | ".join(f"{100 * left(judged):.1f} %" for judged in found)
            lines.append(f"| {words} | {name} | {ours} | {np.mean(looks):.1f} |")
            print(lines[-1], flush=True)
    return "\n".join(lines) + "\n"


def main() -> None:
    """Compute, print, and write what was asked for."""
    parser = argparse.ArgumentParser(prog="figures_tissue", description=__doc__)
    parser.add_argument("--frames", type=int, default=120, help="of each touch")
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="write the table as a page")
    options = parser.parse_args()
    text = table(fingertip_skin(level="draft").with_law(), options.frames)
    if options.page:
        options.page.write_text(HEAD + text + FOOT)


if __name__ == "__main__":
    main()
