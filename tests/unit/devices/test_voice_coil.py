"""The voice coil: which presets make one, and the voltage that a displacement needs."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from core.devices.spec import from_preset
from core.devices.voice_coil import VoiceCoil
from core.errors import DermisError
from core.presets import Library, check

PRESET = Library().load("devices", "voice_coil")
COIL = VoiceCoil.of(Library().device("voice_coil"))
RESONANCE, QUALITY, HIGH = 90.0, 2.0, 14.0  # of the actuator below: Hz, 1, m/s^2/V


def edited(**parameters: Any) -> dict[str, Any]:
    preset = copy.deepcopy(dict(PRESET))
    for name, value in parameters.items():
        preset["parameters"][name]["value"] = value
    return preset


def mass_on_a_spring() -> StateSpace:
    """Return an actuator: x'' + w/Q x' + w^2 x = HIGH volts, its output the displacement."""
    w = 2.0 * np.pi * RESONANCE
    return StateSpace([[0.0, 1.0], [-(w**2), -w / QUALITY]], [[0.0], [HIGH]], [[1.0, 0.0]], [[0.0]])


def measured() -> VoiceCoil:
    """Return a voice coil whose response was taken from that actuator, 24 points an octave."""
    frequency = np.geomspace(40.0, 1000.0, 112)
    r = frequency / RESONANCE
    gain = HIGH * r**2 / np.sqrt((1.0 - r**2) ** 2 + (r / QUALITY) ** 2)
    return VoiceCoil.of(from_preset("own", edited(response_frequency=frequency.tolist(), response_gain=gain.tolist())))


def moved(volts: np.ndarray, rate: float) -> np.ndarray:
    """Return the displacement that the actuator makes [m], integrated between the samples."""
    fine = 8
    t = np.arange(fine * (len(volts) - 1) + 1) / (fine * rate)
    _, x, _ = lsim(mass_on_a_spring(), np.interp(t, t[::fine], volts), t)
    return np.asarray(x[::fine])


@pytest.mark.parametrize("hertz", [50.0, 90.0, 160.0, 250.0])
def test_an_actuator_makes_the_displacement_that_was_asked(hertz: float) -> None:
    """A mass on a spring, integrated in time, knows nothing of filters."""
    coil, rate = measured(), 8000.0
    t = np.arange(16_000) / rate
    asked = 20e-6 * np.sin(2.0 * np.pi * hertz * t)
    made = moved(coil.volts(asked), rate)[8000:]
    wave = np.exp(-2j * np.pi * hertz * t[8000:])
    assert 2.0 * abs(np.mean(made * wave)) == pytest.approx(20e-6, rel=5e-3)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_onsets_come_when_they_were_asked() -> None:
    """A decaying sine at any time: what the actuator makes begins within a millisecond of it, always equally late."""
    coil, rate, late = measured(), 8000.0, []
    t = np.arange(4000) / rate
    for onset in np.random.default_rng(2).uniform(0.1, 0.2, 20):
        since = np.maximum(t - onset, 0.0)
        made = moved(coil.volts(1e-5 * np.exp(-90.0 * since) * np.sin(2.0 * np.pi * 200.0 * since)), rate)
        late.append(t[np.argmax(np.abs(made) > 0.1 * np.abs(made).max())] - onset)
    assert np.ptp(late) <= 1e-3 and max(np.abs(late)) <= 1e-3


def test_windows_give_what_the_whole_gives() -> None:
    displacement = 1e-5 * np.random.default_rng(4).normal(size=9000)
    whole, pieces, before = COIL.volts(displacement), [], None
    for start, end in ((0, 5), (5, 3000), (3000, 9000)):
        part = displacement[start:end]
        pieces.append(COIL.volts(part, before))
        before = COIL.history(part, before, len(part))
    assert np.concatenate(pieces) == pytest.approx(whole, abs=1e-9 * np.abs(whole).max())


def test_a_displacement_that_stays_needs_no_voltage_and_none_gives_none() -> None:
    assert np.abs(COIL.volts(np.full(6000, 1e-4))).max() < 1e-4
    assert COIL.volts(np.zeros(0)).shape == (0,)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"response_gain": [1.0, 2.0]}, "voice_coil', gain curve: the numbers of frequencies and gains differ"),
        ({"response_frequency": [50.0, 2500.0], "response_gain": [1.0, 1.0]}, "beyond a quarter of the device's rate"),
        ({"response_frequency": [60.0, 50.0], "response_gain": [1.0, 1.0]}, "must rise from point to point"),
        ({"response_frequency": [-1.0, 50.0], "response_gain": [1.0, 1.0]}, "'response_frequency' must be above zero"),
        ({"range": 0.0}, "'range' must be above zero"),
    ],
)
def test_presets_that_make_no_voice_coil_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(DermisError, match=words):
        check("devices", "voice_coil", edited(**change))


def test_a_voltage_needs_its_limits() -> None:
    preset = edited()
    del preset["channels"][1]["low"]
    with pytest.raises(DermisError, match="limits on both sides"):
        check("devices", "voice_coil", preset)
    del preset["channels"][0]
    with pytest.raises(DermisError, match="two channels"):
        check("devices", "voice_coil", preset)
