"""What is told of small balls that the skin can slide past, and what was measured of them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.stress.sharp import BACK, SHIFTED
from tests.stress.small import FRICTIONS, RUNS, STORED, Outcome, SmallTouch, draw, outcomes, table

pytestmark = pytest.mark.one_line("3.13", "stored figures; tests/unit/contact/solver runs on both lines")


@cache
def measured() -> tuple[Outcome, ...]:
    before = STORED.read_bytes()
    found = tuple(outcomes(STORED, RUNS))
    assert STORED.read_bytes() == before  # seeds draw what they drew
    return found


def test_none_that_is_pressed_less_deep_than_its_radius_is_told() -> None:
    assert len(measured()) == RUNS * len(FRICTIONS)
    assert min(o.deep for o in measured() if o.told) > 1.0


def test_of_those_not_told_three_miss_the_limit_by_less_than_a_percent() -> None:
    others = [o for o in measured() if not o.told]
    assert sum(o.beyond for o in others) == 3
    assert max(max(o.shifted, o.started) for o in others) < SHIFTED + 0.01 and max(o.back for o in others) < BACK


def test_the_page_has_the_table() -> None:
    page = Path(__file__).resolve().parents[3] / "presets" / "ACCURACY.md"
    assert table(list(measured())) in page.read_text(encoding="utf-8")


def test_a_ball_is_drawn_with_each_friction_and_begins_where_it_touches() -> None:
    one, other = (draw(friction, 3) for friction in FRICTIONS[:2])
    assert {name for name in one if one[name] != other[name]} == {"friction"}
    touch = SmallTouch(one)
    setup = touch.told(np.array([0.0, 0.0, 1e-6]))
    start = setup.bodies[0][1][0, :3, 3]
    np.testing.assert_allclose(start - touch.place, [0.0, 0.0, -0.3e-3 + 1e-6], atol=1e-12)
