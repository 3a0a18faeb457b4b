"""Vibration of a voice coil's track, and the clips that phones and controllers are told it by."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.presets import Library
from core.track import export
from core.track.command_track import CommandTrack
from core.track.vibration import thinned, vibration_of
from tests.unit.track.clip_readers import READERS

COIL = Library().device("voice_coil")
RATE = 8000.0
FULL = 3.0 * 5.8  # [m/s^2] what 3 V make at each measured frequency, 50 Hz being the weakest
HELD = 0.7 * FULL


def a_track(acceleration: float = HELD, hertz: float = 200.0, seconds: float = 2.0) -> CommandTrack:
    """A vibration that is on from 0.5 to 1.5 s."""
    t = np.arange(round(seconds * RATE) + 1) / RATE
    on = np.where((t >= 0.5) & (t <= 1.5), np.minimum(np.minimum(t - 0.5, 1.5 - t) / 0.02, 1.0), 0.0)
    displacement = acceleration / (2 * np.pi * hertz) ** 2 * on * np.sin(2 * np.pi * hertz * (t - 0.5))
    return CommandTrack(COIL, t, np.column_stack([displacement, np.zeros(len(t))]), {"finger": "Zeigefinger ä"})


@pytest.mark.parametrize("form", list(READERS))
@pytest.mark.parametrize("hertz", [100.0, 200.0, 290.0])
def test_other_readers_find_amplitude_frequency_and_times(form: str, hertz: float, tmp_path: Path) -> None:
    assert not export.write(a_track(hertz=hertz), tmp_path / f"t.{form}", form)
    clip = READERS[form](tmp_path / f"t.{form}")
    assert clip.duration == pytest.approx(2.0, abs=1e-3)
    at = np.array([0.55, 0.7, 1.0, 1.3, 1.45])
    assert np.interp(at, *clip.amplitude) * FULL == pytest.approx(HELD, rel=0.02)
    assert np.interp(at, *clip.frequency) == pytest.approx(hertz, abs=5.0)
    assert np.interp([0.3, 0.48, 1.52, 1.9], *clip.amplitude) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("form", list(READERS))
def test_a_tap_begins_within_a_millisecond_of_its_time(form: str, tmp_path: Path) -> None:
    late = []
    for onset in np.random.default_rng(7).uniform(0.2, 0.3, 12):
        t = np.arange(4001) / RATE
        since = np.maximum(t - onset, 0.0)
        tap = 5e-6 * np.exp(-90.0 * since) * np.sin(2 * np.pi * 200.0 * since)
        track = CommandTrack(COIL, t, np.column_stack([tap, np.zeros(len(t))]))
        export.write(track, tmp_path / f"t.{form}", form)
        times = np.arange(0.15, 0.4, 1e-4)
        strength = np.interp(times, *READERS[form](tmp_path / f"t.{form}").amplitude)
        late.append(times[np.argmax(strength > 0.5 * strength.max())] - onset)
    assert np.ptp(late) <= 1e-3 and np.abs(late).max() <= 1.5e-3


def test_full_scale_is_told_and_grows_with_a_stronger_track() -> None:
    assert vibration_of(a_track()).full_scale == pytest.approx(FULL)
    strong = vibration_of(a_track(30.0))
    assert strong.full_scale == pytest.approx(30.0, rel=0.05) and strong.amplitude[1].max() == pytest.approx(1.0)
    assert "m/s^2" in strong.said and "50 to 1000 Hz" in strong.said


def test_long_clips_have_events_and_curves_within_apples_limits(tmp_path: Path) -> None:
    t = np.arange(round(65.0 * RATE) + 1) / RATE
    slow = 1.0 + np.sin(2 * np.pi * 0.4 * t)
    displacement = 0.2 * HELD / (2 * np.pi * 150.0) ** 2 * slow * np.sin(2 * np.pi * 150.0 * t)
    track = CommandTrack(COIL, t, np.column_stack([displacement, np.zeros(len(t))]))
    export.write(track, tmp_path / "t.ahap", "ahap")
    clip = READERS["ahap"](tmp_path / "t.ahap")
    events = [p["Event"] for p in json.loads((tmp_path / "t.ahap").read_text())["Pattern"] if "Event" in p]
    assert [e["Time"] for e in events] == [0.0, 30.0, 60.0] and events[-1]["EventDuration"] == pytest.approx(5.0)
    at = np.linspace(1.0, 64.0, 500)
    wanted = 0.2 * HELD / FULL * (1.0 + np.sin(2 * np.pi * 0.4 * at))
    times, first = np.unique(clip.amplitude[0], return_index=True)
    assert np.interp(at, times, clip.amplitude[1][first]) == pytest.approx(wanted, abs=0.03)


def test_what_a_sharpness_cannot_tell_is_told(tmp_path: Path) -> None:
    for form in ("ahap", "haptic"):
        (found,) = export.write(a_track(hertz=700.0), tmp_path / f"t.{form}", form)
        assert found.code == "frequency-limited" and str(found.value).startswith("70") and found.limit == "65 to 300 Hz"
    assert not export.write(a_track(hertz=700.0), tmp_path / "t.hjif", "hjif")
    assert np.interp(1.0, *READERS["hjif"](tmp_path / "t.hjif").frequency) == pytest.approx(700.0, abs=5.0)


@pytest.mark.parametrize("form", list(READERS))
def test_what_is_no_vibration_is_refused_and_equal_tracks_give_equal_bytes(form: str, tmp_path: Path) -> None:
    tactor = Library().device("haptip")
    still = CommandTrack(tactor, np.arange(3) / 1000.0, np.zeros((3, len(tactor.channels))))
    with pytest.raises(DermisError, match="this format is for voice coils only.*voice_coil"):
        export.write(still, tmp_path / "t", form)
    short = a_track()
    short = replace(short, times=short.times[:1], values=short.values[:1])
    with pytest.raises(DermisError, match="not evenly spaced"):
        export.write(short, tmp_path / "t", form)
    assert not list(tmp_path.iterdir())
    silent = a_track(0.0)
    export.write(silent, tmp_path / "silent", form)
    assert not READERS[form](tmp_path / "silent").amplitude[1].any()
    for name in ("a", "b"):
        export.write(a_track(), tmp_path / name, form)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_thinned_curves_are_within_the_tolerance_and_have_few_points() -> None:
    times = np.arange(5000) / 1000.0
    values = np.sin(3.0 * times) + 0.001 * np.random.default_rng(1).normal(size=5000)
    x, y = thinned(times, values, 0.01)
    assert np.abs(np.interp(times, x, y) - values).max() <= 0.01 + 1e-12
    assert len(x) < 150 and x[0] == times[0] and x[-1] == times[-1]
    straight = thinned(times, 2.0 * times, 1e-9)
    assert straight[0].tolist() == [0.0, times[-1]]
