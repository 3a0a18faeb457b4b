"""The transient of making contact: a decaying sine along the speed of impact.

Source: [S3] eq. 1, after Okamura et al. 2001.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError

# A transient ends when its envelope has fallen to this fraction of the device's range (2 pm of 2 mm).
END = 1e-9
# A tangential part of less than this share of the impact does not decide to which side the normal part turns.
SIDE_SHARE = 0.1


def displacement(
    times: Array,
    onsets: Array,
    velocities: Array,
    amplitude: float | Array,
    decay: float | Array,
    frequency: float | Array,
) -> Array:
    """Return d = -alpha_c exp(-lambda t) sin(2 pi f t) v_c with t since each onset; overlapping transients add.

    Args:
        times: [s], rising, shape (n,).
        onsets: instants of making contact [s], shape (e,); they may lie between two times.
        velocities: speed at each contact, v_c [m/s], shape (e, k).
        amplitude: alpha_c [1/(m/s)], a fraction of the device's range for each m/s. One number, or shape (e,).
        decay: lambda [1/s]. frequency: f [Hz]. One number, or shape (e,).

    Returns:
        displacement as a fraction of the device's range, shape (n, k).

    Raises:
        DermisError: a decay or frequency below 0.

    Source: [S3] eq. 1
    """
    total = np.zeros((len(times), velocities.shape[1]))
    columns = [np.broadcast_to(np.asarray(v, dtype=np.float64), onsets.shape) for v in (amplitude, decay, frequency)]
    for onset, v, alpha, rate, hertz in zip(onsets, velocities, *columns, strict=True):
        if rate < 0.0 or hertz < 0.0:
            raise DermisError(
                "a contact transient needs a decay and a frequency of at least 0", value=f"{rate:g} /s, {hertz:g} Hz"
            )
        strength = abs(alpha) * math.sqrt(float(v @ v))
        if strength <= END:
            continue
        start = int(np.searchsorted(times, onset))
        end = len(times)
        if rate > 0.0:
            end = int(np.searchsorted(times, onset + math.log(strength / END) / rate, side="right"))
        t = times[start:end] - onset
        total[start:end] -= (alpha * np.exp(-rate * t) * np.sin(2.0 * math.pi * hertz * t))[:, None] * v
    return total


def rings(tap: tuple[float, Array, float, float, float], time: float) -> bool:
    """Return whether a tap of an instant, velocity, amplitude and decay still moves anything at a time [s]."""
    onset, velocity, amplitude, decay = tap[:4]
    return abs(amplitude) * math.sqrt(float(velocity @ velocity)) * math.exp(-decay * (time - onset)) > END


def tilted(velocities: Array, axis: Array) -> Array:
    """Return impact velocities with their normal part turned into the plane of the pad.

    A tactor that only shears cannot show the velocity of a straight tap, which is normal to the pad. Its normal part
    therefore turns to a pad axis that the device's preset declares. It turns to the side to which the tangential part
    already points along that axis, so that the two add and no direction of impact is lost; to the axis itself where
    the tangential part points to neither.

    Args:
        velocities: in the finger's frame [m/s], shape (e, 3).
        axis: unit vector in the pad's plane, shape (2,).

    Returns:
        velocities in the pad's plane, their normal component 0, shape (e, 3).

    Source: a decision of Dermis on [S3] eq. 1
    """
    flat = velocities.copy()
    flat[:, 2] = 0.0
    along = flat[:, :2] @ axis
    speed = np.sqrt(np.einsum("ij,ij->i", velocities, velocities))
    side = np.where(along < -SIDE_SHARE * speed, -1.0, 1.0)
    flat[:, :2] += (side * np.abs(velocities[:, 2]))[:, None] * axis
    return flat
