"""WAV files of a screen's track: how far the voltage is from the formula, and when a touch begins to be felt."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from core.arrays import Array
from core.presets import Library
from core.track import export
from core.track.command_track import CommandTrack

from . import Result, benchmark

RATES, CARRIERS, ENVELOPES = (48_000, 96_000, 192_000), (60.0, 110.0, 1000.0), (0.0, 10.0, 50.0, 120.0, 240.0)
SECONDS, PEAK, FULL, SET_IN = 1.0, 280.0, 300.0, 0.05


def _played(volts: Array, carrier: float, rate: int) -> Array:
    """Return the voltage [V] in the WAV file of a track at 1 kHz, as scipy reads it."""
    from scipy.io import wavfile

    values = np.column_stack([volts, np.full(len(volts), carrier)])
    track = CommandTrack(Library().device("electrovibration"), np.arange(len(volts)) / 1000.0, values)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t.wav"
        export.write(track, path, "wav", settings={"rate": rate})
        found, counts = wavfile.read(path)
    assert found == rate
    return np.asarray(counts / 256.0 / (2**23 - 1) * FULL)


def _envelope(at: Array, frequency: float) -> Array:
    """Return an amplitude [V] between 0 and `PEAK` that sets in smoothly, as touches do, and ends so."""
    fade = np.sin(np.pi / 2 * np.clip(np.minimum(at, SECONDS - at) / SET_IN, 0.0, 1.0)) ** 2
    return np.asarray(PEAK / 2 * fade * (1 + np.sin(2 * np.pi * frequency * at + 0.3)))


@benchmark("wav_amplitude_error", limit=0.005, quick=True)
def wav_amplitude_error() -> Result:
    """Largest error of the voltage, as a part of the peak: envelopes up to 240 Hz from a track at 1 kHz, all rates."""
    ours = linear = 0.0
    steps = np.arange(int(SECONDS * 1000) + 1) / 1000.0
    for rate in RATES:
        at = np.arange(int(SECONDS * rate) + 1) / rate
        for frequency in ENVELOPES:
            volts, true = _envelope(steps, frequency), _envelope(at, frequency)
            linear = max(linear, float(np.abs(np.interp(at, steps, volts) - true).max()) / PEAK)
            for carrier in CARRIERS:
                wanted = true * np.sin(2 * np.pi * carrier * at)
                ours = max(ours, float(np.abs(_played(volts, carrier, rate) - wanted).max()) / PEAK)
    return Result("wav_amplitude_error", ours, "1", None, {"linear": linear})


@benchmark("wav_onset_jitter_ms", limit=1.0, quick=True)
def wav_onset_jitter_ms() -> Result:
    """Range of the delay from touches at random times to half the amplitude in the file; the track has 1 ms steps."""
    rng, rate, carrier, delays = np.random.default_rng(5), 48_000, 1000.0, []
    steps = np.arange(201) / 1000.0
    for onset in rng.uniform(0.05, 0.15, 200):
        found = _played(np.where(steps >= onset, PEAK, 0.0), carrier, rate)
        at = np.arange(len(found)) / rate
        sine = np.sin(2 * np.pi * carrier * at)
        clear = np.abs(sine) > 0.2  # where the carrier crosses zero nothing can be read
        above = clear & (np.abs(found) > PEAK / 2 * np.abs(sine))
        delays.append(at[np.argmax(above)] - onset)
    return Result("wav_onset_jitter_ms", 1e3 * float(np.ptp(delays)), "ms", 1e3 * float(np.percentile(delays, 95)))
