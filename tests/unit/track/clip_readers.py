"""Readers of haptic clips, written by the readers of their makers: fields that must be there, their types and ranges.

* AHAP: Apple's *Representing haptic patterns in AHAP files*, and `core/datamodel/src/ios/v1.rs` of Lofelt's
  NiceVibrations.
* .haptic: `core/datamodel/src/v1.rs` there, with its `validate`.
* .hjif: `source/IOHaptics/src/IOJson.cpp` of MPEG's reference software, `load...` and `semanticConformanceCheck...`.

Each returns curves of amplitude and frequency: times [s] and values. They know nothing of what wrote the file.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class Clip(NamedTuple):
    """What a file says: curves of (times [s], values), and how long it is [s]."""

    amplitude: tuple[np.ndarray, np.ndarray]
    frequency: tuple[np.ndarray, np.ndarray]
    duration: float


def loads(path: Path) -> dict[str, Any]:
    def no_pairs_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        assert len({key for key, _ in pairs}) == len(pairs)
        return dict(pairs)

    def no_constant(word: str) -> None:
        raise AssertionError(word)

    found = json.loads(path.read_bytes(), object_pairs_hook=no_pairs_twice, parse_constant=no_constant)
    assert isinstance(found, dict)
    return found


def need(owner: dict[str, Any], **types: Any) -> list[Any]:
    """Return fields that must be there, of these types; float takes whole numbers too, int takes no fractions."""
    assert isinstance(owner, dict), owner
    for name, kind in types.items():
        assert name in owner, f"{name} is missing"
        value = owner[name]
        assert not isinstance(value, bool) and isinstance(value, (int, float) if kind is float else kind), (name, value)
    return [owner[name] for name in types]


# -- Apple


def read_ahap(path: Path) -> Clip:
    whole = loads(path)
    number, about, pattern = need(whole, Version=float, Metadata=dict, Pattern=list)
    assert number == 1.0 and all(isinstance(value, str) for value in about.values())
    curves: dict[str, list[tuple[float, float]]] = {}
    events: list[tuple[float, float]] = []
    for entry in pattern:
        assert isinstance(entry, dict) and len(entry) == 1
        ((kind, content),) = entry.items()
        if kind == "Event":
            time, name, length, parameters = need(
                content, Time=float, EventType=str, EventDuration=float, EventParameters=list
            )
            assert name == "HapticContinuous" and time >= 0.0 and 0.0 < length <= 30.0
            for parameter in parameters:
                which, value = need(parameter, ParameterID=str, ParameterValue=float)
                assert which in ("HapticIntensity", "HapticSharpness") and 0.0 <= value <= 1.0
            events.append((time, time + length))
        else:
            assert kind == "ParameterCurve"
            which, start, points = need(content, ParameterID=str, Time=float, ParameterCurveControlPoints=list)
            assert which in ("HapticIntensityControl", "HapticSharpnessControl") and 1 <= len(points) <= 16
            rows = [need(point, Time=float, ParameterValue=float) for point in points]
            assert all(time >= 0.0 and 0.0 <= value <= 1.0 for time, value in rows)
            curves.setdefault(which, []).extend((start + time, value) for time, value in rows)
    assert events[0][0] == 0.0 and all(abs(a[1] - b[0]) < 1e-5 for a, b in zip(events, events[1:], strict=False))
    strong, sharp = (np.array(curves[f"Haptic{name}Control"]).T for name in ("Intensity", "Sharpness"))
    rising(strong[0])
    rising(sharp[0])
    return Clip((strong[0], strong[1] ** 2), (sharp[0], 65.0 + 235.0 * sharp[1]), events[-1][1])


# -- Lofelt and Meta


def read_haptic(path: Path) -> Clip:
    version, signals = need(loads(path), version=dict, signals=dict)
    assert need(version, major=int, minor=int, patch=int) == [1, 0, 0]
    (continuous,) = need(signals, continuous=dict)
    (envelopes,) = need(continuous, envelopes=dict)
    found = {}
    for name in ("amplitude", "frequency"):
        (points,) = need(envelopes, **{name: list})
        rows = np.array([need(point, time=float, **{name: float}) for point in points]).T
        assert rows.shape[1] >= 1 and (rows[1] >= 0.0).all() and (rows[1] <= 1.0).all()
        rising(rows[0])
        found[name] = rows
    strong, fast = found["amplitude"], found["frequency"]
    return Clip((strong[0], strong[1]), (fast[0], 65.0 + 235.0 * np.sqrt(fast[1])), float(strong[0][-1]))


# -- MPEG


def read_hjif(path: Path) -> Clip:
    whole = loads(path)
    version, profile, level, date, _, ticks, avatars, perceptions, syncs = need(
        whole,
        version=str,
        profile=str,
        level=int,
        date=str,
        description=str,
        timescale=int,
        avatars=list,
        perceptions=list,
        syncs=list,
    )
    assert re.fullmatch(r"[0-9]{4}(-[0-9])?", version) and int(version[:4]) >= 2023 and re.match(r"[0-9]{4}", date)
    assert profile == "Simple Parametric" and level in (1, 2) and ticks == 1000 and avatars == syncs == []
    (perception,) = perceptions
    _, avatar, _, modality, channels, _, devices = need(
        perception,
        id=int,
        avatar_id=int,
        description=str,
        perception_modality=str,
        channels=list,
        effect_library=list,
        reference_devices=list,
    )
    assert avatar == 0 and modality == "Vibrotactile"
    (device,) = devices
    number, _, kind = need(device, id=int, name=str, type=str)
    assert kind in ("Unknown", "LRA", "VCA", "ERM", "Piezo")
    (channel,) = channels
    _, _, gain, mixing, _, bands = need(
        channel, id=int, description=str, gain=float, mixing_coefficient=float, body_part_mask=int, bands=list
    )
    assert gain == mixing == 1.0 and channel["reference_device_id"] == number
    (band,) = bands
    sort, low, high, effects = need(
        band, band_type=str, lower_frequency_limit=int, upper_frequency_limit=int, effects=list
    )
    assert sort == "VectorialWave" and low < high and "curve_type" not in band
    (effect,) = effects
    sort, position, keyframes = need(effect, effect_type=str, position=int, keyframes=list)
    assert sort == "Basis" and position == 0 and effect["base_signal"] in ("Sine", "Square", "Triangle")
    rows = np.array(
        [
            need(frame, relative_position=int, amplitude_modulation=float, frequency_modulation=int)
            for frame in keyframes
        ]
    ).T
    assert (np.diff(rows[0]) > 0).all() and (np.abs(rows[1]) <= 1.0).all()
    assert (rows[2] >= low).all() and (rows[2] <= high).all()
    at = rows[0] / ticks
    return Clip((at, rows[1]), (at, rows[2]), float(at[-1]))


def rising(times: np.ndarray) -> None:
    """Refuse times that go back; those of two parts of one curve may meet."""
    assert (np.diff(times) >= -1e-6).all() and times[0] >= 0.0


READERS = {"ahap": read_ahap, "haptic": read_haptic, "hjif": read_hjif}
