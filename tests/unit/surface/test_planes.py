"""How far surfaces stay flat: over the diagonals of quads, and no farther than their rims."""

from __future__ import annotations

import numpy as np
import pytest

from core.surface import shapes
from core.surface.gap import Surface
from core.surface.planes import MOST


def reach(surface: Surface, point: tuple[float, float, float]) -> float:
    found = surface.query(np.array([point]))
    return surface.planes.rim(found.triangle, found.point)[0]


@pytest.mark.parametrize("point", [(0.0, 0.0, 1e-3), (3e-3, 1e-3, 1e-3), (1e-3, 3e-3, 1e-3), (-4e-3, -4.1e-3, 1e-3)])
def test_a_block_is_flat_to_its_rim(point: tuple[float, float, float]) -> None:
    rim = 5e-3 - max(abs(point[0]), abs(point[1]))
    assert reach(Surface.block(0.01, 0.01, 0.01), point) == pytest.approx(rim, abs=1e-12)


def test_a_ball_is_flat_within_its_triangles_only() -> None:
    ball = Surface.sphere(5e-3, 5000)
    assert reach(ball, (1e-4, 1e-4, 1e-3)) < 0.2e-3


def test_how_a_face_is_cut_does_not_matter() -> None:
    """A block whose triangles are cut into three, thrice, has the planes of a block, and their rims are as far."""
    vertices, triangles = shapes.block(0.01, 0.01, 0.01)
    rng = np.random.default_rng(1)
    for _ in range(3):
        within = np.einsum("tk,tkd->td", rng.dirichlet(np.full(3, 4.0), len(triangles)), vertices[triangles])
        middle = np.arange(len(triangles)) + len(vertices)
        vertices = np.concatenate([vertices, within])
        around = [np.stack([triangles[:, k], triangles[:, k - 2], middle], axis=1) for k in range(3)]
        triangles = np.concatenate(around)
    cut, whole = Surface.build(vertices, triangles), Surface.block(0.01, 0.01, 0.01)
    assert cut.planes.plane.max() == whole.planes.plane.max() == 5
    for x, y in rng.uniform(-4.9e-3, 4.9e-3, (50, 2)):
        assert reach(cut, (x, y, 1e-4)) == pytest.approx(reach(whole, (x, y, 1e-4)), abs=1e-15)


def test_a_plane_ends_where_the_surface_does() -> None:
    """An open sheet of two triangles: to its border, not to the edge between them."""
    sheet = Surface.build(
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * 0.01, np.array([[0, 1, 2], [0, 2, 3]])
    )
    assert reach(sheet, (5e-3, 5e-3, 1e-3)) == pytest.approx(5e-3)


def test_level_step_by_step_is_not_level() -> None:
    """A cylinder of so many facets that each lies level with the next: none is taken for flat farther than it is."""
    around = np.linspace(0.0, np.pi, 80_000)
    rows = np.stack([np.cos(around), 0.0 * around, np.sin(around)], axis=1) * 5e-3
    vertices = np.concatenate([rows, rows + [0.0, 1e-3, 0.0]])
    a = np.arange(len(around) - 1)
    b = a + len(around)
    sheet = Surface.build(vertices, np.concatenate([np.stack([a, a + 1, b], 1), np.stack([a + 1, b + 1, b], 1)]))
    assert reach(sheet, (0.0, 0.5e-3, 6e-3)) < 1e-6


def test_a_rim_of_very_many_edges_is_measured_to_triangle_by_triangle() -> None:
    around = np.linspace(0.0, 2 * np.pi, MOST + 2)[:-1]
    rim = np.stack([np.cos(around), np.sin(around), 0.0 * around], axis=1) * 5e-3
    a = np.arange(len(rim))
    fan = np.stack([np.full(len(rim), len(rim)), a, np.roll(a, -1)], axis=1)
    disc = Surface.build(np.concatenate([rim, np.zeros((1, 3))]), fan)
    assert disc.planes.plane.max() == len(fan) - 1
    assert reach(disc, (2.5e-3, 1e-5, 1e-3)) < 0.1e-3
