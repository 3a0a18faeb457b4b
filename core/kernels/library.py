"""Find the compiled library, check it, and call its functions.

The library is beside this file (in a checkout, or installed by pip), or in the package `dermis_kernels` (the wheel in
the extension for Blender). It is loaded when it is first needed. Skins need it; devices without a skin do not.

Windows locks a loaded file, but an update has to remove or replace it. Therefore the extension sets the environment
variable `COPIES` to a folder of its own. This process and its child processes then load a copy from that folder, which
an update does not touch.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..errors import DermisError
from . import COPIES, building, records

CODE = "no-kernels"
PACKAGE = "dermis_kernels"
REMEDY = (
    "Install Dermis again, the zip for this platform or by pip; in a checkout run 'python3 build_addon.py kernels'. "
    "Devices without a skin do not need the kernels"
)


class Kernels:
    """Functions of a library that fits this engine.

    Each function takes one record and returns `DONE`, `NOT_FINITE` or `ASKS`; an error tells of a damaged record.

    Args:
        path: path of the library.

    Attributes:
        avx2: 1 if this processor has AVX2, else 0; for records with such a field.

    Raises:
        DermisError: the library cannot be loaded, or was built from other sources.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            library = ctypes.CDLL(str(path))
            library.dermis_sources.restype = library.dermis_layout.restype = ctypes.c_char_p
            for name in records.HEADER.functions:
                function = getattr(library, name)
                function.argtypes, function.restype = (ctypes.c_void_p,), ctypes.c_int32
                function.errcheck = self._checked
            self.split, self.fit = library.dermis_tree_split, library.dermis_tree_fit
            self.fit_body, self.find_bulge, self.judge = (
                library.dermis_body_fit,
                library.dermis_body_bulge,
                library.dermis_body_judge,
            )
            self.distances = library.dermis_distances
            self.sweep, self.sum = library.dermis_sweep, library.dermis_sum
            self.touch = library.dermis_touch_points
            self.find_cells = library.dermis_find_cells
            self.law, self.rest = library.dermis_evaluate_law, library.dermis_rest_solve
            self.press_pieces, self.draw_skin = library.dermis_press_pieces, library.dermis_draw_skin
            self.compliance_rows, self.move_points = library.dermis_compliance_rows, library.dermis_move_points
            self.succeed, self.rearrange = library.dermis_succeed, library.dermis_rearrange
            self.arrive = library.dermis_arrive
            self.expect, self.offset = library.dermis_expect, library.dermis_offset
            self.foresee, self.keep, self.drift = library.dermis_foresee, library.dermis_keep, library.dermis_drift
            self.press_disc, self.settle_disc = library.dermis_press_disc, library.dermis_settle_disc
            self.descend = library.dermis_descend
            self.avx2 = int(library.dermis_has_avx2())
            own = library.dermis_sources(), library.dermis_layout()
            found = [bytes(told).decode("ascii", "replace") for told in own]
        except (OSError, AttributeError) as error:
            raise DermisError(
                f"the compiled kernels for {building.this_platform()} cannot be loaded",
                where=str(path),
                value=str(error),
                remedy=REMEDY,
                code=CODE,
            ) from error
        wanted = [building.digest(), records.layout()]
        if found != wanted:
            raise DermisError(
                f"the compiled kernels for {building.this_platform()} are of another version of Dermis",
                where=str(path),
                value="sources {}, records {}".format(*found),
                limit="sources {}, records {}".format(*wanted),
                remedy=REMEDY,
                code=CODE,
            )

    def _checked(self, status: int, *_: Any) -> int:
        """Return the status of a call; raise an error if it refused the record."""
        if status == records.BAD_RECORD:
            raise DermisError("a record for the kernels is damaged", where=self.path.name, value=status)
        return status


def kernels() -> Kernels:
    """Return the kernels for this platform; the first call loads them.

    Raises:
        DermisError: the library is missing or cannot be loaded. The error names platform, file and remedy.
    """
    found = _loaded()
    if isinstance(found, DermisError):
        raise found.changed()
    return found


def have_kernels() -> bool:
    """Return whether the kernels for this platform can be loaded.

    They are loaded if they can be.
    """
    return not isinstance(_loaded(), DermisError)


@cache
def _loaded() -> Kernels | DermisError:
    try:
        path = find(building.this_platform(), _folders())
    except DermisError as error:
        return error
    if folder := _folder_of_copies():
        with contextlib.suppress(DermisError):  # if the folder cannot be written, load the original
            return loaded_copy(path, folder)
    try:
        return Kernels(path)
    except DermisError as error:
        return error


def find(target: str, folders: list[Path]) -> Path:
    """Return the path of a platform's library.

    The first of the folders that contains a library is used.

    Raises:
        DermisError: the platform is not supported, no folder contains the library, or it is damaged.
    """
    if target not in building.TARGETS:
        raise DermisError(
            "there are no compiled kernels for this platform",
            where=target,
            limit=", ".join(building.TARGETS),
            remedy="Devices without a skin do not need the kernels",
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
    """Load a copy of a library, and remove copies of other versions.

    Copies that another process has loaded cannot be removed. The copy to load is made if it is missing or damaged. It
    has the name of the original, with the digest of the content.

    Args:
        path: path of the original.
        folder: folder of the copies.

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
            with contextlib.suppress(OSError):  # a copy that another process has loaded is locked, and stays
                other.unlink()
    return loaded


def _folders() -> list[Path]:
    spec = find_spec(PACKAGE)
    return [building.FOLDER, *(map(Path, spec.submodule_search_locations or ()) if spec else ())]


def _folder_of_copies() -> Path | None:
    """Return the folder for copies; None to load the original.

    Without the environment variable, copies are used only on Windows, which locks a loaded file.
    """
    if named := os.environ.get(COPIES):
        return Path(named)
    local = os.environ.get("LOCALAPPDATA")
    return Path(local) / "dermis" / "kernels" if os.name == "nt" and local else None
