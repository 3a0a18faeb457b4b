"""Measured curves and frequency responses in the list of actuators.

The functions store them, describe them in words, and report their age.
"""

from __future__ import annotations

from datetime import date
from typing import Any

import bpy
import numpy as np

from .._core import DermisError, core
from ..preferences import library
from ..quantities import quantity
from . import calibration_offers, device_calibration


def found(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return findings on the calibration that the list holds, such as its age.

    Raises:
        DermisError: a number is not valid.
    """
    key = scene.dermis_stream.channels_owner.rpartition(": ")[2]
    return tuple(device_calibration.calibration_of(scene, key).findings(library().device(key), date.today()))


def measure(scene: bpy.types.Scene, channel: str, measured: Any) -> None:
    """Give an actuator of the list its measured curve or frequency response.

    Raises:
        DermisError: the list has no such actuator, or the device cannot be driven with it.
    """
    _put(scene, channel, "response" if isinstance(measured, core.devices.response.Response) else "frequency", measured)


def drop(scene: bpy.types.Scene, channel: str, part: str) -> None:
    """Remove an actuator's curve ('response') or frequency response ('frequency').

    Raises:
        DermisError: the list has no such actuator.
    """
    _put(scene, channel, part, None)


def _put(scene: bpy.types.Scene, channel: str, part: str, measured: Any) -> None:
    settings = scene.dermis_stream
    row = settings.channels.get(channel)
    if row is None or not calibration_offers.is_ours(settings):
        raise DermisError(
            "no such actuator is listed", value=channel, remedy="Connect once: the actuators are then listed"
        )
    key = settings.channels_owner.rpartition(": ")[2]
    made = device_calibration.calibration_of(scene, key).with_entry(channel, **{part: measured})
    core.stream.protocols.wire.Wire.of(library().device(key), made)  # refuses a safe state that is out of reach
    setattr(row, part, "" if measured is None else measured.dumps())


def said_of(measured: Any, scene: bpy.types.Scene, channel: str) -> str:
    """Return words on a measurement: the actuator's response, scatter and date.

    For a curve, the range in the preset is given, too.
    """
    if isinstance(measured, core.devices.response.Response):
        unit = scene.dermis_stream.channels[channel].unit
        low, high = (quantity(value, unit) for value in measured.reach)
        reached = f"reaches {low} to {high}"
        if told := _preset_range(scene, channel, unit):
            reached += f" (preset: {told})"
        parts = [reached, f"play {quantity(measured.play, unit).lstrip('+')}"]
        if measured.scatter:
            parts.append(f"readings scatter by {quantity(measured.scatter, unit).lstrip('+')}")
    else:
        (first, last), (hertz, gain) = measured.span, measured.peak
        parts = [f"answers {first:g} to {last:g} Hz", f"{gain:.3g} times at {hertz:g} Hz"]
    if measured.measured_on:
        parts.append(f"measured on {measured.measured_on}")
    return ", ".join(parts)


def _preset_range(scene: bpy.types.Scene, channel: str, unit: str) -> str:
    """Return in words the range of an actuator in the preset, '' if it has none."""
    key = scene.dermis_stream.channels_owner.rpartition(": ")[2]
    try:
        wire = core.stream.protocols.wire.Wire.of(library().device(key))
    except DermisError:  # its preset is gone
        return ""
    ends = [values[wire.names.index(channel)] for values in (wire.range_low, wire.range_high) if channel in wire.names]
    return " to ".join(quantity(float(end), unit) for end in ends) if np.isfinite(ends).all() else ""
