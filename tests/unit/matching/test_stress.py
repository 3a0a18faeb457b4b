"""Skin stress optimisation on touches that the device made itself, and on ones that it cannot make."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.contact.skin_contact import SkinContact
from core.devices.disc_pose import FrictionState, placed
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.matching.description import describe
from core.matching.stress import StressMatcher
from core.matching.thimble import match_stimuli, matcher, render
from core.presets import Library
from core.scene.tactile_scene import DeviceUse, Finger, TactileScene
from core.skin.fingertip import Level, fingertip_mesh
from core.skin.model import fingertip_skin, mesh_skin
from core.skin.stress import locate
from core.surrogate.store import contact_of
from tests import touches
from tests.thimbles import match_sequence
from tests.tissue import probes_at


@pytest.fixture(scope="module")
def observation_matrix(skin, device):
    return describe(device, skin, 0.6).observation_matrix


def device_path(count=24):
    t = np.linspace(0, 1, count)
    depth = 1.1e-3 * np.sin(np.pi * t) - 0.05e-3
    return np.stack([0.2 * np.sin(5 * t), 0.18 * np.sin(4 * t + 0.5), 0.018 - depth], axis=1)


def made_by_device(skin, device, path, friction=0.6):
    contact, forces = contact_of(device, skin, friction), []
    state = FrictionState.rest(contact.count)
    for x in path:
        contact.hold(state)
        found = contact.solve(placed(device, device.pose(x)))
        state = contact.settle(found)
        forces.append(contact.nodal(found))
    return np.array(forces)


def test_what_the_device_made_is_recovered_exactly(skin, device, observation_matrix):
    path = device_path()
    forces = made_by_device(skin, device, path)
    found = match_sequence(device, skin, forces, observation_matrix=observation_matrix)
    pressed = forces[:, :, 2].sum(axis=1) > 0.1
    assert pressed.sum() > 15
    np.testing.assert_allclose(np.degrees(found.x[pressed, :2]), np.degrees(path[pressed, :2]), atol=0.3)
    np.testing.assert_allclose(found.x[pressed, 2], path[pressed, 2], atol=0.02e-3)
    assert np.median(found.mismatch[pressed]) < 0.01


def probe_observation(skin, points):
    """Stress at given points for forces on the pad nodes, shape (6 k, 3 m)."""
    probes = probes_at(skin.mesh, points)
    columns = []
    for i in range(3 * skin.pad_count):
        unit = np.zeros(3 * skin.pad_count)
        unit[i] = 1.0
        columns.append(probes.read(skin.stress(unit)).ravel())
    return np.array(columns).T


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_a_reachable_target_of_another_mesh_is_recovered(device):
    """No inverse crime: the target's skin has other and twice as many elements, and stress is compared at points.

    Both press nodes, for a mesh alone has no smooth skin.
    """
    skin, fine = fingertip_skin(level="standard"), mesh_skin(fingertip_mesh(None, Level(10, 16, 5, 6)))
    assert len(fine.mesh.tetrahedra) > 1.7 * len(skin.mesh.tetrahedra)
    points = fine.probes.points[np.isclose(fine.probes.depth, 2.0e-3)]
    points = points[locate(skin.mesh, points)[0] >= 0][::2]
    coarse = probe_observation(skin, points)
    probes = probes_at(fine.mesh, points)
    path = device_path(16)
    forces = made_by_device(fine, device, path)
    targets = np.array([probes.read(fine.stress(f)).ravel() for f in forces])
    found = match_stimuli(StressMatcher(device, contact_of(device, skin.on_nodes, 0.6), coarse), targets)
    pressed = forces[:, :, 2].sum(axis=1) > 0.15
    assert pressed.sum() >= 14
    assert np.abs(np.degrees(found.x - path)[pressed, :2]).max() < 2.0
    assert np.abs(found.x - path)[pressed, 2].max() < 0.1e-3


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_frame_begins_where_its_target_has_gone(skin, device, observation_matrix):
    """What the last slope says of the target's change is nearly all: fewer poses are looked at, for the same answer."""
    targets = touches.ball_roll(160).forces(skin, points=True).reshape(160, -1) @ observation_matrix.T
    looked, left = [], []
    for forgets in (False, True):
        matching = StressMatcher(device, contact_of(device, skin, 0.6), observation_matrix)
        frames = []
        for target in targets:
            frames.append(matching.step(target))
            if forgets:
                matching.restore((*matching.save()[:4], None, *matching.save()[5:]))
        looked.append(sum(frame.minimum.evaluations for frame in frames if frame.minimum is not None))
        left.append(float(np.linalg.norm(np.array([frame.stimulus for frame in frames]) - targets)))
    assert looked[0] < 0.8 * looked[1]
    assert left[0] < 1.01 * left[1]


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize(
    "touch", [touches.ball_roll(40), touches.edge_press(40), touches.slide(40)], ids=lambda t: t.name
)
def test_no_pose_of_a_grid_is_clearly_better(skin, device, observation_matrix, touch):
    """The search is local; a grid over the whole workspace, from the same friction state, is not."""
    follower = StressMatcher(device, contact_of(device, skin, 0.6), observation_matrix)
    forces = touch.forces(skin)
    targets = forces.reshape(len(forces), -1) @ observation_matrix.T
    checked = 0
    for i, target in enumerate(targets):
        state = follower.state
        frame = follower.step(target)
        found = frame.minimum
        if found is None:
            continue
        assert found.cost <= found.start_cost and found.room.min() >= 0.0
        assert frame.solution.converged
        if i % 9 != 4:
            continue
        checked += 1
        follower.direct.hold(state)
        best = np.inf
        for pitch in np.radians(np.arange(-24, 25, 6.0)):
            for roll in np.radians(np.arange(-24, 25, 6.0)):
                z = follower._start_at(pitch, roll, 0.0)[2]
                for depth in np.arange(0.1e-3, 1.5e-3, 0.2e-3):
                    stimulus, _ = follower.direct.evaluate(np.array([pitch, roll, z - depth]))
                    best = min(best, float(np.linalg.norm(stimulus - target)))
        assert found.mismatch <= 1.03 * best
        follower.direct.hold(state)
    assert checked >= 2


def test_a_faint_touch_begins_on_the_side_that_renders_it_strong(skin, device, observation_matrix):
    """An edge's first instant is alike to many poses; what friction leaves of it once it is strong is not."""
    matching = StressMatcher(device, contact_of(device, skin, 0.6), observation_matrix)
    targets = touches.edge_press(60).forces(skin, points=True).reshape(60, -1) @ observation_matrix.T
    faint = targets[np.linalg.norm(targets, axis=1) > 0.0][0]
    strong = faint * (0.3 * np.median(matching.table.strength) / np.linalg.norm(faint))

    def left(start):
        matching.reset()
        matching.step(faint, start=start)
        return matching.step(strong, start=matching.x).minimum.cost

    sides = [left(start) for start in matching.table.promising(faint, 8)]
    assert max(sides) > 2.0 * min(sides)
    assert left(None) <= min(sides) / 0.9 * (1 + 1e-9)  # for less gain the side that promised most is kept


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_sliding_makes_the_platform_roll_only_with_friction(skin, device):
    """[S0] figure 10."""
    rolls = {}
    for friction in (0.6, 0.0):
        forces = touches.slide(50, friction=friction).forces(skin)
        own = describe(device, skin, friction).observation_matrix
        found = match_sequence(device, skin, forces, friction=friction, observation_matrix=own)
        sliding = found.touched & (np.arange(50) > 15) & (np.arange(50) < 42)
        rolls[friction] = np.degrees(np.ptp(found.x[sliding, 1]))
    assert rolls[0.0] < 0.2
    assert rolls[0.6] > 5 * max(rolls[0.0], 0.1)


def test_without_touch_the_disc_hovers_and_friction_forgets(skin, device, observation_matrix):
    follower = StressMatcher(device, contact_of(device, skin, 0.6), observation_matrix)
    first = follower.step(np.zeros(len(observation_matrix)))
    assert first.minimum is None and not first.touching and first.mismatch == 0.0
    np.testing.assert_allclose(first.x[:2], 0.0)
    forces = made_by_device(skin, device, [[0.1, 0.0, 0.0172]])
    assert follower.step(forces.reshape(1, -1)[0] @ observation_matrix.T).touching
    after = follower.step(np.zeros(len(observation_matrix)))
    assert not after.touching and not follower.state.anchored.any()
    gap = follower.contact.gap(placed(device, device.pose(after.x))).min()
    assert gap == pytest.approx(follower.hover * np.cos(after.x[0]) * np.cos(after.x[1]), rel=1e-3)


def test_a_search_that_begins_in_the_air_ends_there(skin, device, observation_matrix):
    """No point of the skin is near enough to be a candidate: the stimulus and its derivative are zero."""
    follower = StressMatcher(device, contact_of(device, skin, 0.6), observation_matrix)
    follower.direct.hold(follower.state)
    x = np.array([0.0, 0.0, 0.0215])
    value, slope = follower.direct.evaluate(x)
    assert not value.any() and not slope.any() and not len(follower.contact.near)
    target = follower.table.strength[0] * follower.table.direction[0]
    frame = follower.step(target, start=x)
    assert not frame.touching and frame.mismatch == 1.0
    np.testing.assert_array_equal(frame.x, x)


def test_servo_speed_is_a_limit_of_the_search(skin, device, observation_matrix):
    forces = touches.ball_roll(30).forces(skin)
    change = np.radians(1.0)
    found = match_sequence(device, skin, forces, observation_matrix=observation_matrix, change=change)
    start = matcher(device, skin, observation_matrix=observation_matrix).angles
    assert np.abs(np.diff(np.concatenate([start[None], found.angles]), axis=0)).max() <= change * (1 + 1e-9)
    assert found.held_back.any()
    assert np.abs(found.angles).max() <= device.servo_range * (1 + 1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_targets_that_are_not_numbers_are_refused(skin, device, observation_matrix, bad):
    follower = StressMatcher(device, contact_of(device, skin, 0.6), observation_matrix)
    target = np.zeros(len(observation_matrix))
    target[2] = bad
    with pytest.raises(DermisError, match="not finite"):
        follower.step(target)
    with pytest.raises(DermisError, match="do not fit the skin or are not finite"):
        match_sequence(device, skin, np.full((2, 3 * skin.pad_count), bad), observation_matrix=observation_matrix)
    with pytest.raises(DermisError, match="do not fit"):
        match_sequence(device, skin, np.zeros((2, 7)), observation_matrix=observation_matrix)


def test_servo_limits_that_exclude_first_contact_are_refused(skin, device, observation_matrix):
    far = device.mount.copy()
    far[:3, 3] += [0.0, 0.0, 0.012]  # the base 12 mm higher: the platform ends short of the pad
    with pytest.raises(DermisError, match="first contact"):
        StressMatcher(replace(device, mount=far), contact_of(device, skin, 0.6), observation_matrix)


def test_methods_are_named(skin, device, observation_matrix):
    with pytest.raises(DermisError, match="unknown method.*stress, network, ridge, force, geometry"):
        matcher(device, skin, "magic", observation_matrix=observation_matrix)
    with pytest.raises(DermisError, match="needs a surrogate"):
        matcher(device, skin, "network", observation_matrix=observation_matrix)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_rendering_fills_the_track_at_the_devices_rate(skin):
    spec = Library().device("thimble_3rrs")
    touch = touches.ball_roll(31)
    forces = touch.forces(skin)
    contact = np.flatnonzero(forces.any(axis=(1, 2)))
    n, zero = len(forces), np.zeros(31)
    times = np.arange(n) / 30.0
    felt = SkinContact(
        skin,
        times,
        times * 30,
        contact,
        forces[contact].astype(np.float32),
        zero,
        zero,
        zero,
        zero,
        zero.astype(np.int32),
        zero.astype(np.int32),
        (),
        {},
    )
    scene = TactileScene("s", Fraction(30), (0, 30), 30.0, (Finger("index"),), (), (), ())
    use = DeviceUse("thimble_3rrs", {"thimble_method": "network", "thimble_surrogate": "/nowhere/at/all"})
    out = render(None, scene, 0, use, spec, felt)  # type: ignore[arg-type]
    assert [f.code for f in out.findings][0] == "surrogate"  # and the direct method did the work
    assert len(out.track.times) == 101 and out.track.values.shape == (101, 6)
    device = mechanism(spec)
    for row in out.track.values[::7]:
        np.testing.assert_allclose(row[:3], device.servo_angles(row[3:])[0] - device.servo_zero, atol=1e-12)
    assert not [f for f in out.track.check() if f.severity == "error"]
    wanted = out.signals["contact"] > 0
    assert wanted.any() and not wanted[0]
    assert np.corrcoef(out.signals["normal_force"][wanted], out.signals["target_force"][wanted])[0, 1] > 0.9
