"""Limits of a thimble's servos, from its mechanism and its channels.

The tighter of the two limits applies.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .spec import DeviceSpec

SERVOS = ("servo_1", "servo_2", "servo_3")


def servo_bounds(spec: DeviceSpec, servo_range: float) -> Array | None:
    """Return the lowest and the highest angle of every servo.

    A search for a pose must know these limits, because a pose changes if a single angle is clipped afterwards.

    Args:
        spec: preset of the thimble.
        servo_range: range of the mechanism to either side of neutral [rad].

    Returns:
        The limits from neutral [rad], shape (2, 3); None if no channel has a narrower range than the mechanism.

    Raises:
        DermisError: a channel leaves its servo no range.
    """
    low, high = np.full(3, -servo_range), np.full(3, servo_range)
    for channel in spec.channels:
        if channel.name in SERVOS:
            i = SERVOS.index(channel.name)
            low[i] = max(low[i], -servo_range if channel.low is None else channel.low)
            high[i] = min(high[i], servo_range if channel.high is None else channel.high)
            if not low[i] < high[i]:
                raise DermisError(
                    "the channel leaves its servo no range",
                    where=f"device preset '{spec.key}', {channel.name}",
                    value=f"{np.degrees(low[i]):.3g} to {np.degrees(high[i]):.3g} deg",
                    limit=f"within +-{np.degrees(servo_range):.3g} deg of neutral",
                )
    narrower = (low > -servo_range * (1 - 1e-12)).any() or (high < servo_range * (1 - 1e-12)).any()
    return np.stack([low, high]) if narrower else None


def servo_speed(spec: DeviceSpec, speed: float) -> float:
    """Return the speed that every servo can reach [rad/s].

    It is that of the slowest channel, or `speed` if no channel is slower.

    Args:
        spec: preset of the thimble.
        speed: speed of the mechanism's servos [rad/s].
    """
    slews = [c.slew for c in spec.channels if c.name in SERVOS and c.slew is not None]
    slower = [slew for slew in slews if slew < speed * (1 - 1e-12)]
    return min(slower, default=speed)
