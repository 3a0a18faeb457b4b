"""The pad's centre on thin things: the side that it came from, however deep, and no longer than it lasts."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.pad_proxy import PadProxy
from core.surface.gap import Surface

UP = np.array([0.0, 0.0, 1.0])
DEEPEST = 6e-3


def followed(surface: Surface, points: np.ndarray, parts: int = 1):
    """Gap, normal and closest point along a way, in chunks, as `PadSampler` asks for them."""
    proxy, answers = PadProxy(DEEPEST), []
    for k, part in enumerate(np.array_split(points, parts)):
        found = surface.query(part)
        which = np.arange(len(part))
        if k == 0:
            proxy.start(surface, found, 0, part[0], UP)
            which = which[1:]
        if which.size:
            proxy.follow(surface, found, which, part, np.tile(UP, (len(which), 1)))
        answers.append(found)
    return tuple(np.concatenate([getattr(a, name) for a in answers]) for name in ("gap", "normal", "point"))


def down(depths, x=0.0, y=0.0):
    """A way straight down onto a top at height zero."""
    return np.column_stack([np.full(len(depths), x), np.full(len(depths), y), -np.asarray(depths)])


@pytest.mark.parametrize("thickness", [2e-3, 0.5e-3, 0.05e-3])
@pytest.mark.parametrize("step", [0.03e-3, 0.7e-3])
def test_a_card_is_as_deep_as_a_block(thickness, step):
    """There and back again: the gap is the height over the top, though the back face is nearer for most of it."""
    depths = np.concatenate([np.arange(-2e-3, 3e-3, step), np.arange(3e-3, -2e-3, -step)])
    gap, normal, point = followed(Surface.block(0.04, 0.04, thickness), down(depths, 1.3e-3, 0.4e-3))
    np.testing.assert_allclose(gap, -depths, atol=1e-9)
    np.testing.assert_allclose(normal, np.tile(UP, (len(depths), 1)), atol=1e-8)
    np.testing.assert_allclose(point, down(np.zeros(len(depths)), 1.3e-3, 0.4e-3), atol=1e-9)


def test_a_slide_at_depth_stays_on_top():
    x = np.linspace(-8e-3, 8e-3, 200)
    points = np.vstack([down(np.linspace(-1e-3, 1.4e-3, 20), x[0]), np.column_stack([x, 0 * x, 0 * x - 1.4e-3])])
    gap, normal, point = followed(Surface.block(0.02, 0.02, 1e-3), points)
    np.testing.assert_allclose(gap[20:], -1.4e-3, atol=1e-9)
    np.testing.assert_allclose(point[20:, 0], x, atol=1e-9)


def test_over_the_rim_it_is_let_go():
    """Beside a card nothing is touched, however low the centre is; and from below it is the back that is touched."""
    x = np.linspace(0.0, 14e-3, 400)
    points = np.vstack([down(np.linspace(-1e-3, 1.4e-3, 20)), np.column_stack([x, 0 * x, 0 * x - 1.4e-3])])
    gap, _, _ = followed(Surface.block(0.02, 0.02, 1e-3), points)
    off = x > 10.5e-3
    assert (gap[20:][x < 9.9e-3] < -1.39e-3).all() and (gap[20:][off] > 0.0).all()


def test_a_bowl_thinner_than_the_touch_is_felt_as_a_ball():
    """A shell of 0.3 mm, 8 mm in radius: the centre slides round it 0.8 mm deep."""
    outer, inner = Surface.sphere(8e-3, 20_000), Surface.sphere(7.7e-3, 20_000)
    shift = np.array([0.0, 0.0, -8e-3])  # both about the same centre
    vertices = np.vstack([outer.vertices - shift, inner.vertices - [0.0, 0.0, -7.7e-3]])
    shell = Surface.build(vertices, np.vstack([outer.triangles, inner.triangles[:, ::-1] + len(outer.vertices)]))
    angle = np.concatenate([np.zeros(15), np.linspace(0.0, 1.2, 200)])
    radius = np.concatenate([np.linspace(9e-3, 7.2e-3, 15), np.full(200, 7.2e-3)])
    points = np.column_stack([radius * np.sin(angle), 0 * angle, radius * np.cos(angle)])
    gap, normal, _ = followed(shell, points)
    np.testing.assert_allclose(gap[15:], -0.8e-3, rtol=0.03)
    assert (np.einsum("ij,ij->i", normal[15:], points[15:] / 7.2e-3) > 0.99).all()


def test_chunks_do_not_matter():
    depths = np.concatenate([np.linspace(-1e-3, 2e-3, 50), np.linspace(2e-3, -1e-3, 50)])
    whole, *_ = followed(Surface.block(0.04, 0.04, 1e-3), down(depths))
    for parts in (2, 7, 100):
        np.testing.assert_array_equal(followed(Surface.block(0.04, 0.04, 1e-3), down(depths), parts)[0], whole)


def test_a_start_inside_came_from_the_nail():
    gap, normal, _ = followed(Surface.block(0.04, 0.04, 1e-3), down([0.8e-3, 0.9e-3, 0.2e-3]))
    np.testing.assert_allclose(gap, [-0.8e-3, -0.9e-3, -0.2e-3], atol=1e-9)
    np.testing.assert_allclose(normal, np.tile(UP, (3, 1)), atol=1e-9)


def test_what_went_past_the_bone_is_let_go():
    gap, _, _ = followed(Surface.block(0.04, 0.04, 1e-3), down(np.linspace(-1e-3, 9e-3, 101)))
    assert gap.min() == pytest.approx(-DEEPEST, abs=0.2e-3) and gap[-1] == pytest.approx(8e-3)


def test_thick_things_are_left_as_they_are():
    """Where the nearest face is on the side of the way in, nothing changes."""
    ball = Surface.sphere(6e-3, 5000)
    points = down(np.linspace(-2e-3, 5.5e-3, 80), 0.2e-3)
    np.testing.assert_array_equal(followed(ball, points)[0], ball.query(points).gap)
    block, around = Surface.block(0.02, 0.02, 0.02), np.linspace(0.0, 3.0, 300)
    points = np.column_stack([10.5e-3 + 1e-3 * np.sin(around), 0 * around, 0.5e-3 + 1e-3 * np.cos(around)])
    np.testing.assert_array_equal(followed(block, points)[0], block.query(points).gap)


@pytest.mark.parametrize("parts", [1, 7])
def test_a_centre_that_came_in_through_a_wall_lies_on_the_top(parts):
    """A finger slides over the edge of a table, a millimetre lower than its top: it is not as deep as it has gone."""
    x = np.linspace(-0.03, 0.0, 61)
    way = np.column_stack([x, np.zeros_like(x), np.full_like(x, -1e-3)])
    gap, normal, _ = followed(Surface.block(0.02, 0.04, 0.02), way, parts)
    inside = x > -0.01 + 1.2e-3  # from where the top is nearer than the wall
    np.testing.assert_allclose(gap[inside], -1e-3, atol=1e-9)
    np.testing.assert_allclose(normal[inside], np.tile(UP, (inside.sum(), 1)), atol=1e-8)
    assert (gap >= -1e-3 - 1e-9).all()
