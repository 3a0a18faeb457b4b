"""Series on a faster grid: smooth ones keep their amplitude, steps neither overshoot nor ring."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from core.errors import DermisError
from core.track.upsampling import HALF, ratio, upsampled


@pytest.mark.parametrize("up", [Fraction(48), Fraction(441, 10), Fraction(200)], ids=str)
@pytest.mark.parametrize("frequency", [0.004, 0.05, 0.11, 0.249])
def test_a_sinusoid_up_to_a_quarter_of_the_rate_keeps_its_amplitude(up: Fraction, frequency: float) -> None:
    """A linear interpolation is off by 38 % at 0.249."""
    for phase in np.linspace(0.0, 6.0, 7):
        found = upsampled(np.sin(2 * np.pi * frequency * np.arange(200) + phase), up)
        at = np.arange(len(found)) / float(up)
        inside = (at > HALF) & (at < 199 - HALF)
        assert np.abs(found - np.sin(2 * np.pi * frequency * at + phase))[inside].max() < 5e-5


def test_a_step_neither_rings_nor_overshoots_and_samples_are_kept_to_the_bit() -> None:
    step = np.r_[np.zeros(50), np.full(50, 288.0), np.full(50, 7.0)]
    found = upsampled(step, Fraction(48))
    assert np.array_equal(found[::48], step)
    assert found.min() == 0.0 and found.max() == 288.0
    assert not found[: 49 * 48 + 1].any(), "nothing before the step"
    assert (found[50 * 48 : 99 * 48 + 1] == 288.0).all() and (found[100 * 48 :] == 7.0).all()


def test_short_series_and_the_length_of_the_result() -> None:
    assert upsampled(np.array([3.0]), Fraction(48)).tolist() == [3.0]
    np.testing.assert_allclose(upsampled(np.array([3.0, 4.0]), Fraction(2)), [3.0, 3.5, 4.0], rtol=0, atol=1e-12)
    for n in (2, 7, 100):
        assert len(upsampled(np.ones(n), Fraction(441, 10))) == int((n - 1) * 44.1) + 1


def test_the_range_is_kept() -> None:
    pulse = np.r_[np.zeros(9), 300.0, 300.0, np.zeros(9)]  # its band-limited curve goes to 375 between the two
    assert upsampled(pulse, Fraction(48)).max() > 320.0
    found = upsampled(pulse, Fraction(48), 0.0, 300.0)
    assert (found.min(), found.max()) == (0.0, 300.0)


def test_ratios_are_exact_or_refused() -> None:
    assert ratio(1000.0, 48_000, 60.0, "t") == 48
    assert ratio(240.0, 192_000, 60.0, "t") == 800
    assert ratio(24_000 / 1001, 48_000, 3600.0, "t") == 2002
    with pytest.raises(DermisError, match="no simple ratio.*Resample"):
        ratio(997.123456, 48_000, 3600.0, "t")
