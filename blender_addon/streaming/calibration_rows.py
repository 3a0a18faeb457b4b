"""Conversion of a calibration to rows of the panel's list, and back.

There is one row for each actuator of a device.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from .. import changes
from .._core import core
from ..preferences import library

FIELDS = ("name", "unit", "jog", "zero", "gain", "use_limits", "low", "high", "response", "frequency")

MEASURED = ("response", "frequency")  # kept as JSON

Rows = list[dict[str, Any]]

_restoring = False


def rows_of(channels: Any) -> Rows:
    """Return the rows of a collection of settings."""
    return [{name: getattr(channel, name) for name in FIELDS} for channel in channels]


def fill(channels: Any, rows: Rows) -> None:
    """Replace the contents of a collection of settings by rows."""
    channels.clear()
    for row in rows:
        channel = channels.add()
        for name, value in row.items():
            setattr(channel, name, value)


def rows_for(key: str, made: Any) -> Rows:
    """Return the rows of a preset's actuators with a calibration.

    Args:
        key: key of the preset. made: the calibration; None for the preset as it is.

    Raises:
        DermisError: no such preset, or its safe state is not valid.
    """
    fresh, safe = [], safe_pose(key)
    for channel in library().device(key).channels:
        if not channel.actuator:
            continue
        entry = made.entries.get(channel.name) if made is not None else None
        zero, gain, low, high = (entry.zero, entry.gain, entry.low, entry.high) if entry else (0.0, 1.0, None, None)
        limited = low is not None or high is not None
        low, high = (
            next((v for v in pair if v is not None), 0.0) for pair in ((low, channel.low), (high, channel.high))
        )
        fresh.append(
            {
                "name": channel.name,
                "unit": channel.unit,
                "jog": safe[channel.name],
                "zero": zero,
                "gain": gain,
                "use_limits": limited,
                "low": low,
                "high": high,
                **{part: _text(entry, part) for part in MEASURED},
            }
        )
    return fresh


def safe_pose(key: str) -> dict[str, float]:
    """Return the pose of a preset that presses nobody, by channel [SI].

    The values are commands. A calibration moves this pose as it moves every other one.

    Raises:
        DermisError: no such preset, or its safe state is not valid.
    """
    spec = library().device(key)
    stated = core.devices.safe_state.safe_state(spec).values
    return {c.name: stated.get(c.name, c.rest) for c in spec.channels}


def calibration(key: str, rows: Rows) -> Any:
    """Return the calibration that rows hold, for a preset.

    Rows of actuators that the preset does not have are ignored.

    Raises:
        DermisError: no such preset, or a number is not valid.
    """
    spec = library().device(key)
    made = core.devices.calibration.Calibration.of(spec)
    for row in rows:
        if row["name"] in {c.name for c in spec.channels} and calibrated(row):
            limits = {name: row[name] for name in ("low", "high")} if row["use_limits"] else {}
            measured = {part: read(part, row[part]) if row[part] else None for part in MEASURED}
            made = made.with_entry(row["name"], zero=row["zero"], gain=row["gain"], **measured, **limits)
    return made


def calibrated(row: dict[str, Any]) -> bool:
    """Return whether an actuator differs from its preset."""
    return bool(row["zero"] != 0.0 or row["gain"] != 1.0 or row["use_limits"] or any(row[part] for part in MEASURED))


def same(rows: Rows, made: Any) -> bool:
    """Return whether rows equal a calibration, in single precision.

    Args:
        rows: the rows. made: the calibration; None for the preset as it is.
    """
    for row in rows:
        entry = made.entries.get(row["name"]) if made is not None else None
        if entry is None:
            if calibrated(row):
                return False
            continue
        if row["use_limits"] != (entry.low is not None or entry.high is not None):
            return False
        if any(row[part] != _text(entry, part) for part in MEASURED):
            return False
        wanted = {"zero": entry.zero, "gain": entry.gain, "low": entry.low, "high": entry.high}
        if any(v is not None and float(np.float32(v)) != row[name] for name, v in wanted.items()):
            return False
    return True


def read(part: str, text: str) -> Any:
    """Return the measurement that the list holds as JSON.

    It is a curve for 'response', and a frequency response for 'frequency'.

    Raises:
        DermisError: the text is not such a measurement.
    """
    kinds = core.devices.response.Response, core.devices.frequency_response.FrequencyResponse
    return kinds[MEASURED.index(part)].loads(text)


def _text(entry: Any, part: str) -> str:
    """Return the measurement of an actuator as the list holds it; '' for none."""
    measured = getattr(entry, part) if entry is not None else None
    return "" if measured is None else str(measured.dumps())


@contextmanager
def quietly(scene: bpy.types.Scene) -> Iterator[None]:
    """Change settings that belong together without passing half of them on."""
    global _restoring
    changes.expect(scene)
    before, _restoring = _restoring, True
    try:
        yield
    finally:
        _restoring = before


def restoring() -> bool:
    """Return whether `quietly` changes settings, which are not passed on yet."""
    return _restoring
