# mypy: disable-error-code="valid-type"
"""Recorded poses as keys of the active object."""

from dataclasses import replace
from math import ceil
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from mathutils import Matrix

from .. import changes, reporting, scene_time
from .._core import DermisError, core
from ..layouts import properties, words
from ..placing import keyed_poses
from ..polls import needs
from ..quantities import metres_per_unit
from .work import File, listed

UNITS = {"M": 1.0, "CM": 1e-2, "MM": 1e-3}  # [m]
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # turns +Y, their up axis, into +Z, Blender's
SHOWN, LOOKED_AT = 4, 1000  # number of rows that the dialog shows, and number of rows on which it tries the columns


def _compose(self: Any, _context: bpy.types.Context) -> None:
    """Write the choices of the dialog as names of columns."""
    if self.ask:
        names_of = core.motion.recorded_poses.names_of
        chosen = self.turn != "ASK"
        self.columns = names_of(self.time.lower(), self.turn.lower(), self.unit.lower()) if chosen else ""


@needs(
    lambda context: context.object is not None and context.object.is_editable and context.mode == "OBJECT",
    "Select the object that shall move, one of this file",
)
class DERMIS_OT_import_poses(File, bpy.types.Operator):
    """Key the active object, such as a finger, by recorded poses: a time, x, y, z and a rotation in each row"""

    bl_idname = "dermis.import_poses"
    bl_label = "Import Poses"
    bl_options = {"REGISTER", "UNDO"}
    suffix = ".csv"

    filter_glob: listed("*.csv;*.txt;*.tsv")
    first: IntProperty(name="First Frame", description="Frame at which the recording begins", default=1)
    rate: FloatProperty(
        name="Rows a Second",
        description="Rows per second of a file that has no times or counts frames",
        default=100.0,
        min=0.1,
    )
    unit: EnumProperty(
        name="Unit",
        description="Unit of the positions, if the file does not name it",
        items=(
            ("M", "Metres", "Positions are in metres"),
            ("CM", "Centimetres", "Positions are in centimetres"),
            ("MM", "Millimetres", "Positions are in millimetres"),
        ),
        update=_compose,
    )
    y_up: BoolProperty(
        name="Y Is Up",
        description="The file has Y up, as WebXR and many trackers write it; otherwise Z is up, as in Blender",
    )
    columns: StringProperty(
        name="Columns",
        description="Names of the columns, separated by commas, if the file has none or others: 'time_ms, x_mm, y_mm, "
        "z_mm, qw, qx, qy, qz'; '-' is a column that is not used. If empty, the file's own names are used",
    )
    time: EnumProperty(
        name="Time",
        description="Meaning of the first column",
        items=(
            ("NONE", "None", "Rows have no time; they follow at the rate of Rows a Second"),
            ("S", "Seconds", "Times are in seconds"),
            ("MS", "Milliseconds", "Times are in milliseconds"),
            ("US", "Microseconds", "Times are in microseconds"),
            ("NS", "Nanoseconds", "Times are in nanoseconds"),
            ("FRAME", "Frames", "The first column counts frames, at Rows a Second"),
        ),
        options={"SKIP_SAVE"},
        update=_compose,
    )
    turn: EnumProperty(
        name="Rotation",
        description="Meaning of the columns after x, y and z",
        items=(
            ("NONE", "None", "The object keeps its rotation"),
            ("WXYZ", "Quaternion W, X, Y, Z", "The real part is the first of four columns"),
            ("XYZW", "Quaternion X, Y, Z, W", "The real part is the last of four columns"),
            ("EULER_DEG", "Euler Angles, Degrees", "About the fixed X, then Y, then Z: roll, pitch, yaw"),
            ("EULER_RAD", "Euler Angles, Radians", "About the fixed X, then Y, then Z: roll, pitch, yaw"),
            ("VECTOR_RAD", "Rotation Vector, Radians", "Axis times angle"),
            ("VECTOR_DEG", "Rotation Vector, Degrees", "Axis times angle"),
            ("ASK", "Choose", "The numbers do not show whether W is the first or the last column of the quaternion"),
        ),
        options={"SKIP_SAVE"},
        update=_compose,
    )
    by_hand: BoolProperty(name="By Hand", description="A person chose the file", options={"HIDDEN", "SKIP_SAVE"})
    ask: BoolProperty(name="Ask", description="Ask for the columns", options={"HIDDEN", "SKIP_SAVE"})
    _rows: Any = None  # rows of the file for which the dialog is drawn

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file, then for the columns if it does not name them."""
        if not self.ask:
            self.by_hand = True
            return super().invoke(context, event)
        try:
            self._rows = core.number_rows.read_rows(self.path())
        except DermisError as error:
            return reporting.report_error(self, error, self.bl_label)
        self._guess()
        return context.window_manager.invoke_props_dialog(self, width=640, title="Meaning of the Columns")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Key the object.

        A person who chose the file is first asked for missing columns and units.
        """
        if self.by_hand and not self.ask and not self.columns and not bpy.app.background and self._unsaid():
            bpy.ops.dermis.import_poses(
                "INVOKE_DEFAULT",
                filepath=self.filepath,
                first=self.first,
                rate=self.rate,
                unit=self.unit,
                y_up=self.y_up,
                ask=True,
            )
            return {"CANCELLED"}
        return super().execute(context)

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the contents of a file, then the choices."""
        if self.ask:
            self._draw_question()
        else:
            text = "One row per pose. The first line names columns and units: time [ms], x_mm, qw, rx_deg ..."
            words(self.layout, text, 230.0, "INFO")
        properties(self.layout, self, "first", "rate", "unit", "y_up", "columns", keys=False)

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
        made = core.motion.recorded_poses.read(path, columns=self.columns, rate=self.rate, unit=self._unit())
        up = _Y_UP if self.y_up else np.eye(3)
        places = made.places @ up.T / metres_per_unit(scene)
        own = np.array(obj.matrix_world.to_quaternion().to_matrix())
        turns = np.broadcast_to(own, (len(places), 3, 3)) if made.turns is None else up @ made.turns
        poses = [
            Matrix.Translation(place) @ Matrix(turn).to_4x4()
            for place, turn in zip(places.tolist(), turns, strict=True)
        ]
        frames = scene_time.clock(scene, self.first).frames(made.times)
        keyed_poses.key(obj, scene_time.evaluated(scene, frames).tolist(), poses)
        last = ceil(frames[-1])
        scene.frame_end = max(scene.frame_end, last)
        changes.mark_dirty(obj.name)
        span = np.ptp(made.places, axis=0).max()
        unused = f"; not used: {', '.join(made.unused)}" if made.unused else ""
        return (
            f"Keyed {len(places)} poses over {made.times[-1]:.4g} s and {1e3 * span:.4g} mm, "
            f"frames {self.first} to {last}"
            f"{'' if made.turns is not None else ', without rotation'}{unused}"
        )

    def _unit(self) -> float | None:
        """Return the unit of places [m]; None for metres.

        With None, places without a unit are read as metres, and are refused if they would be too far away.
        """
        return None if self.unit == "M" else UNITS[self.unit]

    def _unsaid(self) -> bool:
        """Return whether the file does not name its columns."""
        try:
            core.motion.recorded_poses.read(self.path(), unit=self._unit())
        except DermisError as error:
            return bool(error.code == core.motion.recorded_poses.NOT_SAID)
        return False

    def _guess(self) -> None:
        """Choose the most likely contents of the file."""
        found = core.motion.recorded_poses.guess(self._rows)
        choices = found.time or "s", found.turn or "ask", found.unit or "m"
        self.time, self.turn, self.unit = (choice.upper() for choice in choices)
        self.columns = core.motion.recorded_poses.suggestion(self._rows)  # nothing where the person has to choose

    def _draw_question(self) -> None:
        """Draw the first rows, the choices and their result."""
        layout, rows = self.layout, self._rows
        properties(layout, self, "time", "turn", keys=False)
        if rows is None:  # in the panel of the last operation
            return
        named = [name.strip() for name in self.columns.split(",")] if self.columns else list(rows.names)
        grid = layout.box().row()
        for index in range(rows.values.shape[1]):
            column = grid.column(align=True)
            column.label(text=named[index] if index < len(named) else "?")
            for value in rows.values[:SHOWN, index]:
                column.label(text=f"{value:.6g}")
        few = replace(rows, values=rows.values[:LOOKED_AT], lines=rows.lines[:LOOKED_AT])
        try:
            made = core.motion.recorded_poses.of_rows(few, columns=self.columns, rate=self.rate, unit=self._unit())
        except DermisError as error:
            words(layout, f"{error.what[0].upper()}{error.what[1:]} ({error.value}).", 600.0, "ERROR")
        else:
            span = np.ptp(made.places, axis=0).max()
            text = f"The first {len(made.times)} rows take {made.times[-1]:.4g} s and move {1e3 * span:.4g} mm."
            words(layout, text, 600.0, "CHECKMARK")


CLASSES: tuple[type, ...] = (DERMIS_OT_import_poses,)
