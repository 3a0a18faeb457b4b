"""The Dermis tab and its menus: they draw, and do nothing else."""

import bpy

from .. import choices
from . import bake, calibration, design, main, material, menus, object, pins, preview, skin, stream, thimble

CLASSES: tuple[type, ...] = (
    *main.CLASSES,
    *object.CLASSES,
    *material.CLASSES,
    *pins.CLASSES,
    *thimble.CLASSES,
    *design.OBJECT,
    *skin.OBJECT,
    *bake.RESULT,
    *skin.VIEW,
    *preview.CLASSES,
    *design.SCENE,
    *stream.CLASSES,
    *calibration.CLASSES,
    *bake.SETTINGS,
    *menus.CLASSES,
)


def register() -> None:
    """Register panels and menus in the order in which they appear."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.VIEW3D_MT_add.append(menus.draw_add)


def unregister() -> None:
    """Undo `register`."""
    bpy.types.VIEW3D_MT_add.remove(menus.draw_add)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    choices.forget()
