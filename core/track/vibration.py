"""Vibration: how strong and how fast a voice coil's track vibrates, as phones and game controllers are told it.

Such files know no waveform: they have an amplitude and a frequency over time. Both come from the analytic signal of the
acceleration that the track asks for, within the band that the coil makes. Curves of few points are within `TOLERANCE`
of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.kinds import KINDS
from ..devices.mechanism import mechanism_of
from ..errors import DermisError
from .command_track import CommandTrack
from .track_header import check_finite

TOLERANCE = 0.005  # of full scale, and of the band: how far the curves may be off
STEP = 1e-3  # [s] between two amplitudes: onsets are told to a millisecond
WINDOW = 10e-3  # [s] over which a frequency is averaged, with the power as weight
# Of the largest amplitude: a weaker vibration has no frequency of its own. An analytic signal has some before an onset.
HARDLY = 0.05
PAD = 0.25  # [s] of rest on both sides, so that the end of a track does not reach its start

Curve = tuple[Array, Array]  # times [s], values, shape (n,) each


@dataclass(frozen=True)
class Vibration:
    """A track's vibration.

    Attributes:
        amplitude: curve of the acceleration's amplitude, 0 to 1 of `full_scale`. frequency: curve [Hz], inside `band`.
        full_scale: acceleration of full scale [m/s^2].
        band: frequency band of the coil [Hz].
        duration: duration of the track [s].
    """

    amplitude: Curve
    frequency: Curve
    full_scale: float
    band: tuple[float, float]
    duration: float

    @property
    def said(self) -> str:
        """Description of the values in a file."""
        low, high = self.band
        return f"1 is an acceleration of {self.full_scale:.6g} m/s^2, peak; {low:g} to {high:g} Hz"


def vibration_of(track: CommandTrack) -> Vibration:
    """Return how strong and how fast a voice coil's track vibrates.

    Full scale is the acceleration that the coil makes at each frequency of its band at the limit of its voltage, or
    the track's largest where that is more.

    Raises:
        DermisError: another device, no samples, times that are no regular grid, or a value that is not finite.
    """
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    kind = KINDS.get(track.spec.kind)
    if kind is None or not kind.wave:
        raise DermisError(
            "no vibration drives this device",
            where=where,
            value=track.spec.kind,
            limit=", ".join(name for name, known in KINDS.items() if known.wave),
            remedy="Export it as CSV, JSON, binary or C header",
        )
    check_finite(track)
    rate, count = track.spec.rate, len(track.times)
    if count < 2 or np.abs(np.diff(track.times) * rate - 1.0).max() > 0.01:
        raise DermisError(
            "the samples are no regular grid",
            where=where,
            value=f"{count} samples",
            limit=f"at least 2, at {rate:g} Hz",
            remedy="Resample it",
        )
    coil: Any = mechanism_of(track.spec)
    wave = _analytic(track.column("displacement"), rate, coil.response.band)
    strength = np.abs(wave)
    step = max(round(STEP * rate), 1)
    times = np.append(np.arange(0, count, step), count - 1) / rate
    amplitude = np.interp(times, np.arange(count) / rate, strength)
    volts = track.spec.channel("voltage").high or 0.0
    full = max(volts * min(coil.response.gain), float(amplitude.max()))
    low, high = coil.response.band
    at, hertz = _frequency(wave, rate)
    return Vibration(
        thinned(times, np.minimum(amplitude / full, 1.0), TOLERANCE),
        thinned(at, np.clip(hertz, low, high), TOLERANCE * (high - low)),
        full,
        (low, high),
        (count - 1) / rate,
    )


def thinned(times: Array, values: Array, tolerance: float) -> Curve:
    """Return few of a curve's points, between which straight lines are within a tolerance of all others.

    Points are left out while one line from the last that was kept can pass all of them (a swinging door).
    """
    kept, k = [0], 1
    above, below = np.inf, -np.inf
    x, y = times.tolist(), values.tolist()
    while k < len(x):
        start = kept[-1]
        run = x[k] - x[start]
        if run <= 0.0:
            k += 1
            continue
        slope = (y[k] - y[start]) / run
        if below <= slope <= above:
            above = min(above, (y[k] + tolerance - y[start]) / run)
            below = max(below, (y[k] - tolerance - y[start]) / run)
            k += 1
        else:
            kept.append(k - 1)
            above, below = np.inf, -np.inf
    if kept[-1] != len(x) - 1:
        kept.append(len(x) - 1)
    return times[kept], values[kept]


def _analytic(displacement: Array, rate: float, band: tuple[float, float]) -> Any:
    """Return the analytic signal of the acceleration inside a band [m/s^2], complex, shape (n,)."""
    pad = round(PAD * rate)
    whole = np.pad(displacement, pad, mode="edge")
    frequency = np.fft.fftfreq(len(whole), 1.0 / rate)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    spectrum = np.fft.fft(whole) * np.where(inside, -2.0 * (2.0 * np.pi * frequency) ** 2, 0.0)
    return np.fft.ifft(spectrum)[pad : pad + len(displacement)]


def _frequency(wave: Any, rate: float) -> Curve:
    """Return times [s] and the frequency [Hz] of an analytic signal around them; held where there is hardly any."""
    power = np.abs(wave[1:] * wave[:-1])
    hertz = np.angle(wave[1:] * np.conj(wave[:-1])) * rate / (2.0 * np.pi)
    size = max(round(WINDOW * rate), 1)
    starts = np.arange(0, len(power), size)
    weight = np.add.reduceat(power, starts)
    mean = np.add.reduceat(power * hertz, starts) / np.maximum(weight, 1e-300)
    ends = np.append(starts[1:], len(power))
    felt = weight / (ends - starts) > (HARDLY * np.sqrt(power.max(initial=0.0))) ** 2
    if not felt.any():
        return np.array([0.0]), np.array([0.0])
    last = np.maximum.accumulate(np.where(felt, np.arange(len(felt)), int(np.argmax(felt))))
    return 0.5 * (starts + ends) / rate, np.asarray(mean[last], dtype=np.float64)
