"""Contact transient: a decaying sine along the velocity of impact.

Source: [S3] eq. 1, after Okamura et al. 2001.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError

# A transient ends when its envelope has fallen to this fraction of the device's range (2 pm of 2 mm).
END = 1e-9
# The normal part of an impact is turned to the negative side of the axis only if the tangential part points there and
# is more than this share of the impact. A smaller tangential part does not decide on the side.
SIDE_SHARE = 0.1


def displacement(
    times: Array,
    onsets: Array,
    velocities: Array,
    amplitude: float | Array,
    decay: float | Array,
    frequency: float | Array,
) -> Array:
    """Return the displacement of contact transients.

    Each transient is d = -alpha_c exp(-lambda t) sin(2 pi f t) v_c, with the time t since its onset. Overlapping
    transients are added.

    Args:
        times: [s], increasing, shape (n,).
        onsets: instants of making contact [s], shape (e,); they may be between two times.
        velocities: v_c, velocity of impact at each onset [m/s], shape (e, k).
        amplitude: alpha_c [1/(m/s)], fraction of the device's range per m/s; one number or shape (e,).
        decay: lambda [1/s], one number or shape (e,).
        frequency: f [Hz], one number or shape (e,).

    Returns:
        displacement as a fraction of the device's range, shape (n, k).

    Raises:
        DermisError: a decay or a frequency is below 0.

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
    """Return whether a transient has not ended at a time.

    Args:
        tap: onset [s], velocity of impact [m/s], amplitude [1/(m/s)], decay [1/s] and frequency [Hz].
        time: [s].
    """
    onset, velocity, amplitude, decay = tap[:4]
    return abs(amplitude) * math.sqrt(float(velocity @ velocity)) * math.exp(-decay * (time - onset)) > END


def tilted(velocities: Array, axis: Array) -> Array:
    """Return velocities with the normal part turned into the pad's plane.

    A tactor that only moves in the pad's plane cannot render the velocity of a straight tap, which is normal to the
    pad. The normal part of each velocity is therefore turned to an axis in the pad's plane that the device's preset
    states. Its sign is that of the tangential part along the axis. The two parts then add, and no direction of impact
    is lost. If the tangential part along the axis is too small, the sign is positive.

    Args:
        velocities: velocities of impact in the finger's frame [m/s], shape (e, 3).
        axis: unit vector in the pad's plane, shape (2,).

    Returns:
        velocities in the pad's plane [m/s], shape (e, 3); the normal component is 0.

    Source: a decision of Dermis on [S3] eq. 1
    """
    flat = velocities.copy()
    flat[:, 2] = 0.0
    along = flat[:, :2] @ axis
    speed = np.sqrt(np.einsum("ij,ij->i", velocities, velocities))
    side = np.where(along < -SIDE_SHARE * speed, -1.0, 1.0)
    flat[:, :2] += (side * np.abs(velocities[:, 2]))[:, None] * axis
    return flat
