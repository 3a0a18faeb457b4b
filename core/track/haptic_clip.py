"""Voice-coil tracks as .haptic files, version 1.0.0.

The format is that of Meta's Haptics Studio and of Lofelt's NiceVibrations. A file has curves of amplitude and frequency
over time, both from 0 to 1. When these programs convert a file to AHAP, the sharpness is the square root of the
frequency. The frequency in a file is therefore the square of the sharpness in `ahap.py`.

Source: the data model of github.com/Lofelt/NiceVibrations, core/datamodel/src/v1.rs
"""

from __future__ import annotations

import json
from pathlib import Path

from ..errors import Finding
from ..files import write_bytes
from ..version import version
from .ahap import sharpness, sharpness_findings
from .command_track import CommandTrack
from .vibration import Vibration, vibration_of


def write(track: CommandTrack, path: Path) -> tuple[Finding, ...]:
    """Write a voice coil's track as a .haptic file; return the findings.

    The file is written in one atomic step.

    Raises:
        DermisError: see `vibration_of`; or the file cannot be written.
    """
    found = vibration_of(track)
    write_bytes(Path(path), dumps(track, found).encode("utf-8"))
    return sharpness_findings(track, found)


def dumps(track: CommandTrack, vibration: Vibration) -> str:
    """Return the file's text; equal tracks give equal text."""
    curves = {}
    for name, (times, values) in (
        ("amplitude", vibration.amplitude),
        ("frequency", (vibration.frequency[0], sharpness(vibration.frequency[1]) ** 2)),
    ):
        rows = zip(times.tolist(), values.tolist(), strict=True)
        curves[name] = [{"time": round(time, 6), name: round(value, 5)} for time, value in rows]
    about = {
        "editor": f"Dermis {version()}",
        "author": "",
        "source": str(track.meta.get("finger", track.spec.key)),
        "project": "",
        "tags": [],
        "description": vibration.said,
    }
    whole = {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": about,
        "signals": {"continuous": {"envelopes": curves}},
    }
    return json.dumps(whole, indent=1) + "\n"
