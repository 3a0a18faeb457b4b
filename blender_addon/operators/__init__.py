"""What buttons do, one file per topic."""

from ..registration import registration
from . import (
    add,
    attach,
    bake,
    calibration,
    demo,
    design,
    devices,
    export,
    housekeeping,
    maps,
    material,
    pins,
    placing,
    presets,
    recordings,
    roles,
    skin,
    stream,
    thimble,
    tracks,
)

CLASSES: tuple[type, ...] = (
    *add.CLASSES,
    *attach.CLASSES,
    *demo.CLASSES,
    *roles.CLASSES,
    *placing.CLASSES,
    *recordings.CLASSES,
    *material.CLASSES,
    *devices.CLASSES,
    *bake.CLASSES,
    *export.CLASSES,
    *housekeeping.CLASSES,
    *maps.CLASSES,
    *skin.CLASSES,
    *presets.CLASSES,
    *pins.CLASSES,
    *stream.CLASSES,
    *calibration.CLASSES,
    *tracks.CLASSES,
    *thimble.CLASSES,
    *design.CLASSES,
)


register, unregister = registration(CLASSES)
