"""Patterns that a finger's tactor plays: a rub along a line, or strokes in a direction.

Source: [S3] eq. 7 and 8.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError

# Periods of each pattern in one 1/f: eq. 8 has twice the frequency, so that both have the mean speed 4 A f.
PERIODS = {"orientation": 1.0, "direction": 2.0}


def axis(angle: float | Array) -> Array:
    """Return R(theta) y, clockwise from +Y as seen on the pad: 90 degrees is +X, shape (..., 2).

    Tables 4 and 6 of the paper only make sense with a clockwise turn.

    Args:
        angle: theta [rad].
    """
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def orientation(t: Array, frequency: float | Array, amplitude: float | Array, angle: float | Array) -> Array:
    """Return p = A sin(2 pi f t) R(theta) y, shape (n, 2), in the unit of A.

    Args:
        t: time since the start [s], shape (n,). frequency: f [Hz]. amplitude: A. angle: theta [rad].

    Source: [S3] eq. 7
    """
    return (amplitude * np.sin(2.0 * math.pi * frequency * t))[:, None] * axis(angle)


def direction(t: Array, frequency: float | Array, amplitude: float | Array, angle: float | Array) -> Array:
    """Return p = (A/2 sin(4 pi f t - pi/2) + A/2) R(theta) y, shape (n, 2), in the unit of A.

    Source: [S3] eq. 8
    """
    half = np.asarray(amplitude) / 2.0
    return (half * np.sin(4.0 * math.pi * frequency * t - math.pi / 2.0) + half)[:, None] * axis(angle)


def played(
    kind: str,
    times: Array,
    play: float | Array,
    frequency: float | Array,
    amplitude: float | Array,
    angle: float | Array,
    *,
    repeat: bool,
) -> Array:
    """Return a pattern that every rising edge of a switch starts, shape (n, 2), in the unit of `amplitude`.

    It starts and ends in the centre: played once it lasts one period, repeated it goes on to the end of the period in
    which the switch falls. A new edge starts it anew. Frequency, amplitude and angle hold from an edge to the next.

    Args:
        kind: 'none', 'orientation' or 'direction'.
        times: [s], shape (n,).
        play: the switch, on above 0.5; on at the first sample counts as an edge.

    Raises:
        DermisError: an unknown pattern, or a frequency that is not above 0.
    """
    out = np.zeros((len(times), 2))
    if kind == "none":
        return out
    if kind not in PERIODS:
        raise DermisError("unknown pattern", value=kind, limit="none, " + ", ".join(PERIODS))
    on = np.broadcast_to(np.asarray(play) > 0.5, times.shape)
    edges = np.flatnonzero(on & ~np.concatenate([[False], on[:-1]]))
    columns = [np.broadcast_to(np.asarray(v, dtype=np.float64), times.shape) for v in (frequency, amplitude, angle)]
    wave = orientation if kind == "orientation" else direction
    for edge, until in zip(edges, np.append(edges, len(times))[1:], strict=True):
        hertz, size, theta = (float(c[edge]) for c in columns)
        if not hertz > 0.0:
            raise DermisError("a pattern's frequency must be above 0", value=hertz, limit="> 0 Hz")
        period = 1.0 / (hertz * PERIODS[kind])
        t = times[edge:until] - times[edge]
        if repeat:
            off = np.flatnonzero(~on[edge:until])
            lasts = math.inf if off.size == 0 else math.ceil(t[off[0]] / period - 1e-9) * period
        else:
            lasts = period
        count = int(np.searchsorted(t, lasts * (1.0 + 1e-12), side="right"))
        out[edge : edge + count] = wave(t[:count], hertz, size, theta)
    return out
