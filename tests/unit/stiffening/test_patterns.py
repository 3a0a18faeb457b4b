"""Patterns between the places at which they are known."""

from __future__ import annotations

import numpy as np
import pytest

from core.skin.fingertip import fingertip_mesh
from core.stiffening.patterns import Patterns


def field(points: np.ndarray) -> np.ndarray:
    """Return two patterns that change over some 15 mm, shape (n, 3, 2)."""
    x, y, z = 1e3 * points.T
    one = np.stack([np.sin(0.4 * x), np.cos(0.3 * y + 1.0), np.sin(0.3 * z + 0.2 * x)], axis=1)
    return np.stack([one, np.cos(0.4 * points * 1e3)], axis=2)


def known(level: str) -> Patterns:
    mesh = fingertip_mesh(level=level)
    places = mesh.nodes[np.unique(mesh.surface)]
    return Patterns.through(places, field(places))


@pytest.fixture(scope="module")
def fine() -> np.ndarray:
    mesh = fingertip_mesh(level="fine")
    places = mesh.nodes[mesh.pad]
    far = np.linalg.norm(places, axis=1)
    return np.asarray(places[far <= np.median(far)])  # where skin is touched: towards the cut end meshes are coarse


def error(patterns: Patterns, places: np.ndarray) -> float:
    wanted = field(places)
    return float(np.linalg.norm(patterns.at(places) - wanted) / np.linalg.norm(wanted))


def test_where_they_are_known_they_are_that() -> None:
    patterns = known("standard")
    assert patterns.count == 2 and error(patterns, patterns.centres) <= 1e-4


def test_between_they_are_smooth_and_the_closer_the_better(fine: np.ndarray) -> None:
    coarse, better = error(known("draft"), fine), error(known("standard"), fine)
    assert better <= 0.02 and better <= 0.5 * coarse


def test_a_point_asks_for_what_many_ask_for(fine: np.ndarray) -> None:
    patterns = known("draft")
    np.testing.assert_allclose(patterns.at(fine[:1]), patterns.at(fine)[:1], atol=1e-4)
    assert patterns.at(fine[:0]).shape == (0, 3, 2)
