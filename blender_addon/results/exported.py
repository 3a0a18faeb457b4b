"""The last export of each scene, for the panel, which lists it and opens its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import bpy

from . import store


class Exported(NamedTuple):
    """Files of one export, where they lie, and whose bake they are of."""

    folder: Path
    files: tuple[Path, ...]
    owners: Any  # the bake's own, the same object whatever its fingers are called


_last: dict[int, Exported] = {}  # by the scene's session uid


def note(scene: bpy.types.Scene, folder: Path, files: tuple[Path, ...]) -> None:
    """Remember an export."""
    result = store.current(scene)
    if result is not None:
        _last[scene.session_uid] = Exported(folder, files, result.owners)


def last(scene: bpy.types.Scene) -> Exported | None:
    """Return the last export of a scene's bake; None where there is none, or another bake since."""
    found = _last.get(scene.session_uid)
    result = store.current(scene)
    same = found is not None and result is not None and found.owners is result.owners
    return found if same else None


def forget() -> None:
    """Forget everything: another file is opened."""
    _last.clear()
