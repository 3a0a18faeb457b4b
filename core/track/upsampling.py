"""Upsampling: band-limited interpolation of a series, without ringing.

Between samples, a series is interpolated by a sum of windowed sinc functions, which passes through every sample. At a
step such a sum overshoots by 9 % and rings before and after. The sum is therefore limited. It may leave the range of
two neighbouring samples only if the series bends to the same side at both samples, and then by at most a quarter of the
smaller second difference. The curve of a sinusoid with at least four samples per period is within these bounds, so
smooth series are not changed and keep their amplitude. At a step the bends have opposite signs, so the result stays
between the two samples.

Before its first sample and after its last, a series is unknown. It is continued by its reflection in the end point.
Within 24 samples of an end, fast series are therefore less accurate: the error is 0.7 % for 20 samples per period.

Source of the bounds: Suresh and Huynh, J. Comput. Phys. 136 (1997), section 2, with the minmod function.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..arrays import Array
from ..errors import DermisError

HALF = 24  # samples on each side of a windowed sinc function
# Parameter of the Kaiser window for an attenuation of 90 dB. With 48 taps, the pass band ends at 0.44 of the series'
# rate. That is wide enough, because the bounds already change series above a quarter of the rate.
BETA = 8.96
PHASES = 20_000  # largest number of different positions between two samples for which weights are computed
DRIFT = 1e-6  # [s] largest error of the ratio of the rates at the last sample


def ratio(rate: float, wanted: int, duration: float, where: str) -> Fraction:
    """Return the number of new samples per sample, a ratio of whole numbers.

    Args:
        rate: rate of the series [Hz].
        wanted: rate of the new series [Hz], larger.
        duration: duration of the series [s].

    Raises:
        DermisError: no ratio of whole numbers up to `PHASES` keeps the time within 1 us up to the last sample.
    """
    found = (Fraction(wanted) / Fraction(rate)).limit_denominator(PHASES)
    off = abs(float(found) * rate / wanted - 1) * duration
    if found.numerator > PHASES or off > DRIFT:
        raise DermisError(
            "the rates have no simple ratio",
            where=where,
            value=f"{rate:.9g} Hz",
            limit=f"a ratio to {wanted} Hz of whole numbers up to {PHASES}",
            remedy="Resample the track, for example to 1000 Hz",
        )
    return found


def upsampled(values: Array, up: Fraction, low: float = -np.inf, high: float = np.inf) -> Array:
    """Return a series on a faster grid, from its first sample to its last.

    Args:
        values: samples at equal intervals, finite, shape (n,), n >= 1.
        up: number of new samples per sample.
        low, high: range of the series; the result is limited to it.

    Returns:
        shape (floor((n - 1) * up) + 1,).
    """
    count = int((len(values) - 1) * up) + 1
    if len(values) == 1:
        return values.copy()
    # Beyond its ends the series is continued by its reflection in the end point, so that it has no kink there.
    padded = np.pad(values, HALF, mode="reflect", reflect_type="odd")
    # Sample k is entry HALF of window k, so it is entry HALF - 1 of window k + 1, as `_weights` needs it.
    windows = sliding_window_view(padded, 2 * HALF)
    bottom, top = _bounds(padded)
    result = np.empty(count)
    for phase in range(min(up.numerator, count)):
        place = phase / up
        first = int(place)
        at = slice(first, None, up.denominator)
        wave = windows[1:][at] @ _weights(float(place - first)) if phase else values[at]
        rows = result[phase :: up.numerator]
        k = len(rows)
        rows[:] = np.clip(wave[:k], bottom[at][:k], top[at][:k])
    return np.clip(result, low, high)


def _bounds(padded: Array) -> tuple[Array, Array]:
    """Return the bounds from each sample to the next: least, largest.

    Args:
        padded: series with `HALF` more samples on both sides, shape (n + 2 HALF,).

    Returns:
        two arrays of the shape (n,).
    """
    inner = padded[HALF - 1 : len(padded) - HALF + 2]  # one more sample before, two more after
    here, there, bends = inner[1:-2], inner[2:-1], np.diff(inner, 2)
    bend, after = bends[:-1], bends[1:]
    same = np.where(np.sign(bend) == np.sign(after), np.sign(bend), 0.0)
    beyond = same * np.minimum(np.abs(bend), np.abs(after)) / 4
    return np.minimum(here, there) - np.maximum(beyond, 0.0), np.maximum(here, there) - np.minimum(beyond, 0.0)


def _weights(part: float) -> Array:
    """Return the weights of samples for a position between two samples.

    Args:
        part: distance from the sample before the position, as a share of the interval, 0 to 1.

    Returns:
        weights of `HALF` samples before the position and `HALF` samples after it, shape (2 HALF,).
    """
    away = part - np.arange(1 - HALF, HALF + 1)
    window = np.i0(BETA * np.sqrt(np.maximum(1.0 - (away / HALF) ** 2, 0.0)))
    weights = np.sinc(away) * window
    return np.asarray(weights / weights.sum())
