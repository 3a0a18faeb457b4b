"""What tests measure of tissue and write of it: angles of its elements, stress at a point, its mesh as a file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.files import write_bytes, write_npz
from core.skin.file import SCHEMA
from core.skin.mesh import TetraMesh
from core.skin.recovery import fitted
from core.skin.stress import Probes, locate

Array = NDArray[np.float64]
_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def dihedral_angles(nodes: Array, tetrahedra: NDArray[np.integer]) -> Array:
    """Return the six dihedral angles of each tetrahedron [rad], shape (e, 6)."""
    corners = nodes[tetrahedra]
    out = np.empty((len(tetrahedra), 6))
    for column, (i, j) in enumerate(_EDGES):
        k, m = (x for x in range(4) if x not in (i, j))
        edge = corners[:, j] - corners[:, i]
        first = np.cross(edge, corners[:, k] - corners[:, i])
        second = np.cross(edge, corners[:, m] - corners[:, i])
        # atan2 keeps its accuracy near 0 and pi, where arccos of a dot product loses half the digits
        sine = np.linalg.norm(np.cross(first, second), axis=1)
        out[:, column] = np.arctan2(sine, np.einsum("ij,ij->i", first, second))
    return out


def stress_norm(stress: Array, volumes: Array) -> float:
    """Return the volume-weighted L2 norm of element stresses [Pa m^1.5], shear components counted twice."""
    return float(np.sqrt(np.einsum("ij,ij,j,i->", stress, stress, [1.0, 1.0, 1.0, 2.0, 2.0, 2.0], volumes)))


def probes_at(mesh: TetraMesh, points: Array) -> Probes:
    """Return probes at points in the tissue [m], shape (k, 3)."""
    points = np.asarray(points, float)
    assert (locate(mesh, points)[0] >= 0).all(), "a probe lies outside the tissue"
    return Probes(points, fitted(mesh, points), np.full(len(points), np.nan), np.full(len(points), -1))


def save_mesh(mesh: TetraMesh, path: Path) -> None:
    """Write a mesh as .npz or .json, by the path's ending, in the format that `presets/skins/README.md` describes."""
    arrays = {name: np.asarray(getattr(mesh, name)) for name in ("nodes", "tetrahedra", "fixed", "pad", "surface")}
    texts = {"schema": SCHEMA, "name": mesh.name, "unit": "m"}
    if path.suffix == ".npz":
        write_npz(path, {**{k: np.array(v) for k, v in texts.items()}, **arrays})
    else:
        write_bytes(path, json.dumps({**texts, **{k: v.tolist() for k, v in arrays.items()}}).encode())
