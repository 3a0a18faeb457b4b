"""Voice-coil tracks as .hjif, the interchange format of MPEG haptics.

The format is ISO/IEC 23090-31 with the Simple Parametric profile. A file has one vibrotactile perception with one
channel and one band of the type *VectorialWave*. Such a band is a sine. Its amplitude (0 to 1) and frequency (whole Hz)
are linear between key frames, whose times are whole milliseconds. The reference device of the file states the
acceleration for an amplitude of 1. The date in the file is that of the standard, so equal tracks give equal bytes.

Source: the reader of github.com/MPEGGroup/HapticReferenceSoftware, source/IOHaptics/src/IOJson.cpp
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ..files import write_bytes
from .command_track import CommandTrack
from .vibration import Vibration, vibration_of

TICKS = 1000  # [1/s] ticks per second, the only timescale of the profile


def write(track: CommandTrack, path: Path) -> None:
    """Write a voice coil's track as an .hjif file in one atomic step.

    Raises:
        DermisError: see `vibration_of`; or the file cannot be written.
    """
    write_bytes(Path(path), dumps(track, vibration_of(track)).encode("utf-8"))


def dumps(track: CommandTrack, vibration: Vibration) -> str:
    """Return the file's text; equal tracks give equal text."""
    low, high = vibration.band
    times = np.unique(np.rint(np.concatenate([vibration.amplitude[0], vibration.frequency[0]]) * TICKS)).astype(int)
    amplitude, frequency = (np.interp(times / TICKS, *curve) for curve in (vibration.amplitude, vibration.frequency))
    keyframes = [
        {"relative_position": at, "amplitude_modulation": round(size, 5), "frequency_modulation": round(hertz)}
        for at, size, hertz in zip(times.tolist(), amplitude.tolist(), frequency.tolist(), strict=True)
    ]
    effect = {"effect_type": "Basis", "position": 0, "phase": 0.0, "base_signal": "Sine", "keyframes": keyframes}
    band = {
        "band_type": "VectorialWave",
        "lower_frequency_limit": int(np.floor(low)),
        "upper_frequency_limit": int(np.ceil(high)),
        "effects": [effect],
    }
    finger = str(track.meta.get("finger", track.spec.key))
    channel = {
        "id": 0,
        "description": finger,
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "reference_device_id": 0,
        "bands": [band],
    }
    device = {
        "id": 0,
        "name": track.spec.name,
        "body_part_mask": 0,
        "minimum_frequency": low,
        "maximum_frequency": high,
        "maximum_amplitude": vibration.full_scale,
        "maximum_voltage": track.spec.channel("voltage").high,
        "type": "VCA",
    }
    perception = {
        "id": 0,
        "avatar_id": 0,
        "description": vibration.said,
        "perception_modality": "Vibrotactile",
        "reference_devices": [device],
        "effect_library": [],
        "channels": [channel],
    }
    whole = {
        "version": "2023",
        "profile": "Simple Parametric",
        "level": 1,
        "date": "2023",
        "description": f"{finger}, {track.spec.name}",
        "timescale": TICKS,
        "avatars": [],
        "perceptions": [perception],
        "syncs": [],
    }
    return json.dumps(whole, indent=1) + "\n"
