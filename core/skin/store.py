"""How a condensed skin lies in the cache. What cannot be read is computed again, never trusted."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..files import put_array
from ..npz import opened_npz
from .mesh import TetraMesh

MESH_ARRAYS = ("nodes", "tetrahedra", "fixed", "pad", "surface")


def write_model(path: Path, mesh: TetraMesh, compliance: Array) -> None:
    """Write a mesh and its compliance."""
    with zipfile.ZipFile(path, "w", allowZip64=True) as archive:
        for name in MESH_ARRAYS:
            put_array(archive, name, getattr(mesh, name))
        put_array(archive, "compliance", compliance)


def read_model(path: Path) -> dict[str, NDArray[Any]] | None:
    """Read a model; None where the file is gone or damaged, so that it is computed again."""
    try:
        with opened_npz(path) as archive:
            arrays = archive.arrays((*MESH_ARRAYS, "compliance"))
    except DermisError:
        return None
    size = 3 * arrays["pad"].size
    return arrays if arrays["compliance"].shape == (size, size) else None


def write_table(path: Path, table: NDArray[Any]) -> None:
    """Write one array."""
    with zipfile.ZipFile(path, "w", allowZip64=True) as archive:
        put_array(archive, "table", table)


def read_table(path: Path, shape: tuple[int | None, ...], kind: type = np.float32) -> NDArray[Any] | None:
    """Read a table; None where the file is gone or damaged, or is of another shape or kind.

    Read whole, not mapped: a mapped file that shrinks or whose disk vanishes ends the process, and Blender with it.
    """
    try:
        with opened_npz(path) as archive:
            table = archive.array("table")
    except DermisError:
        return None
    fits = table.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, table.shape, strict=True))
    return table if fits and table.dtype == kind else None
