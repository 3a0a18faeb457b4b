"""Armatures of hands for tests: Rigify's own metarig, and one hand under the names of other tools.

The made hand is a right one at rest, palm down (-Z), fingers along +Y, thumb towards -X, in millimetres; its bones are
rolled at random, and where an importer would make up their ends they point anywhere. Left hands are its mirror image.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .build import CUBE, CUBE_FACES, empty, mesh_object

FINGERS = ("thumb", "index", "middle", "ring", "little")
KNUCKLES = {
    "thumb": (-20.0, 25.0, -8.0),
    "index": (-24.0, 90.0, 0.0),
    "middle": (-5.0, 94.0, 3.0),
    "ring": (14.0, 90.0, 1.0),
    "little": (31.0, 82.0, -3.0),
}
LENGTHS = {  # of the phalanges
    "thumb": (44.0, 34.0, 29.0),
    "index": (42.0, 25.0, 24.0),
    "middle": (46.0, 29.0, 25.0),
    "ring": (43.0, 27.0, 25.0),
    "little": (34.0, 20.0, 21.0),
}
SPREAD = {"index": 5.0, "middle": 0.0, "ring": -5.0, "little": -12.0}  # degrees
WIDTH = {"thumb": 20.0, "index": 16.0, "middle": 17.0, "ring": 15.5, "little": 13.5}
UNREAL = {"little": "pinky"}
WEBXR = {1: "phalanx-proximal", 2: "phalanx-intermediate", 3: "phalanx-distal", 4: "tip"}


def unreal(finger: str, place: int, side: str) -> str | None:
    """Return `index_03_l`."""
    return f"{UNREAL.get(finger, finger)}_{place:02d}_{side.lower()}" if place < 4 else None


def mixamo(finger: str, place: int, side: str) -> str | None:
    """Return `mixamorig:LeftHandIndex3`; the fourth is an end."""
    return f"mixamorig:{'Left' if side == 'L' else 'Right'}Hand{UNREAL.get(finger, finger).title()}{place}"


def makehuman(finger: str, place: int, side: str) -> str | None:
    """Return `finger2-3.L`."""
    return f"finger{FINGERS.index(finger) + 1}-{place}.{side}" if place < 4 else None


def webxr(finger: str, place: int, _side: str) -> str | None:
    """Return `index-finger-phalanx-distal`; a thumb's first is its metacarpal, and no side is named."""
    if finger == "thumb":
        return f"thumb-{ {1: 'metacarpal', 2: 'phalanx-proximal', 3: 'phalanx-distal', 4: 'tip'}[place] }"
    return f"{UNREAL.get(finger, finger)}-finger-{WEBXR[place]}"


def nameless(finger: str, place: int, _side: str) -> str | None:
    """Return `Bone.012`."""
    return f"Bone.{3 * FINGERS.index(finger) + place:03d}" if place < 4 else None


@dataclass
class HandRig:
    """A made hand: its armature, its skin (None without), and the truth, in the scene's space and units.

    Attributes:
        last: bone that carries each fingertip. tips, nails: where fingers end, and where their nails look.
    """

    armature: bpy.types.Object
    skin: bpy.types.Object | None
    last: dict[str, str]
    tips: dict[str, np.ndarray]
    nails: dict[str, np.ndarray]


def joints(bend: float = 12.0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return each finger's four joints (4, 3) and the nail's direction at each phalanx (3, 3), of a right hand [mm].

    Args:
        bend: of each joint, in degrees.
    """
    found = {}
    for finger in FINGERS:
        if finger == "thumb":
            way, nail = unit(np.array([-0.62, 0.72, -0.3])), np.array([-0.9, 0.0, 0.45])
        else:
            turn = np.radians(SPREAD[finger])
            way, nail = np.array([-np.sin(turn), np.cos(turn), 0.0]), np.array([0.0, 0.0, 1.0])
        nail = unit(nail - (nail @ way) * way)
        line, nails = [np.array(KNUCKLES[finger])], []
        for i, length in enumerate(LENGTHS[finger]):
            # A thumb bends in its last joint alone; fingers in all, the knuckle too.
            angle = np.radians(bend if finger != "thumb" or i == 2 else 0.0)
            way, nail = np.cos(angle) * way - np.sin(angle) * nail, np.cos(angle) * nail + np.sin(angle) * way
            line.append(line[-1] + length * way)
            nails.append(nail)
        found[finger] = (np.array(line), np.array(nails))
    return found


def hand(
    name: Callable[[str, int, str], str | None],
    side: str = "R",
    *,
    wrist: str = "",
    bend: float = 12.0,
    ends: bool = False,
    flat: bool = False,
    made_up: bool = False,
    skin: bool = True,
    scale: float = 1e-3,
    placed: Matrix | None = None,
    object_scale: float = 1.0,
    fingers: tuple[str, ...] = FINGERS,
) -> HandRig:
    """Make a hand.

    Args:
        name: of the bone of a finger at a place (1 to 3, 4 an end) of a side; None leaves it out.
        wrist: name of the palm's bone, '' for none; parents of bones exist with it only.
        ends: there are bones at the ends. flat: bones have no parents. made_up: bones end anywhere.
        scale: scene units in a millimetre. placed: where the hand is. object_scale: of the armature, whose data is
            smaller by as much.
    """
    mirror = np.array([-1.0 if side == "L" else 1.0, 1.0, 1.0])
    data = bpy.data.armatures.new("Armature")
    armature = bpy.data.objects.new("Armature", data)
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    rng = np.random.default_rng(5)
    inner = scale / object_scale
    palm = None
    if wrist:
        palm = data.edit_bones.new(wrist)
        palm.head, palm.tail = (0.0, 0.0, 0.0), (0.0, 60.0 * inner, 0.0)
    last: dict[str, str] = {}
    truth = joints(bend)
    for finger in fingers:
        line = truth[finger][0] * mirror * inner
        parent = palm
        for place in range(1, 5 if ends else 4):
            called = name(finger, place, side)
            if called is None:
                continue
            bone = data.edit_bones.new(called)
            bone.head = line[place - 1]
            ahead = line[min(place, 3)] - line[min(place, 3) - 1]
            size = np.linalg.norm(ahead)
            bone.tail = bone.head + Vector(unit(rng.normal(size=3)) * 2 * size if made_up else ahead)
            bone.roll = rng.uniform(-3.0, 3.0)
            bone.parent = None if flat else parent
            parent = bone
            if place == 3:
                last[finger] = bone.name
    bpy.ops.object.mode_set(mode="OBJECT")
    armature.matrix_world = (placed or Matrix.Identity(4)) @ Matrix.Scale(object_scale, 4)
    bpy.context.view_layer.update()
    world = np.array(placed or Matrix.Identity(4))
    made = _skin(armature, truth, name, side, mirror, inner, fingers) if skin else None
    return HandRig(
        armature,
        made,
        last,
        {f: world[:3, :3] @ (truth[f][0][-1] * mirror * scale) + world[:3, 3] for f in fingers},
        {f: unit(world[:3, :3] @ (truth[f][1][-1] * mirror)) for f in fingers},
    )


Helper = tuple[str, str, tuple[float, float, float] | str]


@dataclass(frozen=True)
class Skeleton:
    """The bones of a hand as a tracking system, a game or a rigging tool has them, beside those of `hand`.

    Attributes:
        name: of the bone of a finger at a place: 0 in the palm, 1 to 3 phalanges, 4 an end; None without one.
        above: names of the bones from the root to the wrist, by side. helpers: bones that carry no phalanx, by side: a
            name, the parent's name, and where it is [mm], or the bone that it is at. on: parents of fingers whose first
            bone is not on the wrist, by side.
    """

    name: Callable[[str, int, str], str | None]
    above: Callable[[str], tuple[str, ...]]
    helpers: Callable[[str], tuple[Helper, ...]] = lambda _: ()
    on: Callable[[str], Mapping[str, str]] = lambda _: {}


def steamvr(finger: str, place: int, side: str) -> str | None:
    """Return `finger_index_meta_r`, `finger_index_2_r` for the last phalanx, `finger_index_r_end`."""
    s, finger = side.lower(), UNREAL.get(finger, finger)
    if place == 0:
        return None if finger == "thumb" else f"finger_{finger}_meta_{s}"
    return f"finger_{finger}_{s}_end" if place == 4 else f"finger_{finger}_{place - 1}_{s}"


def arkit(finger: str, place: int, side: str) -> str | None:
    """Return `left_handIndexStart_joint`, `left_handIndex_1_joint`, `left_handIndexEnd_joint`.

    A thumb has a bone less, which begins at its `Start`.
    """
    word = (
        {"L": "left", "R": "right"}[side] + "_hand" + {"middle": "Mid", "little": "Pinky"}.get(finger, finger.title())
    )
    if finger == "thumb":
        place -= 1
    if place < 0:
        return None
    end = 3 if finger == "thumb" else 4
    return f"{word}Start_joint" if place == 0 else f"{word}End_joint" if place == end else f"{word}_{place}_joint"


def visionos(finger: str, place: int, _side: str) -> str | None:
    """Return `indexFingerMetacarpal`, `indexFingerKnuckle`, `…IntermediateBase`, `…IntermediateTip`, `…Tip`."""
    if finger == "thumb" and place == 0:
        return None
    word = ("Metacarpal", "Knuckle", "IntermediateBase", "IntermediateTip", "Tip")[place]
    return f"thumb{word}" if finger == "thumb" else f"{finger}Finger{word}"


def openxr(finger: str, place: int, _side: str) -> str | None:
    """Return `XRHand_IndexProximal`; a thumb's first bone is its metacarpal."""
    if finger == "thumb":
        return None if place == 0 else f"XRHand_Thumb{('Metacarpal', 'Proximal', 'Distal', 'Tip')[place - 1]}"
    return f"XRHand_{finger.title()}{('Metacarpal', 'Proximal', 'Intermediate', 'Distal', 'Tip')[place]}"


def advanced(finger: str, place: int, side: str) -> str | None:
    """Return `IndexFinger3_R`; the fourth is an end."""
    return f"{UNREAL.get(finger, finger).title()}Finger{place}_{side}" if place else None


def second_life(finger: str, place: int, side: str) -> str | None:
    """Return `mHandIndex3Left`; there are no ends."""
    word = UNREAL.get(finger, finger).title()
    return f"mHand{word}{place}{ {'L': 'Left', 'R': 'Right'}[side] }" if 0 < place < 4 else None


def _long(side: str) -> str:
    return {"L": "left", "R": "right"}[side]


SKELETONS: dict[str, Skeleton] = {
    # Auxiliary bones of the root are where the last joints are.
    "SteamVR": Skeleton(
        steamvr,
        lambda side: ("Root", f"wrist_{side.lower()}"),
        lambda side: tuple(
            (f"finger_{UNREAL.get(finger, finger)}_{side.lower()}_aux", "Root", steamvr(finger, 3, side) or "")
            for finger in FINGERS
        ),
    ),
    "ARKit": Skeleton(
        arkit,
        lambda side: (
            *("root", "hips_joint", *(f"spine_{i}_joint" for i in range(1, 8))),
            *(f"{_long(side)}_{part}_joint" for part in ("shoulder_1", "arm", "forearm", "hand")),
        ),
    ),
    # The forearm hangs on the wrist.
    "visionOS": Skeleton(
        visionos,
        lambda _: ("wrist",),
        lambda _: (("forearmWrist", "wrist", (0.0, -5.0, 0.0)), ("forearmArm", "forearmWrist", (0.0, -250.0, 0.0))),
    ),
    "OpenXR": Skeleton(openxr, lambda _: ("XRHand_Wrist",), lambda _: (("XRHand_Palm", "XRHand_Wrist", (0, 60, -4)),)),
    # Ring and little finger are on a bone that cups the palm; the arm has bones that share its twist.
    "AdvancedSkeleton": Skeleton(
        advanced,
        lambda side: ("Root_M", "Spine1_M", "Chest_M", *(f"{n}_{side}" for n in ("Shoulder", "Elbow", "Wrist"))),
        lambda side: (
            (f"ElbowPart1_{side}", f"Elbow_{side}", (0.0, -60.0, 0.0)),
            (f"Cup_{side}", f"Wrist_{side}", (10.0, 30.0, 0.0)),
        ),
        lambda side: dict.fromkeys(("ring", "little"), f"Cup_{side}"),
    ),
    # Volumes of collision are bones too.
    "Second Life": Skeleton(
        second_life,
        lambda side: (
            *("mPelvis", "mTorso", "mChest"),
            *(f"m{part}{_long(side).title()}" for part in ("Collar", "Shoulder", "Elbow", "Wrist")),
        ),
        lambda side: ((f"{side}_HAND", f"mWrist{_long(side).title()}", (0.0, 50.0, 0.0)),),
    ),
}
# Joints of two of them at rest, from the wrist on [mm]: Valve's open right hand (fingers forward along -Z, the thumb up
# along Y, the back along X), and Second Life's left hand (fingers along Y, the back along Z).
LOCATIONS: dict[str, dict[str, list[tuple[int, int, int]]]] = {
    "SteamVR": {
        "thumb": [(-18, 1, -35), (-23, 13, -73), (-28, 20, -105), (-33, 38, -128)],
        "index": [(-5, 8, -29), (9, -34, -89), (6, -62, -123), (6, -80, -145), (8, -95, -163)],
        "middle": [(0, -6, -17), (9, -54, -69), (9, -87, -96), (5, -112, -118), (6, -133, -133)],
        "ring": [(1, -16, -7), (7, -66, -49), (6, -102, -69), (4, -127, -82), (1, -147, -92)],
        "little": [(0, -24, 3), (5, -78, -29), (3, -107, -38), (-2, -124, -44), (-5, -141, -47)],
    },
    "Second Life": {
        "thumb": [(31, 26, 4), (59, 58, 3), (82, 89, 2), (97, 114, 2)],
        "index": [(38, 97, 15), (55, 133, 9), (69, 165, 3), (80, 190, -1)],
        "middle": [(13, 101, 15), (12, 141, 9), (11, 190, 1), (9, 223, -5)],
        "ring": [(-10, 99, 9), (-23, 137, 1), (-36, 177, -8), (-46, 205, -14)],
        "little": [(-31, 95, 3), (-55, 120, -3), (-70, 138, -7), (-83, 154, -11)],
    },
}


def skeleton(
    scheme: str,
    side: str = "R",
    *,
    bend: float = 12.0,
    skin: bool = True,
    made_up: bool = False,
    lines: Mapping[str, np.ndarray] | None = None,
) -> HandRig:
    """Make the hand of `hand`, in metres, with the bones of `SKELETONS`.

    Args:
        made_up: bones end anywhere. lines: joints of each finger from its first bone on, of the side [mm], else those
            of `joints`; a skin needs those.
    """
    kind = SKELETONS[scheme]
    mirror = np.array([-1.0 if side == "L" else 1.0, 1.0, 1.0])
    truth = joints(bend)
    rows: dict[str, tuple[str, np.ndarray]] = {}
    above = kind.above(side)
    for i, name in enumerate(above):
        rows[name] = above[i - 1] if i else "", np.array([0.0, -120.0 * (len(above) - 1 - i), 0.0])
    helpers = kind.helpers(side)
    for name, parent, at in helpers:
        if not isinstance(at, str):
            rows[name] = parent, np.array(at) * mirror
    last, tips = {}, {}
    for finger in FINGERS:
        own = [(kind.name(finger, place, side), place) for place in range(5)]
        there = [(name, place) for name, place in own if name is not None]
        if lines is None:
            line = truth[finger][0] * mirror
            line = np.vstack([0.3 * line[0], line]) if there[0][1] == 0 else line
        else:
            line = lines[finger]
        parent = kind.on(side).get(finger, above[-1])
        for (name, place), at in zip(there, line, strict=False):
            rows[name] = parent, at
            parent = name
            if place == 3:
                last[finger] = name
        tips[finger] = 1e-3 * line[-1]
    for name, parent, at in helpers:
        if isinstance(at, str):
            rows[name] = parent, rows[at][1]
    ends = {name: tips[finger] for finger, name in last.items()}
    armature = _armature({name: (parent, 1e-3 * at) for name, (parent, at) in rows.items()}, ends, made_up)
    made = _skin(armature, truth, kind.name, side, mirror, 1e-3, FINGERS) if skin else None
    nails = {finger: unit(truth[finger][1][-1] * mirror) for finger in FINGERS}
    return HandRig(armature, made, last, tips, nails)


def _armature(
    rows: Mapping[str, tuple[str, np.ndarray]], ends: Mapping[str, np.ndarray], made_up: bool
) -> bpy.types.Object:
    """Make an armature from each bone's parent and head; bones end at `ends`, at their first child, or anywhere."""
    data = bpy.data.armatures.new("Armature")
    armature = bpy.data.objects.new("Armature", data)
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    rng = np.random.default_rng(7)
    for name, (parent, head) in rows.items():
        bone = data.edit_bones.new(name)
        after = [ends[name]] if name in ends else [at for above, at in rows.values() if above == name]
        behind = head - rows[parent][1] if parent else np.array([0.0, 0.05, 0.0])
        ahead = after[0] - head if after else 0.8 * behind
        size = max(float(np.linalg.norm(ahead)), 0.01)
        bone.head = head
        bone.tail = head + (unit(rng.normal(size=3)) * 2 * size if made_up else size * unit(ahead))
        bone.roll = rng.uniform(-3.0, 3.0)
        bone.parent = data.edit_bones[parent] if parent else None
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    return armature


def limit_x(owner: bpy.types.Object | bpy.types.PoseBone, low: float, high: float) -> None:
    """Limit the rotation about the local X."""
    limit = owner.constraints.new("LIMIT_ROTATION")
    limit.owner_space, limit.use_limit_x, limit.min_x, limit.max_x = "LOCAL", True, low, high


Truth = Mapping[str, tuple[np.ndarray, np.ndarray]]


@dataclass
class LinkedHand:
    """A robot's hand as importers make it, from links with no armature.

    Attributes:
        last: the link that carries each fingertip. tips, nails: where the last bodies end, and where their backs look.
            knuckles: where they begin, in the middle of their fingers.
    """

    palm: bpy.types.Object
    last: dict[str, bpy.types.Object]
    tips: dict[str, np.ndarray]
    nails: dict[str, np.ndarray]
    knuckles: dict[str, np.ndarray]


def linked(
    side: str = "R",
    *,
    name: Callable[[str, int], str] = lambda finger, place: f"{'abcde'[FINGERS.index(finger)]}{place}",
    truth: Truth | None = None,
    wide: float = 16.0,
    thick: float = 14.0,
    beside: float = 0.0,
    ends: bool = True,
    behind: bool = False,
    laden: bool = False,
    limits: tuple[float, float] | None = None,
) -> LinkedHand:
    """Make a robot's hand: an empty for each link, which its body hangs on, and more for frames and ends.

    Args:
        name: of a link, by its finger and its place from 0. truth: joints and nails, as of `joints`.
        wide, thick: of the bodies. beside: distance of the links' frames from their fingers, along the axes of the
            joints [mm]. The first link's frame is moved out of the back too, as it lies anywhere along its own axis.
        ends: there are frames at the ends, and sensors before them. behind: a last link's body is not its own but hangs
            on the frame of its end, behind it. laden: bodies carry a frame. limits: range of the last two joints, a
            bend is positive [rad]; frames then have the axis of their joint as X.
    """

    def frame(
        called: str, parent: bpy.types.Object | None, at: np.ndarray, axes: np.ndarray | None = None
    ) -> bpy.types.Object:
        made = empty(called)
        made.parent = parent
        bpy.context.view_layer.update()
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.eye(3) if axes is None else axes, at
        made.matrix_world = Matrix(matrix.tolist())
        bpy.context.view_layer.update()
        return made

    def body(link: bpy.types.Object, axes: np.ndarray, at: np.ndarray, size: tuple[float, float, float]) -> None:
        made = mesh_object("Visual", np.array(CUBE) * size @ axes.T, CUBE_FACES)
        made.parent = link
        bpy.context.view_layer.update()
        made.matrix_world = Matrix.Translation(at.tolist())
        bpy.context.view_layer.update()
        if laden:
            frame("contact", made, at + 0.3 * size[2] * axes[:, 2])

    mirror = np.array([-1.0 if side == "L" else 1.0, 1.0, 1.0]) * 1e-3
    truth = truth or joints()
    palm = frame("base", frame("world", None, np.zeros(3)), np.zeros(3))
    body(palm, np.eye(3), np.array([0.0, 0.04, 0.0]), (0.06, 0.08, 0.02))
    frame("camera", palm, np.array([0.0, 0.05, 0.03]))
    made = LinkedHand(palm, {}, {}, {}, {})
    for finger, (line, nails) in truth.items():
        parent = palm
        for i in range(3):
            ahead, nail = (unit(way * mirror) for way in (line[i + 1] - line[i], nails[i]))
            axes = np.stack([np.cross(ahead, nail), ahead, nail], axis=1)
            off = 1e-3 * beside * axes[:, 0] + (1e-3 * beside * nail if i == 0 else 0.0)
            parent = frame(name(finger, i), parent, line[i] * mirror + off, axes if limits else None)
            if limits and i:
                limit_x(parent, -limits[1], -limits[0])
            size = (1e-3 * wide, float(np.linalg.norm((line[i + 1] - line[i]) * mirror)), 1e-3 * thick)
            middle = 0.5 * (line[i] + line[i + 1]) * mirror
            if i < 2 or not behind:
                body(parent, axes, middle, size)
        if ends:
            end = frame(f"end {finger}", parent, line[3] * mirror)
            frame(f"sensor {finger}", parent, 0.5 * (line[2] + line[3]) * mirror)
            if behind:
                body(end, axes, middle, size)
        made.last[finger], made.tips[finger] = parent, line[3] * mirror
        made.nails[finger], made.knuckles[finger] = unit(nails[2] * mirror), line[2] * mirror
    bpy.context.view_layer.objects.active = made.last["index"]
    return made


def rigify(rig: str = "human") -> bpy.types.Object:
    """Add Rigify's metarig as Blender ships it."""
    import addon_utils

    addon_utils.enable("rigify", default_set=True)
    getattr(bpy.ops.object, f"armature_{rig}_metarig_add")()
    return bpy.context.object


def unit(vector: np.ndarray) -> np.ndarray:
    """Return a direction."""
    return vector / np.linalg.norm(vector)


def _skin(
    armature: bpy.types.Object,
    truth: Mapping[str, tuple[np.ndarray, np.ndarray]],
    name: Callable[[str, int, str], str | None],
    side: str,
    mirror: np.ndarray,
    scale: float,
    fingers: tuple[str, ...],
) -> bpy.types.Object:
    """Make a mesh of rounded tubes round the phalanges, each vertex bound to its bone, in the armature's space."""
    vertices: list[np.ndarray] = []
    faces: list[tuple[int, ...]] = []
    groups: dict[str, list[int]] = {}
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    for finger in fingers:
        line, nails = truth[finger]
        for place in (1, 2, 3):
            called = name(finger, place, side)
            assert called is not None
            start, ahead, nail = line[place - 1], line[place] - line[place - 1], nails[place - 1]
            length, across = float(np.linalg.norm(ahead)), np.cross(unit(ahead), nail)
            first = len(vertices)
            steps = np.append(np.linspace(0.0, 0.6, 7), 0.6 + 0.4 * np.sin(np.linspace(0.1, np.pi / 2, 8)))
            for step in steps:
                # A last phalanx is round towards its tip.
                taper = np.sqrt(max(1.0 - max((step - 0.6) / 0.4, 0.0) ** 2, 1e-4)) if place == 3 else 1.0
                half, below = 0.5 * WIDTH[finger] * taper, 0.42 * WIDTH[finger] * taper
                for a in angle:
                    ring = half * np.cos(a) * across + below * np.sin(a) * nail
                    vertices.append(start + step * length * unit(ahead) + ring)
            for r in range(len(steps) - 1):
                a, b = first + r * len(angle), first + (r + 1) * len(angle)
                for i in range(len(angle)):
                    j = (i + 1) % len(angle)
                    faces.append((a + j, a + i, b + i, b + j) if mirror[0] > 0 else (a + i, a + j, b + j, b + i))
            groups.setdefault(called, []).extend(range(first, len(vertices)))
    obj = mesh_object("Skin", np.array(vertices) * mirror * scale, faces)
    for called, members in groups.items():
        obj.vertex_groups.new(name=called).add(members, 1.0, "REPLACE")
    obj.parent = armature
    modifier = obj.modifiers.new("Armature", "ARMATURE")
    modifier.object = armature
    bpy.context.view_layer.update()
    return obj
