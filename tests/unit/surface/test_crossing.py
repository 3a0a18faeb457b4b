"""Ways of pad nodes through thin things: against exact fractions, and against continuous collision detection.

The second judge is that of incremental potential contact: `pip install ipctk` lets it speak (development only).
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from core.arrays import Array, Indices
from core.skin.fingertip import fingertip_mesh
from core.surface import crossing
from core.surface.crossing import first_crossing
from core.surface.gap import Surface
from core.surface.triangles import TriangleTable
from tests.closest_points import closest

MOVED = 4e-3  # how far a pad moves and turns in a way, about [m]
SEEDS = range(3)
THIN = {"card of 0.1 mm": 1e-4, "foil of 1 um": 1e-6}
KEPT = 1e-3  # of its first distance, which the other judge keeps


def turned(rng):
    """A random turn, shape (3, 3)."""
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))


def ways(rng, count=60):
    """Starts and ends of the ways of some nodes of a pad that moves, turns and deforms, shape (count, 3) each [m]."""
    mesh = fingertip_mesh(level="draft")
    pad = rng.permutation(mesh.nodes[mesh.pad])[:count]
    small = turned(rng) * 0.1 + np.eye(3) * 0.9
    start = pad @ turned(rng).T + rng.uniform(-2e-3, 2e-3, 3)
    return start, start @ small.T + rng.normal(0.0, MOVED, 3) + rng.normal(0.0, 3e-4, pad.shape)


def thin_things(rng, kind, middles):
    """Vertices [m] and triangles: of a closed card amid places, or of slivers each about one of them."""
    if kind in THIN:
        block = Surface.block(0.014, 0.014, THIN[kind])
        return block.vertices @ turned(rng).T + middles.mean(axis=0), block.triangles
    along, across = rng.normal(0.0, 5e-3, (2, *middles.shape))
    across *= 10.0 ** rng.uniform(-5.0, 0.0, (len(middles), 1))
    corner = middles - 0.3 * (along + across)
    return np.stack([corner, corner + along, corner + across], axis=1).reshape(-1, 3), np.arange(
        3 * len(middles)
    ).reshape(-1, 3)


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def exact_crossing(start, end, corners, side):
    """How far along its way a point enters a triangle, as a fraction, or None."""
    a, b, c, p, q = ([Fraction(float(x)) for x in v] for v in (*corners, start, end))
    ab, ac, way, offset = ([y - x for x, y in zip(*pair, strict=True)] for pair in ((a, b), (a, c), (p, q), (a, p)))
    normal = cross(ab, ac)
    along = dot(way, normal)
    if side * along >= 0:
        return None
    t = -dot(offset, normal) / along
    turn = cross(offset, way)
    u, w = -dot(turn, ac) / along, dot(turn, ab) / along
    return t if 0 <= t <= 1 and u >= 0 and w >= 0 and u + w <= 1 else None


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("kind", [*THIN, "slivers"])
@pytest.mark.parametrize("side", [1, -1])
def test_ways_enter_what_they_enter_in_exact_fractions(kind, side):
    entered = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        start, end = ways(rng)
        vertices, triangles = thin_things(rng, kind, 0.5 * (start + end))
        found, share = first_crossing(TriangleTable.build(vertices, triangles), start, end, side)
        for i in range(len(start)):
            met = [exact_crossing(start[i], end[i], vertices[t], side) for t in triangles]
            first = min((t for t in met if t is not None), default=None)
            assert (found[i] >= 0) == (first is not None), (seed, i)
            if first is not None:
                entered += 1
                assert met[found[i]] is not None
                assert share[i] == pytest.approx(float(first), abs=1e-9)
    assert entered > 20


def test_no_way_slips_through_between_triangles():
    """Ways through edges and corners of a card that turns: at each there are several triangles, or none by rounding."""
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        block = Surface.block(0.014, 0.014, 1e-4)
        turn = turned(rng)
        vertices = block.vertices @ turn.T
        weights = rng.dirichlet(np.ones(2), 300)
        on_edge = np.einsum("nk,nkx->nx", weights, block.vertices[block.triangles[rng.integers(0, 12, 300)][:, :2]])
        on_edge[:50] = block.vertices[rng.integers(0, len(block.vertices), 50)]
        outwards = on_edge - block.vertices.mean(axis=0)
        start, end = (on_edge + 0.5 * outwards) @ turn.T, (on_edge - 0.5 * outwards) @ turn.T
        found, share = first_crossing(TriangleTable.build(vertices, block.triangles), start, end)
        assert (found >= 0).all()
        np.testing.assert_allclose(share, 0.5, atol=1e-6)


@pytest.mark.parametrize("kind", [*THIN, "slivers"])
def test_ways_meet_what_continuous_collision_detection_meets(kind):
    ipctk = pytest.importorskip("ipctk")
    judge = ipctk.TightInclusionCCD(tolerance=1e-6, conservative_rescaling=1.0 - KEPT)
    both = 0
    for seed in SEEDS:
        rng = np.random.default_rng(100 + seed)
        start, end = ways(rng)
        vertices, triangles = thin_things(rng, kind, 0.5 * (start + end))
        push = rng.normal(0.0, 1e-3, 3)  # the thing moves too: its own frame goes along
        table = TriangleTable.build(vertices, triangles)
        share = np.minimum(*(first_crossing(table, start, end - push, side)[1] for side in (1, -1)))
        hit = np.any([first_crossing(table, start, end - push, side)[0] >= 0 for side in (1, -1)], axis=0)
        for i in range(len(start)):
            times = [np.inf]
            for corners in 1e3 * vertices[triangles]:
                after = corners + 1e3 * push
                met, time = judge.point_triangle_ccd(1e3 * start[i], *corners, 1e3 * end[i], *after)
                times += [time] if met else []
            if hit[i]:
                assert min(times) <= share[i] + 1e-9, (seed, i)
                both += 1
            elif np.isfinite(times).any():  # it comes near and keeps some of its distance: that must be small
                assert nearest(table, start[i], end[i] - push) < 10 * KEPT * nearest(table, start[i], start[i])
    assert both > 40


def nearest(table, start, end):
    """How near a way comes to triangles [m]."""
    at = start + np.linspace(0.0, 1.0, 2001)[:, None] * (end - start)
    count = table.usable.size
    squared, _, _ = closest(table, np.repeat(at.T, count, axis=1), np.tile(np.arange(count), len(at)))
    return float(np.sqrt(squared.min()))


def test_lines_near_one_place_are_not_tested_against_all_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Groups of near lines and their own triangles: few pairs, and what each line alone finds, to the bit."""
    table, rng = Surface.sphere(6e-3, facets=20_000).table, np.random.default_rng(0)
    start = np.column_stack([rng.uniform(-5e-3, 5e-3, (2000, 2)), rng.uniform(0.0, 3e-3, 2000)])
    end = start - np.array([0.5e-3, 0.0, 8e-3])
    pairs, own = [], crossing._close

    def counted(start: Array, way: Array, middle: Array, radius: Array, front: Array) -> tuple[Indices, Indices]:
        pairs.append(len(start) * len(radius))
        return own(start, way, middle, radius, front)

    monkeypatch.setattr(crossing, "_close", counted)
    triangle, share = first_crossing(table, start, end)
    assert (triangle >= 0).mean() > 0.4 and sum(pairs) < 0.05 * len(start) * table.usable.sum()
    for k in range(0, 2000, 40):
        alone = first_crossing(table, start[k : k + 1], end[k : k + 1])
        assert (alone[0][0], alone[1][0]) == (triangle[k], share[k])
