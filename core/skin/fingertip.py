"""Graded mesh of a fingertip.

Hexahedra from bone to skin are split into five tetrahedra each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import DermisError
from .disk import disk_quads, mirrored, split_hexahedra, split_quads
from .mesh import TetraMesh, pad_nodes, tetra_volumes
from .quality import check_mesh
from .shape import FingertipShape

# Approximate thickness of the layer at the bone, divided by that of the layer at the skin, under the pad. The ratio is
# nearer to 1 where tissue is thin.
DEPTH_GROWTH = 2.0


@dataclass(frozen=True)
class Level:
    """Resolution of a mesh.

    Attributes:
        across, along: numbers of cells of the fine block across and along the pad, both even.
        rings: number of rings of cells from the block to the cut end.
        layers: number of layers from bone to skin.
    """

    across: int
    along: int
    rings: int
    layers: int

    @property
    def tetrahedra(self) -> int:
        """Number of tetrahedra."""
        return 5 * self.layers * (self.across * self.along + 2 * (self.across + self.along) * self.rings)


LEVELS: dict[str, Level] = {
    "draft": Level(4, 8, 3, 3),
    "standard": Level(8, 12, 4, 5),
    "fine": Level(14, 20, 7, 7),
    "reference": Level(20, 30, 10, 11),
}


def fingertip_mesh(shape: FingertipShape | None = None, level: str | Level = "standard") -> TetraMesh:
    """Return the mesh of a fingertip.

    The mesh is finest at the pad and exactly symmetric in x. The nodes on the bone's surface and under the nail are
    fixed. The pad nodes are the free nodes of the palmar skin, without the rim of the cut end.

    Args:
        shape: the fingertip; None for the default lengths.
        level: 'draft' (about 1.6k tetrahedra), 'standard' (6.4k), 'fine' (26k), 'reference' (88k, for tests), or a
            `Level`.

    Raises:
        DermisError: the level is unknown or has an invalid number, or the tissue would fold because lengths do not fit
            each other.
    """
    shape = shape or FingertipShape()
    if isinstance(level, str):
        if level not in LEVELS:
            raise DermisError("unknown accuracy", where="fingertip mesh", value=level, limit=", ".join(LEVELS))
        level = LEVELS[level]
    if level.layers < 1:
        raise DermisError("too few layers", where="fingertip mesh", value=level.layers, limit=">= 1")
    disk = disk_quads(level.across, level.along, level.rings)
    count = len(disk.chart)
    skin, bone = (mirrored(surface, disk.mirror) for surface in (shape.skin(disk.chart), shape.bone(disk.chart)))
    thickness = np.linalg.norm(skin - bone, axis=1)
    rate = np.log(DEPTH_GROWTH) * np.minimum(1.0, thickness / shape.pulp)
    depth = np.linspace(1.0, 0.0, level.layers + 1)[:, None]
    share = 1.0 - np.expm1(rate * depth) / np.expm1(rate)
    nodes = (bone[None] + share[:, :, None] * (skin - bone)[None]).reshape(-1, 3)

    starts = (np.arange(level.layers, dtype=np.int32) * count)[:, None, None]
    hexahedra = np.concatenate([disk.quads[None] + starts, disk.quads[None] + starts + np.int32(count)], axis=2)
    colour = (disk.colour[None] + np.arange(level.layers + 1)[:, None]).ravel() % 2
    tetrahedra = split_hexahedra(hexahedra.reshape(-1, 8), colour)

    top = level.layers * count
    triangles = split_quads(disk.quads, (disk.colour + level.layers) % 2) + np.int32(top)
    nail = np.flatnonzero(shape.under_nail(skin)) + top
    fixed = np.concatenate([np.arange(count), nail]).astype(np.int32)
    mesh = TetraMesh(nodes, tetrahedra, fixed, np.zeros(0, np.int32), triangles.astype(np.int32))
    pad = pad_nodes(mesh, exclude=disk.rim + top)
    mesh = TetraMesh(nodes, tetrahedra, fixed, pad, mesh.surface)
    _check_volumes(mesh, shape)
    check_mesh(mesh)
    return mesh


def _check_volumes(mesh: TetraMesh, shape: FingertipShape) -> None:
    """Raise an error if the layers between bone and skin fold.

    The error names the lengths of the fingertip.
    """
    folded = int((tetra_volumes(mesh.nodes, mesh.tetrahedra) <= 0).sum())
    if folded:
        names = ("width", "thickness", "length", "tip", "bone_width", "bone_thickness", "bone_bed", "bone_margin")
        raise DermisError(
            f"lengths out of proportion: the tissue between bone and skin folds in {folded} elements",
            where="fingertip",
            value=", ".join(f"{name} {1e3 * getattr(shape, name):.2f}" for name in names) + " mm",
            limit="a bone that follows the skin",
            remedy="Change the bone's lengths with the finger's: a thicker finger has a thicker bone, too",
        )
