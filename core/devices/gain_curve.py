"""GainCurve: measured gain of an actuator, and filters made from it.

All measured responses are evaluated by `gain_between`: between two frequencies the logarithm of the gain is linear.
Outside the measured band a gain is unknown.

A voice coil is a mass on a spring, driven by one force. It is a minimum-phase system, so its phase follows from its
gain. The inverse of such a system is causal and has minimum phase, too. `minimum_phase` finds it from the gain alone by
the real cepstrum (Oppenheim and Schafer, *Discrete-Time Signal Processing*, 3rd edition, section 13.5).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError

MOST_POINTS = 1000
# Largest relative error of a filter's gain within the band. The amplitude of a file may be off by 0.5 %; upsampling
# causes 0.04 % of it.
TOLERANCE = 2e-3
LONGEST = 2**16  # [taps] longest filter: 8 s at 8 kHz
FINER = 8  # factor by which the grid of the cepstrum is finer than that of the filter's own frequencies
NEAR = 1.01  # ratio of the two frequencies between which the slope at an end of the band is taken
FALL = math.log(4.0) / math.log(2.0) ** 2  # factor of the log gain's fall beyond the band: 12 dB after one octave


@dataclass(frozen=True)
class GainCurve:
    """Measured gain of one actuator over frequency.

    Attributes:
        frequency: measured frequencies [Hz], above zero and rising.
        gain: output per unit of input at each frequency, above zero.

    Raises:
        DermisError: the points are no such curve.
    """

    frequency: tuple[float, ...]
    gain: tuple[float, ...]

    def __post_init__(self) -> None:
        where = "gain curve"
        if len(self.frequency) != len(self.gain):
            raise DermisError(
                "the numbers of frequencies and gains differ",
                where=where,
                value=f"{len(self.frequency)} and {len(self.gain)}",
                remedy="State a gain for each frequency",
            )
        if not 2 <= len(self.frequency) <= MOST_POINTS:
            raise DermisError(
                "a curve has too few or too many points",
                where=where,
                value=len(self.frequency),
                limit=f"2 to {MOST_POINTS}",
            )
        for name in ("frequency", "gain"):
            for k, value in enumerate(getattr(self, name)):
                if not (math.isfinite(value) and value > 0.0):
                    raise DermisError(
                        f"a {name} must be above zero", where=f"{where}, point {k + 1}", value=value, limit="> 0"
                    )
        steps = np.diff(self.frequency)
        if not (steps > 0).all():
            k = int(np.argmin(steps > 0))
            raise DermisError(
                "the frequencies must rise from point to point",
                where=f"{where}, points {k + 1} and {k + 2}",
                value=f"{self.frequency[k]:g} and {self.frequency[k + 1]:g} Hz",
            )

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest measured frequency [Hz]."""
        return self.frequency[0], self.frequency[-1]

    def at(self, frequency: Array) -> Array:
        """Return the gain at frequencies [Hz]; NaN outside the measured band."""
        low, high = self.band
        found = gain_between(frequency, np.array(self.frequency), np.log(self.gain))
        return np.where((frequency < low) | (frequency > high), np.nan, found)


def gain_between(frequency: Array, measured: Array, log_gain: Array) -> Array:
    """Return gains at frequencies by interpolation of the logarithm.

    Beyond the measured frequencies, it is the gain at the nearest of them.

    Args:
        frequency: frequencies [Hz], any shape.
        measured: measured frequencies [Hz], rising, shape (n,).
        log_gain: natural logarithms of the gains there, shape (n,).
    """
    return np.asarray(np.exp(np.interp(frequency, measured, log_gain)))


def filter_taps(gain: Callable[[Array], Array], band: tuple[float, float], rate: float) -> Array:
    """Return a causal filter of least delay with a wanted gain in a band.

    In the band, the gain is met to within 0.2 %. Outside the band the actuator's response is unknown, so the filter's
    gain falls there. It continues with the slope at the band's end, and falls below that by 12 dB after one octave and
    by 48 dB after two. The output for a constant value is practically zero.

    Args:
        gain: function that returns the positive gain at frequencies inside the band [Hz].
        band: lowest and highest frequency [Hz].
        rate: samples per second [Hz].

    Returns:
        Weights of the newest sample and those before it, shape (taps,).

    Raises:
        DermisError: the band reaches beyond half of the rate, or the gain changes too fast for a filter of bounded
            length.
    """
    low, high = band
    if not high < rate / 2.0:
        raise DermisError(
            "the band reaches beyond half of the rate", where="filter", value=f"{high:g} Hz", limit=f"< {rate / 2:g} Hz"
        )
    ends = np.array([[low, low * NEAR], [high / NEAR, high]])
    slopes = np.diff(np.log(gain(ends)), axis=1)[:, 0] / math.log(NEAR)

    def wanted(frequency: Array) -> Array:
        inside = np.clip(frequency, low, high)
        beyond = np.log(frequency / inside)
        return np.asarray(np.log(gain(inside)) + np.where(beyond < 0.0, *slopes) * beyond - FALL * beyond**2)

    taps = 1 << math.ceil(math.log2(rate / low))  # one period of the lowest frequency
    while taps <= LONGEST:
        grid = np.asarray(np.fft.rfftfreq(FINER * taps, 1.0 / rate), np.float64)
        grid[0] = 0.5 * grid[1]  # the frequency 0 has no logarithm
        log_gain = wanted(grid)
        found = minimum_phase(log_gain)[:taps]
        made = np.abs(np.fft.rfft(found, FINER * taps))
        judged = (grid >= low) & (grid <= high)
        if np.abs(made[judged] / np.exp(log_gain[judged]) - 1.0).max() <= TOLERANCE:
            return found
        taps *= 2
    raise DermisError(
        "the response changes too fast over frequency for a filter",
        where="filter",
        value=f"more than {LONGEST} taps at {rate:g} Hz",
        limit=f"gain within {TOLERANCE:.1%}",
        remedy="Smooth the measured response",
    )


def filtered(values: Array, taps: Array) -> Array:
    """Return filtered values, from the first with all earlier values present.

    Args:
        values: values at equal steps of time, shape (n,), n >= taps - 1.
        taps: weights of the newest value and those before it, shape (taps,).

    Returns:
        Filtered values, shape (n - taps + 1,).
    """
    block = FINER * len(taps)  # values that are filtered at once, so that long series need no more memory
    response, count = np.fft.rfft(taps, block), len(values) - len(taps) + 1
    out = np.empty(count)
    for first in range(0, count, block - len(taps) + 1):
        part = np.fft.irfft(np.fft.rfft(values[first : first + block], block) * response, block)[len(taps) - 1 :]
        out[first : first + len(part)] = part[: count - first]
    return out


def minimum_phase(log_gain: Array) -> Array:
    """Return the impulse response of least delay with a gain.

    Args:
        log_gain: natural logarithm of the gain at equal steps of frequency, from zero to half of the sampling rate,
            shape (n / 2 + 1,), n even.

    Returns:
        Impulse response, shape (n,).
    """
    count = 2 * (len(log_gain) - 1)
    cepstrum = np.fft.irfft(log_gain, count)
    fold = np.zeros(count)
    fold[0] = fold[count // 2] = 1.0
    fold[1 : count // 2] = 2.0
    return np.asarray(np.fft.irfft(np.exp(np.fft.rfft(cepstrum * fold)), count))
