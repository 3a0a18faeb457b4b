"""The drawn twin: true dimensions, in the finger's frame, without the object's scale."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from blender_addon.viewport import drawing, tactor_twin

from .build import finger

HOLE, REACH = 4.0e-3, 2.0e-3


def radii(part: tactor_twin.Part) -> np.ndarray:
    """Return every vertex's distance from the axis."""
    return np.hypot(part.positions[:, 0], part.positions[:, 1])


def test_the_cap_covers_the_hole_wherever_the_tactor_goes() -> None:
    assert radii(tactor_twin.housing()).min() == pytest.approx(HOLE, rel=1e-6)
    assert radii(tactor_twin.cap()).max() - REACH >= HOLE - 1e-9


def test_the_tactor_reaches_the_pad_and_the_cap_stays_behind_the_housing() -> None:
    cap, housing = tactor_twin.cap(), tactor_twin.housing()
    assert 0.0 < cap.positions[:, 2].max() < 0.5e-3
    wide = cap.positions[radii(cap) > HOLE]
    assert wide[:, 2].max() <= housing.positions[:, 2].min() + 1e-9


def test_parts_are_what_the_gpu_accepts() -> None:
    parts = (
        tactor_twin.housing(),
        tactor_twin.cap(),
        tactor_twin.plan(),
        tactor_twin.dot(),
        tactor_twin.glow(0.01, (1.0, 0.5, 0.1, 1.0)),
    )
    for part in parts:
        assert part.positions.dtype == part.colours.dtype == np.float32 and part.triangles.dtype == np.int32
        assert part.positions.shape[1:] == (3,) and part.colours.shape == (len(part.positions), 4)
        assert part.triangles.min() >= 0 and part.triangles.max() < len(part.positions)
        assert np.isfinite(part.positions).all() and (part.colours >= 0).all() and (part.colours <= 1).all()


def test_a_circle_is_one() -> None:
    ring = tactor_twin.circle(0.003, 0.001)
    assert np.hypot(ring[:, 0], ring[:, 1]) == pytest.approx(0.003)
    assert (ring[0] == pytest.approx(ring[-1], abs=1e-9)) and set(ring[:, 2].tolist()) == {np.float32(0.001)}


def test_heat_runs_from_blue_to_orange_and_stops_at_its_ends() -> None:
    assert tactor_twin.heat(0.0) == tactor_twin.heat(-1.0) and tactor_twin.heat(1.0) == tactor_twin.heat(7.0)
    assert tactor_twin.heat(0.0)[2] > tactor_twin.heat(0.0)[0] and tactor_twin.heat(1.0)[0] > tactor_twin.heat(1.0)[2]


def test_the_frame_has_the_fingers_pose_but_not_its_scale() -> None:
    hand = finger(location=(0.1, 0.2, 0.3))
    hand.rotation_euler = (0.3, -0.4, 1.1)
    hand.scale = (2.0, 3.0, 4.0)
    bpy.context.view_layer.update()
    frame = drawing.finger_matrix(bpy.context.scene, "Finger")
    expected = Matrix.Translation(Vector((0.1, 0.2, 0.3))) @ hand.rotation_euler.to_matrix().to_4x4()
    assert np.array(frame) == pytest.approx(np.array(expected), abs=1e-6)
    assert drawing.finger_matrix(bpy.context.scene, "Gone") is None
