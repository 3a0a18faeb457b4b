"""Voice-coil tracks as AHAP, the patterns of Apple's Core Haptics.

Files are of version 1. An event lasts up to 30 s and a parameter curve has up to 16 points, which are Apple's limits.
Longer tracks have several continuous events and several curves of intensity and sharpness. Both quantities are
relative, since the actuator of a phone differs from the coil. Intensity is the square root of the amplitude, as in
Meta's converter from .haptic. Sharpness 0 to 1 stands for 65 to 300 Hz, as in MPEG's reference encoder. Frequencies
outside this range are set to its limits.

Source: Apple, *Representing haptic patterns in AHAP files*; times of control points count from their curve's
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import Finding
from ..files import write_bytes
from .command_track import CommandTrack
from .vibration import Vibration, vibration_of

POINTS = 16  # largest number of points of a parameter curve
LONGEST = 30.0  # [s] longest continuous event
SOFT, SHARP = 65.0, 300.0  # [Hz] frequencies of sharpness 0 and 1


def write(track: CommandTrack, path: Path) -> tuple[Finding, ...]:
    """Write a voice coil's track as an AHAP file; return the findings.

    The file is written in one atomic step.

    Raises:
        DermisError: see `vibration_of`; or the file cannot be written.
    """
    found = vibration_of(track)
    write_bytes(Path(path), dumps(track, found).encode("utf-8"))
    return sharpness_findings(track, found)


def dumps(track: CommandTrack, vibration: Vibration) -> str:
    """Return the file's text; equal tracks give equal text."""
    pattern: list[dict[str, Any]] = []
    for start in np.arange(0.0, vibration.duration, LONGEST).tolist():
        event = {
            "Time": start,
            "EventType": "HapticContinuous",
            "EventDuration": round(min(LONGEST, vibration.duration - start), 6),
            "EventParameters": [
                {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
                {"ParameterID": "HapticSharpness", "ParameterValue": 0.0},
            ],
        }
        pattern.append({"Event": event})
    times, amplitude = vibration.amplitude
    pattern += _curves("HapticIntensityControl", times, np.sqrt(amplitude))
    pattern += _curves("HapticSharpnessControl", vibration.frequency[0], sharpness(vibration.frequency[1]))
    about = {"Project": str(track.meta.get("finger", track.spec.name)), "Created": "", "Description": vibration.said}
    return json.dumps({"Version": 1.0, "Metadata": about, "Pattern": pattern}, indent=1) + "\n"


def sharpness(hertz: Array) -> Array:
    """Return Apple's sharpness, 0 to 1, of frequencies [Hz]."""
    return np.clip((hertz - SOFT) / (SHARP - SOFT), 0.0, 1.0)


def sharpness_findings(track: CommandTrack, vibration: Vibration) -> tuple[Finding, ...]:
    """Return a finding if frequencies are outside the range of sharpness."""
    hertz = vibration.frequency[1]
    beyond = (hertz < SOFT) | (hertz > SHARP)
    if not beyond.any() or not vibration.amplitude[1].any():
        return ()
    return (
        Finding(
            "info",
            "frequency-limited",
            "some frequencies are outside the format's range, and were set to its limits",
            where=f"track of '{track.meta.get('finger', track.spec.key)}'",
            value=f"{hertz.min():.4g} to {hertz.max():.4g} Hz",
            limit=f"{SOFT:g} to {SHARP:g} Hz",
            count=int(beyond.sum()),
        ),
    )


def _curves(name: str, times: Array, values: Array) -> list[dict[str, Any]]:
    """Return a curve in parts of up to 16 points.

    Each part begins with the last point of the part before.

    Args:
        name: parameter in the file.
        times: [s], shape (n,).
        values: shape (n,).
    """
    parts = []
    for first in range(0, max(len(times) - 1, 1), POINTS - 1):
        rows = slice(first, first + POINTS)
        points = [
            {"Time": round(t - float(times[first]), 6), "ParameterValue": round(v, 5)}
            for t, v in zip(times[rows].tolist(), values[rows].tolist(), strict=True)
        ]
        curve = {"ParameterID": name, "Time": round(float(times[first]), 6), "ParameterCurveControlPoints": points}
        parts.append({"ParameterCurve": curve})
    return parts
