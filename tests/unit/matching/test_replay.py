"""Replay: a track's poses give the very forces that the matching ended with, whatever the order of asking."""

from __future__ import annotations

import numpy as np
import pytest

from core.devices.disc_device import seated
from core.devices.first_contact import first_contact
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.matching.replay import INTERVAL, Replay, configurations
from core.matching.thimble import match_touch
from core.matching.thimble_use import prepare
from core.surrogate.store import contact_of
from core.track.command_track import CommandTrack
from tests import touches


@pytest.fixture(scope="module")
def matched(skin, spec):
    return match_touch(prepare(spec, skin, {}), touches.slide(2 * INTERVAL + 12).forces(skin), np.radians(6.0))


def test_forces_come_back_in_any_order(skin, spec, matched):
    replay = Replay(mechanism(spec), skin, 0.6, matched.x)
    top = float(np.abs(matched.force).max())
    for sample in (40, 41, 12, len(matched.x) - 1, 41, 0, INTERVAL, 2 * INTERVAL):
        np.testing.assert_allclose(replay.forces(sample), matched.force[sample], atol=2e-5 * top)
    np.testing.assert_allclose(replay.forces(40, ahead=matched.x[41]), matched.force[41], atol=2e-5 * top)
    with pytest.raises(DermisError, match="no such sample"):
        replay.forces(len(matched.x))


def test_friction_is_remembered(skin, spec, matched):
    """The same pose from rest makes other forces: without the path the answer would be wrong."""
    sample = int(np.argmax(np.linalg.norm(matched.force.sum(axis=1)[:, :2], axis=1)))
    alone = Replay(mechanism(spec), skin, 0.6, matched.x[sample : sample + 1]).forces(0)
    assert np.linalg.norm(alone - matched.force[sample]) > 0.05 * np.linalg.norm(matched.force[sample])


def test_a_tracks_angles_give_its_poses(spec, matched):
    columns = np.concatenate([matched.angles, matched.x], axis=1)
    track = CommandTrack(spec, np.arange(len(columns)) / spec.rate, columns)
    np.testing.assert_allclose(configurations(track, mechanism(spec)), matched.x, atol=1e-10)


@pytest.mark.parametrize("x", [np.zeros((4, 2)), np.full((4, 3), np.nan)])
def test_poses_that_are_none_are_refused(skin, spec, x):
    with pytest.raises(DermisError, match="configurations are"):
        Replay(mechanism(spec), skin, 0.6, x)


def test_contacts_that_do_not_settle_are_told_once_each(skin, device):
    """A disc 6 mm deep is beyond what the law holds; samples on the way to a wanted one count too."""
    law = skin.with_law()
    contact = contact_of(device, law, 0.6)
    first = first_contact(device, contact, 0.0, 0.0)
    deep = [seated(device, 0.0, 0.0, first - depth) for depth in (-0.5e-3, 0.5e-3, 6e-3, 6e-3, -0.5e-3)]
    replay = Replay(device, law, 0.6, np.array(deep))
    replay.solution(1)
    assert replay.findings("A thimble") == ()
    for _ in range(2):
        assert replay.solution(4).settled
        (found,) = replay.findings("A thimble")
        assert (found.code, found.severity, found.count) == ("law-unsettled", "warning", 2)
        assert "A thimble" in found.what and "sample 2" in str(found)
    linear = Replay(device, skin, 0.6, np.array(deep))
    linear.solution(4)
    assert linear.findings("A thimble") == ()
