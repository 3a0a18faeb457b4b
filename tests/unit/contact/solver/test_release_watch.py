"""What ReleaseWatch takes for skin that lets go, as on a sharp edge."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.bodies import ContactBody
from core.contact.solver.release_watch import ReleaseWatch
from core.surface.gap import Surface
from tests.one_node import one_node
from tests.stress.paths import Press, dragged

BLOCK = Surface.block()
STEP = 1e-4  # that the block moves in a frame [m]


def released(ways: list[float], forces: list[float]) -> list[float]:
    """Return what is told of skin that is drawn along [m] by a block, and of its force along X [N]; 0 for none."""
    watch, out = ReleaseWatch(), []
    for k, (way, force) in enumerate(zip(ways, forces, strict=True)):
        came, now = (ContactBody(BLOCK, translation=np.array([(k + i) * STEP, 0.0, 0.0])) for i in (0, 1))
        pushed = np.array([[force, 0.0, 1.0 if force else 0.0]])
        out.append(watch.released([came], one_node(now, pushed, np.array([[way, 0.0, 0.0]]))))
    return out


def test_skin_that_springs_back_farther_than_the_object_moves_lets_go() -> None:
    drawn, force = [0.0, STEP, 2 * STEP, -1.5 * STEP], [0.1, 0.5, 1.0, 0.1]
    assert released(drawn, force) == [0.0, 0.0, 0.0, pytest.approx(0.9 / np.hypot(1.0, 1.0))]


def test_skin_that_goes_along_or_slides_does_not_let_go_however_its_force_changes() -> None:
    assert released([0.0, STEP, 0.0, 0.0], [0.1, 1.0, 0.1, 1.0]) == [0.0] * 4


def test_what_changes_the_force_by_less_than_edges_are_trusted_is_not_told() -> None:
    assert released([0.0, 5 * STEP], [1.0, 1.02]) == [0.0, 0.0]


def test_skin_that_hangs_on_nothing_any_more_has_let_go() -> None:
    assert released([5 * STEP, 0.0], [1.0, 0.0])[1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("shape", "angle", "told"), [("edge", 1.05, True), ("edge", 1.33, False), ("ball", 1.33, False)]
)
def test_an_edge_of_60_degrees_lets_skin_go_and_one_of_76_or_a_ball_does_not(
    shape: str, angle: float, told: bool
) -> None:
    """Dragged over the edge of 60 degrees, the force falls by 14 % in a sample of 0.05 mm.

    On the one of 76 degrees it changes with the way, since its cells are fine where friction has drawn the skin to.
    """
    values = {"level": "draft", "poisson": 0.48, "tissue": "linear", "young": 1e5, "contact": "points"}
    values |= {"shape": shape, "size": 6e-3, "angle": angle, "facets": 5120, "slivers": 0, "mesh_seed": 0}
    press = Press({**values, "tilt": 0.0, "roll": 0.0, "x": 0.0, "y": 0.0})
    felt = press.feel([press.thing(dragged(1.7e-3, 2e-3, 0.05e-3, 90), 0.3)], step=1.0 / 480.0)
    assert ("lets-go" in felt.told) is told


@pytest.mark.parametrize(("step", "friction", "told"), [(1.5e-3, 1.2, True), (0.4e-3, 1.2, True), (1.5e-3, 0.0, False)])
def test_an_edge_that_strikes_the_skin_from_the_side_lets_it_go_in_long_samples_too(
    step: float, friction: float, told: bool
) -> None:
    """In a sample of 1.5 mm skin springs back less far than the edge moves; in a part of it, farther.

    Without friction, the force at the end of a sample does not depend on its parts.
    """
    values = {"level": "draft", "poisson": 0.48, "tissue": "linear", "young": 1e5, "contact": "points"}
    values |= {"shape": "edge", "size": 10e-3, "angle": 1.34, "facets": 5120, "slivers": 0, "mesh_seed": 0}
    press = Press({**values, "tilt": -20.0, "roll": 0.0, "x": 0.0, "y": 0.0})
    felt = press.feel([press.thing(dragged(0.5e-3, 3e-3, step, int(14e-3 / step)), friction)], step=1.0 / 60.0)
    assert ("lets-go" in felt.told) is told
