"""Bounds of the joints within one frame."""

from __future__ import annotations

import numpy as np

from core.matching.minimum import ServoLimits


def test_narrower_limits_are_those_of_the_servos_speed(device):
    angles = np.array([0.69, 0.0, -0.3])
    near = ServoLimits.of(device).near(angles, 0.05)
    np.testing.assert_allclose(near.high, [device.servo_range, 0.05, -0.25])
    np.testing.assert_allclose(near.low, [0.64, -0.05, -0.35])
