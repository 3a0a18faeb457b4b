"""What buttons do, one file per topic."""

from ..registration import registration
from . import (
    add,
    attach,
    bake,
    calibration,
    compare,
    curves,
    demo,
    design,
    devices,
    export,
    film,
    housekeeping,
    maps,
    material,
    pins,
    placing,
    plots,
    recordings,
    roles,
    skin,
    stream,
    strip,
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
    *film.CLASSES,
    *compare.CLASSES,
    *housekeeping.CLASSES,
    *maps.CLASSES,
    *skin.CLASSES,
    *pins.CLASSES,
    *stream.CLASSES,
    *calibration.CLASSES,
    *tracks.CLASSES,
    *thimble.CLASSES,
    *design.CLASSES,
    *strip.CLASSES,
    *curves.CLASSES,
    *plots.CLASSES,
)


register, unregister = registration(CLASSES)
