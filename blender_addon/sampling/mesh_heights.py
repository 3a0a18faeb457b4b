"""Cast the relief of a mesh onto a touch screen, along the screen's own Z."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from .._core import DermisError, Finding
from . import meshes, participants


def cast(
    screen: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    unit: float,
    centre: NDArray[np.float64],
    size: NDArray[np.float64],
) -> tuple[NDArray[np.float64], tuple[Any, ...]]:
    """Cast rays along a screen's -Z onto its mesh object; return heights [m].

    Heights are over the screen, at the current frame, and row 0 lies at the bottom. One ray goes through the middle of
    each pixel. A pixel whose ray hits nothing shows the screen itself, and has height 0.

    Args:
        unit: [m] length of a scene unit.
        centre, size: those of the screen's own mesh in its X and Y, see `height_maps.bounds`.

    Raises:
        DermisError: no mesh, a screen scaled to nothing, or nothing of the mesh over the screen.
    """
    settings = screen.dermis.screen
    target = settings.mesh_object
    where = f"screen '{screen.name_full}'"
    if target is None:
        raise DermisError(
            "no mesh was chosen for its relief",
            where=where,
            remedy="Choose an object as Mesh in the panel Touch: Screen",
        )
    evaluated = target.evaluated_get(depsgraph)
    with meshes.EvaluatedMesh(evaluated) as mesh:
        points = np.zeros((0, 3)) if mesh is None else meshes.positions(mesh).astype(np.float64)
        faces = np.zeros((0, 3), np.int32) if mesh is None else meshes.triangles(mesh)
    if len(faces) == 0:
        raise DermisError("the mesh has no faces", where=f"object '{target.name_full}'", remedy="Give it faces")
    matrix = np.array(screen.evaluated_get(depsgraph).matrix_world, np.float64)
    stretch = np.linalg.norm(matrix[:3, :3], axis=0)
    if abs(np.linalg.det(matrix[:3, :3])) <= 1e-9 * stretch.prod():
        raise DermisError(
            "the screen's scale is zero",
            where=where,
            value=" x ".join(f"{s:g}" for s in stretch),
            limit="a scale other than zero",
            remedy="Give it a scale above zero in X, Y and Z",
        )
    axes = matrix[:3, :3] / stretch
    origin = matrix[:3, :3] @ centre + matrix[:3, 3]
    to_world = np.array(evaluated.matrix_world, np.float64)
    local = ((points @ to_world[:3, :3].T + to_world[:3, 3]) - origin) @ np.linalg.inv(axes).T * unit
    extent = size * stretch[:2] * unit
    shape = grid(extent, settings.resolution)
    heights = _ray_grid(local, faces, extent, shape)
    bare = np.isnan(heights)
    missed = int(bare.sum())
    if missed == heights.size:
        raise DermisError(
            "no part of the mesh lies over the touch screen",
            where=where,
            value=target.name_full,
            remedy="Move the mesh in front of the screen, along the screen's own Z",
        )
    if not missed:
        return heights, ()
    heights[bare] = 0.0
    return heights, (
        Finding(
            "info",
            "bare-screen",
            "the mesh does not cover the whole screen; beside it the screen itself is used",
            where=where,
            value=f"{100.0 * missed / heights.size:.3g} % of it",
            count=missed,
        ),
    )


class Frozen:
    """Watcher for the first change of a mesh from which a relief was cast.

    The relief was cast at the first frame. A mesh that moves with its screen does not count as changed.
    """

    def __init__(self, screen: bpy.types.Object, depsgraph: bpy.types.Depsgraph, reshaped: bool) -> None:
        """Note a screen and its mesh at the first frame.

        `reshaped` says whether the shape of either may change.
        """
        target = screen.dermis.screen.mesh_object
        self._names = screen.name_full, target.name_full
        self._uids = screen.session_uid, target.session_uid
        self._reader = meshes.MeshReader() if reshaped else None
        self._first = self._now(screen, target, depsgraph)
        self._tolerance = 1e-5 * float(np.abs(self._first[0]).max())
        self.findings: list[Any] = []

    def look(self, depsgraph: bpy.types.Depsgraph, frame: float) -> None:
        """Compare the current frame with the first."""
        if self.findings:
            return
        found = participants.look_up(set(self._uids))
        if len(found) < len(set(self._uids)):
            return  # an object was deleted; the recorder raises an error for it
        place, *shapes = self._now(found[self._uids[0]], found[self._uids[1]], depsgraph)
        still = np.abs(place - self._first[0]).max() <= self._tolerance
        if still and all(now is first for now, first in zip(shapes, self._first[1:], strict=True)):
            return
        self.findings.append(
            Finding(
                "info",
                "relief-frozen",
                "the mesh changes with time, but its relief is cast once, at the first frame",
                where=f"screen '{self._names[0]}'",
                value=self._names[1],
                remedy="Make the mesh touchable and set the device's Relief to Mesh, which follows it",
                frame=frame,
            )
        )

    def _now(self, screen: bpy.types.Object, target: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> list[Any]:
        evaluated = [obj.evaluated_get(depsgraph) for obj in (screen, target)]
        place = np.linalg.solve(*(np.array(e.matrix_world, np.float64) for e in evaluated))
        return [place, *(self._reader.read(e, 1.0) for e in evaluated if self._reader is not None)]


def grid(extent: NDArray[np.float64], resolution: int) -> tuple[int, int]:
    """Return rows and columns of a grid of nearly square pixels.

    The longer side has `resolution` pixels.
    """
    longer = float(extent.max())
    columns, rows = (max(1, round(resolution * float(e) / longer)) for e in extent)
    return rows, columns


def _ray_grid(
    points: NDArray[np.float64], faces: NDArray[np.int32], extent: NDArray[np.float64], shape: tuple[int, int]
) -> NDArray[np.float64]:
    rows, columns = shape
    # The tree works in single precision with fixed tolerances, so the mesh is scaled to coordinates of at most 1.
    size = float(np.abs(points).max()) or 1.0
    tree = BVHTree.FromPolygons((points / size).tolist(), faces.tolist(), all_triangles=True)
    top = float(points[:, 2].max()) / size + 1.0
    xs = ((np.arange(columns) + 0.5) / columns - 0.5) * extent[0] / size
    ys = ((np.arange(rows) + 0.5) / rows - 0.5) * extent[1] / size
    heights = np.full(shape, np.nan)
    down = (0.0, 0.0, -1.0)
    for r, y in enumerate(ys.tolist()):
        row = heights[r]
        for c, x in enumerate(xs.tolist()):
            distance = tree.ray_cast((x, y, top), down)[3]
            if distance is not None:
                row[c] = (top - distance) * size
    return heights
