"""Patterns of a tactor: a rub along a line, or strokes in a direction.

Source: [S3] eq. 7 and 8.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..memory import Carry

# Number of periods of a pattern in the time 1/f. Eq. 8 has twice the frequency of eq. 7, so that both patterns have the
# mean speed 4 A f.
PERIODS = {"orientation": 1.0, "direction": 2.0}


def axis(angle: float | Array) -> Array:
    """Return the axis of a pattern, the unit vector R(theta) y.

    Its shape is (..., 2). The angle is clockwise from +Y as seen on the pad, so 90 degrees is +X. With the opposite
    turn, Tables 4 and 6 of the paper would make no sense.

    Args:
        angle: theta [rad].
    """
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def orientation(t: Array, frequency: float | Array, amplitude: float | Array, angle: float | Array) -> Array:
    """Return the rub p = A sin(2 pi f t) R(theta) y, shape (n, 2).

    Args:
        t: time since the start [s], shape (n,).
        frequency: f [Hz], one number or shape (n,).
        amplitude: A, one number or shape (n,); it sets the unit of p.
        angle: theta [rad], one number or shape (n,).

    Source: [S3] eq. 7
    """
    return (amplitude * np.sin(2.0 * math.pi * frequency * t))[:, None] * axis(angle)


def direction(t: Array, frequency: float | Array, amplitude: float | Array, angle: float | Array) -> Array:
    """Return strokes p = (A/2 sin(4 pi f t - pi/2) + A/2) R(theta) y.

    The arguments and the shape are those of `orientation`.

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
    carry: Carry | None = None,
) -> Array:
    """Return a pattern that starts at every rising edge of a switch.

    The pattern has the shape (n, 2) and the unit of `amplitude`. It starts and ends in the centre. A new edge starts it
    again from the beginning. Frequency, amplitude and angle are those at the last edge.

    Args:
        kind: 'none', 'orientation' or 'direction'.
        times: [s], increasing, shape (n,).
        play: value of the switch, one number or shape (n,). The switch is on above 0.5; on at the first sample counts
            as an edge.
        frequency: f [Hz], one number or shape (n,).
        amplitude: A, one number or shape (n,).
        angle: theta [rad], one number or shape (n,).
        repeat: False: the pattern lasts one period. True: it lasts to the end of the period in which the switch is
            turned off.
        carry: state from the window of times before, and for the next window; None if the switch was off before.

    Raises:
        DermisError: the pattern is unknown, or a frequency is not above 0.
    """
    out = np.zeros((len(times), 2))
    if kind == "none":
        return out
    if kind not in PERIODS:
        raise DermisError("unknown pattern", value=kind, limit="none, " + ", ".join(PERIODS))
    on = np.broadcast_to(np.asarray(play) > 0.5, times.shape)
    carry = carry or Carry()
    was_on, running = carry.start or (False, None)
    edges = np.flatnonzero(on & ~np.concatenate([[was_on], on[:-1]])).tolist()
    columns = [np.broadcast_to(np.asarray(v, dtype=np.float64), times.shape) for v in (frequency, amplitude, angle)]
    wave = orientation if kind == "orientation" else direction
    # The entries of a play are its first sample, the time of its edge [s], the time at which the switch was turned off
    # [s] (inf unless an earlier window found it), frequency, amplitude and angle.
    plays = [(edge, float(times[edge]), math.inf, *(float(c[edge]) for c in columns)) for edge in edges]
    if running is not None:
        plays.insert(0, (0, *running))
    ends = [*(first for first, *_ in plays), len(times)][1:]
    for (first, began, fell, hertz, size, theta), until in zip(plays, ends, strict=True):
        if not hertz > 0.0:
            raise DermisError("a pattern's frequency must be above 0", value=hertz, limit="> 0 Hz")
        period = 1.0 / (hertz * PERIODS[kind])
        t = times[first:until] - began
        off = np.flatnonzero(~on[first:until])
        if first < carry.index or (first == 0 and running is not None):
            early = fell == math.inf and off.size and first + off[0] < carry.index
            carry.found = began, float(times[first + off[0]]) if early else fell, hertz, size, theta
        if repeat:
            lasted = float(t[off[0]]) if fell == math.inf and off.size else fell - began
            lasts = lasted if lasted == math.inf else math.ceil(lasted / period - 1e-9) * period
        else:
            lasts = period
        count = int(np.searchsorted(t, lasts * (1.0 + 1e-12), side="right"))
        out[first : first + count] = wave(t[:count], hertz, size, theta)
    carry.found = bool(on[carry.index - 1]) if carry.index else was_on, carry.found
    return out
