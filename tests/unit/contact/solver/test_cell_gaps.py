"""The gap over whole cells: where a surface turns between two of them, and nowhere else."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.contact.solver.bodies import BONE, ContactBody, node_gaps
from core.contact.solver.cell_gaps import CellGaps
from core.contact.solver.point_set import NONE
from core.surface.gap import Surface

SIDE = 0.2e-3
BESIDE = np.array([[NONE, NONE, NONE, 1], [NONE, NONE, 0, NONE]])
SIDES = np.tile([[0.0, 4 * SIDE, 0.0], [SIDE, 0.0, 0.0]], (2, 1, 1))


class Cells(NamedTuple):
    """What is asked of points."""

    positions: np.ndarray
    sides: np.ndarray
    beside: np.ndarray


def row(surface, spread, height):
    """Return gaps of two cells beside each other, which lie astride x = 0, of their centres and over the cells."""
    points = np.array([[-0.5 * SIDE, 0.0, 0.0], [0.5 * SIDE, 0.0, 0.0]])
    places = points * [spread, 1.0, 1.0] + [0.0, 0.0, height]
    body = ContactBody(surface, friction=0.0)
    gaps = node_gaps(places, [body], 2.5e-3, BONE)
    gaps.gap[:] = gaps.clearance - np.einsum("ij,ij->i", places - points, gaps.normal)
    return gaps, CellGaps(2.5e-3, BONE).over(gaps, Cells(points, SIDES, BESIDE), places)


def test_what_does_not_turn_is_touched_by_centres():
    for surface in (Surface.block(), Surface.sphere(2e-3, 20_000)):
        gaps, same = row(surface, 1.0, 0.02e-3)
        assert same is gaps


def test_an_edge_between_two_cells_keeps_both_off():
    """Centres lie on the faces while the edge stands between them; they keep off by the mean along each cell."""
    surface = Surface.edge(np.pi / 3, 0.2e-3)
    spread, height = 4.0, -0.37e-3
    gaps, over = row(surface, spread, height)
    np.testing.assert_array_equal(over.normal, gaps.normal)
    assert (over.clearance < gaps.clearance - 5e-6).all()
    np.testing.assert_allclose(over.clearance - gaps.clearance, over.gap - gaps.gap, atol=1e-15)
    assert over.clearance[0] == pytest.approx(over.clearance[1], abs=1e-7)


def test_the_two_sides_of_something_thin_are_left_alone():
    gaps, same = row(Surface.block(0.05e-3, 0.02, 0.02), 6.0, -1e-3)
    assert gaps.normal[0] @ gaps.normal[1] == pytest.approx(-1.0)
    assert same is gaps
