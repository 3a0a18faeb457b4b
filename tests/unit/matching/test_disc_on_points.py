"""The thimble presses as touches are felt: its disc on points, against the path solver on points of its choice."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.pad_points import PadPoints
from core.contact.solver.path_solver import PathSolver
from core.devices.disc import DiscContact
from core.devices.disc_pose import Disc, FrictionState, placed
from core.devices.press_problem import PressPoints
from core.devices.thimble import mechanism
from core.matching.description import observation_of
from core.matching.thimble import follower
from core.matching.thimble_use import prepare
from core.presets import Library
from core.skin.model import fingertip_skin
from core.skin.nodal_forces import NodalForces
from core.skin.point_forces import PointForces
from core.skin.stimulus import Stimulus
from core.skin.surface_store import smooth_pad
from core.surrogate.press_points import point_forces, press_points
from core.surrogate.store import contact_of
from tests.thimbles import match_sequence
from tests.touches import ball_roll

FRICTION = 0.6
FORCE, STRESS = 0.02, 0.03  # of the touch, over a path: parts of 1.6 mm against 0.8 mm
AT_NODES = {"draft": (0.25, 0.32), "standard": (0.11, 0.16)}  # what it was: of the same touch's stress
LEFT, TILT, DEPTH = 0.025, 0.15, 20e-6  # [1, deg, m] of the stress, and how near the pose is found again: medians
FELT = 0.1  # [N] of a touch that counts


@pytest.fixture(scope="module")
def device():
    return mechanism(Library().device("thimble_3rrs"))


@pytest.fixture(scope="module", params=["draft", "standard"])
def skin(request):
    return fingertip_skin(level=request.param)


def path(count=60):
    """Poses that press up to 3 N, tilt both ways, and leave."""
    t = np.linspace(0, 1, count)
    depth = 1.4e-3 * np.sin(np.pi * t) - 0.1e-3
    return np.stack([0.25 * np.sin(6 * t), 0.2 * np.sin(9 * t + 0.4), 0.018 - depth], axis=1)


def touched(skin, device):
    """Forces on the nodes of a skin that the disc is solved on as an object is, and where they act."""
    pad, disc = smooth_pad(skin), Disc(radius=device.disc_radius)
    solver, out = PathSolver(PadPoints(pad, NodalForces(skin.mesh, pad.chart))), []
    for x in path():
        step = solver.step([disc.body(placed(device, device.pose(x)), FRICTION)])
        out.append((step.nodal, PointForces(pad, solver.cells, step.solution.force)))
    return np.array([nodal for nodal, _ in out]), [points for _, points in out]


def pressed(contact, device):
    state, out = FrictionState.rest(contact.count), []
    for x in path():
        contact.hold(state)
        out.append(contact.solve(placed(device, device.pose(x))))
        assert out[-1].converged
        state = contact.settle(out[-1])
    return out


def off(ours, theirs):
    return float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs))


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_disc_presses_as_the_same_disc_is_touched(skin, device):
    target, points = touched(skin, device)
    contact = contact_of(device, skin, FRICTION)
    solutions = pressed(contact, device)
    found = np.array([contact.nodal(s) for s in solutions])
    assert contact.points.on == "points" and np.linalg.norm(target.sum(axis=1), axis=1).max() > 2.0
    assert off(found.sum(axis=1), target.sum(axis=1)) < FORCE
    observed = observation_of(device, skin, FRICTION)
    ours, theirs = (f.reshape(len(f), -1) @ observed.T for f in (found, target))
    assert off(ours, theirs) < STRESS
    at_nodes = DiscContact(PressPoints(skin.positions, skin.compliance), contact.disc, FRICTION)
    before = np.array([at_nodes.nodal(s) for s in pressed(at_nodes, device)])
    low, high = AT_NODES["draft" if skin.pad_count < 100 else "standard"]
    assert low < off(before.reshape(len(before), -1) @ observed.T, theirs) < high
    # and where stress is read beneath the points themselves
    k = int(np.linalg.norm(target.sum(axis=1), axis=1).argmax())
    beneath = point_forces(skin, solutions[k].spread(contact.count))
    assert beneath is not None
    np.testing.assert_allclose(beneath.force.sum(axis=0), target[k].sum(axis=0), atol=FORCE * np.abs(target[k].sum()))
    mine, wanted = (Stimulus(skin, f, p).probe_stress for f, p in ((found[k], beneath), (target[k], points[k])))
    assert off(mine, wanted) < 0.2  # 0.3 mm deep the parts themselves show


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_the_pose_is_found_that_made_a_touch(skin, device):
    """Touched by the very disc, the finger is matched nearly to nothing: what is left is that of 1.6 mm parts."""
    target, _ = touched(skin, device)
    found = match_sequence(device, skin, target)
    felt = np.linalg.norm(target.sum(axis=1), axis=1) > FELT
    assert np.median(found.mismatch[felt]) < LEFT
    apart = np.abs(found.x - path())[felt]
    assert np.degrees(np.median(apart[:, :2])) < TILT and np.median(apart[:, 2]) < DEPTH


def test_skin_of_another_stiffness_is_pressed_alike(device):
    skin = fingertip_skin(level="draft")
    soft, hard = press_points(skin), press_points(skin.with_material(alpha=2.0))
    np.testing.assert_allclose(soft.compliance, 2.0 * hard.compliance, rtol=1e-9)


def test_a_skin_on_nodes_is_pressed_there(device):
    """What was touched at nodes is followed there: both sides are alike again."""
    skin = fingertip_skin(level="draft").on_nodes
    contact = contact_of(device, skin, FRICTION)
    assert contact.points.on == "nodes" and contact.count == skin.pad_count
    assert skin.key == fingertip_skin(level="draft").key
    assert point_forces(skin, np.zeros((contact.count, 3))) is None


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_the_same_touch_gives_the_same_bytes_whatever_was_solved_before(device):
    """The first to follow a touch makes the table that searches start from; a preview takes steps back."""
    skin = fingertip_skin(level="draft")
    forces = ball_roll(40).forces(skin, points=True)
    use = prepare(Library().device("thimble_3rrs"), skin, {"thimble_method": "force"})
    first, again = follower(use), follower(use)
    whole = first.follow(forces)
    first.matching.reset()
    for other in (again.follow(forces), first.follow(forces)):
        assert other.x.tobytes() == whole.x.tobytes() and other.force.tobytes() == whole.force.tobytes()
    again.matching.reset()
    for target, x in zip(forces, whole.x, strict=True):
        before = again.matching.save()
        again.step(forces[20])  # somewhere else
        again.matching.restore(before)
        np.testing.assert_array_equal(again.step(target).x, x)
