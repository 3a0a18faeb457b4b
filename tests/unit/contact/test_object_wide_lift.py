"""A known failure: the sharpest edge of an object sets the lift of all of it, see ACCURACY, *Limits*."""

from __future__ import annotations

import numpy as np
import pytest

from core.arrays import Array
from core.contact.solver.bodies import ContactBody
from core.contact.solver.point_solver import PointSolver
from core.contact.solver.sub_stepper import SubStepper
from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.surface_store import surface_compliance
from core.surface.gap import Surface

DEEP, STEP, DEPTHS = 1e-3, 0.05e-3, (4, 19)  # a press [m]: its depth, a frame's way; frames 0.25 and 1 mm deep
BELOW = 20e-3  # of the ball's top to that of a block that nothing touches [m]


def forces(surfaces: list[Surface]) -> Array:
    """Return the force along Z on skin that is pressed by objects whose tops are at the origin or below it [N]."""
    pad = surface_compliance(Library().skin("index_medium"), shipped=BUILT_IN / "skins")
    assert pad is not None
    lowest = pad.cells.positions[pad.cells.positions[:, 2].argmin()]
    stepper, out = SubStepper(PointSolver(pad), 8e-3), []
    for depth in np.arange(STEP, DEEP + STEP / 2, STEP):
        place = lowest + [0.0, 0.0, depth]
        bodies = [ContactBody(surface, translation=place, friction=0.0) for surface in surfaces]
        out.append(stepper.step(bodies).solution.force[:, 2].sum())
    return np.array(out)[list(DEPTHS)]


@pytest.mark.parametrize(("radius", "off"), [(1e-3, 0.15), (2e-3, 0.08), (5e-3, 0.05)])
def test_a_sharp_block_far_below_changes_a_ball_that_is_one_object_with_it(radius: float, off: float) -> None:
    ball, block = Surface.sphere(radius, facets=1280), Surface.block(4e-3, 4e-3, 2e-3)
    round_, sharp = ball.vertices - [0.0, 0.0, ball.vertices[:, 2].max()], block.vertices - [0.0, 0.0, BELOW]
    triangles = np.vstack([ball.triangles, block.triangles + len(round_)])
    alone, far = Surface.build(round_, ball.triangles), Surface.build(sharp, block.triangles)
    joined = Surface.build(np.vstack([round_, sharp]), triangles)
    wanted = forces([alone])
    np.testing.assert_array_equal(forces([alone, far]), wanted)
    change = forces([joined]) / wanted - 1.0
    print(f"ball of {1e3 * radius:g} mm: {change[0]:+.1%} of the force 0.25 mm deep, {change[1]:+.1%} 1 mm deep")
    assert np.abs(change).max() < off
