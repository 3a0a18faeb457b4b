"""Hands under the naming schemes of many tools and languages, and how far fingers land from where they belong.

Each scheme renames Rigify's metarig, with and without bones at the ends of its fingers, and a made hand with its skin.
Skeletons of trackers, games and tools have bones of their own beside the fingers'.
The reference of each is the same hand under names that are read without doubt.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import bpy
import numpy as np

from . import hand_rigs
from .hand_rigs import FINGERS

Name = Callable[[str, int, str], str]  # of a finger's bone at a place: 0 in the palm, 1 to 3 phalanges, 4 an end

CLINICAL = ("CMC", "MCP", "PIP", "DIP", "TIP")
CLINICAL_THUMB = ("carpal", "CMC", "MCP", "IP", "TIP")
SHADOW = dict(zip(FINGERS, ("th", "ff", "mf", "rf", "lf"), strict=True))
GERMAN = dict(zip(FINGERS, ("Daumen", "Zeigefinger", "Mittelfinger", "Ringfinger", "KleinerFinger"), strict=True))
FRENCH = dict(zip(FINGERS, ("pouce", "index", "majeur", "annulaire", "auriculaire"), strict=True))
LATIN = ("metacarpal", "proximal", "middle", "distal", "tip")


def _clinical(finger: str, place: int, side: str) -> str:
    return f"{finger}_{(CLINICAL_THUMB if finger == 'thumb' else CLINICAL)[place]}.{side}"


def _clinical_ends(finger: str, place: int, side: str) -> str:
    """Return names of the joints where bones end: the bone that ends in the tip moves it."""
    return f"{finger}_{('MCP', 'PIP', 'DIP', 'TIP', 'NIL')[place]}.{side}"


SCHEMES: dict[str, Name] = {
    "MCP PIP DIP TIP": _clinical,
    "MCP PIP DIP TIP, palm first": _clinical_ends,
    "a b c": lambda finger, place, side: f"{finger}_{'mabce'[place]}.{side}",
    "A to E along a finger": lambda finger, place, side: f"{finger}{'ABCDE'[place]}_{side}",
    "A to E from the thumb": lambda finger, place, side: f"finger_{'ABCDE'[FINGERS.index(finger)]}_{place}.{side}",
    "ff mf rf lf th": lambda finger, place, side: f"{side.lower()}h_{SHADOW[finger]}{LATIN[place]}",
    "ff1": lambda finger, place, side: f"{SHADOW[finger]}{place}.{side}",
    "German": lambda finger, place, side: f"{GERMAN[finger]}{place}.{side}",
    "German, links": lambda finger, place, side: f"{GERMAN[finger]}_{place}_{ {'L': 'links', 'R': 'rechts'}[side] }",
    "French": lambda finger, place, side: f"{FRENCH[finger]}_{place}.{ {'L': 'G', 'R': 'D'}[side] }",
    "digit1_prox": lambda finger, place, side: (
        f"digit{FINGERS.index(finger) + 1}_{('meta', 'prox', 'mid', 'dist', 'tip')[place]}.{side}"
    ),
    "Mixamo": lambda finger, place, side: hand_rigs.mixamo(finger, place, side) or "",
    "nameless": lambda finger, place, side: f"Bone.{ord(side)}{FINGERS.index(finger)}{place}",
}
KINDS = ("metarig", "metarig with ends", "skin", "skin and ends", "ends")


class Miss(NamedTuple):
    """How fingers of a scheme differ from the reference: fingers on wrong bones, and the farthest pad [mm]."""

    wrong: int
    pad_mm: float


def misses() -> Iterator[tuple[str, str, Miss]]:
    """Yield each kind of hand and scheme with its misses."""
    for kind in KINDS:
        for scheme in SCHEMES:
            yield kind, scheme, miss(kind, scheme)
    for scheme in hand_rigs.SKELETONS:
        yield "own bones", scheme, skeleton_miss(scheme)


def skeleton_miss(scheme: str, side: str = "R") -> Miss:
    """Attach fingers to a hand with the bones of a tracker, game or tool, and compare them with the plainly named."""
    wanted = _reference("skin and ends", side)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    rig = hand_rigs.skeleton(scheme, side)
    found = _attach(side)
    wrong = [f for f in FINGERS if f not in found or found[f].parent_bone != rig.last[f]]
    pads = [_apart(found[f], wanted[f][1]) if f in found else np.inf for f in FINGERS]
    return Miss(len(wrong), 1e3 * max(pads))


def _apart(finger: bpy.types.Object, pad: np.ndarray) -> float:
    """Return the distance of a finger's pad from a place [m]."""
    return float(np.linalg.norm(np.array(finger.matrix_world.translation) - pad))


def _attach(side: str) -> dict[str, bpy.types.Object]:
    """Attach fingers to the hand of a side; return them by their names' first word."""
    bpy.context.view_layer.objects.active = next(o for o in bpy.data.objects if o.type == "ARMATURE")
    bpy.ops.dermis.attach_fingers(hand=side)
    bpy.context.view_layer.update()
    return {o.name.split(".")[0].lower(): o for o in bpy.context.scene.objects if o.dermis.role == "FINGER"}


def miss(kind: str, scheme: str, side: str = "R") -> Miss:
    """Attach fingers to a hand of a kind under a scheme and under plain names, and compare them."""
    wanted, found = _reference(kind, side), _attached(kind, SCHEMES[scheme], side)
    lost = [finger for finger in wanted if finger not in found or found[finger][0] != wanted[finger][0]]
    pads = [float(np.linalg.norm(found[f][1] - wanted[f][1])) if f in found else np.inf for f in wanted]
    return Miss(len(lost), 1e3 * max(pads))


def _plain(finger: str, place: int, side: str) -> str:
    return f"{finger}_{('metacarpal', '01', '02', '03', 'end')[place]}_{side.lower()}"


@functools.cache
def _reference(kind: str, side: str) -> dict[str, tuple[int, np.ndarray]]:
    return _attached(kind, _plain, side)


def _attached(kind: str, name: Name, side: str) -> dict[str, tuple[int, np.ndarray]]:
    """Return the place along its finger of the bone that carries each fingertip, and its pad in metres (3,)."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if kind.startswith("metarig"):
        places = _metarig(name, ends=kind != "metarig")
    else:
        hand_rigs.hand(name, side, wrist=f"Palm.{side}", ends="ends" in kind, skin="skin" in kind)
        places = {name(finger, place, side): (finger, place) for finger in FINGERS for place in range(1, 5)}
    found = {}
    for name, obj in _attach(side).items():
        finger, place = places.get(obj.parent_bone, ("", 0))
        found[name] = (place if name == finger else -1, np.array(obj.matrix_world.translation))
    return found


def _metarig(name: Name, *, ends: bool) -> dict[str, tuple[str, int]]:
    """Add Rigify's metarig, rename both hands' bones, and return each new name's finger and place."""
    armature = hand_rigs.rigify()
    bpy.ops.object.mode_set(mode="EDIT")
    bones, places = armature.data.edit_bones, {}
    for side in "LR":
        for i, finger in enumerate(FINGERS):
            stem = "thumb" if finger == "thumb" else f"f_{ {'little': 'pinky'}.get(finger, finger) }"
            own = [bones[f"{stem}.{place:02d}.{side}"] for place in (1, 2, 3)]
            if i:
                own.insert(0, bones[f"palm.{i:02d}.{side}"])
            if ends:
                end = bones.new("end")
                end.head, end.tail = own[-1].tail, 2.0 * own[-1].tail - own[-1].head
                end.parent = own[-1]
                own.append(end)
            for place, bone in enumerate(own, 0 if i else 1):
                bone.name = name(finger, place, side)
                places[bone.name] = (finger, place)
    bpy.ops.object.mode_set(mode="OBJECT")
    return places
