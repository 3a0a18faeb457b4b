"""Keep the last export of each scene for the panel.

The panel lists its files and opens its folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import bpy

from . import store


class Exported(NamedTuple):
    """The files of one export, their folder, and the owners of their bake."""

    folder: Path
    files: tuple[Path, ...]
    owners: Any  # those of the bake; the same object even if fingers are renamed


_last: dict[int, Exported] = {}  # by the scene's session uid


def note(scene: bpy.types.Scene, folder: Path, files: tuple[Path, ...]) -> None:
    """Note an export."""
    result = store.current(scene)
    if result is not None:
        _last[scene.session_uid] = Exported(folder, files, result.owners)


def last(scene: bpy.types.Scene) -> Exported | None:
    """Return the last export of a scene's bake; None if there is none.

    An export of an earlier bake does not count.
    """
    found = _last.get(scene.session_uid)
    result = store.current(scene)
    same = found is not None and result is not None and found.owners is result.owners
    return found if same else None


def forget() -> None:
    """Drop all exports, as when another file is opened."""
    _last.clear()
