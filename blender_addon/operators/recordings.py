# mypy: disable-error-code="valid-type"
"""Recorded poses as keys of the active object."""

from math import ceil

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from mathutils import Matrix

from .. import changes
from .._core import DermisError
from ..layouts import properties, words
from ..placing import keyed_poses, recording
from ..polls import needs
from ..quantities import metres_per_unit
from .work import File


@needs(
    lambda context: context.object is not None and context.object.is_editable and context.mode == "OBJECT",
    "Select the object that shall move, one of this file",
)
class DERMIS_OT_import_poses(File, bpy.types.Operator):
    """Key the active object, such as a finger, by recorded poses: columns of time, x, y, z and a quaternion"""

    bl_idname = "dermis.import_poses"
    bl_label = "Import Poses"
    bl_options = {"REGISTER", "UNDO"}
    suffix = ".csv"

    filter_glob: StringProperty(default="*.csv", options={"HIDDEN"})
    first: IntProperty(name="First Frame", description="Where the recording begins", default=1)
    rate: FloatProperty(
        name="Rows a Second", description="Of a file that has no times (3 or 7 columns)", default=100.0, min=0.1
    )
    unit: EnumProperty(
        name="Unit",
        description="Of the places",
        items=(("M", "Metres", ""), ("CM", "Centimetres", ""), ("MM", "Millimetres", "")),
    )
    y_up: BoolProperty(name="Y Is Up", description="As WebXR and many trackers write; else Z is up, as in Blender")
    w_last: BoolProperty(name="W Comes Last", description="Quaternions are x, y, z, w; else w, x, y, z")

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw what a file holds, then how it is read."""
        words(
            self.layout,
            "One row a pose: x, y, z in 3 columns; before them a time; after them a quaternion",
            230.0,
            "INFO",
        )
        properties(self.layout, self, "first", "rate", "unit", "y_up", "w_last", keys=False)

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the file and key it."""
        obj, scene, path = context.object, context.scene, self.path()
        assert obj is not None
        if obj.parent is not None or obj.rotation_mode == "AXIS_ANGLE":
            raise DermisError(
                "only an object without a parent, turned by Euler angles or a quaternion, can be keyed",
                where=f"object '{obj.name}'",
                remedy="Clear its parent, keeping the transformation",
            )
        times, places, turned = recording.read(
            path, rate=self.rate, unit=recording.UNITS[self.unit], y_up=self.y_up, w_last=self.w_last
        )
        rotation = obj.matrix_world.to_quaternion().to_matrix()
        unit = metres_per_unit(scene)
        poses = [
            Matrix.Translation(place / unit) @ (turned[i] if turned else rotation).to_4x4()
            for i, place in enumerate(places)
        ]
        rate = scene.render.fps / scene.render.fps_base
        last = keyed_poses.key(obj, [self.first + rate * float(t) for t in times], poses)
        scene.frame_end = max(scene.frame_end, ceil(last))
        changes.mark_dirty(obj.name)
        return f"Keyed {len(times)} poses, frames {self.first} to {ceil(last)}"


CLASSES: tuple[type, ...] = (DERMIS_OT_import_poses,)
