"""Vibration: amplitude and frequency of a voice coil's track over time.

Haptic files for phones and game controllers have no waveform. They have curves of amplitude and frequency. Both curves
are computed from the analytic signal of the acceleration of the track's displacement, within the frequency band of the
coil. Points are then left out, so that the curves change by `TOLERANCE` at most.
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

TOLERANCE = 0.005  # largest change of a curve if points are left out, relative to full scale or to the band's width
STEP = 1e-3  # [s] interval of the amplitudes; the time of an onset is off by at most this
WINDOW = 10e-3  # [s] interval over which a frequency is averaged, with the power as weight
# A vibration up to this share of the largest amplitude has no frequency of its own. Before an onset, an analytic signal
# is not quite zero, and its frequency means nothing.
HARDLY = 0.05
PAD = 0.25  # [s] constant displacement added at both ends, since the Fourier transform joins the end to the start

Curve = tuple[Array, Array]  # times [s] and values, shape (n,) each


@dataclass(frozen=True)
class Vibration:
    """Vibration of a track.

    Attributes:
        amplitude: curve of the amplitude of the acceleration, divided by `full_scale`, 0 to 1.
        frequency: curve of the frequency [Hz], inside `band`.
        full_scale: acceleration for an amplitude of 1 [m/s^2].
        band: lowest and highest frequency of the coil [Hz].
        duration: duration of the track [s].
    """

    amplitude: Curve
    frequency: Curve
    full_scale: float
    band: tuple[float, float]
    duration: float

    @property
    def said(self) -> str:
        """Description of full scale and band for the files."""
        low, high = self.band
        return f"1 is an acceleration of {self.full_scale:.6g} m/s^2, peak; {low:g} to {high:g} Hz"


def vibration_of(track: CommandTrack) -> Vibration:
    """Return amplitude and frequency of a voice coil's track over time.

    Full scale is the acceleration that the coil can reach at every frequency of its band with the largest voltage. If
    the track has a larger acceleration, full scale is the largest acceleration of the track.

    Raises:
        DermisError: the device is no voice coil, there are fewer than two samples, the times are no regular grid, or a
            value is not finite.
    """
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    kind = KINDS.get(track.spec.kind)
    if kind is None or not kind.wave:
        raise DermisError(
            "this format is for voice coils only",
            where=where,
            value=track.spec.kind,
            limit=", ".join(name for name, known in KINDS.items() if known.wave),
            remedy="Export it as CSV, JSON, binary or C header",
        )
    check_finite(track)
    rate, count = track.spec.rate, len(track.times)
    if count < 2 or np.abs(np.diff(track.times) * rate - 1.0).max() > 0.01:
        raise DermisError(
            "the samples are not evenly spaced",
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
    """Return a curve with fewer points, within a tolerance of all points.

    Points are left out while a straight line from the last kept point passes all of them within the tolerance (the
    swinging door algorithm).

    Args:
        times: [s], increasing, shape (n,).
        values: shape (n,).
        tolerance: largest difference between the returned curve and a point, in the unit of the values.
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
    """Return the analytic signal of the acceleration [m/s^2], shape (n,).

    Args:
        displacement: [m], shape (n,).
        rate: samples per second [Hz].
        band: lowest and highest frequency that is kept [Hz].
    """
    pad = round(PAD * rate)
    whole = np.pad(displacement, pad, mode="edge")
    frequency = np.fft.fftfreq(len(whole), 1.0 / rate)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    spectrum = np.fft.fft(whole) * np.where(inside, -2.0 * (2.0 * np.pi * frequency) ** 2, 0.0)
    return np.fft.ifft(spectrum)[pad : pad + len(displacement)]


def _frequency(wave: Any, rate: float) -> Curve:
    """Return the frequency of an analytic signal over time [Hz].

    It is averaged over intervals of `WINDOW`, and the times are the middles of the intervals. An interval with hardly
    any vibration (see `HARDLY`) has the frequency of the last stronger interval. Before the first stronger interval, it
    has the frequency of that interval. If no interval is stronger, the curve is a single frequency of 0.

    Args:
        wave: analytic signal, complex, shape (n,).
        rate: samples per second [Hz].
    """
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
