"""Interpolation of several series at once that never leaves the range of the two samples beside it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .errors import DermisError

Array = NDArray[np.float64]
Method = Literal["linear", "pchip"]
METHODS: tuple[Method, ...] = ("linear", "pchip")
MOST_SAMPLES = 2**27  # of all channels of a track together: 1 GiB, or 37 hours of one channel at 1 kHz


def grid(first: float, last: float, rate: float) -> Array:
    """Return times at `rate` [Hz] from `first` on, the last at or just before `last` [s].

    Raises:
        DermisError: the rate is not a positive number.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise DermisError("the rate must be a positive number", value=rate, limit="> 0 Hz")
    steps = (last - first) * rate
    return first + np.arange(int(np.floor(steps + 1e-6 * min(1.0, steps))) + 1) / rate


def interpolate(times: Array, values: Array, at: Array, method: Method = "linear") -> Array:
    """Interpolate columns.

    Args:
        times: [s], strictly rising, shape (n,), n >= 1.
        values: shape (n, channels).
        at: [s], shape (m,); outside of `times` the end values hold.
        method: 'linear', or 'pchip': a C1 cubic that is monotone wherever the samples are.

    Returns:
        Shape (m, channels).

    Raises:
        DermisError: unknown method, no samples.
    """
    if method not in METHODS:
        raise DermisError("unknown method of interpolation", value=method, limit=", ".join(METHODS))
    if len(times) == 0:
        raise DermisError("no samples to interpolate")
    if len(times) == 1:
        return np.repeat(values, len(at), axis=0)
    interval = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    width = np.diff(times)
    part = np.clip((at - times[interval]) / width[interval], 0.0, 1.0)[:, None]
    if method == "linear":
        result = _linear(values, interval, part)
    else:
        result = _hermite(values, pchip_slopes(width, values), width, interval, part)
    result[at >= times[-1]] = values[-1]  # to the bit, as at every other sample
    return result


def pchip_slopes(width: Array, values: Array) -> Array:
    """Return the derivative of the monotone cubic at each sample.

    Inside, the weighted harmonic mean of the two slopes beside, 0 where they differ in sign; at the ends the
    three-point formula, held to the sign of the end slope and to three times its size.

    Args:
        width: [s] between the samples, shape (n - 1,), n >= 2.
        values: shape (n, channels).

    Source: Fritsch and Butland, A Method for Constructing Local Monotone Piecewise Cubic Interpolants, 1984, eq. 5;
    ends as in Moler, Numerical Computing with MATLAB, section 3.6.
    """
    h = width[:, None]
    secant = np.diff(values, axis=0) / h
    if len(secant) == 1:
        return np.repeat(secant, 2, axis=0)
    slopes = np.zeros_like(values)
    left, right = secant[:-1], secant[1:]
    w_left, w_right = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    same = left * right > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (w_left + w_right) / (w_left / left + w_right / right)
    slopes[1:-1] = np.where(same, mean, 0.0)
    slopes[0] = _end_slope(h[0], h[1], secant[0], secant[1])
    slopes[-1] = _end_slope(h[-1], h[-2], secant[-1], secant[-2])
    return slopes


def _end_slope(h0: Array, h1: Array, secant0: Array, secant1: Array) -> Array:
    slope = ((2 * h0 + h1) * secant0 - h0 * secant1) / (h0 + h1)
    slope = np.where(slope * secant0 <= 0, 0.0, slope)
    turns = (secant0 * secant1 <= 0) & (np.abs(slope) > 3 * np.abs(secant0))
    return np.where(turns, 3 * secant0, slope)


def _linear(values: Array, interval: NDArray[np.intp], part: Array) -> Array:
    low = np.take(values, interval, axis=0)
    result = np.take(values, interval + 1, axis=0)
    result -= low
    result *= part
    result += low
    return result


def _hermite(values: Array, slopes: Array, width: Array, interval: NDArray[np.intp], part: Array) -> Array:
    low, high = values[interval], values[interval + 1]
    h = width[interval, None]
    up = part * part * (3 - 2 * part)
    result = (
        low
        + (high - low) * up
        + h * (slopes[interval] * part * (1 - part) ** 2 - slopes[interval + 1] * part * part * (1 - part))
    )
    # The monotone cubic stays between its ends; this takes away what rounding adds.
    return np.clip(result, np.minimum(low, high), np.maximum(low, high))
