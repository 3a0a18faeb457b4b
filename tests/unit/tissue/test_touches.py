"""Touches drawn by chance: the same each time, within their ranges, and dragged across the pad where that is asked."""

from __future__ import annotations

import numpy as np
import pytest

from core.skin.model import SkinModel, fingertip_skin
from core.tissue.touches import PRESSES, SLIDES, Ranges, Touch, touches

LONG = Ranges(depths=(1.5e-3, 2.0e-3), slides=(4e-3, 6e-3), frictions=(0.6,), back=0.4)


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
    for touch in touches(skin, 40, 1, LONG):
        depth, drag = touch.ways[PRESSES - 1] @ touch.rotation[:, 2], drag_of(touch)
        assert 1.5e-3 <= depth <= 2.0e-3
        assert 4e-3 <= np.linalg.norm(drag) <= 6e-3 and len(touch.ways) == PRESSES + SLIDES
        assert abs(drag @ touch.rotation[:, 2]) < 1e-12, "as deep all the way"
        assert touch.friction == 0.6
    assert any(len(touch.ways) == PRESSES for touch in touches(skin, 40, 1)), "without friction nothing is dragged"


def test_a_drag_begins_before_the_place_that_it_would_begin_at(skin: SkinModel) -> None:
    """So that its middle lies about as far from the pad's lowest point as other touches' beginnings."""
    lowest = skin.positions[skin.positions[:, 2].argmin()][:2]

    def off(back: float) -> tuple[float, float]:
        drawn = touches(skin, 60, 2, Ranges(slides=(6e-3, 6e-3), frictions=(0.6,), back=back))
        middles = [t.start[:2] + 0.5 * drag_of(t)[:2] - lowest for t in drawn]
        ends = [t.start[:2] + drag_of(t)[:2] - lowest for t in drawn]
        return tuple(float(np.median(np.linalg.norm(places, axis=1))) for places in (middles, ends))  # type: ignore[return-value]

    (middle, end), (plain_middle, plain_end) = off(0.5), off(0.0)
    assert middle < plain_middle and end < plain_end
