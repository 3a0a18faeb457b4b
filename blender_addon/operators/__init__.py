"""What buttons do, one file per topic."""

import bpy

from . import (
    add,
    bake,
    calibration,
    demo,
    design,
    devices,
    export,
    housekeeping,
    material,
    pins,
    roles,
    skin,
    stream,
    thimble,
    tracks,
)

CLASSES: tuple[type, ...] = (
    *add.CLASSES,
    *demo.CLASSES,
    *roles.CLASSES,
    *material.CLASSES,
    *devices.CLASSES,
    *bake.CLASSES,
    *export.CLASSES,
    *housekeeping.CLASSES,
    *skin.CLASSES,
    *pins.CLASSES,
    *stream.CLASSES,
    *calibration.CLASSES,
    *tracks.CLASSES,
    *thimble.CLASSES,
    *design.CLASSES,
)


def register() -> None:
    """Register the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
