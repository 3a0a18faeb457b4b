"""What the artist sets of a touch screen."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import IntProperty, PointerProperty, StringProperty

from ..compat import BLEND_RELATIVE
from .fields import OVERRIDE, choice, millimetres, switch, touched


def _is_mesh(_self: Any, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH" and obj.dermis.role != "SCREEN"


class DermisScreen(bpy.types.PropertyGroup):
    """A touch screen in the object's own XY plane, +Z towards the viewer; its size is that of the object's mesh."""

    source: choice(
        "Relief",
        "Where the relief that the finger shall feel comes from",
        (
            ("IMAGE", "Image", "An image of this file; white is high", "IMAGE_DATA", 0),
            ("FILE", "Image File", "A height or depth map from disk", "FILE_IMAGE", 1),
            ("SEQUENCE", "Image Sequence", "Numbered files, one a frame", "RENDER_ANIMATION", 2),
            ("MESH", "Mesh", "Ray-cast from any object that lies on the screen", "MESH_DATA", 3),
        ),
        "IMAGE",
    )
    image: PointerProperty(
        name="Image",
        description="The relief, brighter is higher",
        type=bpy.types.Image,
        update=touched,
        override=OVERRIDE,
    )
    filepath: StringProperty(
        name="File",
        description="Height map; of a sequence the first file",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        update=touched,
        override=OVERRIDE,
    )
    sequence_start: IntProperty(
        name="Start Frame",
        description="Scene frame that shows the sequence's first file",
        default=1,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    mesh_object: PointerProperty(
        name="Mesh",
        description="The object whose relief is cast onto the screen",
        type=bpy.types.Object,
        poll=_is_mesh,
        update=touched,
        override=OVERRIDE,
    )
    invert: switch("Depth Map", "The image holds depth, not height: brighter is farther away", False, options=set())
    zero_is_hole: switch(
        "Zero Is a Hole",
        "A stored 0 means that nothing was measured there, as depth cameras write "
        "it; such pixels are filled from their rims",
        False,
        options=set(),
    )
    height_mm: millimetres("Height", "How high white stands above black", 2.0, 0.0, 1e6, soft_max=20.0, options=set())
    resolution: IntProperty(
        name="Resolution",
        description="Points along the longer side when a mesh is cast onto the screen",
        default=256,
        min=2,
        max=8192,
        soft_max=1024,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    touch_distance_mm: millimetres(
        "Touch Gap", "The finger counts as touching up to this far above the screen", 1.0, 0.0, 1000.0, soft_max=10.0
    )
