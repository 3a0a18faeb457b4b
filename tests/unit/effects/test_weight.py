"""[S3] eq. 4, the two weights that people confused, and the auto-range that keeps them apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.effects.weight import displacement, fitting
from core.errors import DermisError

GRAVITY = np.array([0.0, 0.0, -9.81])


def test_equation_4_and_its_sign() -> None:
    a = np.array([[1.0, -2.0, 0.5]])
    assert displacement(a, GRAVITY, 3.0, 0.1) == pytest.approx(np.array([[3.0, -6.0, 1.5 - 0.981]]))
    assert displacement(a, GRAVITY, 3.0, 0.1, "inertia") == pytest.approx(np.array([[-3.0, 6.0, -1.5 - 0.981]]))


def test_keyed_amplitudes() -> None:
    d = displacement(np.ones((2, 3)), GRAVITY, np.array([0.0, 1.0]), np.array([0.1, 0.0]))
    assert d == pytest.approx(np.array([[0, 0, -0.981], [1, 1, 1]]))


@pytest.mark.parametrize(("alpha", "saturates"), [(3.0, 0.065), (9.0, 0.022)])
def test_sideways_acceleration_at_which_the_paper_s_weights_saturate(alpha: float, saturates: float) -> None:
    """Gravity alone uses 98 % of the range."""
    assert np.linalg.norm(displacement(np.zeros((1, 3)), GRAVITY, alpha, 0.1)) == pytest.approx(0.981)
    a = math.sqrt(1 - 0.981**2) / alpha
    assert a == pytest.approx(saturates, abs=5e-4)
    for factor, over in ((0.999, False), (1.001, True)):
        d = displacement(np.array([[a * factor, 0, 0]]), GRAVITY, alpha, 0.1)
        assert (np.linalg.norm(d) > 1.0) == over


def test_one_factor_keeps_ratios_and_only_shrinks() -> None:
    a = np.array([[2.0, 0.0, 0.0]])
    peaks = [float(np.linalg.norm(displacement(a, GRAVITY, alpha, 0.0))) for alpha in (1 / 3, 1.0, 3.0, 9.0)]
    assert min(1.0, peaks[2]) == min(1.0, peaks[3])  # limited: the two heaviest feel alike
    scaled = [fitting(max(peaks)) * p for p in peaks]
    assert scaled[3] == pytest.approx(1.0)
    assert [scaled[i + 1] / scaled[i] for i in range(3)] == pytest.approx([3.0, 3.0, 3.0])
    assert fitting(0.4) == 1.0 and fitting(0.0) == 1.0


def test_unknown_sign_is_refused() -> None:
    with pytest.raises(DermisError, match="sign"):
        displacement(np.zeros((1, 3)), GRAVITY, 1.0, 1.0, "upwards")
