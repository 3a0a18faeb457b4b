"""Find which touches of a finger can be distinguished through each device.

A child process does the work. The result is kept for the session.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from .._core import core
from ..identity import Place
from ..jobs import Steps
from ..results import same_inputs, store
from . import compared


@dataclass(frozen=True)
class Told:
    """The result on one finger.

    Attributes:
        table: table of the panel, see the engine's `told_report.as_dict`. csv: contents of the file.
        inputs: the contents of the scene when it was kept; None before.
        place: place of the finger, which finds it under another name as well.
    """

    table: Mapping[str, Any]
    csv: bytes
    inputs: same_inputs.Inputs | None
    place: Place | None = None


_told: dict[int, Told] = {}


def current(scene: bpy.types.Scene) -> Told | None:
    """Return the last result of a scene in this session."""
    return _told.get(scene.session_uid)


def keep(scene: bpy.types.Scene, made: Told) -> None:
    """Keep a result for the session."""
    _told[scene.session_uid] = replace(made, inputs=same_inputs.of(scene))


def check_touches(scene: bpy.types.Scene, finger: str) -> None:
    """Check the number of a finger's touches in the scene's bake.

    The check is left out if the bake is out of date or does not have the finger's skin.

    Raises:
        DermisError: the finger touches too seldom or too often.
    """
    result = store.current(scene)
    skin = None if result is None else result.bake.skins.get(finger)
    if skin is not None and store.state(scene) == "fresh":
        told_apart = core.comparison.told_apart
        told_apart.check_count(finger, told_apart.touches_of(skin))


def find(scene: bpy.types.Scene, finger: str) -> Steps:
    """Sample a scene and distinguish a finger's touches; yield progress.

    Returns a `Told`.

    Raises:
        DermisError: the scene cannot be sampled or rendered, or the finger does not touch twice.
    """
    place = compared.place_of(scene, finger)
    made = yield from compared.asked("tell-apart", "telling apart", scene, finger)
    return Told(json.loads(made["table"]), made["csv"], None, place)


def save(made: Told, folder: Path) -> Path:
    """Write the table as CSV into a folder; return its path.

    Raises:
        DermisError: the folder cannot be written.
    """
    safe, names = core.track.file_names.safe, core.track.file_names.FileNames()
    path = folder / names.take(f"{safe(made.table['finger']) or 'finger'}.told-apart", ".csv")
    core.files.write_bytes(path, made.csv)
    return path
