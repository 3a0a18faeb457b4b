"""What names and branches of bones say: which finger, which hand, which bone carries the tip."""

from __future__ import annotations

import numpy as np
import pytest

from blender_addon.hands.bone_names import END, FINGERS, labels, side_of, words
from blender_addon.hands.readings import found_hands
from blender_addon.hands.skeleton import Bone, Chain, along_body, joints, wrist_at

from . import hand_rigs, hand_schemes

pytestmark = pytest.mark.shared_tests("geometry of skeletons: names, sizes and poses")

SPELLED = {  # of the index finger's last bone on the left: finger, side, place
    "f_index.03.L": 3,
    "DEF-f_index.03.L": 3,
    "index_03_l": 3,
    "mixamorig:LeftHandIndex3": 3,
    "mixamorig7:LeftHandIndex3": 3,
    "J_Bip_L_Index3": 3,
    "lIndex3": 3,
    "l_index3": 3,
    "CC_Base_L_Index3": 3,
    "b_l_index3": 3,
    "finger_index_2_l": 2,
    "LeftIndexDistal": 3,
    "Left Index Distal": 3,
    "left-index-finger-phalanx-distal": 3,
    "lefthandindex3": 3,
    "人指３.L": 3,
    "左人指３": 3,
    "index3.l": 3,
    "pointer_tip_L": END,
    "LeftHandIndex4_end": END,
    "b_l_index_null": END,
    "index_metacarpal_l": 0,
    "leftIndexFingerKnuckle": 1,
    "leftIndexFingerIntermediateBase": 2,
    "leftIndexFingerIntermediateTip": 3,
    "leftIndexFingerTip": END,
}


def bone(name: str, parent: str = "", at: float = 0.0, deform: bool = True) -> Bone:
    """Return a bone along Y."""
    return Bone(name, parent, np.array([0.0, at, 0.0]), np.array([0.0, at + 1.0, 0.0]), deform)


@pytest.mark.parametrize("name", SPELLED)
def test_a_name_says_finger_side_and_place(name: str) -> None:
    label = labels([name])[name]
    assert (label.finger, label.side, label.place) == ("index", "L", SPELLED[name])


@pytest.mark.parametrize(
    ("word", "finger"),
    [("Thumb", "thumb"), ("Mid", "middle"), ("Ring", "ring"), ("Pinky", "little"), ("little", "little")],
)
def test_every_finger_has_its_words(word: str, finger: str) -> None:
    assert labels([f"Right{word}Distal"])[f"Right{word}Distal"].finger == finger


@pytest.mark.parametrize(
    "name", ["spine.003", "toe_index.L", "palm.01.L", "hand.L", "Bone.012", "string", "finger", "LeftFoot", "earring.L"]
)
def test_other_names_say_nothing(name: str) -> None:
    assert labels([name]) == {}


def test_fingers_by_number_begin_with_the_thumb_whether_at_one_or_at_none() -> None:
    makehuman = [f"finger{f}-{p}.L" for f in range(1, 6) for p in range(1, 4)]
    found = labels(makehuman)
    assert [found[f"finger{f}-3.L"].finger for f in range(1, 6)] == list(FINGERS)
    biped = ["Bip01 L Finger" + text for f in "01234" for text in (f, f"{f}1", f"{f}2")]
    found = labels(biped)
    assert [found[f"Bip01 L Finger{f}2"].finger for f in range(5)] == list(FINGERS)
    assert [found[f"Bip01 L Finger1{t}"].place for t in ("", "1", "2")] == [1, 2, 3]
    assert found["Bip01 L Finger1"].side == "L"


def test_an_l_before_a_number_is_a_side_where_there_is_an_r_too() -> None:
    links = labels([f"{finger}_L{p}" for finger in FINGERS for p in (1, 2)])
    assert {label.side for label in links.values()} == {""} and links["ring_L2"].place == 2
    both = labels([f"index_{side}{p}" for side in "LR" for p in (1, 2)])
    assert [both[f"index_{side}2"].side for side in "LR"] == ["L", "R"] and both["index_L2"].place == 2
    assert labels(["index_R1"])["index_R1"].side == "R" and labels(["L1_index"])["L1_index"].side == "L"


def test_a_side_is_a_word_of_its_own() -> None:
    assert [side_of(n) for n in ("hand.L", "RightHand", "wrist_l", "ball", "left_right")] == ["L", "R", "L", "", ""]
    assert words("DEF-f_index.03.L") == ["def", "f", "index", "03", "l"]


def test_the_layer_that_moves_the_mesh_is_taken() -> None:
    names = {f"{layer}f_index.0{p}.L": p for layer in ("", "DEF-", "ORG-", "MCH-") for p in (1, 2, 3)}
    bones = {n: bone(n, at=float(p), deform=n.startswith("DEF")) for n, p in names.items()}
    (hand,) = found_hands(bones)
    assert hand.chains["index"] == Chain(tuple(f"DEF-f_index.0{p}.L" for p in (1, 2, 3)))
    (hand,) = found_hands(bones, weighted={f"ORG-f_index.0{p}.L" for p in (1, 2, 3)})
    assert hand.chains["index"].last == "ORG-f_index.03.L"


def test_a_fourth_bone_is_an_end_unless_vertices_follow_it() -> None:
    names = [f"LeftHandIndex{p}" for p in range(1, 5)]
    bones = {n: bone(n, at=float(i)) for i, n in enumerate(names)}
    (hand,) = found_hands(bones)
    assert (hand.chains["index"].last, hand.chains["index"].end) == (names[2], names[3])
    (hand,) = found_hands(bones, weighted=set(names))
    assert (hand.chains["index"].bones, hand.chains["index"].end) == (tuple(names[1:]), "")
    bones |= {"LeftHandIndex4_end": bone("LeftHandIndex4_end", at=4.0)}
    assert found_hands(bones)[0].chains["index"] == Chain(tuple(names[:3]), names[3])
    three = {n: bones[n] for n in names[:3]} | {"LeftHandIndex3_end": bone("LeftHandIndex3_end", at=3.0)}
    assert found_hands(three)[0].chains["index"] == Chain(tuple(names[:3]), "LeftHandIndex3_end")
    metacarpal = {n: bone(n, at=float(i)) for i, n in enumerate(f"b_l_index{p}" for p in range(4))}
    assert found_hands(metacarpal)[0].chains["index"] == Chain(("b_l_index1", "b_l_index2", "b_l_index3"))


def test_where_a_last_bone_ends_is_believed_where_it_can_be_true() -> None:
    ahead = {n: bone(n, at=float(i)) for i, n in enumerate("abc")}
    chain = Chain(tuple("abc"))
    assert joints(ahead, chain)[-1] == pytest.approx([0.0, 3.0, 0.0])
    aside = ahead | {"c": Bone("c", "", np.array([0.0, 2.0, 0.0]), np.array([5.0, 2.0, 0.0]))}
    assert joints(aside, chain)[-1] == pytest.approx([0.0, 2.8, 0.0])
    long = ahead | {"c": Bone("c", "", np.array([0.0, 2.0, 0.0]), np.array([0.0, 9.0, 0.0]))}
    assert joints(long, chain)[-1] == pytest.approx([0.0, 2.8, 0.0])
    assert joints(aside | {"e": bone("e", at=2.7)}, Chain(tuple("abc"), "e"))[-1] == pytest.approx([0.0, 2.7, 0.0])


def test_a_last_link_whose_frame_lies_beside_its_body_goes_along_the_body() -> None:
    box = np.array(np.meshgrid([-10.0, 10.0], [-5.0, 45.0], [0.0, 30.0], indexing="ij")).reshape(3, -1).T
    faces = np.array([(0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 5, 1), (0, 4, 5), (2, 3, 7), (2, 7, 6)])
    faces = np.vstack([faces, [(0, 2, 6), (0, 6, 4), (1, 7, 3), (1, 5, 7)]])
    at, made_up = np.zeros(3), np.array([0.0, 40.0, 30.0])
    moved = along_body(Bone("tip", "", at, made_up), box[faces])
    assert moved.aside == pytest.approx(np.array([0.0, 0.0, 15.0])) and moved.tail == pytest.approx([0.0, 45.0, 15.0])
    line = joints({"a": Bone("a", "", np.array([0.0, -40.0, 0.0]), at), "tip": moved}, Chain(("a", "tip")))
    assert line == pytest.approx(np.array([[0.0, -40.0, 15.0], [0.0, 0.0, 15.0], [0.0, 45.0, 15.0]]))
    inside = Bone("tip", "", np.array([0.0, 0.0, 15.0]), made_up)
    assert along_body(inside, box[faces]) is inside
    ball = box * (1.5, 0.5, 1.0)  # as long as wide: it shows no direction
    assert along_body(Bone("tip", "", at, made_up), ball[faces]).aside is None
    assert along_body(Bone("tip", "", at, made_up), np.zeros((4, 3, 3))).aside is None


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("body", [False, True])
def test_fingers_without_names_are_told_apart_by_how_they_lie(side: str, body: bool) -> None:
    mirror = np.array([-1.0 if side == "L" else 1.0, 1.0, 1.0])
    bones = {"palm": Bone("palm", "arm" if body else "", np.zeros(3), np.array([0.0, 60.0, 0.0]))}
    if body:  # a trunk with legs is no hand
        bones |= {n: bone(n, "root" if n != "root" else "") for n in ("root", "arm", "leg 1", "leg 2", "head")}
    for finger, (line, _) in hand_rigs.joints().items():
        parent = "palm"
        for i in range(3):
            name = f"{finger[::-1]} {i}"
            bones[name] = Bone(name, parent, line[i] * mirror, line[i + 1] * mirror)
            parent = name
    (hand,) = found_hands(bones)
    assert hand.wrist == "palm" and not hand.named
    assert {finger: chain.last for finger, chain in hand.chains.items()} == {f: f"{f[::-1]} 2" for f in FINGERS}


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("elbow", [(-100.0, -250.0, 0.0), (-200.0, -150.0, 150.0), (-250.0, -50.0, 0.0)])
def test_a_forearm_that_carries_all_metacarpals_begins_at_no_wrist(elbow: tuple[float, ...], side: str) -> None:
    """Seen from such an elbow, the little finger points away, and the thumb lies among the others."""
    mirror = np.array([-1.0 if side == "L" else 1.0, 1.0, 1.0])
    bones = {"arm": Bone("arm", "", np.array(elbow) * mirror, np.zeros(3))}
    for finger, (line, _) in hand_rigs.joints(30.0).items():
        points, parent = np.vstack([np.zeros(3), line]) * mirror, "arm"
        for i in range(4):
            name = f"{finger[::-1]} {i}"
            bones[name] = Bone(name, parent, points[i], points[i + 1])
            parent = name
    (hand,) = found_hands(bones)
    assert hand.wrist == "arm"
    assert {finger: chain.last for finger, chain in hand.chains.items()} == {f: f"{f[::-1]} 3" for f in FINGERS}
    assert wrist_at(bones, "arm", hand.chains.values()) == pytest.approx(np.zeros(3))


def test_a_hand_without_a_thumb_has_none() -> None:
    bones = {"palm": bone("palm")}
    for i in range(4):
        for p in range(3):
            at = np.array([20.0 * i, 90.0 + 20.0 * p, 0.0])
            parent = f"{i} {p - 1}" if p else "palm"
            bones[f"{i} {p}"] = Bone(f"{i} {p}", parent, at, at + np.array([0.0, 20.0, 0.0]))
    (hand,) = found_hands(bones)
    assert set(hand.chains) == set(FINGERS[1:])
    assert [hand.chains[f].last for f in FINGERS[1:]] in (
        [f"{i} 2" for i in range(4)],
        [f"{3 - i} 2" for i in range(4)],
    )


@pytest.mark.parametrize("length", [20.0, 60.0])
def test_a_robots_thumb_that_lies_across_the_palm_is_one_however_long_it_is(length: float) -> None:
    bones = {"palm": bone("palm")}
    ways = ([-1.0, 0.0, -0.2], [-0.2, 1.0, 0.0], [0.0, 1.0, 0.0], [0.2, 1.0, 0.0])
    for i, way in enumerate(ways):
        for p in range(3):
            step = (length if i == 0 else 25.0) * np.array(way)
            at = np.array([-20.0, 10.0, 0.0] if i == 0 else [20.0 * i - 40.0, 60.0, 0.0]) + p * step
            bones[f"{i} {p}"] = Bone(f"{i} {p}", f"{i} {p - 1}" if p else "palm", at, at + step)
    (hand,) = found_hands(bones)
    assert [hand.chains[f].last for f in FINGERS[:4]] == ["0 2", "1 2", "2 2", "3 2"]
    assert set(hand.chains) == set(FINGERS[:4])


def test_feet_and_faces_are_no_hands() -> None:
    bones = {"head": bone("head")} | {f"face {i}": bone(f"face {i}", "head") for i in range(4)}
    assert found_hands(bones) == []
    assert found_hands({"lip_middle.L": bone("lip_middle.L")}) == []


@pytest.mark.parametrize("kind", hand_schemes.KINDS)
@pytest.mark.parametrize("scheme", hand_schemes.SCHEMES)
def test_every_scheme_of_names_gives_the_same_fingers(scheme: str, kind: str) -> None:
    for side in "LR":
        found = hand_schemes.miss(kind, scheme, side)
        assert found.wrong == 0 and found.pad_mm < 1.0, (side, found)


@pytest.mark.parametrize("scheme", hand_rigs.SKELETONS)
def test_every_skeleton_gives_the_same_fingers(scheme: str) -> None:
    for side in "LR":
        found = hand_schemes.skeleton_miss(scheme, side)
        assert found.wrong == 0 and found.pad_mm < 1.0, (side, found)
