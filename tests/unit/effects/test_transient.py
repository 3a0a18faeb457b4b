"""[S3] eq. 1 against values worked out with 50 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from core.effects.transient import END, displacement, tilted
from core.errors import DermisError

TIMES = np.arange(1000) / 1000.0


def exact(t: float, onset: float, alpha: float, decay: float, hertz: float, v: float) -> float:
    with mpmath.workdps(50):
        s = mpmath.mpf(t) - mpmath.mpf(onset)
        if s < 0:
            return 0.0
        return float(-alpha * mpmath.exp(-decay * s) * mpmath.sin(2 * mpmath.pi * hertz * s) * v)


def test_decaying_sine_from_an_onset_between_two_samples() -> None:
    v = np.array([[0.1, -0.4, 0.2]])
    d = displacement(TIMES, np.array([0.12345]), v, 0.8, 60.0, 30.0)
    for i in (0, 100, 123, 124, 130, 177, 300):
        assert d[i] == pytest.approx([exact(TIMES[i], 0.12345, 0.8, 60.0, 30.0, x) for x in v[0]], abs=1e-13)
    assert not d[:124].any()


def test_first_swing_goes_against_the_impact() -> None:
    d = displacement(TIMES, np.array([0.0]), np.array([[0.0, 0.0, -0.5]]), 0.8, 60.0, 30.0)
    assert d[3, 2] > 0.0


def test_overlapping_transients_add() -> None:
    onsets, v = np.array([0.1001, 0.1102, 0.11025]), np.array([[0.3, 0, 0], [-0.2, 0.1, 0], [0.05, 0, 1.0]])
    together = displacement(TIMES, onsets, v, 0.5, 40.0, 80.0)
    alone = sum(displacement(TIMES, onsets[i : i + 1], v[i : i + 1], 0.5, 40.0, 80.0) for i in range(3))
    assert np.allclose(together, alone, atol=1e-15)
    want = sum(exact(0.13, o, 0.5, 40.0, 80.0, x[0]) for o, x in zip(onsets, v, strict=True))
    assert together[130, 0] == pytest.approx(want, abs=1e-12)


def test_each_contact_may_have_its_own_material() -> None:
    d = displacement(
        TIMES,
        np.array([0.1, 0.5]),
        np.ones((2, 1)),
        np.array([1.0, 0.5]),
        np.array([60.0, 90.0]),
        np.array([30.0, 300.0]),
    )
    assert d[110, 0] == pytest.approx(exact(0.11, 0.1, 1.0, 60.0, 30.0, 1.0), abs=1e-12)
    tail = exact(0.503, 0.1, 1.0, 60.0, 30.0, 1.0)
    assert d[503, 0] - tail == pytest.approx(exact(0.503, 0.5, 0.5, 90.0, 300.0, 1.0), abs=1e-9)


def test_what_is_cut_off_is_below_the_declared_end() -> None:
    d = displacement(TIMES, np.array([0.0]), np.array([[1.0]]), 1.0, 60.0, 30.0)[:, 0]
    whole = np.array([exact(t, 0.0, 1.0, 60.0, 30.0, 1.0) for t in TIMES])
    assert np.abs(d - whole).max() <= END
    assert d[345] != 0.0 and not d[346:].any()  # ln(1e9) / 60 = 0.3454 s
    undamped = displacement(TIMES, np.array([0.0]), np.array([[1.0]]), 1.0, 0.0, 30.0)[:, 0]
    assert undamped[-1] == pytest.approx(exact(0.999, 0.0, 1.0, 0.0, 30.0, 1.0), abs=1e-11)


def test_straight_tap_turns_to_the_pad_axis() -> None:
    axis = np.array([0.0, 1.0])
    assert tilted(np.array([[0.0, 0.0, -0.5]]), axis) == pytest.approx(np.array([[0.0, 0.5, 0.0]]))
    assert tilted(np.array([[0.1, 0.0, -0.5]]), axis) == pytest.approx(np.array([[0.1, 0.5, 0.0]]))


def test_no_direction_of_impact_is_lost() -> None:
    rng = np.random.default_rng(0)
    v = rng.normal(size=(5000, 3))
    v /= np.linalg.norm(v, axis=1)[:, None]
    for axis in (np.array([0.0, 1.0]), np.array([0.6, 0.8])):
        left = np.linalg.norm(tilted(v, axis), axis=1)
        assert left.min() > 0.85 and left.max() < 1.5
    assert tilted(np.array([[0.0, -0.5, -0.5]]), np.array([0.0, 1.0])) == pytest.approx(np.array([[0.0, -1.0, 0.0]]))


def test_negative_decay_is_refused() -> None:
    with pytest.raises(DermisError, match="at least 0"):
        displacement(TIMES, np.array([0.0]), np.array([[1.0]]), 1.0, -1.0, 30.0)
