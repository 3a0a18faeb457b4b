"""Walls that skin hangs on: what is looked for behind a rim, and not found, is nothing."""

from __future__ import annotations

import numpy as np

from core.contact.solver.bodies import BONE, ContactBody, node_gaps
from core.contact.solver.over_edges import over_rims
from core.surface.gap import Surface


def test_a_wall_with_nothing_behind_it_changes_no_gap_and_is_no_arithmetic_error():
    wall = Surface.build(
        np.array([[0.0, -0.05, -0.05], [0.0, 0.05, -0.05], [0.0, 0.05, 0.05], [0.0, -0.05, 0.05]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    points, places = np.array([[1e-3, 0.0, 0.0]]), np.array([[2e-3, 0.0, 0.0]])
    gaps = node_gaps(places, [ContactBody(wall)], 2.5e-3, BONE)
    drawn = gaps.__class__(**{**vars(gaps), "clearance": np.array([-1e-3])})
    with np.errstate(all="raise"):
        found = over_rims(drawn, points, places, np.array([[0.0, 0.0, 1.0]]), 0.1e-3, BONE)
    np.testing.assert_array_equal(found.gap, drawn.gap)
    np.testing.assert_array_equal(found.normal, drawn.normal)
