"""A disc against the skin, held to the path solver, to exact answers, and to differences of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.solver.bodies import NodeGaps
from core.contact.solver.cone import along
from core.contact.solver.contact_points import RATIO
from core.contact.solver.nodes import Nodes
from core.contact.solver.pad_points import LIFT, SPREAD, PadPoints
from core.contact.solver.path_solver import PathSolver
from core.contact.solver.posed_records import ROUND
from core.devices import disc as module
from core.devices.disc import DiscContact
from core.devices.disc_pose import Disc, FrictionState, placed
from core.devices.first_contact import calibrated, first_contact
from core.devices.press_problem import PressPoints
from core.devices.thimble import mechanism
from core.presets import Library
from core.skin.model import fingertip_skin
from core.skin.surface_store import smooth_pad
from tests import contact_laws, problems


@pytest.fixture(scope="module")
def device():
    return mechanism(Library().device("thimble_3rrs"))


def disc_of(device):
    return Disc(radius=device.disc_radius)


def contact_with(skin, device, friction):
    return DiscContact(PressPoints(skin.positions, skin.compliance), disc_of(device), friction)


def walk(count=40):
    """A path that presses, tilts both ways, and leaves."""
    t = np.linspace(0, 1, count)
    depth = 1.4e-3 * np.sin(np.pi * t) - 0.1e-3
    return np.stack([0.25 * np.sin(6 * t), 0.2 * np.sin(9 * t + 0.4), 0.018 - depth], axis=1)


def forces_along(contact, device, path, state=None):
    state = state or FrictionState.rest(contact.count)
    out = []
    for x in path:
        contact.hold(state)
        found = contact.solve(placed(device, device.pose(x)))
        assert found.converged
        state = contact.settle(found)
        out.append(found.spread(contact.count))
    return np.array(out), state


def test_it_is_asked_as_every_surface_is():
    points = np.array([[0.0, 0.0, 1e-3], [1e-3, 0.0, -1e-3], [0.0, 0.0, -5e-3]])
    found = Disc().query(points, search_radius=2e-3)
    np.testing.assert_allclose(found.gap, [-1e-3, 1e-3, np.inf])
    assert found.triangle.tolist() == [0, 0, -1]


def gaps_of_nodes(solver, bodies):
    """Return the gaps of the nodes where they are expected."""
    (body,), places = bodies, solver.history.expected(bodies, solver.points + solver._image, solver.search_radius)
    found = body.surface.query(body.local(places)[0], solver.search_radius)
    near, normal = found.triangle >= 0, found.normal @ body.rotation.T
    gap, friction = found.gap - along(places - solver.points, normal), np.where(near, body.friction, 0.0)
    owner = np.where(near, 0, -1)
    return NodeGaps(bodies, gap, found.gap, normal, owner, found.triangle, friction, np.zeros(len(gap)))


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.9])
def test_a_path_equals_the_path_solver(skin, device, friction, monkeypatch):
    """Two implementations that share nothing but the law: Newton on the nodes near, and the alternating method.

    Both have the gaps of the nodes themselves; the path solver's own gaps are means about the nodes.
    """
    contact_laws.at_frame_ends_alone(monkeypatch)
    path, disc = walk(), disc_of(device)
    ours, _ = forces_along(contact_with(skin, device, friction), device, path)
    solver = PathSolver(Nodes.of(skin.positions, skin.normals, None, skin.compliance), tolerance=1e-8)
    bodies = ((disc.body(placed(device, device.pose(x)), friction),) for x in path)
    theirs = np.array([solver.step_gaps(gaps_of_nodes(solver, body)).solution.force for body in bodies])
    assert np.abs(theirs).max() > 0.05
    np.testing.assert_allclose(ours, theirs, atol=2e-5 * np.abs(theirs).max())


def test_a_level_press_without_friction_is_the_exact_one(skin, device):
    wide = replace(device, disc_radius=0.05)
    x = np.array([0.0, 0.0, 0.018 - 0.8e-3])
    found = contact_with(skin, wide, 0.0).solve(placed(wide, wide.pose(x)))
    exact = problems.flat_press(skin.compliance, skin.positions[:, 2], 0.8e-3)
    np.testing.assert_allclose(found.spread(skin.pad_count), exact, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_the_derivative_is_that_of_the_forces(skin, device, friction, monkeypatch):
    monkeypatch.setattr(module, "TOLERANCE", 1e-13)
    contact = contact_with(skin, device, friction)
    path = walk()
    for step in (8, 15, 22, 30):
        _, state = forces_along(contact, device, path[:step])
        contact.hold(state)
        x = path[step]
        found = contact.solve(placed(device, device.pose(x)))
        if friction:
            assert set(found.status.tolist()) == {0, 1, 2}
        slope = np.zeros((skin.pad_count, 3, 3))
        slope[found.near] = found.slope
        for j, h in enumerate((1e-7, 1e-7, 1e-9)):
            ahead, behind = (contact.solve(placed(device, device.pose(x + s * h * np.eye(3)[j]))) for s in (1, -1))
            difference = (ahead.spread(skin.pad_count) - behind.spread(skin.pad_count)) / (2 * h)
            np.testing.assert_allclose(slope[:, :, j], difference, atol=2e-5 * np.abs(difference).max())


def test_two_ways_to_one_pose_differ_only_with_friction(skin, device):
    """[S0] figure 4: without friction the stress at C does not depend on the way, once the rim knows where skin is."""
    end = np.array([0.05, -0.08, 0.0168])
    starts = ([0.3, 0.0, 0.0185], [-0.25, 0.2, 0.0185])
    ways = [np.concatenate([np.linspace(start, end, 12), [end] * 4]) for start in starts]
    for friction, alike in ((0.0, True), (0.6, False)):
        contact = contact_with(skin, device, friction)
        first, second = (forces_along(contact, device, way)[0][-1] for way in ways)
        apart = np.linalg.norm(first - second) / np.linalg.norm(first)
        assert apart < 1e-6 if alike else apart > 0.02


def test_standing_still_changes_nothing(skin, device):
    """Anchors of slipping nodes move to where the nodes are: the same pose again then needs the same forces."""
    contact = contact_with(skin, device, 0.4)
    path = walk()[:20]
    # where skin lies under the rim is that of the step before: what is left of that is an eighth after each step
    before, state = forces_along(contact, device, [*path, *[path[-1]] * 5])
    after, _ = forces_along(contact, device, [path[-1]] * 5, state)
    assert (contact.solve(placed(device, device.pose(path[-1]))).status == 1).any()
    np.testing.assert_allclose(after[-1], before[-1], atol=1e-5 * np.abs(before[-1]).max())


def test_the_rim_carries_nothing_outside_of_it(skin, device):
    small = replace(device, disc_radius=2e-3)
    x = np.array([0.0, 0.0, 0.018 - 1.0e-3])
    found = contact_with(skin, small, 0.0).solve(placed(small, small.pose(x)))
    reach = np.hypot(*skin.positions[found.near[found.status > 0], :2].T)
    # the rim falls away as r^2 / 2 rho, so 1 mm deep it is met up to sqrt(2 rho d) farther out at most
    assert reach.max() <= 2e-3 + np.sqrt(2 * small_rounding() * 1.0e-3) and found.touching


def small_rounding():
    return Disc().rounding


def test_the_disc_moves_its_material_when_it_tilts(skin, device):
    """Parasitic shift and yaw shear the skin: pressed flat and then turned by both tilts, it is pulled sideways."""
    contact = contact_with(skin, device, 5.0)  # so rough that nothing slips
    flat = np.array([0.0, 0.0, 0.0172])
    tilted = np.array([0.12, 0.12, 0.0172])
    force, _ = forces_along(contact, device, np.linspace(flat, tilted, 6))
    moved = device.pose(tilted).centre[:2] - device.pose(flat).centre[:2]
    still = replace(device, platform_radius=1e-9, base_radius=15e-3, crank=15e-3, rod=20e-3)  # no arm: no shift
    ideal, _ = forces_along(contact_with(skin, device, 5.0), still, np.linspace(flat, tilted, 6))
    assert np.linalg.norm(moved) > 1e-6
    assert np.linalg.norm(force[-1] - ideal[-1]) > 1e-3 * np.linalg.norm(ideal[-1])


def test_first_contact_is_where_the_gap_closes(skin, device):
    contact = contact_with(skin, device, 0.6)
    for pitch, roll in ((0.0, 0.0), (0.2, -0.1), (-0.3, 0.25)):
        z = first_contact(device, contact, pitch, roll)
        gap = contact.gap(placed(device, device.pose((pitch, roll, z)))).min()
        assert abs(gap) < 1e-9
        assert not contact.solve(placed(device, device.pose((pitch, roll, z + 1e-5)))).touching
        assert contact.solve(placed(device, device.pose((pitch, roll, z - 1e-5)))).touching


def test_calibration_puts_first_contact_where_it_was_felt(skin, device):
    contact = contact_with(skin, device, 0.6)
    felt_at = np.array([0.1, -0.05, 0.0169])
    felt = device.servo_angles(felt_at)[0] - device.servo_zero
    own = calibrated(device, contact, felt)
    assert first_contact(own, contact, 0.1, -0.05) == pytest.approx(0.0169, abs=1e-9)
    assert first_contact(device, contact, 0.1, -0.05) != pytest.approx(0.0169, abs=1e-5)


def test_far_away_nothing_is_felt(skin, device):
    found = contact_with(skin, device, 0.6).solve(placed(device, device.pose((0.0, 0.0, 0.025))))
    assert not found.touching and found.method == "none" and not found.force.any()


def test_points_of_smooth_skin_find_the_gap_that_the_disc_has(device):
    """The compiled look of a touch, against `query` at the lifted places from which a touch looks."""
    pad, disc = smooth_pad(fingertip_skin(level="draft")), disc_of(device)
    pose = placed(device, device.pose(np.array([0.25, -0.15, 0.0172])))
    solver = PathSolver(PadPoints(pad))
    found = solver.look([disc.body(pose, 0.3)])
    up = -pad.chart.cells.normals[solver.cells] * LIFT * ROUND
    aside = ROUND * SPREAD * pad.chart.cells.sides[solver.cells]
    aside /= np.linalg.norm(pad.chart.cells.sides[solver.cells], axis=2)[:, :, None]
    low, high = np.zeros((2, len(up)))
    for a, b, share in ((1, 1, 1 / 6), (1, -1, 1 / 6), (-1, 1, 1 / 6), (-1, -1, 1 / 6), (0, 0, 2 / 6)):
        places = solver.points + a * aside[:, 0] + b * aside[:, 1] - pose.centre
        low += share * disc.query((places + up) @ pose.rotation).gap
        high += share * disc.query((places + RATIO * up) @ pose.rotation).gap
    near = found.body >= 0
    assert near.sum() > 20 and (disc.query((solver.points - pose.centre) @ pose.rotation).gap[near] > 0.0).any()
    expected = (RATIO * low - high) / (RATIO - 1.0)
    exact = near & (expected < 0.2e-3)  # a point that is farther looks but once
    reach = np.hypot(*((solver.points - pose.centre) @ pose.rotation)[exact, :2].T)
    assert (reach > disc.radius + 0.5e-3).any() and (reach < disc.radius).any()
    np.testing.assert_allclose(found.clearance[exact], expected[exact], atol=1e-12)
