"""Plots of a bake's tracks as images inside Blender, packed into the file where one is saved."""

from __future__ import annotations

from typing import Any

import bpy

from .._core import core

SCALE = 1.5  # pixels a point: a window shows it pixel by pixel, and letters stay letters
MARK = "dermis_plot"  # on an image, whose plot it is


def make(bake: Any) -> dict[str, bpy.types.Image]:
    """Make an image of every track's plot, in place of that of an earlier bake; return them by finger and device."""
    outputs = core.pipeline.outputs
    before = {str(image[MARK]): image for image in bpy.data.images if MARK in image}
    made = {}
    for name, output in zip(outputs.file_names(bake), bake.outputs, strict=True):
        data = outputs.plot_of(bake, output, scale=SCALE)
        image = bpy.data.images.new(f"Plot {name}", 1, 1)
        image.pack(data=data, data_len=len(data))
        image.source = "FILE"
        image[MARK] = name
        old = before.pop(name, None)
        if old is not None:  # editors that show it go on with the new one
            old.user_remap(image)
            bpy.data.images.remove(old)
            image.name = f"Plot {name}"
        made[name] = image
    return made
