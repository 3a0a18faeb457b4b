"""The stimulus plot of a finger's last bake, as a picture file."""

from __future__ import annotations

from pathlib import Path

import bpy

from .._core import DermisError, core
from ..devices import active_presets, skin_models, thimble_devices
from . import store


def write(scene: bpy.types.Scene, obj: bpy.types.Object, path: Path) -> Path:
    """Write the picture; the touch is matched once more, as the finger's thimble is set now.

    Raises:
        DermisError: no thimble, no bake with this finger's skin, nothing touched, or the file cannot be written.
    """
    device, result = active_presets.device_of(obj, "thimble"), store.current(scene)
    felt = result.bake.skins.get(obj.name_full) if result is not None else None
    spec = active_presets.spec_of(device.preset, "thimble") if device is not None else None
    if device is None or spec is None or result is None or felt is None:
        raise DermisError(
            "no bake of this finger's skin is at hand",
            where=f"finger '{obj.name}'",
            remedy="Press Bake, then draw the plot",
        )
    if not len(felt.contact):
        raise DermisError("the finger touches nothing in the last bake", where=f"finger '{obj.name}'")
    output = next(
        (o for o in result.bake.outputs if o.finger == obj.name_full and o.track.spec.kind == "thimble"), None
    )
    times = felt.times if output is None else output.track.times
    with skin_models.one_thread():
        use = thimble_devices.prepared(device, felt.pressed)
        forces = core.matching.thimble.forces_at(felt, times)
        amounts = core.matching.thimble.amounts_at(felt, times)
        found = core.matching.thimble.match_touch(use, forces, use.device.servo_speed / spec.rate, amounts)
        made = core.matching.stimulus_plot.stimulus_plot(use, forces, found, amounts=amounts)
    return core.plot.stimuli.write(path, *core.command_line.thimble.picture(made, found, obj.name))
