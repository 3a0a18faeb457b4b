"""Read an armature: its bones, the skin round them, and its hands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import bpy
import numpy as np

from .._core import Array, DermisError
from . import armatures
from .bone_names import LEFT, RIGHT
from .bound_skin import BoundSkin, bound_skin, own_skin
from .fingertip_fit import FEWEST
from .nails import Nails, bend_of_turns, curl, nails
from .readings import found_hands
from .skeleton import Bone, Chain, Hand, along_body, ancestors, joints, wrist_at


@dataclass(frozen=True)
class Rig:
    """The armatures, or the linked parts, that fingers are attached to.

    Attributes:
        armatures: the armatures, that of the active object first; several form one hand. Without armatures, the parts.
        places: armature and own name of each bone.
        hands: the hands, those that the active bone selects first.
        fingers: names of the fingers that are attached already, by bone.
        picked: whether an active bone selects some of the hands.
    """

    armatures: tuple[bpy.types.Object, ...]
    places: Mapping[str, tuple[bpy.types.Object, str]]
    bones: Mapping[str, Bone]
    skin: BoundSkin
    hands: tuple[Hand, ...]
    fingers: Mapping[str, str]
    picked: bool

    @property
    def has_bones(self) -> bool:
        """Whether it has armatures; else its parts serve as bones."""
        return self.armatures[0].type == "ARMATURE"

    @property
    def where(self) -> str:
        """The place that errors name."""
        if not self.has_bones:
            return f"object '{self.armatures[0].name}' and its parts"
        return ", ".join(f"armature '{armature.name}'" for armature in self.armatures)

    def by_side(self) -> dict[str, Hand]:
        """Return the first hand of each side, by `side_of`."""
        found: dict[str, Hand] = {}
        for hand in self.hands:
            found.setdefault(self.side_of(hand), hand)
        return found

    def side_of(self, hand: Hand) -> str:
        """Return a hand's side, 'L' or 'R'; '' if it is unknown.

        The side is taken from names, else from the position of the bones.
        """
        return hand.side or self.nails(hand).side

    def nails(self, hand: Hand) -> Nails:
        """Return the directions of a hand's nails at rest."""
        lines, bends = {}, {}
        turns = {f: [armatures.to_middle(*self.places[b]) for b in chain.bones] for f, chain in hand.chains.items()}
        bounded = any(turn is not None for own in turns.values() for turn in own)
        for finger, chain in hand.chains.items():
            lines[finger] = line = joints(self.bones, chain)
            if bounded:
                bends[finger] = bend_of_turns(line, turns[finger], finger)
                continue
            moves = [self.move(bone) for bone in (*chain.bones, chain.last)]
            posed = [move[:3, :3] @ point + move[:3, 3] for move, point in zip(moves, line, strict=True)]
            bends[finger] = rotation(moves[-1]).T @ curl(np.array(posed), finger, not self.has_bones)
        side = hand.side
        # A mirrored right hand is a left one. A person says what the hand is as it is seen.
        if self.armatures[0].matrix_world.determinant() < 0.0 and not hand.given:
            side = {LEFT: RIGHT, RIGHT: LEFT}.get(side, side)
        wrist = wrist_at(self.bones, hand.wrist, hand.chains.values())
        return nails(lines, wrist, side, bends, given=hand.given, rigid=not self.has_bones, bounded=bounded)

    def move(self, bone: str) -> Array:
        """Return the matrix from the rest of a bone to its pose, shape (4, 4)."""
        return armatures.pose_of(*self.places[bone])

    def skin_of(self, chain: Chain) -> Array | None:
        """Return the skin round a chain's last bone at rest, as triangles.

        If too few triangles follow it, as on a coarse mesh, those of the bone before are returned, too. Their shape is
        (t, 3, 3). The result is None if there is no skin.
        """
        skin = self.skin.round(chain.last, chain.end)
        if skin is None or len(skin) < FEWEST:
            skin = self.skin.round(*chain.bones[-2:], chain.end)
        if skin is None:
            return None
        back = np.linalg.inv(self.move(chain.last))
        rested: Array = skin @ back[:3, :3].T + back[:3, 3]
        return rested

    def has_skin(self, hand: Hand) -> bool:
        """Return whether vertices follow any of a hand's fingertips."""
        return not self.skin.bones.isdisjoint(chain.last for chain in hand.chains.values())


def read(context: bpy.types.Context) -> Rig:
    """Return the rig of the active object.

    Raises:
        DermisError: no armature is selected, or it has no bones or a scale of zero.
    """
    armature = armatures.armature_of(context.object)
    if armature is None and armatures.part_of_hand(context.object):
        return _of_parts(context, armatures.linked_parts(context.object))
    if armature is None:
        raise DermisError(
            "no hand is selected",
            where=f"object '{context.object.name}'" if context.object else "",
            remedy="Select an armature, one of its bones, or a mesh that it moves. On a mesh without bones, add single "
            "fingers and parent them",
        )
    _judge(armature)
    if context.mode == "OBJECT":
        selected = dict.fromkeys(filter(None, map(armatures.armature_of, context.selected_objects)))
        parts = [part for part in selected if part.data.bones and armatures.sized(part)]
        if len(parts) < 2:  # one armature of a hand that has several is selected
            parts = armatures.beside(armature)
        if len(parts) > 1 and not any(_of(context, (part,)).hands for part in parts):
            several = _of(context, (armature, *(part for part in parts if part != armature)))
            if several.hands:
                return several
    return _of(context, (armature,))


def _judge(armature: bpy.types.Object) -> None:
    """Raise a `DermisError` for an armature without bones or of zero scale."""
    where = f"armature '{armature.name}'"
    if not armature.data.bones:
        raise DermisError("it has no bones", where=where, remedy="Choose another one")
    if not armatures.sized(armature):
        raise DermisError("its scale is zero", where=where, remedy="Give it a scale")


def _of(context: bpy.types.Context, parts: tuple[bpy.types.Object, ...]) -> Rig:
    """Return armatures as one rig."""
    places, bones = armatures.bones_of(parts)
    keys = {place: key for key, place in places.items()}
    triangles: dict[str, Array] = {}
    for part in parts:
        found = bound_skin(part, context).triangles
        triangles |= {keys[part, bone]: own for bone, own in found.items()}
    picked = parts[0].data.bones.active if context.mode == "POSE" else None
    active = keys[parts[0], picked.name] if picked is not None else ""
    hands = found_hands(bones, triangles.keys())
    if not hands and active:
        hands = [Hand("", "", {"index": Chain(tuple(ancestors(bones, active)[:3][::-1]))})]
    near = armatures.meant(hands, bones, active)
    there = {
        keys[part, child.parent_bone]: child.name
        for part in parts
        for child in part.children
        if child.dermis.role == "FINGER" and child.parent_type == "BONE" and (part, child.parent_bone) in keys
    }
    order = tuple(near + [hand for hand in hands if hand not in near])
    return Rig(parts, places, bones, BoundSkin(triangles), order, there, len(near) < len(hands))


def _of_parts(context: bpy.types.Context, parts: tuple[bpy.types.Object, ...]) -> Rig:
    """Return parts without an armature as one rig."""
    places, bones, body = armatures.bones_of_parts(parts)
    skin = own_skin(parts, body, context)
    carrying = {bone.parent for bone in bones.values() if bone.name in skin.bones}
    for name in skin.bones - carrying:
        bones[name] = along_body(bones[name], skin.triangles[name])
    carried = ((part.name, child) for part in parts for child in part.children)
    there = {body.get(name, name): child.name for name, child in carried if child.dermis.role == "FINGER"}
    return Rig(parts, places, bones, skin, tuple(found_hands(bones, skin.bones)), there, picked=False)


def rotation(matrix: Array) -> Array:
    """Return the rotation nearest to a matrix, without its scale."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    turned: Array = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return turned
