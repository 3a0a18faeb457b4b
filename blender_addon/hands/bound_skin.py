"""BoundSkin: the triangles round each bone, from the meshes that an armature deforms or carries, at this frame."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import Array

_LEAST = 0.05  # least vertex weight with which a vertex belongs to a bone


@dataclass(frozen=True)
class BoundSkin:
    """Meshes bound to an armature.

    Attributes:
        triangles: for each bone's name, its triangles, with corners in world space in Blender units, shape (t, 3, 3).
            A triangle belongs to a bone if at least two of its vertices have their largest weight there. All triangles
            of a mesh that is parented to a bone belong to that bone.
    """

    triangles: Mapping[str, Array]

    @property
    def bones(self) -> set[str]:
        """Names of the bones that have triangles."""
        return set(self.triangles)

    def round(self, *bones: str) -> Array | None:
        """Return the triangles round some bones, shape (t, 3, 3); None if there are none."""
        found = [self.triangles[bone] for bone in bones if bone in self.triangles]
        return np.concatenate(found) if found else None


def bound_skin(armature: bpy.types.Object, context: bpy.types.Context) -> BoundSkin:
    """Return the skin of an armature, from all meshes that are visible in the view layer.

    Meshes of Dermis' own fingers are left out.
    """
    depsgraph = context.evaluated_depsgraph_get()
    deforming = {bone.name for bone in armature.data.bones if bone.use_deform}
    found: dict[str, list[Array]] = defaultdict(list)
    for obj in context.view_layer.objects:
        if obj.type != "MESH" or obj.dermis.role == "FINGER" or not obj.visible_get(view_layer=context.view_layer):
            continue
        carried = obj.parent == armature and obj.parent_type == "BONE"
        if not carried and not _deformed(obj, armature):
            continue
        evaluated = obj.evaluated_get(depsgraph)
        corners, points = _read(evaluated)
        if not len(corners):
            continue
        if carried:
            found[obj.parent_bone].append(points[corners])
            continue
        bones = {group.index: group.name for group in obj.vertex_groups if group.name in deforming}
        owner = _owners(evaluated.data, len(points), bones)
        for group, own in _by_owner(corners, owner):
            found[bones[group]].append(points[own])
    names = {bone.name for bone in armature.data.bones}
    return BoundSkin({name: np.concatenate(parts) for name, parts in found.items() if name in names})


def own_skin(parts: Sequence[bpy.types.Object], body: Mapping[str, str], context: bpy.types.Context) -> BoundSkin:
    """Return the skin of a hand without an armature, which consists of separate parts.

    Parts that are hidden or are not meshes are left out.

    Args:
        body: for the name of each mesh, the name of the bone that gets its triangles.
    """
    depsgraph = context.evaluated_depsgraph_get()
    found: dict[str, list[Array]] = defaultdict(list)
    for part in parts:
        if part.type == "MESH" and part.visible_get(view_layer=context.view_layer):
            corners, points = _read(part.evaluated_get(depsgraph))
            if len(corners):
                found[body[part.name]].append(points[corners])
    return BoundSkin({name: np.concatenate(own) for name, own in found.items()})


def _deformed(obj: bpy.types.Object, armature: bpy.types.Object) -> bool:
    by_modifier = any(m.type == "ARMATURE" and m.object == armature and m.show_viewport for m in obj.modifiers)
    return by_modifier or (obj.parent == armature and obj.parent_type == "ARMATURE")


def _read(evaluated: bpy.types.Object) -> tuple[NDArray[np.int32], Array]:
    """Return the vertex indices of the triangles, shape (t, 3), and the vertices in world space, shape (n, 3)."""
    mesh: Any = evaluated.data
    mesh.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", points)
    matrix = np.array(evaluated.matrix_world, np.float64)
    return corners.reshape(-1, 3), points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def _owners(mesh: Any, count: int, bones: Collection[int]) -> NDArray[np.int32]:
    """Return for each vertex the group of the bone with the largest weight, shape (n,); -1 for none.

    Args:
        mesh: the evaluated mesh.
        count: number n of vertices.
        bones: indices of the vertex groups that belong to deforming bones. Other groups only mark parts of the mesh.
    """
    owner = np.full(count, -1, np.int32)
    for vertex in mesh.vertices:
        own = (group for group in vertex.groups if group.group in bones)
        most = max(own, key=lambda g: g.weight, default=None)
        if most is not None and most.weight >= _LEAST:
            owner[vertex.index] = most.group
    return owner


def _by_owner(corners: NDArray[np.int32], owner: NDArray[np.int32]) -> Iterator[tuple[int, NDArray[np.int32]]]:
    """Yield each group with its triangles: those with at least two corners in the group."""
    a, b, c = owner[corners].T
    group = np.where((a == b) | (a == c), a, np.where(b == c, b, -1))
    for each in np.unique(group[group >= 0]):
        yield int(each), corners[group == each]
