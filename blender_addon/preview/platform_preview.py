"""Commands of platforms at the current frame, without a bake.

They are looked up in a table for the skin of `skin_preview`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import DermisError, core
from ..devices import active_presets, platform_devices, skin_models
from . import followers
from .rows import Row, by_channel, row_of
from .skin_state import SkinState

NO_TABLE = "no look-up table of this finger yet: Bake makes it"

_commands: dict[str, tuple[SkinState, tuple[Any, ...], NDArray[np.float64] | None]] = {}
_refused: dict[str, str] = {}  # by finger, why its table cannot be used


def live_rows(scene: bpy.types.Scene, skins: Sequence[SkinState]) -> tuple[Row, ...]:
    """Return the rows of platforms whose commands are looked up for a live skin.

    Without a table, a row has a note in place of values.
    """
    rows = []
    for target, obj, device, spec in followers.wearers_of(scene, skins, "platform"):
        looked_up = target.source == "live" and active_presets.searched(device) is None
        values = commands(obj, device, spec, target) if looked_up else None
        if values is not None:
            rows.append(row_of(target.finger, device.preset, spec, by_channel(spec, values), float(target.touching)))
        elif looked_up:
            note = _refused.get(target.finger) or NO_TABLE
            rows.append(row_of(target.finger, device.preset, spec, {}, None, note=note))
    return tuple(rows)


def prepare(scene: bpy.types.Scene, target: SkinState) -> Iterator[None]:
    """Look up the values of a finger's platform for this frame; never yield."""
    for skin, obj, device, spec in followers.wearers_of(scene, (target,), "platform"):
        if skin.source == "live" and active_presets.searched(device) is None:
            commands(obj, device, spec, skin)
    return iter(())


def commands(obj: Any, device: Any, spec: Any, target: SkinState) -> NDArray[np.float64] | None:
    """Return motor commands for one frame's skin.

    None while the table is missing or cannot be used.
    """
    key = (spec.hash, device.table, device.table_rows)
    kept = _commands.get(target.finger)
    if kept is not None and kept[0] is target and kept[1] == key and kept[2] is not None:
        return kept[2]
    lookup, values = core.matching.lookup, None
    _refused.pop(target.finger, None)
    try:
        table = platform_devices.table(obj, device)
        if table is not None:
            with skin_models.one_thread():
                force = np.asarray(target.force)[None] if target.touching else np.zeros((0, *np.shape(target.force)))
                own = target
                values = lookup.commands_now(table, spec, own.model, force, own.amounts)
    except DermisError as error:
        _refused[target.finger] = str(error)
    _commands[target.finger] = (target, key, values)
    return values


def reset() -> None:
    """Forget all looked-up values."""
    _commands.clear()
    _refused.clear()
