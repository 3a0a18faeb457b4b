"""Mesh of a user's own skin, from a file named in a finger's parameters."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import DermisError
from ..files import read_bytes
from .file import load_mesh
from .mesh import TetraMesh


def digest(path: Path) -> str:
    """Return the SHA-256 of a file.

    Raises:
        DermisError: the file cannot be read.
    """
    return hashlib.sha256(read_bytes(path)).hexdigest()


def own_mesh(parameters: Mapping[str, Any], where: str) -> TetraMesh:
    """Return the mesh from the file that a finger's parameters name.

    Args:
        parameters: parameters of the finger's skin: 'mesh' (path of the file) and optionally 'mesh_hash' (SHA-256 that
            the file must have).
        where: name of the finger, for errors.

    Raises:
        DermisError: the file cannot be read, is invalid (see `load_mesh`), or has another hash.
    """
    path = Path(str(parameters["mesh"]))
    wanted = str(parameters.get("mesh_hash", ""))
    if wanted and digest(path) != wanted:
        raise DermisError(
            "the skin's mesh file has changed since the scene was sampled",
            where=where,
            value=path.name,
            remedy="Sample the scene again",
        )
    return load_mesh(path)
