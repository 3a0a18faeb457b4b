"""A platform presses on points of the smooth skin, as a touch does: forces, moments and what the sensor reads."""

from __future__ import annotations

import numpy as np
import pytest

from core.cache import Cache
from core.contact.solver.bodies import ContactBody
from core.contact.solver.pad_points import PadPoints
from core.contact.solver.path_solver import PathSolver
from core.devices.disc_pose import Disc
from core.devices.press import BATCH, Press, _alike
from core.devices.press_problem import PressPoints
from core.matching.platforms import mechanism
from core.matching.readings import readings_of
from core.matching.sweep import platform_poses, sweep
from core.matching.table import build, press_of, sound
from core.presets import Library
from core.recent import Recent
from core.skin.model import fingertip_skin, skin_from_parameters
from core.skin.nodal_forces import NodalForces
from core.skin.surface_store import smooth_pad
from core.surrogate import press_points as press_points_module
from core.surrogate.press_points import press_points

FLIP = np.diag([1.0, -1.0, -1.0])  # the thimble's disc touches with -Z
LIKE = 0.02  # of what is read on points four times as fine: the press's own parts of the skin are 1.5 mm


@pytest.fixture(scope="module")
def skin():
    return fingertip_skin(level="draft")


@pytest.fixture(scope="module")
def points(skin) -> PressPoints:
    return press_points(skin)


def test_the_compliance_between_points_is_that_of_a_passive_body(points):
    np.testing.assert_array_equal(points.compliance, points.compliance.T)
    ends = np.linalg.eigvalsh(points.compliance)[[0, -1]]
    assert 0.0 < ends[0] and points.on == "points"


def test_forces_on_the_nodes_have_the_sum_and_the_moment_of_those_on_points(skin, points):
    force = np.random.default_rng(1).standard_normal((len(points.positions), 3))
    nodal = (points.nodal @ force.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(nodal.sum(axis=0), force.sum(axis=0), atol=1e-10)
    np.testing.assert_allclose(
        np.cross(skin.positions, nodal).sum(axis=0), np.cross(points.positions, force).sum(axis=0), atol=1e-12
    )


def test_points_are_kept_beside_the_skin_for_every_stiffness(monkeypatch, tmp_path, points):
    cache = Cache(tmp_path, 10**9)
    monkeypatch.setattr(press_points_module, "_kept", Recent(1))
    first = press_points(fingertip_skin(level="draft", cache=cache))
    monkeypatch.setattr(press_points_module, "_made", None)  # nobody makes them any more
    monkeypatch.setattr(press_points_module, "_kept", Recent(1))
    again = press_points(fingertip_skin(level="draft", cache=cache))
    for made in (first, points):
        for name in ("positions", "compliance", "nodal"):
            np.testing.assert_array_equal(getattr(again, name), getattr(made, name))
    stiffer = press_points(fingertip_skin(level="draft", cache=cache).with_material(alpha=2.0))
    np.testing.assert_allclose(stiffer.compliance, points.compliance / 2.0, rtol=1e-15)


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (-0.3, 0.1), (0.2, 0.3)])
def test_a_disc_presses_as_the_same_disc_is_touched(skin, pitch, roll):
    """The table's batch on its one set of points, against the path solver on the points that it chooses."""
    device = mechanism(Library().device("hexapod"))  # rigid legs: the pose is known
    depth = np.array([1.5e-3])
    poses = platform_poses(skin.positions, depth, *(np.array([v]) for v in (pitch, roll)), np.zeros((1, 2)), depth * 0)
    command = device.commands(poses)
    steps = 20
    found = Press(press_points(skin), device, 0.4, steps=steps).press(command).force[0]
    pad = smooth_pad(skin)
    nodes = NodalForces(skin.mesh, pad.chart)
    solver = PathSolver(PadPoints(pad, nodes))
    pose, disc = device.rest_poses(1), Disc(radius=device.disc_radius)
    for share in np.linspace(0.5, 1.0, 8 * steps):
        pose = device.carry(device.rest + share * (command - device.rest), pose)
        solved = solver.step([ContactBody(disc, pose.rotation[0] @ FLIP, pose.centre[0], 0.4)])
    touched = solver.nodal(solved.solution.force)
    total = np.linalg.norm(touched.sum(axis=0))
    np.testing.assert_allclose(found.sum(axis=0), touched.sum(axis=0), atol=LIKE * total)
    sensor = readings_of(skin)
    read, wanted = sensor.counts(found[None])[0] - sensor.rest, sensor.counts(touched[None])[0] - sensor.rest
    assert np.linalg.norm(read - wanted) < LIKE * np.linalg.norm(wanted)


def test_nodes_of_a_draft_skin_are_a_fifth_off(skin):
    """Why tables are not pressed on nodes, and what the finding says of one that was."""
    device, sensor = mechanism(Library().device("hexapod")), readings_of(skin)
    commands, _ = sweep(Library().device("hexapod"), skin.positions, 64)
    at_nodes = PressPoints(skin.positions, skin.compliance)
    on, off = (sensor.counts(Press(p, device, 0.4).press(commands).force) for p in (press_points(skin), at_nodes))
    assert 0.1 < np.linalg.norm(off - on) / np.linalg.norm(on - sensor.rest) < 0.3


def test_a_table_says_where_it_was_pressed_and_what_the_motors_cannot_reach(skin):
    spec = Library().device("cable_platform")
    table = build(spec, skin, readings_of(skin), 64)
    assert table.meta["pressed_on"] == "points" == press_of(skin, spec).points.on
    meta = table.meta  # corners of the grid are beyond the cables
    assert meta["asked"] == 64 and 0 < meta["unreached_rows"] < 8
    left_out = sum(meta[name] for name in ("unreached_rows", "rest_rows", "unbalanced_rows"))
    assert len(table.commands) - 1 == 64 - left_out


def test_rows_that_touch_nothing_are_pressed_alone_too(skin):
    device = mechanism(Library().device("cable_platform"))
    found = press_of(skin, Library().device("cable_platform")).press(np.tile(device.rest, (3, 1)))
    assert not found.touching.any() and not found.force.any()


def test_rows_are_what_they_are_in_any_company(skin):
    """A row is pressed on the points that its batch comes near: the answer is its own."""
    spec = Library().device("hexapod")
    press = press_of(skin, spec)
    commands, _ = sweep(spec, press.points.positions, 300)
    together = press.press(commands)
    for row in (7, 100, 222):
        alone = press.press(commands[row : row + 1])
        both = readings_of(skin).counts(np.stack([alone.force[0], together.force[row]]))
        assert np.abs(both[0] - both[1]).max() < 0.5, "counts"


@pytest.mark.parametrize("count", [0, 1, BATCH, 3 * BATCH + 5])
def test_batches_are_of_rows_that_are_near_each_other(count):
    """Every row is in one, and they lie closer than rows as they come."""
    where = np.random.default_rng(count).uniform(size=(count, 3))
    batches = _alike(np.arange(count), where)
    np.testing.assert_array_equal(np.sort(np.concatenate([np.zeros(0, int), *batches])), np.arange(count))
    assert all(len(rows) <= BATCH for rows in batches) and len(batches) == -(-count // BATCH)
    if len(batches) > 1:
        assert np.mean([np.ptp(where[rows], axis=0).prod() for rows in batches]) < 0.5


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_platforms_sweep_every_skin_that_ships():
    """Poses out of the motors' reach are left out: never so many that the table is refused. Points know no level."""
    library = Library()
    for entry in library.list("skins"):
        points = press_points(skin_from_parameters(library.skin(entry.key), level="draft"))
        assert points.on == "points", entry.key
        for device in ("cable_platform", "hexapod"):
            commands, unreached = sweep(library.device(device), points.positions, 729)
            assert len(commands) + unreached == 729 and unreached <= 0.1 * 729, (entry.key, device, unreached)


def test_a_platform_that_comes_off_again_is_no_row_without_balance(skin):
    """Tilted far, with one cable slack: taut, as it counts at first, it would let the platform press the skin, but the
    platform hangs 0.02 to 0.2 mm below it. Such rows were left out of tables, as their residual was relative to no
    force.
    """
    taut = np.array([0.01715603, 0.67178876, 2.03944991])
    rows = taut + np.linspace(-0.015, 0.015, 7)[:, None]
    press = press_of(skin, Library().device("cable_platform"))
    pressed = press.press(rows)
    gap = press.problem.gap(pressed.poses).min(axis=1)
    assert pressed.touching.tolist() == (gap < 0.0).tolist() == [False] * 5 + [True] * 2
    assert sound(pressed).all() and (pressed.residual[~pressed.touching] == 0.0).all()
    assert (pressed.residual[pressed.touching] > 0.0).all()
