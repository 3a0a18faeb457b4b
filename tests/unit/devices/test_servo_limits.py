"""Servo limits: one channel that is narrower or slower on one side alone is kept to, and nothing wider ever counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.devices.servo_limits import SERVOS, servo_bounds, servo_speed
from core.devices.spec import DeviceSpec
from core.errors import DermisError
from core.presets import Library

REACH, SPEED = 0.7, 10.0  # of the mechanism [rad], [rad/s]


def with_channels(**changes: dict[str, float | None]) -> DeviceSpec:
    """Return the thimble with channels that state no limit, but for those given."""
    spec = Library().device("thimble_3rrs")
    channels = tuple(
        replace(c, **{"low": None, "high": None, "slew": None, **changes.get(c.name, {})}) if c.name in SERVOS else c
        for c in spec.channels
    )
    return replace(spec, channels=channels)


@pytest.mark.parametrize("servo", [0, 1, 2])
@pytest.mark.parametrize(("side", "angle"), [("low", -0.3), ("low", 0.1), ("high", 0.3), ("high", -0.1)])
def test_one_end_of_one_servo_is_enough(servo: int, side: str, angle: float) -> None:
    bounds = servo_bounds(with_channels(**{SERVOS[servo]: {side: angle}}), REACH)
    expected = np.array([[-REACH] * 3, [REACH] * 3])
    expected[int(side == "high"), servo] = angle
    np.testing.assert_array_equal(bounds, expected)


def test_what_is_no_narrower_changes_nothing() -> None:
    for far in (REACH, 2.0, 3.0):
        assert servo_bounds(with_channels(servo_1={"low": -far, "high": far}), REACH) is None
    one = servo_bounds(with_channels(servo_1={"low": -2.0, "high": 2.0}, servo_3={"high": 0.5}), REACH)
    np.testing.assert_array_equal(one, [[-REACH] * 3, [REACH, REACH, 0.5]])


def test_a_channel_without_any_range_is_refused_by_name() -> None:
    for limits in ({"low": 0.8, "high": 0.9}, {"high": -REACH}, {"low": 0.2, "high": 0.2}):
        with pytest.raises(DermisError, match="servo_2: the channel leaves its servo no range"):
            servo_bounds(with_channels(servo_2=limits), REACH)


def test_the_slowest_servo_sets_the_speed() -> None:
    """A pose is three angles at once: the other two wait for it."""
    assert servo_speed(with_channels(), SPEED) == SPEED
    assert servo_speed(with_channels(servo_2={"slew": 4.0}, servo_3={"slew": 20.0}), SPEED) == 4.0
    assert servo_speed(with_channels(servo_1={"slew": 20.0}), SPEED) == SPEED
