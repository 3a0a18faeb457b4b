"""The laws that measured fingers were said to follow, fitted to curves by least squares, and how well they do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """A law of two parameters that was fitted.

    Attributes:
        scale, rate: F = scale (exp(rate d) - 1), or F = scale d^rate. fit: share of the variance that it tells, R2.
    """

    scale: float
    rate: float
    fit: float


def exponential(depth: Array, force: Array) -> Law:
    """Fit F = a (exp(b d) - 1)."""
    return _fitted(depth, force, np.expm1, np.linspace(1e-3, 12.0, 1200) / depth.max())


def power(depth: Array, force: Array) -> Law:
    """Fit F = a d^n."""
    return _fitted(np.log(depth), force, np.exp, np.linspace(0.2, 6.0, 1200))


def slope(x: Array, y: Array) -> float:
    """Return the exponent n of y = a x^n, fitted to the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def straight(x: Array, y: Array) -> float:
    """Return R2 of the straight line through points."""
    return share(y, np.polyval(np.polyfit(x, y, 1), x))


def paraboloid(points: Array, pressure: Array) -> float:
    """Return R2 of p = c + c_x x + c_y y + c_xx x^2 + c_yy y^2, over points (n, 2)."""
    columns = _quadratic(points)
    return share(pressure, columns @ np.linalg.lstsq(columns, pressure, rcond=None)[0])


def ellipsoid(points: Array, pressure: Array) -> float:
    """Return R2 of Hertz's half ellipsoid: the square of pressure is a paraboloid."""
    columns = _quadratic(points)
    square = columns @ np.linalg.lstsq(columns, pressure**2, rcond=None)[0]
    return share(pressure, np.sqrt(np.maximum(square, 0.0)))


def share(values: Array, told: Array) -> float:
    """Return how much of the variance of values others tell: R2."""
    return float(1.0 - np.sum((values - told) ** 2) / np.sum((values - values.mean()) ** 2))


def _quadratic(points: Array) -> Array:
    x, y = points[:, 0] / np.ptp(points[:, 0]), points[:, 1] / np.ptp(points[:, 1])
    return np.stack([np.ones(len(points)), x, y, x * x, y * y], axis=1)


def _fitted(x: Array, y: Array, shape: np.ufunc, rates: Array) -> Law:
    """Return the best y = scale shape(rate x): the scale of each rate is linear, the rate is looked for twice."""
    best = Law(0.0, 0.0, -np.inf)
    for _ in range(2):
        for rate in rates.tolist():
            column = shape(rate * x)
            scale = float(column @ y / (column @ column))
            fit = share(y, scale * column)
            if fit > best.fit:
                best = Law(scale, rate, fit)
        step = float(rates[1] - rates[0])
        rates = np.linspace(max(best.rate - step, 1e-9), best.rate + step, 201)
    return best
