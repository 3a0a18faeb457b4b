"""Reader of tetrahedral meshes from files.

`presets/skins` describes the format.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import read_bytes
from ..foreign import MAX_TEXT, json_of
from ..npz import opened_npz
from ..units import UNITS
from .mesh import TetraMesh, boundary_faces, pad_nodes
from .quality import check_mesh

SCHEMA = "dermis-tetra-mesh 1"
_REQUIRED = ("nodes", "tetrahedra", "fixed")
_OPTIONAL = ("pad", "surface")


def load_mesh(path: Path) -> TetraMesh:
    """Read a tetrahedral mesh with its node sets from an .npz or .json file.

    Raises:
        DermisError: the file cannot be read; a field is missing or has another shape; or the mesh is invalid (see
            `check_mesh`): it has inverted or flat elements, hanging nodes, overlapping elements, or parts that are not
            held.
    """
    path = Path(path)
    where = f"skin mesh '{path.name}'"
    fields = _read_json(path, where) if path.suffix.lower() == ".json" else _read_npz(path, where)
    schema = fields.get("schema")
    if schema is None or str(schema) != SCHEMA:
        raise DermisError("unknown schema", where=where, value=None if schema is None else str(schema), limit=SCHEMA)
    for name in _REQUIRED:
        if name not in fields:
            raise DermisError(f"'{name}' is missing", where=where, limit=", ".join(_REQUIRED + _OPTIONAL))
    unit = str(fields.get("unit", "m"))
    if unit not in UNITS or UNITS[unit][0] != "m":
        raise DermisError("not a unit of length", where=where, value=unit, limit="m, mm, um, cm")
    nodes = _numbers(fields["nodes"], 3, where, "nodes") * UNITS[unit][1]
    tetrahedra = _indices(fields["tetrahedra"], 4, where, "tetrahedra", len(nodes))
    fixed = np.unique(_indices(fields["fixed"], 0, where, "fixed", len(nodes)))
    if "surface" in fields:
        surface = _indices(fields["surface"], 3, where, "surface", len(nodes))
    else:
        surface = _skin_faces(tetrahedra, fixed)
    name = str(fields.get("name", path.stem))
    mesh = TetraMesh(nodes, tetrahedra, fixed, np.zeros(0, np.int32), surface, name)
    if "pad" in fields:
        pad = np.unique(_indices(fields["pad"], 0, where, "pad", len(nodes)))
    else:
        pad = pad_nodes(mesh) if len(tetrahedra) else np.zeros(0, np.int32)
    mesh = TetraMesh(nodes, tetrahedra, fixed, pad.astype(np.int32), surface, name)
    check_mesh(mesh)
    return mesh


def _read_npz(path: Path, where: str) -> Mapping[str, Any]:
    known = {*_REQUIRED, *_OPTIONAL, "schema", "name", "unit"}
    with opened_npz(path, where, "a mesh") as archive:
        return archive.arrays(name for name in archive.names if name in known)


def _read_json(path: Path, where: str) -> Mapping[str, Any]:
    fields = json_of(read_bytes(path, most=MAX_TEXT, where=where), where, MAX_TEXT)
    if not isinstance(fields, dict):
        raise DermisError("a mesh is one JSON object", where=where, value=type(fields).__name__)
    return fields


def _numbers(value: Any, columns: int, where: str, name: str) -> NDArray[np.float64]:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DermisError(f"'{name}' is not a table of numbers", where=where, value=str(error)[:80]) from error
    if array.ndim != 2 or array.shape[1] != columns:
        raise DermisError(f"'{name}' has another shape", where=where, value=array.shape, limit=f"(count, {columns})")
    return np.ascontiguousarray(array)


def _indices(value: Any, columns: int, where: str, name: str, count: int) -> NDArray[np.int32]:
    try:
        array = np.asarray(value)
        if array.size == 0:
            array = array.reshape((0, columns) if columns else (0,)).astype(np.int64)
    except (ValueError, OverflowError) as error:
        raise DermisError(f"'{name}' is not a table of node numbers", where=where, value=str(error)[:80]) from error
    if array.dtype.kind not in "iu":
        raise DermisError(f"'{name}' must be whole node numbers, from 0", where=where, value=str(array.dtype))
    shape = f"(count, {columns})" if columns else "(count,)"
    if array.ndim != (2 if columns else 1) or (columns and array.shape[1] != columns):
        raise DermisError(f"'{name}' has another shape", where=where, value=array.shape, limit=shape)
    if array.size and (int(array.min()) < 0 or int(array.max()) >= count):
        bad = int(array.min()) if int(array.min()) < 0 else int(array.max())
        limit = f"0 to {count - 1}"
        raise DermisError(f"'{name}' names a node that does not exist", where=where, value=bad, limit=limit)
    return np.ascontiguousarray(array, dtype=np.int32)


def _skin_faces(tetrahedra: NDArray[np.int32], fixed: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the faces of the skin, shape (t, 3).

    They are the boundary faces, except those whose three corners are fixed.
    """
    faces = boundary_faces(tetrahedra)
    return faces[~np.isin(faces, fixed).all(axis=1)]
