"""Find the best match that any pose of a finger's device could have.

It is found for the touch of the last bake, and kept for the session.
"""

from __future__ import annotations

from typing import Any

import bpy

from .._core import DermisError, core
from ..devices import active_presets, skin_models, thimble_devices
from . import store

_floors: dict[int, tuple[str, str, Any]] = {}  # by the finger's session uid


def find(scene: bpy.types.Scene, obj: bpy.types.Object) -> Any:
    """Find the floor of a finger's device; yield progress, return it.

    Raises:
        DermisError: no such device, no bake with this finger's skin, or nothing touched.
    """
    device, result = active_presets.searched_of(obj), store.current(scene)
    felt = result.bake.skins.get(obj.name_full) if result is not None else None
    if device is None or result is None or felt is None:
        raise DermisError(
            "this finger's skin is not baked", where=f"finger '{obj.name}'", remedy="Press Bake, then try again"
        )
    engine, matching, uid = core.matching.floor, core.matching.thimble, obj.session_uid
    times = felt.times[engine.looked_at(len(felt.times))]
    with skin_models.one_thread():
        use = thimble_devices.prepared(device, felt.pressed)
        forces, amounts = matching.forces_at(felt, times), matching.amounts_at(felt, times)
    steps = engine.floor_of(use, forces, amounts)
    while True:
        try:
            with skin_models.one_thread():
                step = next(steps)
        except StopIteration as stop:
            _floors[uid] = (result.bake.content_hash, device.preset, stop.value)
            return stop.value
        yield core.pipeline.bake.Progress(step.stage, step.done, step.total)


def shown(scene: bpy.types.Scene, obj: bpy.types.Object, device: Any) -> Any | None:
    """Return the best achievable match of the present bake; None without one."""
    result, known = store.current(scene), _floors.get(obj.session_uid)
    if result is None or known is None or known[:2] != (result.bake.content_hash, device.preset):
        return None
    return known[2]


def forget() -> None:
    """Drop all floors."""
    _floors.clear()
