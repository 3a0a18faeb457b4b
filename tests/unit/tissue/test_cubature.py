"""Elements that stand for all: positive weights, and sums of few kinds are kept by few elements."""

from __future__ import annotations

import numpy as np

from core.tissue.cubature import sampled


def _rows(kinds: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    return (rng.standard_normal((120, kinds)) @ rng.uniform(0.0, 1.0, (kinds, 400))).astype(np.float32)


def test_sums_of_few_kinds_are_kept_by_few_elements() -> None:
    elements, share, left = sampled(_rows(8), 40)
    assert len(elements) <= 40
    assert (np.diff(elements) > 0).all()
    assert share.min() > 0.0
    assert left < 1e-3
    # what stands for all stands for four hundred
    assert 0.5 < share.sum() / 400.0 < 2.0


def test_more_elements_leave_less() -> None:
    rows = _rows(100)
    left = [sampled(rows, count)[2] for count in (10, 30, 90)]
    assert left[0] > 1.5 * left[1] > 2.0 * left[2]


def test_what_is_left_is_what_the_sums_miss() -> None:
    rows = _rows(100)
    elements, share, left = sampled(rows, 30)
    whole = rows.astype(float).sum(axis=1)
    missed = rows[:, elements].astype(float) @ share - whole
    np.testing.assert_allclose(left, np.linalg.norm(missed) / np.linalg.norm(whole), rtol=1e-6)
