"""The drawn twin: true dimensions, in the finger's frame, without the object's scale."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from blender_addon.preview.rows import NO_PATH, Row
from blender_addon.viewport import drawing, parts, tactor_twin

from .build import finger

HOLE, REACH = 4.0e-3, 2.0e-3


def radii(part: parts.Part) -> np.ndarray:
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
    made = (
        tactor_twin.housing(),
        tactor_twin.cap(),
        tactor_twin.plan(),
        tactor_twin.dot(),
        parts.disc(0.01, 0.0, (1.0, 0.5, 0.1, 1.0), (1.0, 0.5, 0.1, 0.0)),
    )
    for part in made:
        assert part.positions.dtype == part.colours.dtype == np.float32 and part.triangles.dtype == np.int32
        assert part.positions.shape[1:] == (3,) and part.colours.shape == (len(part.positions), 4)
        assert part.triangles.min() >= 0 and part.triangles.max() < len(part.positions)
        assert np.isfinite(part.positions).all() and (part.colours >= 0).all() and (part.colours <= 1).all()


def test_a_circle_is_one() -> None:
    ring = parts.circle(0.003, 0.001)
    assert np.hypot(ring[:, 0], ring[:, 1]) == pytest.approx(0.003)
    assert (ring[0] == pytest.approx(ring[-1], abs=1e-9)) and set(ring[:, 2].tolist()) == {0.001}


def test_heat_runs_from_blue_to_orange_and_stops_at_its_ends() -> None:
    assert parts.heat(0.0) == parts.heat(-1.0) and parts.heat(1.0) == parts.heat(7.0)
    assert parts.heat(0.0)[2] > parts.heat(0.0)[0] and parts.heat(1.0)[0] > parts.heat(1.0)[2]


def test_the_frame_has_the_fingers_pose_but_not_its_scale() -> None:
    hand = finger(location=(0.1, 0.2, 0.3))
    hand.rotation_euler = (0.3, -0.4, 1.1)
    hand.scale = (2.0, 3.0, 4.0)
    bpy.context.view_layer.update()
    frame = drawing.finger_matrix(bpy.context.scene, "Finger")
    expected = Matrix.Translation(Vector((0.1, 0.2, 0.3))) @ hand.rotation_euler.to_matrix().to_4x4()
    assert np.array(frame) == pytest.approx(np.array(expected), abs=1e-6)
    assert drawing.finger_matrix(bpy.context.scene, "Gone") is None


def row(values: dict[str, float], unit: str, high: float | None, kind: str = "") -> Row:
    """Return a device without more than these values."""
    same, highs, units = dict.fromkeys(values), dict.fromkeys(values, high), dict.fromkeys(values, unit)
    return Row("Finger", "", "", kind, values, same, highs, units, NO_PATH, 1)


def test_a_device_is_drawn_as_its_kind_says_if_it_has_the_channels_for_that() -> None:
    tactor, pulleys = {"tactor_x": 0.0, "tactor_y": 0.0}, {"pulley_1": 0.0, "pulley_2": 0.0}
    assert row({**tactor, **pulleys}, "m", None, "shear_tactor").drawn == "tactor"
    assert row(pulleys, "rad", None, "shear_tactor").drawn == row(tactor, "m", None, "unknown").drawn == ""
    assert row({"leg_1": 0.0}, "rad", None, "hexapod").drawn == "platform"


def test_the_tactor_is_drawn_where_it_is_within_its_reach() -> None:
    still, moved = (tactor_twin.tactor(row({"tactor_x": x, "tactor_y": 0.0}, "m", 1.5e-3), 2.0) for x in (0.0, 1e-3))
    shift = moved.solid.positions - still.solid.positions
    housing = len(tactor_twin.housing().positions)
    assert not shift[:housing].any() and shift[housing:] == pytest.approx(
        np.tile([2e-3, 0, 0], (len(shift) - housing, 1))
    )
    assert np.hypot(*moved.lines[0].points[:, :2].T) == pytest.approx(3e-3)  # its reach, as exaggerated
    assert len(still.lines) == 1 and moved.lines[1].points[1] == pytest.approx([2e-3, 0.0, 0.35e-3])


def test_a_field_glows_with_its_share_of_the_limit_and_not_at_all_at_zero() -> None:
    off, half = (tactor_twin.screen(row({"amplitude": v}, "V", 200.0)) for v in (0.0, 100.0))
    assert not off.solid.colours[:, 3].any() and len(off.lines) == 1
    assert half.solid.colours[0, 3] == pytest.approx(0.55) and radii(half.solid).max() == pytest.approx(10.5e-3)
    assert not half.covers


@pytest.mark.parametrize(("unit", "expected"), [("m", 2e-3), ("N", 0.4), ("V", 1.0)])
def test_a_preset_without_limits_is_drawn_to_the_scale_of_its_unit(unit: str, expected: float) -> None:
    assert row({"a": 0.1}, unit, None).full_scale("a") == expected
    assert row({"a": 0.1}, unit, 3.0).full_scale("a") == 3.0


def test_a_bar_is_closed() -> None:
    """Each of its edges borders two triangles; the seam's two ends of a ring are one place."""
    bar = parts.bar(np.zeros(3), np.array([0.0, 3e-3, 4e-3]), 1e-3, (1.0, 1.0, 1.0, 1.0))
    places = np.unique(np.round(bar.positions, 9), axis=0, return_inverse=True)[1].reshape(-1)[bar.triangles]
    edges = np.sort(np.concatenate([places[:, [0, 1]], places[:, [1, 2]], places[:, [2, 0]]]), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1].tolist()) == {2}
