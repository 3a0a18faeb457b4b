"""On which side nails lie, and where a pad is in a finger: geometry against what it was made from."""

from __future__ import annotations

import numpy as np
import pytest

from blender_addon.hands import attachment
from blender_addon.hands.bone_names import FINGERS
from blender_addon.hands.fingertip_fit import MIDDLE, distance, fit, section
from blender_addon.hands.nails import curl, nails

from . import hand_rigs

pytestmark = pytest.mark.shared_tests("geometry of skeletons: names, sizes and poses")

WRIST = np.zeros(3)
PRESETS = {"small": {"length": 22e-3, "width": 14e-3, "thickness": 11.5e-3, "tip": 9.6e-3}}
PRESETS["large"] = {name: 1.2 * value for name, value in PRESETS["small"].items()}


def lines(bend: float, side: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return joints and true nails of a hand."""
    mirror = np.array([-1.0 if side == "L" else 1.0, 1.0, 1.0])
    made = hand_rigs.joints(bend)
    return {f: made[f][0] * mirror for f in FINGERS}, {f: made[f][1][-1] * mirror for f in FINGERS}


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("bend", [0.0, 3.0, 12.0, 45.0, 80.0])
@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_nails_lie_on_the_back_of_straight_and_bent_fingers(turn: float, bend: float, side: str, told: bool) -> None:
    given, truth = lines(bend, side)
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])
    given = {f: line @ turned.T for f, line in given.items()}
    found = nails(given, WRIST, side if told else "", {f: curl(given[f], f) for f in FINGERS})
    assert found.side == side and found.sure
    for finger in FINGERS:
        assert found.directions[finger] @ (turned @ truth[finger]) > 0.98, finger


@pytest.mark.parametrize("side", ["L", "R"])
def test_a_pose_tells_where_the_rest_is_straight_and_no_side_is_named(side: str) -> None:
    given, truth = lines(0.0, side)
    given.pop("thumb")
    unsure = nails(given, WRIST, "", {f: np.zeros(3) for f in given})
    assert not unsure.sure
    found = nails(given, WRIST, "", {f: 0.5 * truth[f] for f in given})
    assert found.sure and found.side == side
    assert all(found.directions[f] @ truth[f] > 0.99 for f in given)


def test_fingers_that_bend_to_the_back_by_a_little_do_not_turn_the_hand() -> None:
    given, truth = lines(-5.0, "R")
    found = nails(given, WRIST, "R", {f: curl(given[f], f) for f in FINGERS})
    assert found.side == "R" and all(found.directions[f] @ truth[f] > 0.95 for f in FINGERS)


def test_a_wrong_side_is_not_believed_where_all_fingers_bend() -> None:
    given, truth = lines(20.0, "R")
    found = nails(given, WRIST, "L", {f: curl(given[f], f) for f in FINGERS})
    assert found.side == "R" and all(found.directions[f] @ truth[f] > 0.98 for f in FINGERS[1:])


@pytest.mark.parametrize("bend", [-27.0, 0.0])
def test_a_person_is_believed_against_all_bends(bend: float) -> None:
    given, truth = lines(bend, "R")
    bends = {f: curl(given[f], f, True) for f in FINGERS}
    found = nails(given, WRIST, "R", bends, given=True, rigid=True)
    assert found.side == "R" and found.sure
    assert all(found.directions[f] @ truth[f] > 0.98 for f in FINGERS[1:])


def test_a_thumb_in_the_plane_of_the_palm_shows_no_side() -> None:
    given, truth = lines(0.0, "R")
    straight = {f: np.zeros(3) for f in FINGERS}
    for height, sure in ((-60.0, True), (-5.0, False), (12.0, False)):
        given["thumb"] = given["thumb"] * (1.0, 1.0, 0.0) + (0.0, 0.0, height)
        found = nails(given, WRIST, "", straight)
        assert (found.sure, found.side) == (sure, "R" if height < 0.0 else "L"), height


def test_bends_of_a_robot_alone_show_no_side() -> None:
    given, truth = lines(20.0, "R")
    given.pop("thumb")
    bends = {f: curl(line, f, True) for f, line in given.items()}
    found = nails(given, WRIST, "", bends, rigid=True)
    assert found.side == "R" and not found.sure
    assert nails(given, WRIST, "", {f: curl(line, f) for f, line in given.items()}).sure


def test_a_single_finger_is_known_by_its_bend() -> None:
    given, truth = lines(15.0, "R")
    only = {"index": given["index"]}
    found = nails(only, None, "", {"index": curl(only["index"], "index")})
    assert found.sure and found.directions["index"] @ truth["index"] > 0.999
    straight = {"index": lines(0.0, "R")[0]["index"]}
    assert not nails(straight, None, "", {"index": np.zeros(3)}).sure


def test_a_pad_by_the_bone_lies_below_its_tip() -> None:
    line = np.array([[0.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 52.0, 0.0]])
    found = fit(line, np.array([0.0, 0.0, 1.0]), None, PRESETS, 1e-3)
    assert (found.preset, found.scale, found.on_skin) == ("small", 1.0, False)
    assert found.origin == pytest.approx([0.0, 52.0 - 9.6, -MIDDLE * 11.5])
    assert found.axes == pytest.approx(np.eye(3))


def tube(radius: float, length: float, thick: float = 1.0, off: float = 0.0, rings: int = 40) -> np.ndarray:
    """Return triangles of a tube along Y with a round end, flattened and off its axis along X."""
    angle = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    y = length * np.sin(np.linspace(0.0, np.pi / 2, rings))
    r = radius * np.sqrt(np.clip(1.0 - np.clip((y - length + radius) / radius, 0.0, 1.0) ** 2, 0.0, 1.0))
    grid = np.stack(
        [
            r[:, None] * np.cos(angle) + off,
            np.broadcast_to(y[:, None], (rings, 32)),
            thick * r[:, None] * np.sin(angle),
        ],
        axis=-1,
    )
    a, b = grid[:-1], grid[1:]
    c, d = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, c, d), (a, d, b))])


@pytest.mark.parametrize("size", [0.5, 1.0, 30.0])
def test_a_pad_on_a_skin_lies_on_it_and_has_its_size(size: float) -> None:
    line = size * np.array([[0.0, -30.0, 0.0], [0.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
    skin = size * tube(7.0, 23.0, thick=11.5 / 14.0, off=1.5)
    found = fit(line, np.array([0.0, 0.0, 1.0]), skin, PRESETS, 1e-3)
    assert found.on_skin
    lengths = PRESETS[found.preset]
    assert found.scale * lengths["width"] == pytest.approx(14e-3 * size, rel=0.03)
    assert found.origin[0] == pytest.approx(1.5 * size, abs=0.1 * size)
    assert found.origin[1] == pytest.approx(23.0 * size - 1e3 * found.scale * lengths["tip"], abs=0.1 * size)
    assert found.origin[2] == pytest.approx(-5.75 * size, abs=0.1 * size)


def test_a_fit_says_how_wide_it_is_and_how_far_off_the_skin() -> None:
    line = np.array([[0.0, -30.0, 0.0], [0.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
    nail, skin = np.array([0.0, 0.0, 1.0]), tube(7.0, 23.0, thick=11.5 / 14.0)
    found = fit(line, nail, skin, PRESETS, 1e-3)
    assert found.width == pytest.approx(14e-3, rel=0.07) and found.miss == pytest.approx(0.0, abs=2e-5)
    assert not attachment.misses(found) and attachment.told(found).endswith("mm wide, on the skin")
    bare = fit(line, nail, None, PRESETS, 1e-3)
    assert bare.miss is None and not attachment.misses(bare) and "no skin" in attachment.told(bare)
    wide = fit(line, nail, tube(90.0, 200.0), PRESETS, 1e-3)
    assert wide.miss > 0.05 and attachment.misses(wide) and "mm off the skin" in attachment.told(wide)


def test_a_distance_to_triangles_is_that_to_face_edge_or_corner() -> None:
    one = np.array([[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]])
    flat = np.zeros((1, 3, 3))
    for point, wanted in (
        ((1.0, 1.0, 3.0), 3.0),
        ((1.0, 1.0, -2.0), 2.0),
        ((2.0, -3.0, 4.0), 5.0),
        ((-3.0, -4.0, 0.0), 5.0),
        ((3.0, 3.0, 0.0), np.sqrt(2.0)),
    ):
        assert distance(np.array(point), one) == pytest.approx(wanted)
        assert distance(np.array(point), np.concatenate([flat + 100.0, one])) == pytest.approx(wanted)
    assert distance(np.array([3.0, 4.0, 0.0]), flat) == pytest.approx(5.0), "a corner thrice"


def test_a_surface_that_is_no_fingers_is_not_followed() -> None:
    line = np.array([[0.0, -30.0, 0.0], [0.0, 0.0, 0.0], [0.0, 22.0, 0.0]])
    found = fit(line, np.array([0.0, 0.0, 1.0]), tube(90.0, 200.0), PRESETS, 1e-3)
    assert not found.on_skin and found.scale == 1.0


def test_a_long_nail_is_no_tip() -> None:
    line = np.array([[0.0, -30.0, 0.0], [0.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
    skin = tube(7.0, 23.0, thick=11.5 / 14.0)
    claw = np.array([[[-3.0, 15.0, 5.6], [3.0, 15.0, 5.6], [0.0, 40.0, 5.6]]])
    plain = fit(line, np.array([0.0, 0.0, 1.0]), skin, PRESETS, 1e-3)
    assert fit(line, np.array([0.0, 0.0, 1.0]), np.concatenate([skin, claw]), PRESETS, 1e-3).origin == pytest.approx(
        plain.origin, abs=0.3
    )


@pytest.mark.parametrize("sides", [5, 6, 7, 8])
def test_a_pad_on_few_faces_lies_on_one(sides: int) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False) + 0.3
    rings = [np.stack([7.0 * np.cos(angle), 0.0 * angle + y, 6.0 * np.sin(angle)], axis=1) for y in (0.0, 21.0)]
    faces = []
    for i in range(sides):
        j = (i + 1) % sides
        faces += [(rings[0][i], rings[0][j], rings[1][j]), (rings[0][i], rings[1][j], rings[1][i])]
        faces += [(rings[1][i], rings[1][j], np.array([0.0, 23.0, 0.0]))]
    skin = np.array(faces)
    line = np.array([[0.0, -30.0, 0.0], [0.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
    found = fit(line, np.array([0.0, 0.0, 1.0]), skin, PRESETS, 1e-3)
    assert found.on_skin and found.miss == pytest.approx(0.0, abs=1e-6)
    assert found.origin[2] < -4.0


def test_a_section_is_where_edges_cross() -> None:
    triangle = np.array([[[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [4.0, 0.0, 0.0]]])
    assert sorted(section(triangle, 1.0).tolist()) == [[0.0, 1.0, 0.0], [2.0, 1.0, 0.0]]
    assert len(section(triangle, 3.0)) == 0


def test_a_finger_near_a_presets_size_has_the_presets_lengths_and_touches_its_tip() -> None:
    line = np.array([[0.0, -30.0, 0.0], [0.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
    for size in (0.96, 1.05):
        skin = size * tube(7.0, 23.0, thick=11.5 / 14.0)
        found = fit(size * line, np.array([0.0, 0.0, 1.0]), skin, PRESETS, 1e-3)
        assert (found.preset, found.scale) == ("small", 1.0)
        assert found.origin[1] == pytest.approx(23.0 * size - 9.6, abs=0.01)
    assert fit(0.8 * line, np.array([0.0, 0.0, 1.0]), 0.8 * skin, PRESETS, 1e-3).scale != 1.0
