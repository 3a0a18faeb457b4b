"""What PressWatch takes for a loss of force, and for a body that the skin has slid past."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from core.contact.solver.bodies import ContactBody
from core.contact.solver.press_watch import PressWatch
from core.surface.gap import Surface
from tests.one_node import one_node

BLOCK = Surface.block()


def lost(forces: list[float]) -> list[float]:
    """Return what is lost while a block rises by 0.1 mm a frame and pushes with some forces along Z [N]."""
    watch, out = PressWatch(), []
    for k, force in enumerate(forces):
        came, now = (ContactBody(BLOCK, translation=np.array([0.0, 0.0, (k + i) * 1e-4])) for i in (0, 1))
        out.append(watch.lost([came], one_node(now, np.array([[0.0, 0.0, force]]), np.zeros((1, 3)))))
    return out


def test_force_that_falls_while_a_body_presses_deeper_is_lost() -> None:
    assert lost([1.0, 2.0, 1.5]) == [0.0, 0.0, pytest.approx(0.25)]
    assert lost([1.0, 2.0, 1.99]) == [0.0, 0.0, 0.0]


def test_there_is_no_share_of_a_force_towards_the_nail() -> None:
    """As when the finger begins inside an object: the share was negative, and a finding told of it."""
    assert lost([-1.0, -1.5, -2.0]) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("leans", "tilt", "beside", "drawn", "share"),
    [
        ((10.0, 80.0), 0.0, 0.06, (), 0.0),
        ((170.0, 80.0), 0.0, 0.06, (1,), 0.2 * np.cos(np.radians(10.0))),
        ((170.0, 80.0), 0.0, 0.05, (), 0.2 * np.cos(np.radians(10.0))),
        ((170.0, 170.0), 0.0, 0.05, (0, 1), 1.2 * np.cos(np.radians(10.0))),
        ((170.0, 50.0), 0.0, 0.06, (), 0.2 * np.cos(np.radians(10.0))),
        ((10.0, 80.0), -60.0, 0.06, (1,), np.cos(np.radians(40.0))),
    ],
)
def test_a_body_draws_skin_out_if_its_normal_forces_do_in_sum(
    leans: tuple[float, float], tilt: float, beside: float, drawn: tuple[int, ...], share: float
) -> None:
    """Body 0 presses in by 0.5 N; body 1 with 0.2 N and 1 N, along normals that lean so far from the skin's [degrees].

    The skin is tilted by so much [degrees]. Body 1 is so far beside body 0 [m], which is 0.05 m wide: one that meets it
    is a part of the same thing.
    """
    angles, skin = np.radians([tilt, tilt, *leans]), np.radians(tilt)
    normals = np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)], axis=1)
    size, inward = np.array([0.2, 0.3, 0.2, 1.0]), np.tile([np.sin(skin), 0.0, np.cos(skin)], (4, 1))
    bodies = ContactBody(BLOCK), ContactBody(BLOCK, translation=np.array([beside, 0.0, 0.0]))
    solution = SimpleNamespace(loaded=np.ones(4, bool), normals=normals, normal_force=size)
    step: Any = SimpleNamespace(solution=solution, gaps=SimpleNamespace(body=np.array([0, 0, 1, 1]), bodies=bodies))
    found, bodies_that_draw = PressWatch().outward(step, inward)
    assert bodies_that_draw == drawn
    assert found == pytest.approx(share / size.sum(), abs=1e-12)
