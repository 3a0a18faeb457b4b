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

    channel: StringProperty(
        name="Actuator", description="Actuator to which the measurement belongs", options={"HIDDEN", "SKIP_SAVE"}
    )
    valid_days: IntProperty(
        name="Valid for Days",
        description="Number of days after which Connect reports that the measurement has to be repeated. 0 is never",
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
        description="Time from a command to the response of the actuator. Tracks are played earlier by this time",
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
        description="Pairs of driven and reached position, separated by semicolons: '0 0.4; 30 29.1; 60 58.4'. Upwards "
        "only, or up and down again with at least five readings in each direction, which also gives the play",
        options={"SKIP_SAVE"},
    )
    handy: BoolProperty(
        name="In mm or Degrees",
        description="Lengths are in mm and angles in degrees; otherwise in SI units",
        default=True,
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
    """Read the actuator's frequency response from a CSV with the columns 'frequency [Hz]', 'gain' and 'phase [deg]'"""

    bl_idname = "dermis.frequency_response_load"
    bl_label = "Read Frequency Response"

    filter_glob: listed("*.csv;*.tsv;*.txt")

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the file."""
        return self.take(context, core.devices.frequency_response.read_csv(self.path(), **self.more()))


class DERMIS_OT_frequency_response_type(_Measured, bpy.types.Operator):
    """Type the actuator's frequency response: frequency, gain relative to slow movement, and phase"""

    bl_idname = "dermis.frequency_response_type"
    bl_label = "Type Frequency Response"

    readings: StringProperty(
        name="Readings",
        description="Frequency [Hz], gain and phase [degrees], separated by semicolons: '20 1 -5; 80 1.2 -30'. The "
        "gain is relative to slow movement. The phase is negative if the actuator lags, and includes its latency",
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
    """Remove a measurement of the actuator: its curve or its frequency response"""

    bl_idname = "dermis.measured_curve_drop"
    bl_label = "Remove Measurement"
    bl_options = {"INTERNAL", "UNDO"}

    channel: StringProperty(
        name="Actuator", description="Actuator to which the measurement belongs", options={"HIDDEN", "SKIP_SAVE"}
    )
    part: EnumProperty(
        name="Measurement",
        description="Measurement to remove",
        items=(
            ("response", "Curve", "Reached position for each driven position"),
            ("frequency", "Frequency Response", "Gain and phase against frequency"),
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
