"""Interpolation of several series at once, without overshoot.

Each result lies in the range of the two samples beside it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .errors import DermisError

Method = Literal["linear", "pchip"]
METHODS: tuple[Method, ...] = ("linear", "pchip")
MAX_SAMPLES = 2**27  # most samples of a track, all channels together: 1 GiB, or 37 hours of one channel at 1 kHz


def grid(first: float, last: float, rate: float) -> Array:
    """Return evenly spaced times [s], shape (n,).

    Args:
        first: the first time [s].
        last: limit of the times [s]; the last one is at most one step before it. It may exceed the limit by rounding,
            up to 1e-6 of a step.
        rate: times per second [Hz].

    Raises:
        DermisError: the rate is not a positive number.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise DermisError("the rate must be a positive number", value=rate, limit="> 0 Hz")
    steps = (last - first) * rate
    return first + np.arange(int(np.floor(steps + 1e-6 * min(1.0, steps))) + 1) / rate


def smoothstep(share: Array) -> Array:
    """Return 3 s^2 - 2 s^3 for shares s from 0 to 1; 0 below 0, and 1 above 1.

    The slope is zero at both ends.
    """
    s = np.clip(share, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def interpolate(times: Array, values: Array, at: Array, method: Method = "linear") -> Array:
    """Interpolate the columns of an array.

    Args:
        times: times of the samples [s], strictly rising, shape (n,), n >= 1.
        values: samples, shape (n, channels).
        at: times at which values are wanted [s], shape (m,). Before the first sample and after the last one, the result
            is the value of that sample.
        method: 'linear', or 'pchip' for a C1 cubic that is monotone wherever the samples are; 'pchip' loads scipy.

    Returns:
        Interpolated values, shape (m, channels).

    Raises:
        DermisError: the method is unknown, there are no samples, or for 'pchip' a sample is not finite.
    """
    if method not in METHODS:
        raise DermisError("unknown method of interpolation", value=method, limit=", ".join(METHODS))
    if len(times) == 0:
        raise DermisError("no samples to interpolate")
    if len(times) == 1:
        return np.repeat(values, len(at), axis=0)
    interval = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    result = (_linear if method == "linear" else _monotone)(times, values, at, interval)
    result[at >= times[-1]] = values[-1]  # exact, as at every other sample
    return result


def _linear(times: Array, values: Array, at: Array, interval: NDArray[np.intp]) -> Array:
    part = np.clip((at - times[interval]) / np.diff(times)[interval], 0.0, 1.0)[:, None]
    low = np.take(values, interval, axis=0)
    result = np.take(values, interval + 1, axis=0)
    result -= low
    result *= part
    result += low
    return result


def _monotone(times: Array, values: Array, at: Array, interval: NDArray[np.intp]) -> Array:
    from scipy.interpolate import PchipInterpolator

    try:
        with np.errstate(over="ignore"):  # dividing by a slope near zero may overflow
            result = PchipInterpolator(times, values)(np.clip(at, times[0], times[-1]))
    except ValueError as error:
        raise DermisError("the samples cannot be interpolated", value=str(error), limit="finite numbers") from error
    low, high = values[interval], values[interval + 1]
    # The monotone cubic stays between its two samples except for rounding errors, which are clipped here.
    return np.clip(result, np.minimum(low, high), np.maximum(low, high))
