"""An armature as it is now: its bones, the skin round them, and its hands, those meant first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import bpy
import numpy as np

from .._core import Array, DermisError
from . import armatures
from .bone_names import LEFT, RIGHT
from .bound_skin import BoundSkin, bound_skin
from .nails import Nails, curl, nails
from .readings import found_hands
from .skeleton import Bone, Chain, Hand, ancestors, joints


@dataclass(frozen=True)
class Rig:
    """What fingers are attached to.

    Attributes:
        fingers: names of the fingers that hang on bones already, by bone. picked: an active bone says which hand.
    """

    armature: bpy.types.Object
    bones: Mapping[str, Bone]
    skin: BoundSkin
    hands: tuple[Hand, ...]
    fingers: Mapping[str, str]
    picked: bool

    @property
    def where(self) -> str:
        """What refusals are about."""
        return f"armature '{self.armature.name}'"

    def by_side(self) -> dict[str, Hand]:
        """Return the hands by side ('L', 'R'), those meant first; where names do not say, as their bones lie."""
        found: dict[str, Hand] = {}
        for hand in self.hands:
            found.setdefault(hand.side or self.nails(hand).side or RIGHT, hand)
        return found

    def nails(self, hand: Hand) -> Nails:
        """Return where a hand's nails look at rest."""
        lines, bends = {}, {}
        for finger, chain in hand.chains.items():
            lines[finger] = line = joints(self.bones, chain)
            moves = [self.move(bone) for bone in (*chain.bones, chain.last)]
            posed = [move[:3, :3] @ point + move[:3, 3] for move, point in zip(moves, line, strict=True)]
            bends[finger] = rotation(moves[-1]).T @ curl(np.array(posed), finger)
        side = hand.side
        if self.armature.matrix_world.determinant() < 0.0:  # a mirrored right hand is a left one
            side = {LEFT: RIGHT, RIGHT: LEFT}.get(side, side)
        return nails(lines, self.bones[hand.wrist].head if hand.wrist else None, side, bends)

    def move(self, bone: str) -> Array:
        """Return how a bone's pose moves what rests, in the scene's space, shape (4, 4)."""
        return armatures.pose_of(self.armature, bone)

    def skin_of(self, chain: Chain) -> Array | None:
        """Return the triangles round a chain's last bone as they lie at rest, shape (t, 3, 3); None without any."""
        skin = self.skin.round(chain.last, chain.end)
        if skin is None:
            return None
        back = np.linalg.inv(self.move(chain.last))
        rested: Array = skin @ back[:3, :3].T + back[:3, 3]
        return rested


def read(context: bpy.types.Context) -> Rig:
    """Return the active object's armature and its hands.

    Raises:
        DermisError: no armature is selected, or none with bones and a size.
    """
    armature = armatures.armature_of(context.object)
    if armature is None:
        raise DermisError(
            "no hand is selected",
            where=f"object '{context.object.name}'" if context.object else "",
            remedy="Select an armature, one of its bones, or a mesh that it moves. On a mesh without bones, add single "
            "fingers and parent them",
        )
    where = f"armature '{armature.name}'"
    if not armature.data.bones:
        raise DermisError("it has no bones", where=where, remedy="Choose another one")
    if abs(armature.matrix_world.determinant()) < 1e-30:
        raise DermisError("its scale is zero", where=where, remedy="Give it a scale")
    bones, skin = armatures.bones_of(armature), bound_skin(armature, context)
    active = armature.data.bones.active if context.mode == "POSE" else None
    hands = found_hands(bones, skin.bones)
    if not hands and active is not None:
        hands = [Hand("", "", {"index": Chain(tuple(ancestors(bones, active.name)[:3][::-1]))})]
    near = armatures.meant(hands, bones, active.name if active is not None else "")
    there = {
        child.parent_bone: child.name
        for child in armature.children
        if child.dermis.role == "FINGER" and child.parent_type == "BONE"
    }
    order = tuple(near + [hand for hand in hands if hand not in near])
    return Rig(armature, bones, skin, order, there, len(near) < len(hands))


def rotation(matrix: Array) -> Array:
    """Return the rotation nearest to a matrix, without its scale."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    turned: Array = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return turned
