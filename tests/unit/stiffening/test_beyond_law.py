"""The law beyond linear tissue: its slopes are those of its value, and squeezing alone has a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.skin.material import lame
from core.stiffening.beyond_law import FLATTEST, BeyondLaw

Array = NDArray[np.float64]
FIRST, SHEAR = lame(1.0, 0.48)
LAW = BeyondLaw(FIRST, SHEAR)


def _points(size: float, count: int = 30) -> tuple[Array, Array]:
    rng = np.random.default_rng(5)
    return size * rng.standard_normal((3, 3, count)), 0.3 * rng.standard_normal(count)


def _volumes(h: Array) -> Array:
    return np.linalg.det(h.transpose(2, 0, 1) + np.eye(3))


@pytest.mark.parametrize("size", [0.05, 0.4])
def test_slopes_are_those_of_the_value(size: float) -> None:
    h, p = _points(size)
    rng, step = np.random.default_rng(6), 1e-6
    dh, dp = rng.standard_normal(h.shape), rng.standard_normal(p.shape)
    risen = (LAW.value(h + step * dh, p + step * dp) - LAW.value(h - step * dh, p - step * dp)) / (2.0 * step)
    by_h, by_p = LAW.slopes(h, p)
    np.testing.assert_allclose(np.einsum("ije,ije->e", by_h, dh) + by_p * dp, risen, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("size", [0.05, 0.4])
def test_bends_are_those_of_the_slopes(size: float) -> None:
    h, p = _points(size)
    if size > 0.3:
        assert _volumes(h).min() < FLATTEST, "none of them is pressed flat"
    rng, step = np.random.default_rng(7), 1e-6
    dh, dp = rng.standard_normal(h.shape), rng.standard_normal(p.shape)
    more, less = LAW.slopes(h + step * dh, p + step * dp), LAW.slopes(h - step * dh, p - step * dp)
    twice, mixed, pressed = LAW.bends(h, p)
    way = dh.reshape(9, -1).T
    by_h = np.einsum("exy,ey->ex", twice, way) + mixed * dp[:, None]
    np.testing.assert_allclose(by_h, ((more[0] - less[0]) / (2.0 * step)).reshape(9, -1).T, rtol=1e-5, atol=2e-6)
    by_p = np.einsum("ex,ex->e", mixed, way) + pressed * dp
    np.testing.assert_allclose(by_p, (more[1] - less[1]) / (2.0 * step), rtol=1e-5, atol=2e-6)


def test_it_is_of_third_order() -> None:
    h, p = _points(1.0)
    small = LAW.value(1e-3 * h, 1e-3 * p)
    smaller = LAW.value(0.5e-3 * h, 0.5e-3 * p)
    np.testing.assert_allclose(smaller, small / 8.0, rtol=0.05, atol=1e-11)


def test_a_squeezed_block_has_the_law_s_pressure() -> None:
    for volume in (0.97, 1.03):
        h = (volume ** (1.0 / 3.0) - 1.0) * np.eye(3)[:, :, None]
        p = np.array([FIRST * np.log(volume) / volume])
        # in balance the linear part, tr H - p / lambda, and the slope by p cancel
        left = float(LAW.slopes(h, p)[1][0] + np.trace(h[..., 0]) - p[0] / FIRST)
        assert abs(left) < 15.0 * abs(volume - 1.0) ** 4
