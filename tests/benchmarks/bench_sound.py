"""A voice coil from a touch to the voltage behind a simulated sound card: amplitude, and when a tap begins."""

from __future__ import annotations

from functools import cache

import numpy as np

from core.arrays import Array
from core.devices.spec import DeviceSpec
from core.devices.voice_coil import VoiceCoil
from core.presets import Library
from core.stream.signals import Signals
from core.stream.sound.loopback import measure
from core.stream.sound.measured_card import MeasuredCard
from core.stream.sound.play import play, samples_of
from core.stream.virtual.sound_loop import SoundLoop
from core.track.command_track import CommandTrack

from . import Result, benchmark

RATE, CARD_RATE, FULL = 8000.0, 48_000, 3.0
FREQUENCIES = (55.0, 70.0, 90.0, 110.0, 160.0, 250.0, 400.0, 600.0)
SET_IN = 0.1  # [s]
ACCELERATION = 12.0  # [m/s^2] peak: within 3 V at each of these frequencies


def _track(spec: DeviceSpec, displacement: Array) -> CommandTrack:
    coil = VoiceCoil.of(spec)
    values = np.column_stack([displacement, coil.volts(displacement)])
    return CommandTrack(spec, np.arange(len(displacement)) / RATE, values)


@cache
def _card() -> MeasuredCard:
    return measure(SoundLoop("virtual:", CARD_RATE, {}))


def _heard(track: CommandTrack) -> tuple[Array, float]:
    """Return the voltage that comes out of the loop [V], and how late it is [s], by what was measured of the loop."""
    found = _card()
    samples, _ = samples_of(track, {}, found, "virtual:")
    heard: list[Array] = []
    loop = SoundLoop("virtual:", CARD_RATE, {})
    through = loop.run
    loop.run = lambda source, done, sink=None: through(source, done, heard.append)  # type: ignore[method-assign]
    play(loop, samples, Signals())
    return np.concatenate(heard) * FULL / found.gain, found.latency


@benchmark("audio_amplitude_error", limit=0.005, quick=True)
def audio_amplitude_error() -> Result:
    """Largest error of a vibration's amplitude behind the loop, 55 to 600 Hz, by the response of the preset."""
    spec, worst = Library().device("voice_coil"), 0.0
    coil, t = VoiceCoil.of(spec), np.arange(8001) / RATE
    fade = np.sin(np.pi / 2 * np.clip(t / SET_IN, 0.0, 1.0)) ** 2  # as textures set in
    for hertz in FREQUENCIES:
        asked = ACCELERATION / (2 * np.pi * hertz) ** 2
        heard, _ = _heard(_track(spec, asked * fade * np.sin(2 * np.pi * hertz * t)))
        at = np.arange(len(heard)) / CARD_RATE
        steady = (at >= 0.6) & (at < 0.8)  # whole periods of each frequency
        volts = 2.0 * abs(np.mean(heard[steady] * np.exp(-2j * np.pi * hertz * at[steady])))
        worst = max(worst, abs(volts * float(coil.gain(np.array([hertz]))[0]) / asked - 1.0))
    return Result("audio_amplitude_error", worst, "1")


@benchmark("audio_onset_jitter_ms", limit=1.0, quick=True)
def audio_onset_jitter_ms() -> Result:
    """Range of the delay from taps at random times to a tenth of their voltage, behind the loop, less its latency."""
    spec, delays, t = Library().device("voice_coil"), [], np.arange(2401) / RATE
    for onset in np.random.default_rng(5).uniform(0.1, 0.2, 60):
        since = np.maximum(t - onset, 0.0)
        heard, latency = _heard(_track(spec, 2e-6 * np.exp(-90.0 * since) * np.sin(2 * np.pi * 200.0 * since)))
        first = int(np.argmax(np.abs(heard) > 0.1 * np.abs(heard).max()))
        delays.append(first / CARD_RATE - onset - latency)
    return Result("audio_onset_jitter_ms", 1e3 * float(np.ptp(delays)), "ms", 1e3 * float(np.percentile(delays, 95)))
