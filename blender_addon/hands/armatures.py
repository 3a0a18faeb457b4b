"""Armatures as the hand finder wants them: bones at rest in the scene's space, and how a pose moves them."""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np
from mathutils import Matrix

from .._core import Array
from .bone_names import side_of
from .skeleton import Bone, Hand, ancestors


def armature_of(obj: bpy.types.Object | None) -> bpy.types.Object | None:
    """Return the armature that an object is, that deforms it, or that it hangs on; None without one."""
    while obj is not None:
        if obj.type == "ARMATURE":
            return obj
        for modifier in obj.modifiers:
            if modifier.type == "ARMATURE" and modifier.object is not None:
                return modifier.object
        obj = obj.parent
    return None


def bones_of(armature: bpy.types.Object) -> dict[str, Bone]:
    """Return all bones of an armature, by name."""
    to_world = np.array(armature.matrix_world, np.float64)

    def placed(point: Array) -> Array:
        return to_world[:3, :3] @ np.array(point, np.float64) + to_world[:3, 3]

    return {
        bone.name: Bone(
            bone.name,
            bone.parent.name if bone.parent else "",
            placed(bone.head_local),
            placed(bone.tail_local),
            bone.use_deform,
        )
        for bone in armature.data.bones
    }


def pose_of(armature: bpy.types.Object, bone: str) -> Array:
    """Return how a bone's pose moves what rests, in the scene's space, shape (4, 4)."""
    world, posed = armature.matrix_world, armature.pose.bones[bone]
    return np.array(world @ posed.matrix @ posed.bone.matrix_local.inverted() @ world.inverted(), np.float64)


def carrier(armature: bpy.types.Object, bone: str) -> Matrix:
    """Return the matrix on which children of a bone hang: its own, at the bone's end."""
    posed = armature.pose.bones[bone]
    return armature.matrix_world @ posed.matrix @ Matrix.Translation((0.0, posed.bone.length, 0.0))


def meant(hands: list[Hand], bones: Mapping[str, Bone], active: str) -> list[Hand]:
    """Return the hands that an active bone belongs to: its own, those on its side, else all of them."""
    if active not in bones:
        return hands
    near = [hand for hand in hands if _touches(hand, bones, active)]
    if not near and (side := side_of(active)):
        near = [hand for hand in hands if hand.side == side]
    return near or hands


def _touches(hand: Hand, bones: Mapping[str, Bone], active: str) -> bool:
    """Return whether a bone is of a hand, or carries it and no other's."""
    own = {name for chain in hand.chains.values() for name in (*chain.bones, chain.end)}
    above = ancestors(bones, active)
    return bool(own.intersection(above)) or (bool(hand.wrist) and hand.wrist in above)
