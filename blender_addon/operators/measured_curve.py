# mypy: disable-error-code="valid-type"
"""Curve and frequency response of an actuator: read, type, remove."""

import math
from datetime import date
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from .._core import DermisError, core
from ..streaming import measured_curves, session
from .stream import Streaming
from .work import File, listed

HANDY = {"m": 1e-3, "rad": math.radians(1.0)}  # SI of a millimetre and of a degree


class _Measured(Streaming):
    """Gives one actuator of the list its new measurement."""

    bl_options = {"INTERNAL", "UNDO"}

    channel: StringProperty(name="Actuator", description="Whose it is", options={"HIDDEN", "SKIP_SAVE"})
    valid_days: IntProperty(
        name="Valid for Days",
        description="After so many days, Connect says that it has to be measured again; 0: never",
        default=30,
        min=0,
    )

    def more(self) -> dict[str, Any]:
        """Return the validity and the date of the readings."""
        return {"valid_days": self.valid_days, "measured_on": date.today().isoformat()}

    def take(self, context: bpy.types.Context, measured: Any) -> str:
        """Put a curve or a frequency response on the actuator; return words about it."""
        measured_curves.measure(context.scene, self.channel, measured)
        session.changed()
        words = measured_curves.said_of(measured, context.scene, self.channel)
        return f"{self.channel}: {words}. Save it as the device's"


class _Curve(_Measured):
    """Gives one actuator its curve."""

    latency: FloatProperty(
        name="Latency",
        description="From a command until the actuator answers. Tracks are played earlier by it",
        min=0.0,
        precision=3,
        unit="TIME_ABSOLUTE",
    )

    def more(self) -> dict[str, Any]:
        """Return the latency, the validity and the date of the readings."""
        return {"latency": self.latency, **super().more()}


class DERMIS_OT_measured_curve_load(_Curve, File, bpy.types.Operator):
    """Read the reached positions from a CSV with columns 'driven' and 'reached', such as 'driven [deg]'"""

    bl_idname = "dermis.measured_curve_load"
    bl_label = "Read Measured Curve"

    filter_glob: listed("*.csv;*.tsv;*.txt")

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the file."""
        row = context.scene.dermis_stream.channels.get(self.channel)
        unit = row.unit if row is not None else ""
        return self.take(context, core.devices.response_readings.read_csv(self.path(), unit, **self.more()))


class DERMIS_OT_measured_curve_type(_Curve, bpy.types.Operator):
    """Type the reached position for each driven position, in the order of the readings, up and down again"""

    bl_idname = "dermis.measured_curve_type"
    bl_label = "Type Measured Curve"

    readings: StringProperty(
        name="Readings",
        description="Pairs of driven and reached, parted by semicolons: '0 0.4; 30 29.1; 60 58.4'. Up alone, or up and "
        "down again with five or more readings each way: then play is known, too",
        options={"SKIP_SAVE"},
    )
    handy: BoolProperty(
        name="In mm or Degrees", description="Lengths are in mm and angles in degrees; otherwise in SI", default=True
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the readings."""
        return context.window_manager.invoke_props_dialog(
            self, width=460, title=f"Measured Curve of {self.channel}", confirm_text="Use"
        )

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the fields."""
        column = self.layout.column()
        column.use_property_split = True
        column.activate_init = True
        column.prop(self, "readings", placeholder="driven reached; driven reached; ...")
        for name in ("handy", "latency", "valid_days"):
            column.prop(self, name)

    def work(self, context: bpy.types.Context) -> str | None:
        """Take the readings."""
        row = context.scene.dermis_stream.channels.get(self.channel)
        factor = HANDY.get(row.unit, 1.0) if row is not None and self.handy else 1.0
        pairs = [pair.replace(":", " ").split() for pair in self.readings.split(";") if pair.strip()]
        try:
            driven, reached = zip(*((float(a) * factor, float(b) * factor) for a, b in pairs), strict=True)
        except ValueError:
            raise DermisError(
                "the readings are not pairs of numbers",
                where=self.channel,
                value=self.readings[:80],
                limit="'driven reached; driven reached; ...'",
            ) from None
        return self.take(context, core.devices.response_readings.of_readings(driven, reached, **self.more()))


class DERMIS_OT_frequency_response_load(_Measured, File, bpy.types.Operator):
    """Read how the actuator answers vibration, from a CSV with columns 'frequency [Hz]', 'gain' and 'phase [deg]'"""

    bl_idname = "dermis.frequency_response_load"
    bl_label = "Read Frequency Response"

    filter_glob: listed("*.csv;*.tsv;*.txt")

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the file."""
        return self.take(context, core.devices.frequency_response.read_csv(self.path(), **self.more()))


class DERMIS_OT_frequency_response_type(_Measured, bpy.types.Operator):
    """Type how the actuator answers vibration: frequency, how many times as far it moves as slowly, and its phase"""

    bl_idname = "dermis.frequency_response_type"
    bl_label = "Type Frequency Response"

    readings: StringProperty(
        name="Readings",
        description="Frequency [Hz], gain and phase [degrees] of each, parted by semicolons: '20 1 -5; 80 1.2 -30'. "
        "The gain is relative to slow movement; the phase is negative where the actuator lags, and holds its latency",
        options={"SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the readings."""
        return context.window_manager.invoke_props_dialog(
            self, width=460, title=f"Frequency Response of {self.channel}", confirm_text="Use"
        )

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the fields."""
        column = self.layout.column()
        column.use_property_split = True
        column.activate_init = True
        column.prop(self, "readings", placeholder="Hz gain degrees; Hz gain degrees; ...")
        column.prop(self, "valid_days")

    def work(self, context: bpy.types.Context) -> str | None:
        """Take the readings."""
        return self.take(context, core.devices.frequency_response.of_text(self.readings, **self.more()))


class DERMIS_OT_measured_curve_drop(Streaming, bpy.types.Operator):
    """Remove a measurement: curve or frequency response of the actuator count no more"""

    bl_idname = "dermis.measured_curve_drop"
    bl_label = "Remove Measurement"
    bl_options = {"INTERNAL", "UNDO"}

    channel: StringProperty(name="Actuator", description="Whose it is", options={"HIDDEN", "SKIP_SAVE"})
    part: EnumProperty(
        name="Measurement",
        description="Measurement to remove",
        items=(
            ("response", "Curve", "Reached position for each driven position"),
            ("frequency", "Frequency Response", "How it answers vibration"),
        ),
        options={"HIDDEN", "SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Remove the measurement."""
        measured_curves.drop(context.scene, self.channel, self.part)
        session.changed()
        return None


CLASSES: tuple[type, ...] = (
    DERMIS_OT_measured_curve_load,
    DERMIS_OT_measured_curve_type,
    DERMIS_OT_frequency_response_load,
    DERMIS_OT_frequency_response_type,
    DERMIS_OT_measured_curve_drop,
)
