"""Settings of a touchable object."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

import bpy
from bpy.props import StringProperty

from .. import choices
from .._core import core
from .fields import OVERRIDE, declare_one, declared


@declared(core.parameters.material.BODY)
class DermisMaterial(bpy.types.PropertyGroup):
    """Haptic material and behaviour of something that can be touched."""

    preset: StringProperty(
        name="Preset",
        description="The preset that the values below were last taken from",
        search=lambda _self, _context, text: choices.search("materials", text),
        options=set(),
        override=OVERRIDE,
    )
    curved: declare_one(core.parameters.material.CURVED)
