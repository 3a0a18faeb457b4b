"""Read armatures: bones at rest in the scene's space, and their poses."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Matrix

from .._core import Array
from .bone_names import side_of
from .skeleton import Bone, Hand, ancestors

_PARTS = ("MESH", "EMPTY")  # types of the objects that form a robot's hand without an armature
_BEYOND = 1.2  # share of the distance to the middle of a body; an empty nearer to the origin marks no end of it
_PALM = ":"  # key of the made-up bone that carries several armatures; no other bone has this key


def armature_of(obj: bpy.types.Object | None) -> bpy.types.Object | None:
    """Return the armature of an object: itself, its deformer, or an ancestor.

    Armatures of its ancestors' modifiers count as well. The result is None if there is none.
    """
    while obj is not None:
        if obj.type == "ARMATURE":
            return obj
        for modifier in obj.modifiers:
            if modifier.type == "ARMATURE" and modifier.object is not None:
                return modifier.object
        obj = obj.parent
    return None


def part_of_hand(obj: bpy.types.Object | None) -> bool:
    """Return whether an object belongs to an armature, or to linked parts.

    Fingers may be attached to either.
    """
    if armature_of(obj) is not None:
        return True
    if obj is not None and obj.dermis.role == "FINGER":  # a finger may be attached to a hand already
        obj = obj.parent
    return obj is not None and obj.type in _PARTS and obj.parent is not None


def linked_parts(obj: bpy.types.Object) -> tuple[bpy.types.Object, ...]:
    """Return the meshes and empties of an object's whole tree, root first.

    Those with a scale of zero, fingers and screens are left out.
    """
    tree = (o for o in _tree(obj) if o.type in _PARTS and sized(o))
    return tuple(o for o in tree if o.dermis.role not in ("FINGER", "SCREEN"))


def beside(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """Return the armatures of an armature's whole tree.

    Those without bones or with a scale of zero are left out.
    """
    return [o for o in _tree(armature) if o.type == "ARMATURE" and o.data.bones and sized(o)]


def _tree(obj: bpy.types.Object) -> tuple[bpy.types.Object, ...]:
    while obj.parent is not None:
        obj = obj.parent
    return (obj, *obj.children_recursive)


def bones_of_parts(
    parts: Sequence[bpy.types.Object],
) -> tuple[dict[str, tuple[bpy.types.Object, str]], dict[str, Bone], dict[str, str]]:
    """Return links as bones, by name, and the link of each mesh.

    A bone begins at the origin of its link and ends at the origin of its only child, else at the far end of its body. A
    mesh whose parent is an empty, and that carries no other mesh, is the body of that empty, as importers of robots
    make them; what it carries then hangs on that empty. If several such meshes of an empty carry something, they are
    links. An empty without a body marks the end of a last link if it lies beyond it; other such empties are left out.
    """
    names = {part.name: part for part in parts}
    body = _bodies(names)
    links = {name: part for name, part in names.items() if body.get(name, name) == name}
    above = {name: _above(part, body) for name, part in links.items()}
    above = {name: parent if parent in links else "" for name, parent in above.items()}
    own: dict[str, list[str]] = defaultdict(list)
    for mesh, owner in body.items():
        own[owner].append(mesh)
    middle = {name: np.mean([_middle(names[mesh]) for mesh in meshes], axis=0) for name, meshes in own.items()}
    for name in _frames(links, above, middle):
        del links[name], above[name]
    carried = _carried(above)
    at = {name: np.array(part.matrix_world.translation, np.float64) for name, part in links.items()}
    bones = {}
    for name, part in links.items():
        after, parent = carried.get(name, []), above[name]
        last = name in own and parent and not after and part.type == "EMPTY"
        if last and (middle[name] - at[name]) @ (at[name] - at[parent]) < 0.0:
            # The body lies behind the origin of its empty, so it belongs to the link that carries the empty.
            body.update(dict.fromkeys(own[name], parent))
            middle[name] = at[name]
        tail = at[after[0]] if len(after) == 1 else 2.0 * middle.get(name, at[name]) - at[name]
        bones[name] = Bone(name, parent, at[name], tail)
    return {name: (part, "") for name, part in links.items()}, bones, body


def _bodies(names: Mapping[str, bpy.types.Object]) -> dict[str, str]:
    """Return the link of each mesh: itself, or the empty that carries it."""
    body = {name: name for name, part in names.items() if part.type == "MESH"}
    laden: dict[str, list[str]] = defaultdict(list)  # meshes that carry empties alone, by the empty above them
    for name in body:
        above = names[name].parent
        if above is None or above.name not in names or above.type != "EMPTY":
            continue
        below = [child for child in names[name].children_recursive if child.name in names]
        if not below:
            body[name] = above.name
        elif not any(child.name in body for child in below):
            laden[above.name].append(name)
    for above_name, own in laden.items():
        if len(own) == 1:
            body[own[0]] = above_name
    return body


def _above(part: bpy.types.Object, body: Mapping[str, str]) -> str:
    """Return the name of the link that carries a part, '' for none."""
    return body.get(part.parent.name, part.parent.name) if part.parent is not None else ""


def _carried(above: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the links that each link carries, from the link above each."""
    carried: dict[str, list[str]] = defaultdict(list)
    for name, parent in above.items():
        if parent:
            carried[parent].append(name)
    return dict(carried)


def _middle(mesh: bpy.types.Object) -> Array:
    """Return the middle of a mesh's box in the scene's space, shape (3,)."""
    matrix = np.array(mesh.matrix_world, np.float64)
    middle: Array = matrix[:3, :3] @ np.mean(np.array(mesh.bound_box), axis=0) + matrix[:3, 3]
    return middle


def _frames(links: Mapping[str, bpy.types.Object], above: Mapping[str, str], middle: Mapping[str, Array]) -> set[str]:
    """Return the empties that carry no body and mark no end.

    These are beside a link that goes on, or nearer to the origin of their link than another empty of it, or not beyond
    the middle of the body of their link.

    Args:
        above: the link that carries each link, '' for none. middle: middle of the body of each link that has one.
    """
    carried = _carried(above)
    filled = {name for name in middle if name in links}
    for name in list(filled):
        while name := above[name]:
            filled.add(name)
    found: set[str] = set()
    for name in filled:
        bare = [child for child in carried.get(name, []) if child not in filled]
        start = np.array(links[name].matrix_world.translation, np.float64)
        to = {child: np.array(links[child].matrix_world.translation, np.float64) - start for child in bare}
        half = middle.get(name, start) - start
        ends = [child for child in bare if to[child] @ half >= _BEYOND * float(half @ half)]
        if len(bare) < len(carried.get(name, [])):
            ends = []
        _, end = max(((float(np.linalg.norm(to[child])), child) for child in ends), default=(0.0, ""))
        for child in bare:
            if child != end:
                found |= {child, *(below.name for below in links[child].children_recursive)} & set(links)
    return found


def sized(obj: bpy.types.Object) -> bool:
    """Return whether an object's scale is not zero."""
    return bool(abs(obj.matrix_world.determinant()) > 1e-30)


def bones_of(parts: Sequence[bpy.types.Object]) -> tuple[dict[str, tuple[bpy.types.Object, str]], dict[str, Bone]]:
    """Return the armature and the name of each bone, and the bones at rest.

    Both are by key, and the bones are in the scene's space. The key of a bone is its name. With several armatures, it
    has the name of the armature too, and one more bone, of no armature, is the palm that carries them all.
    """
    places: dict[str, tuple[bpy.types.Object, str]] = {}
    bones: dict[str, Bone] = {}
    for part in parts:
        # Names of parts count as well, such as 'Thumb', but not the numbers that Blender appends to them.
        label = f"{part.name}: {re.sub(r'[.][0-9]+$', '', part.name)} " if len(parts) > 1 else ""
        to_world = np.array(part.matrix_world, np.float64)
        for bone in part.data.bones:
            places[label + bone.name] = part, bone.name
            head, tail = (
                to_world[:3, :3] @ np.array(point, np.float64) + to_world[:3, 3]
                for point in (bone.head_local, bone.tail_local)
            )
            parent = label + bone.parent.name if bone.parent else _PALM if len(parts) > 1 else ""
            bones[label + bone.name] = Bone(label + bone.name, parent, head, tail, bone.use_deform)
    if len(parts) > 1:
        knuckles = np.mean([bone.head for bone in bones.values() if bone.parent == _PALM], axis=0)
        parents = {bone.parent for bone in bones.values()}
        tips = np.mean([bone.tail for bone in bones.values() if bone.name not in parents], axis=0)
        # A palm is about as long as the fingers.
        bones[_PALM] = Bone(_PALM, "", 2.0 * knuckles - tips, knuckles, deform=False)
    return places, bones


def pose_of(armature: bpy.types.Object, bone: str) -> Array:
    """Return the matrix from the rest of a bone to its pose, shape (4, 4).

    It is in the scene's space. The name '' stands for a part without an armature, which is always at rest.
    """
    if not bone:
        return np.eye(4)
    world, posed = armature.matrix_world, armature.pose.bones[bone]
    return np.array(world @ posed.matrix @ posed.bone.matrix_local.inverted() @ world.inverted(), np.float64)


def to_middle(part: bpy.types.Object, bone: str) -> Array | None:
    """Return the matrix that turns a bone, or a link, from its rest to the middle of the range of its joint.

    Its shape is (3, 3), and it is in the scene's space. The range is that of *Limit Rotation* in local space, or of
    inverse kinematics. The result is None if there are no limits.
    """
    owner = part.pose.bones[bone] if bone else part
    limits = _limits(owner)
    if not limits:
        return None
    if bone:
        axes, rest = part.matrix_world @ owner.bone.matrix_local, Euler()
    else:
        axes, rest = part.matrix_world @ part.matrix_basis.inverted(), part.matrix_basis.to_euler()
    middle = rest.copy()
    for axis, (low, high) in limits.items():
        middle[axis] = 0.5 * (low + high)
    frame = np.array(axes, np.float64)[:3, :3]
    turn = np.array(middle.to_matrix(), np.float64) @ np.array(rest.to_matrix(), np.float64).T
    turned: Array = frame @ turn @ np.linalg.inv(frame)
    return turned


def _limits(owner: Any) -> dict[int, tuple[float, float]]:
    """Return the limits of the rotation about the local axes 0 to 2 that have some [rad]."""
    found: dict[int, tuple[float, float]] = {}
    for axis, letter in enumerate("xyz"):
        if getattr(owner, f"use_ik_limit_{letter}", False):
            found[axis] = getattr(owner, f"ik_min_{letter}"), getattr(owner, f"ik_max_{letter}")
        for limit in owner.constraints:
            local = limit.type == "LIMIT_ROTATION" and limit.owner_space == "LOCAL" and not limit.mute
            if local and getattr(limit, f"use_limit_{letter}"):
                found[axis] = getattr(limit, f"min_{letter}"), getattr(limit, f"max_{letter}")
    return found


def carrier(armature: bpy.types.Object, bone: str) -> Matrix:
    """Return the matrix to which the children of a bone are relative.

    It is the matrix of the bone, moved to its end. For the name '' it is the matrix of the object.
    """
    if not bone:
        return armature.matrix_world
    posed = armature.pose.bones[bone]
    return armature.matrix_world @ posed.matrix @ Matrix.Translation((0.0, posed.bone.length, 0.0))


def meant(hands: list[Hand], bones: Mapping[str, Bone], active: str) -> list[Hand]:
    """Return the hands that an active bone selects.

    They are the hands it belongs to, else those on its side, else all.
    """
    if active not in bones:
        return hands
    near = [hand for hand in hands if _touches(hand, bones, active)]
    if not near and (side := side_of(active)):
        near = [hand for hand in hands if hand.side == side]
    return near or hands


def _touches(hand: Hand, bones: Mapping[str, Bone], active: str) -> bool:
    """Return whether a bone belongs to a hand, or hangs on its wrist."""
    own = {name for chain in hand.chains.values() for name in (*chain.bones, chain.end)}
    above = ancestors(bones, active)
    return bool(own.intersection(above)) or (bool(hand.wrist) and hand.wrist in above)
