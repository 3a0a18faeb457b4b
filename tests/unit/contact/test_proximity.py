"""Bounds of gaps: never above the truth, and good enough to leave bodies alone."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.proximity import Proximity, RelativePoses
from core.contact.solver.bodies import ContactBody, least_gaps
from core.surface.gap import Surface

BONE = np.array([0.0, 0.0, 0.006])
REACH = 2.5e-3


def turns(axis, angles):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angles)[:, None, None] * k + (1 - np.cos(angles))[:, None, None] * (k @ k)


@pytest.mark.parametrize(
    "stretch", [np.eye(3), np.diag([1.0, 1.4, 0.7]), np.array([[1.0, 0.3, 0], [0, 1, 0], [0, 0, 1]])]
)
def test_a_bound_is_never_above_the_gap(skin, stretch):
    """However the body turns, moves and is stretched; and where it keeps its shape, however large it is."""
    n = 60
    t = np.linspace(0.0, 1.0, n)
    surface = Surface.block(0.3, 0.3, 0.01)
    place = np.column_stack([0.004 * t, -0.003 * np.sin(5 * t), -0.004 - 0.003 * np.cos(7 * t)])
    poses = RelativePoses(turns([1, 2, 3], 0.15 * np.sin(6 * t)) @ stretch, place)
    proximity, mesh = Proximity(skin.positions, BONE), surface.mesh
    carried = Surface.build(surface.vertices @ stretch.T, surface.triangles)

    def body(i):
        return ContactBody(carried, poses.linear[i] @ np.linalg.inv(stretch), poses.place[i])

    true = np.array([least_gaps(skin.positions, [body(i)], np.inf, BONE).min() for i in range(n)])
    seen = {0: poses}
    assert (proximity.gaps(0, 0, seen, mesh) == -np.inf).all()
    measured = proximity.measure(0, 20, seen, mesh, body(20)).min()
    assert measured <= true[20] + 1e-12
    bounds = np.array([proximity.gaps(0, i, seen, mesh).min() for i in range(n)])
    assert (bounds <= true + 1e-12).all() and bounds[20] == measured
    # a plate of 30 cm that turns a little under a still finger is not as far away as its corners move
    assert np.abs(true - bounds)[15:26].max() < 4e-3
    assert (proximity.gaps(0, 20, seen, Surface.sphere(0.01).mesh) == -np.inf).all()  # another surface: not known


def test_a_gap_within_reach_is_exact(skin):
    surface = Surface.sphere(5e-3, 500)
    poses = RelativePoses(np.eye(3)[None], np.array([[0.0, 0.0, skin.positions[:, 2].min() - 1e-3]]))
    body = ContactBody(surface, translation=poses.place[0])
    exact = least_gaps(skin.positions, [body], np.inf, BONE).min()
    assert 1e-3 < exact < REACH
    gaps = Proximity(skin.positions, BONE).measure(0, 0, {0: poses}, surface.mesh, body)
    assert gaps.min() == pytest.approx(exact)


def test_a_surface_that_deforms_is_as_far_as_its_vertices_came_nearer(skin):
    """And groups of nodes are told apart: a ball beside the finger is near some of them only."""
    surface = Surface.sphere(5e-3, 500)
    low, high = skin.positions.min(axis=0), skin.positions.max(axis=0)
    place = np.array([[high[0] + 7e-3, 0.0, (low[2] + high[2]) / 2 + 5e-3]] * 2)
    poses = {0: RelativePoses(np.array([np.eye(3)] * 2), place)}
    proximity = Proximity(skin.positions, BONE)
    before = proximity.measure(0, 0, poses, surface.mesh, ContactBody(surface, translation=place[0]))
    assert before.min() > 1e-3 and before.max() > before.min() + 5e-3
    swollen = Surface.build(surface.vertices * [1.1, 1.0, 1.05], surface.triangles)
    after = proximity.gaps(0, 1, poses, swollen.mesh)
    body = ContactBody(swollen, translation=place[1])
    assert 0.0 < after.min() <= least_gaps(skin.positions, [body], np.inf, BONE).min()
    reach = proximity.grouped(np.where(skin.positions[:, 0] < 0.0, 2e-3, 0.0))
    assert (after > reach).all() and not (after > 2e-3).all()


def test_what_is_far_is_told_by_few_points(skin, monkeypatch):
    asked = []
    real = Surface.kernel_body_for
    monkeypatch.setattr(Surface, "kernel_body_for", lambda self, count: asked.append(count) or real(self, count))
    surface = Surface.sphere(5e-3, 500)
    poses = RelativePoses(np.eye(3)[None], np.array([[0.0, 0.0, -0.03]]))
    gap = Proximity(skin.positions, BONE).measure(
        0, 0, {0: poses}, surface.mesh, ContactBody(surface, translation=poses.place[0])
    )
    assert gap.min() > 0.02 and asked == [32]
