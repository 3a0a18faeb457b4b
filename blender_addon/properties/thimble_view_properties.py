"""Display of thimbles in the view: parameters only. A thimble's method is set on its device."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

import bpy
from bpy.props import BoolProperty

from .fields import redrawn


class DermisThimbleView(bpy.types.PropertyGroup):
    """Display of thimbles in the 3D view beside their twin."""

    split: BoolProperty(
        name="Split View",
        description="Show the skin as the thimble renders it beside the target, as maps of the pad. "
        "Needs the finger's skin to be shown",
        default=True,
        options=set(),
        update=redrawn,
    )
    workspace: BoolProperty(
        name="Workspace",
        description="Draw where the pointer under the disc can go, at several heights: each loop is "
        "the largest tilt in every direction",
        default=False,
        options=set(),
        update=redrawn,
    )
