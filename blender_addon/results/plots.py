"""Plot a bake: tracks as images in Blender, stimuli as a picture file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import bpy

from .._core import Array, DermisError, core
from ..devices import active_presets, skin_models, thimble_devices
from . import store

SCALE = 1.5  # [px per point] scale at which letters are legible where an editor shows one image pixel per screen pixel
MARK = "dermis_plot"  # property of an image: the device whose plot it is


def make(result: Any, spreads: Mapping[int, Array] = MappingProxyType({})) -> dict[str, bpy.types.Image]:
    """Make an image of every track's plot; return them by file name of output.

    An image replaces the earlier one of its device.

    Args:
        spreads: bands about the curves, by the index of the output in the bake.
    """
    outputs, bake = core.pipeline.outputs, result.bake
    before = {str(image[MARK]): image for image in bpy.data.images if MARK in image}
    made = {}
    every = zip(outputs.file_names(bake), result.whose, bake.outputs, strict=True)
    for k, (name, device, output) in enumerate(every):
        data = outputs.plot_of(bake, output, scale=SCALE, spread=spreads.get(k))
        image = bpy.data.images.new(f"Plot {name}", 1, 1)
        image.pack(data=data, data_len=len(data))
        image.source = "FILE"
        image[MARK] = whose = " ".join(device) if device.device else name
        old = before.pop(whose, None) or before.pop(name, None)  # earlier versions marked an image with this name
        if old is not None:  # editors that show the old image then show the new one
            old.user_remap(image)
            bpy.data.images.remove(old)
        made[name] = image
    for name, image in made.items():  # the names are free once the old images are removed
        image.name = f"Plot {name}"
    return made


def write_stimuli(scene: bpy.types.Scene, obj: bpy.types.Object, path: Path) -> Path:
    """Write the stimulus plot of a finger's last bake; return its path.

    The touch is matched again with the present settings of the thimble.

    Raises:
        DermisError: no thimble, no bake with this finger's skin, nothing touched, or the file cannot be written.
    """
    device, result = active_presets.device_of(obj, "thimble"), store.current(scene)
    felt = result.bake.skins.get(obj.name_full) if result is not None else None
    spec = active_presets.spec_of(device.preset, "thimble") if device is not None else None
    if device is None or spec is None or result is None or felt is None:
        raise DermisError(
            "this finger's skin is not baked", where=f"finger '{obj.name}'", remedy="Press Bake, then draw the plot"
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
