"""Plots of a bake's tracks as images inside Blender, packed into the file where one is saved."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import bpy

from .._core import Array, core

SCALE = 1.5  # pixels a point: a window shows it pixel by pixel, and letters stay letters
MARK = "dermis_plot"  # on an image, whose plot it is


def make(result: Any, spreads: Mapping[int, Array] = MappingProxyType({})) -> dict[str, bpy.types.Image]:
    """Make an image of every track's plot, in place of its device's earlier one; return them by finger and device.

    Args:
        spreads: bands about the curves, by the place among the bake's outputs.
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
        old = before.pop(whose, None) or before.pop(name, None)  # by its name: of an earlier version
        if old is not None:  # editors that show it go on with the new one
            old.user_remap(image)
            bpy.data.images.remove(old)
        made[name] = image
    for name, image in made.items():  # now that those before are gone
        image.name = f"Plot {name}"
    return made
