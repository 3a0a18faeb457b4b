"""How far surfaces stay flat: over the diagonals of quads, and no farther than their rims."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.flatness import flat_reach
from core.surface.gap import Surface


def reach(surface, point):
    found = surface.query(np.array([point]))
    return flat_reach(surface, found.triangle, found.point)[0]


@pytest.mark.parametrize("point", [(0.0, 0.0, 1e-3), (3e-3, 1e-3, 1e-3), (1e-3, 3e-3, 1e-3), (-4e-3, -4.1e-3, 1e-3)])
def test_a_block_is_flat_to_its_rim(point):
    rim = 5e-3 - max(abs(point[0]), abs(point[1]))
    assert reach(Surface.block(0.01, 0.01, 0.01), point) == pytest.approx(rim, abs=1e-12)


def test_a_ball_is_flat_within_its_triangles_only():
    ball = Surface.sphere(5e-3, 5000)
    assert reach(ball, (1e-4, 1e-4, 1e-3)) < 0.2e-3
