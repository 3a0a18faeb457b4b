"""What a guess of the active bounds holds of H, against H itself."""

from __future__ import annotations

import numpy as np
import pytest

from core.errors import DermisError
from core.matching.active_bounds import ActiveBounds, Box

H = np.cov(np.random.default_rng(1).normal(size=(5, 40)))
STATUS = np.array([0, -1, 1, 0, 1], dtype=np.int8)


@pytest.mark.parametrize("high", [2.0, np.arange(2.0, 7.0)])
def test_it_holds_its_share_of_h_and_of_the_bounds(high):
    guess = ActiveBounds.of(H, STATUS, Box(-1.0, high, 5))
    tops = np.broadcast_to(high, 5)
    np.testing.assert_array_equal(guess.free, [0, 3])
    np.testing.assert_array_equal(guess.block, H[np.ix_([0, 3], [0, 3])])
    np.testing.assert_array_equal(guess.columns, H[:, [0, 3]])
    np.testing.assert_array_equal(guess.fixed, [0.0, -1.0, tops[2], 0.0, tops[4]])
    np.testing.assert_array_equal(guess.sign, [0.0, 1.0, -1.0, 0.0, -1.0])
    assert guess.beyond(np.array([-1.5, 1.0])) == (0.5, max(-1.5 - tops[0], 1.0 - tops[3]))
    assert guess.beyond(np.array([0.0, 7.0])) == (-1.0, 7.0 - tops[3])


def test_its_inverse_is_kept_where_it_is_well_conditioned():
    for h, kept in ((H, True), (np.diag([1.0, 1.0, 1.0, 1e-6, 1.0]), False)):
        guess = ActiveBounds.of(h, STATUS, Box(-1.0, 2.0, 5))
        base = h @ guess.fixed
        guess.base = base, base[guess.free]
        inverse = np.linalg.inv(guess.block)
        guess.invert(np.triu(inverse))
        assert (guess.inverse is not None) is kept
        if kept:
            np.testing.assert_allclose(guess.inverse, inverse, rtol=1e-12)
            np.testing.assert_allclose(guess.offset, -inverse @ base[guess.free], rtol=1e-12)


def test_a_box_says_whether_all_have_the_same_bounds():
    assert Box(0.0, 0.4, 3).uniform == (0.0, 0.4) and Box(0.0, [0.4, 0.4, 0.5], 3).uniform is None
    assert Box(-3.0, [0.4, 0.4, 0.5], 3).span == 3.0 and Box([], [], 0).uniform is None
    with pytest.raises(DermisError, match="crossed"):
        Box(1.0, 0.0, 3)
