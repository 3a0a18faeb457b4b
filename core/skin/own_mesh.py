"""A skin of one's own, as a finger's parameters name it: a mesh file, and what it held when the scene was sampled."""

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
        DermisError: it cannot be read.
    """
    return hashlib.sha256(read_bytes(path)).hexdigest()


def own_mesh(parameters: Mapping[str, Any], where: str) -> TetraMesh:
    """Return the mesh that 'mesh' (a path) names; 'mesh_hash', where it is given, must be its SHA-256.

    Raises:
        DermisError: the file cannot be read, is refused (see `load_mesh`), or is another one by now.
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
