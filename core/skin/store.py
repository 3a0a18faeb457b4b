"""Storage of skin models and tables in the cache.

Unreadable entries are computed again.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..cache import Cache
from ..errors import DermisError
from ..files import put_array
from ..npz import opened_npz
from .mesh import TetraMesh

Shape = tuple[int | None, ...]  # None stands for any length

MESH_ARRAYS = ("nodes", "tetrahedra", "fixed", "pad", "surface")


def write_model(path: Path, mesh: TetraMesh, compliance: Array) -> None:
    """Write a mesh and its compliance."""
    with zipfile.ZipFile(path, "w", allowZip64=True) as archive:
        for name in MESH_ARRAYS:
            put_array(archive, name, getattr(mesh, name))
        put_array(archive, "compliance", compliance)


def read_model(path: Path) -> dict[str, NDArray[Any]] | None:
    """Read the arrays of a mesh and its compliance.

    Return None if the file is missing or damaged, or if the compliance has a wrong shape.
    """
    try:
        with opened_npz(path) as archive:
            arrays = archive.arrays((*MESH_ARRAYS, "compliance"))
    except DermisError:
        return None
    size = 3 * arrays["pad"].size
    return arrays if arrays["compliance"].shape == (size, size) else None


def kept(
    cache: Cache | None, key: str, shapes: Mapping[str, Shape], make: Callable[[], Mapping[str, Array]]
) -> Mapping[str, NDArray[Any]]:
    """Return arrays by name from the cache, or compute and store them.

    The arrays are in double precision.

    Args:
        cache: the cache; None always computes the arrays.
        key: key of the cache entry, made from all inputs, see `cache_key`.
        shapes: shape of each array; None stands for any length.
        make: function that computes the arrays.
    """
    path = None if cache is None else cache.get(key)
    found = None if path is None else read_arrays(path, shapes, np.float64)
    if found is not None:
        return found
    made = make()
    if cache is not None:
        with suppress(DermisError):  # if the folder cannot be written, the arrays are computed again next time
            cache.put(key, lambda part: write_arrays(part, made))
    return made


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name to an .npz file."""
    with zipfile.ZipFile(path, "w", allowZip64=True) as archive:
        for name, array in arrays.items():
            put_array(archive, name, array)


def read_arrays(path: Path, shapes: Mapping[str, Shape], kind: type = np.float32) -> dict[str, NDArray[Any]] | None:
    """Read arrays by name.

    Return None if the file is missing or damaged, or if a shape or the type differs. The file is read into memory and
    not mapped. If a mapped file is truncated or its disk is removed, the operating system ends the process, and Blender
    with it.

    Args:
        path: file to read.
        shapes: shape of each array; None stands for any length.
        kind: type of the arrays.
    """
    try:
        with opened_npz(path) as archive:
            arrays = archive.arrays(shapes)
    except DermisError:
        return None
    fits = all(_fits(arrays[name], shape) and arrays[name].dtype == kind for name, shape in shapes.items())
    return arrays if fits else None


def _fits(array: NDArray[Any], shape: Shape) -> bool:
    return array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))


def write_table(path: Path, table: NDArray[Any]) -> None:
    """Write one array to an .npz file."""
    write_arrays(path, {"table": table})


def read_table(path: Path, shape: Shape, kind: type = np.float32) -> NDArray[Any] | None:
    """Read an array that `write_table` wrote; see `read_arrays`."""
    found = read_arrays(path, {"table": shape}, kind)
    return None if found is None else found["table"]
