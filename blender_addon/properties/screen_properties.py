"""Settings of a touch screen."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty, PointerProperty, StringProperty

from .._core import core
from ..compat import BLEND_RELATIVE
from .fields import OVERRIDE, declare_one, declared, switch, touched


def _is_mesh(_self: Any, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH" and obj.dermis.role != "SCREEN"


_screen = core.parameters.screen


@declared(_screen.SCREEN)
class DermisScreen(bpy.types.PropertyGroup):
    """A touch screen in the object's own XY plane, +Z towards the viewer; its size is that of the object's mesh."""

    source: EnumProperty(
        name="Relief",
        description="Source of the relief",
        items=(
            ("IMAGE", "Image", "An image of this file; white is high", "IMAGE_DATA", 0),
            ("FILE", "Image File", "A height or depth map from disk", "FILE_IMAGE", 1),
            ("SEQUENCE", "Image Sequence", "Numbered files, one per frame", "RENDER_ANIMATION", 2),
            ("MESH", "Mesh", "Ray-cast from any object that lies on the screen", "MESH_DATA", 3),
        ),
        default="IMAGE",
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    image: PointerProperty(
        name="Image",
        description="Image of the relief; brighter is higher",
        type=bpy.types.Image,
        update=touched,
        override=OVERRIDE,
    )
    filepath: StringProperty(
        name="File",
        description="File of the height map, or the first file of a sequence",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        update=touched,
        override=OVERRIDE,
    )
    sequence_start: declare_one(_screen.SEQUENCE["sequence_start"])
    mesh_object: PointerProperty(
        name="Mesh",
        description="Object whose relief is cast onto the screen",
        type=bpy.types.Object,
        poll=_is_mesh,
        update=touched,
        override=OVERRIDE,
    )
    invert: switch("Depth Map", "The image holds depth, not height: brighter is farther away", False)
    no_data: declare_one(_screen.NO_DATA)
    zero_is_hole: switch("Zero Is a Hole", "Saved by earlier versions; No Data says it now", False)
    map_unit: declare_one(_screen.MAP_UNIT)
    height_mm: declare_one(_screen.HEIGHT)
    resolution: IntProperty(
        name="Resolution",
        description="Number of points along the longer side, for a mesh that is cast onto the screen",
        default=256,
        min=2,
        max=8192,
        soft_max=1024,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
