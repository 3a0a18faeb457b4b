"""Find the compiled library, check it, and call its functions: one record of arrays each.

It lies beside this file (in a checkout, or installed by pip) or in the package `dermis_kernels` (the wheel that the
extension brings to Blender). It is loaded where it is first needed. Skins need it; devices without a skin do not.

Windows locks a loaded file, and an update has to remove or replace it. So the extension names a folder of its own in
the environment variable `COPIES`, and this process and its children load a copy from there. An update leaves it alone.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..errors import DermisError
from . import COPIES, building, records

CODE = "no-kernels"
PACKAGE = "dermis_kernels"
REMEDY = (
    "Install Dermis anew, the zip for this platform or by pip; in a checkout run 'python3 build_addon.py kernels'. "
    "Devices without a skin work without them"
)


class Kernels:
    """The functions of a library that fits this engine.

    Args:
        path: the file.

    Attributes:
        avx2: 1 where this processor has AVX2, for the records that ask.

    Raises:
        DermisError: it cannot be loaded, or is of other sources.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            library = ctypes.CDLL(str(path))
            library.dermis_layout.restype = ctypes.POINTER(ctypes.c_uint64)
            library.dermis_sources.restype = library.dermis_fields.restype = ctypes.c_char_p
            self.split, self.fit = _function(library.dermis_tree_split), _function(library.dermis_tree_fit)
            self.fit_body, self.judge = _function(library.dermis_body_fit), _function(library.dermis_body_judge)
            self.distances = _function(library.dermis_distances)
            self.sweep, self.find_cells = _function(library.dermis_sweep), _function(library.dermis_find_cells)
            self.law, self.rest = _function(library.dermis_evaluate_law), _function(library.dermis_rest_solve)
            self.press_pieces = _function(library.dermis_press_pieces)
            self.number_points = _function(library.dermis_number_points)
            self.avx2 = int(library.dermis_has_avx2())
            sources = bytes(library.dermis_sources()).decode("ascii", "replace")
            fields = bytes(library.dermis_fields()).decode("ascii", "replace")
            told = library.dermis_layout()
        except (OSError, AttributeError) as error:
            raise DermisError(
                f"the compiled kernels for {building.this_platform()} cannot be loaded",
                where=str(path),
                value=str(error),
                remedy=REMEDY,
                code=CODE,
            ) from error
        wanted = list(records.layout())
        found: list[int] = []
        while len(found) < len(wanted) and found[-1:] != wanted[-1:]:
            found.append(int(told[len(found)]))
        if sources != building.digest() or found != wanted or fields != records.fields():
            raise DermisError(
                f"the compiled kernels for {building.this_platform()} are of another version of Dermis",
                where=str(path),
                value=f"sources {sources}, layout {found[:-1]} of {fields}",
                limit=f"sources {building.digest()}, layout {wanted[:-1]} of {records.fields()}",
                remedy=REMEDY,
                code=CODE,
            )


def kernels() -> Kernels:
    """Return the kernels of this platform, loaded when they are first asked for.

    Raises:
        DermisError: there are none, or they cannot be loaded; the sentence names platform, file and remedy.
    """
    found = _loaded()
    if isinstance(found, DermisError):
        raise found.changed()
    return found


def have_kernels() -> bool:
    """Return whether there are kernels for this platform that can be loaded."""
    return not isinstance(_loaded(), DermisError)


@cache
def _loaded() -> Kernels | DermisError:
    try:
        path = find(building.this_platform(), _folders())
    except DermisError as error:
        return error
    if folder := _folder_of_copies():
        with contextlib.suppress(DermisError):  # a folder that cannot be written: the original does as well
            return loaded_copy(path, folder)
    try:
        return Kernels(path)
    except DermisError as error:
        return error


def find(target: str, folders: list[Path]) -> Path:
    """Return the library of a platform from the first of some folders that has it.

    Raises:
        DermisError: none has, or it is damaged.
    """
    if target not in building.TARGETS:
        raise DermisError(
            "there are no compiled kernels for this platform",
            where=target,
            limit=", ".join(building.TARGETS),
            remedy="Devices without a skin work without them",
            code=CODE,
        )
    for folder in folders:
        path = building.found(target, folder)
        if path is not None:
            if not building.whole(path):
                raise DermisError(
                    f"the compiled kernels for {target} are damaged or cannot be read",
                    where=str(path),
                    remedy=REMEDY,
                    code=CODE,
                )
            return path
    raise DermisError(
        f"the compiled kernels for {target} are missing",
        where=f"{building.stem(target)}*{building.TARGETS[target].suffix}",
        limit=f"in {', '.join(map(str, folders))}",
        remedy=REMEDY,
        code=CODE,
    )


def loaded_copy(path: Path, folder: Path) -> Kernels:
    """Load a copy of a library, and remove copies of other versions where nobody has them loaded.

    A copy has the name of the original, which tells its content.

    Raises:
        DermisError: the folder cannot be written, or the library cannot be loaded.
    """
    from ..files import atomic

    target = folder / path.name
    if not building.whole(target):
        with atomic(target) as part:
            part.write_bytes(path.read_bytes())
    loaded = Kernels(target)
    for other in folder.glob(f"dermis-*{path.suffix}"):
        if other != target:
            with contextlib.suppress(OSError):  # locked: another Blender runs with it
                other.unlink()
    return loaded


def _function(function: Any) -> Callable[[Any], int]:
    """Return a function that takes one record, by reference, and returns a status."""
    function.restype, function.argtypes = ctypes.c_int32, (ctypes.c_void_p,)
    called: Callable[[Any], int] = function
    return called


def _folders() -> list[Path]:
    spec = find_spec(PACKAGE)
    return [building.FOLDER, *(map(Path, spec.submodule_search_locations or ()) if spec else ())]


def _folder_of_copies() -> Path | None:
    """Return the folder to load a copy from, None to load the original: only Windows locks it."""
    if named := os.environ.get(COPIES):
        return Path(named)
    local = os.environ.get("LOCALAPPDATA")
    return Path(local) / "dermis" / "kernels" if os.name == "nt" and local else None
