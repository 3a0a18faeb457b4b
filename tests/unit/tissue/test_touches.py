"""Touches drawn by chance: the same each time, within their ranges, and dragged across the pad where that is asked."""

from __future__ import annotations

import numpy as np
import pytest

from core.skin.model import SkinModel, fingertip_skin
from core.tissue.touches import DEPTHS, FRICTIONS, PRESSES, SLIDE, SLIDES, Touch, touches


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip_skin(level="draft")


def drag_of(touch: Touch) -> np.ndarray:
    """Return the way of a touch after it was pressed [m]."""
    return np.asarray(touch.ways[-1] - touch.ways[PRESSES - 1])


def test_the_same_seed_draws_the_same_touches(skin: SkinModel) -> None:
    once, again, other = touches(skin, 6, 3), touches(skin, 6, 3), touches(skin, 6, 4)
    for a, b in zip(once, again, strict=True):
        assert np.array_equal(a.start, b.start) and np.array_equal(a.ways, b.ways) and a.friction == b.friction
    assert any(not np.array_equal(a.start, b.start) for a, b in zip(once, other, strict=True))
    # of more, the first are the same
    assert all(np.array_equal(a.ways, b.ways) for a, b in zip(once, touches(skin, 9, 3), strict=False))


def test_depths_slides_and_friction_lie_in_their_ranges(skin: SkinModel) -> None:
    drawn = touches(skin, 40, 1)
    for touch in drawn:
        depth = touch.ways[PRESSES - 1] @ touch.rotation[:, 2]
        assert DEPTHS[0] <= depth <= DEPTHS[1] and touch.friction in FRICTIONS
        if len(touch.ways) == PRESSES:
            continue
        drag = drag_of(touch)
        assert np.linalg.norm(drag) <= SLIDE and len(touch.ways) == PRESSES + SLIDES and touch.friction > 0.0
        assert abs(drag @ touch.rotation[:, 2]) < 1e-12, "as deep all the way"
    assert any(len(touch.ways) == PRESSES for touch in drawn), "without friction nothing is dragged"
    assert any(len(touch.ways) > PRESSES for touch in drawn)
