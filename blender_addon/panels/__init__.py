"""The Dermis tab and its menus: they draw, and do nothing else."""

import bpy

from .. import choices
from ..registration import registration
from . import (
    bake,
    calibration,
    compare,
    design,
    film,
    main,
    material,
    menus,
    object,
    pins,
    preview,
    skin,
    stream,
    thimble,
    told,
)

# In the order of the work: place, touch, wear, preview, bake, export, stream.
CLASSES: tuple[type, ...] = (
    *main.CLASSES,
    *object.PLACE,
    *material.CLASSES,
    *skin.OBJECT,
    *object.WEAR,
    *pins.CLASSES,
    *thimble.CLASSES,
    *design.OBJECT,
    *preview.CLASSES,
    *skin.VIEW,
    *bake.CLASSES,
    *film.CLASSES,
    *compare.CLASSES,
    *told.CLASSES,
    *stream.CLASSES,
    *calibration.CLASSES,
    *design.SCENE,
    *menus.CLASSES,
)


_add, _remove = registration(CLASSES, forget=(choices,))


def register() -> None:
    """Register panels and menus in the order in which they appear."""
    _add()
    bpy.types.VIEW3D_MT_add.append(menus.draw_add)
    bpy.types.TOPBAR_MT_file_import.append(menus.draw_import)
    bpy.types.TOPBAR_MT_file_export.append(menus.draw_export)


def unregister() -> None:
    """Undo `register`."""
    bpy.types.TOPBAR_MT_file_export.remove(menus.draw_export)
    bpy.types.TOPBAR_MT_file_import.remove(menus.draw_import)
    bpy.types.VIEW3D_MT_add.remove(menus.draw_add)
    _remove()
