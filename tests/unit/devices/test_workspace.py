"""What the platform reaches: on the limit a servo is at its end, beyond it one is past it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.devices.thimble import mechanism
from core.devices.workspace import distance_range, workspace
from core.errors import DermisError
from core.presets import Library


@pytest.fixture(scope="module")
def device():
    return mechanism(Library().device("thimble_3rrs"))


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, 0.0), (-0.1, 0.2)])
def test_at_either_end_a_servo_is_at_its_limit(device, tilt):
    for z in distance_range(device, 0.018, *tilt):
        assert device.constraints((*tilt, z), *device.servo_limits).min() == pytest.approx(0.0, abs=1e-3)
        assert device.feasible((*tilt, z))
        away = z + np.sign(z - 0.018) * 5e-6
        assert not device.feasible((*tilt, away))


def test_level_ends_follow_from_the_links_alone(device):
    """At level all legs are alike: the joint is at r = rp - rb and the crank at its limit."""
    low, high = distance_range(device, 0.018)
    r = device.platform_radius - device.base_radius
    for turn, found in ((device.servo_range, high), (-device.servo_range, low)):
        q = device.servo_zero + turn
        knee = device.crank * np.array([np.cos(q), np.sin(q)])
        z = knee[1] + np.sqrt(device.rod**2 - (r - knee[0]) ** 2)
        assert found == pytest.approx(z, abs=2e-6)


def test_tilts_on_the_limit_are_reached_and_others_are_not(device):
    found = workspace(device, 0.018, levels=5, directions=12)
    assert found.tilt.shape == (5, 12) and (np.diff(found.distance) > 0).all()
    assert found.tilt[2].min() > np.radians(20)
    for level in range(5):
        for x, tilt in zip(found.configurations(level), found.tilt[level], strict=True):
            assert np.hypot(x[0], x[1]) == pytest.approx(tilt)
            assert device.feasible(x)
            if tilt < np.radians(59):
                assert not device.feasible([x[0] * (1 + 1e-3 / tilt), x[1] * (1 + 1e-3 / tilt), x[2]])


def test_a_distance_out_of_reach_is_refused(device):
    with pytest.raises(DermisError, match="does not reach"):
        distance_range(device, 0.05)
    with pytest.raises(DermisError, match="does not reach"):
        workspace(replace(device, servo_range=1e-6), 0.021)
