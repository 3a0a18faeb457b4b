"""When an object counts as held."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from core.contact.holding_times import holding_times
from core.contact.pad_contact import PadContact
from core.contact.pad_sampler import PadSampler
from core.errors import DermisError
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene, sample_frames

TIMES = np.arange(1001) / 1000.0


def cube(half: float) -> Mesh:
    corners = half * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32))


def grasp(places: list[Any], animated: dict[str, np.ndarray] | None = None, **parameters: Any):
    """Fingers at (constant or moving) places about a cube of 4 cm at the origin."""
    frames, t = sample_frames(Fraction(24), (1, 25), 240.0)
    fingers = np.tile(np.eye(4), (len(places), len(t), 1, 1))
    for f, place in enumerate(places):
        fingers[f, :, :3, 3] = place(t) if callable(place) else place
    chunk = Chunk(
        frames, t, fingers, np.tile(np.eye(4), (1, len(t), 1, 1)), np.zeros((0, len(t), 4, 4)), {}, animated or {}
    )
    scene = TactileScene(
        "s",
        Fraction(24),
        (1, 25),
        240.0,
        tuple(Finger(f"f{i}") for i in range(len(places))),
        (Body("cube", cube(0.02), parameters),),
        (),
        (chunk,),
    )
    sampler = PadSampler(scene)
    sampler.add(chunk)
    return sampler.finish(), scene


def holding(grasped: tuple[PadContact, TactileScene], finger: int) -> np.ndarray:
    found = holding_times(*grasped, finger, 0, TIMES)
    return np.zeros(len(TIMES), dtype=bool) if found is None else found


def test_opposed_fingers_hold_and_a_third_on_top_does_not() -> None:
    grasped = grasp([(0.02, 0, 0), (-0.02, 0.005, 0), (0, 0, 0.02)])
    assert holding(grasped, 0).all() and holding(grasped, 1).all()
    assert not holding(grasped, 2).any()


def test_one_finger_and_two_at_a_right_angle_do_not_hold() -> None:
    assert not holding(grasp([(0.02, 0, 0)]), 0).any()
    assert not holding(grasp([(0.02, 0, 0), (0, 0.02, 0)]), 0).any()


def test_two_fingers_on_one_side_oppose_the_thumb_each() -> None:
    grasped = grasp([(0.02, 0.01, 0), (0.02, -0.01, 0), (-0.02, 0, 0)])
    assert all(holding(grasped, f).all() for f in range(3))


def test_a_hold_begins_and_ends_with_the_touch_of_both() -> None:
    def closing(t: np.ndarray) -> np.ndarray:  # at 0.5 mm from the face at t = 0.3 and again, leaving, at 0.7
        return np.stack([-0.0205 - 0.1 * (np.abs(t - 0.5) - 0.2), 0 * t, 0 * t], axis=1)

    grasped = grasp([(0.02, 0, 0), closing])
    for f in range(2):
        on = np.flatnonzero(holding(grasped, f))
        assert TIMES[on[0]] == pytest.approx(0.3, abs=0.0011) and TIMES[on[-1]] == pytest.approx(0.7, abs=0.0011)
        assert len(on) == on[-1] - on[0] + 1


def test_keyed_holds_while_the_switch_is_on_for_fingers_that_touch() -> None:
    _, t = sample_frames(Fraction(24), (1, 25), 240.0)
    key = {"body/0/held": ((t >= 0.25) & (t < 0.75)).astype(float)}
    grasped = grasp([(0.02, 0, 0), (0.05, 0, 0)], key, held_mode="keyed")
    assert np.array_equal(holding(grasped, 0), (TIMES >= 0.25) & (TIMES < 0.75))
    assert not holding(grasped, 1).any()
    assert holding(grasp([(0.02, 0, 0)], held_mode="keyed", held=True), 0).all()
    assert not holding(grasp([(0.02, 0, 0)], held_mode="keyed"), 0).any()


def test_never_and_unknown() -> None:
    assert holding_times(*grasp([(0.02, 0, 0), (-0.02, 0, 0)], held_mode="never"), 0, 0, TIMES) is None
    with pytest.raises(DermisError, match="unknown held mode"):
        holding_times(*grasp([(0.02, 0, 0)], held_mode="glue"), 0, 0, TIMES)
