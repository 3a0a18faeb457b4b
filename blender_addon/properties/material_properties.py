"""What the artist sets of something that can be touched."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import StringProperty

from .. import choices
from .._core import core
from .fields import OVERRIDE, declared


def _material_keys(_self: Any, _context: Any, text: str) -> list[str]:
    return [entry.key for entry in choices.materials() if text.lower() in f"{entry.key} {entry.name}".lower()]


@declared(core.parameters.material.BODY)
class DermisMaterial(bpy.types.PropertyGroup):
    """Haptic material and behaviour of something that can be touched."""

    preset: StringProperty(
        name="Preset",
        description="The preset that the values below were last taken from",
        search=_material_keys,
        options=set(),
        override=OVERRIDE,
    )
