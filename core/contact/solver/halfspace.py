"""The compliance of an elastic half-space: a skin whose contact is known in closed form.

For checking solvers, and as a stand-in for skin where no fingertip is at hand. The half-space fills z > 0, as a finger
lies above its pad; tractions are uniform over squares about the nodes.
"""

from __future__ import annotations

import numpy as np

from ...errors import DermisError
from ...surface.triangles import Array


def halfspace_compliance(nodes: Array, spacing: float, young: float, poisson: float) -> Array:
    """Return the displacement of nodes for unit forces on the squares about them [m/N], shape (3 m, 3 m).

    Args:
        nodes: centres of the squares on the surface [m], on a square grid, shape (m, 2).
        spacing: side of the squares [m].
        young: Young's modulus [Pa]; poisson: Poisson's ratio.

    Raises:
        DermisError: spacing or modulus not positive, or a ratio outside [0, 0.5].

    Source: Love 1929 (pressure), Johnson, Contact Mechanics, section 3.6 (Cerruti's tangential point force),
    integrated here over a square.
    """
    if not (spacing > 0.0 and young > 0.0 and 0.0 <= poisson <= 0.5):
        raise DermisError(
            "a half-space needs a positive spacing and modulus, and a Poisson's ratio in [0, 0.5]",
            value=(spacing, young, poisson),
        )
    m = nodes.shape[0]
    dx = nodes[:, None, 0] - nodes[None, :, 0]
    dy = nodes[:, None, 1] - nodes[None, :, 1]
    xx = yy = xy = x_r2 = y_r2 = np.zeros((m, m))
    half = 0.5 * spacing
    for sx in (-1.0, 1.0):
        for sy in (-1.0, 1.0):
            x, y = dx + sx * half, dy + sy * half
            r = np.hypot(x, y)
            sign = sx * sy
            log_x, log_y = _log_sum(x, y, r), _log_sum(y, x, r)
            xx = xx + sign * y * log_x  # of x^2 / r^3
            yy = yy + sign * x * log_y  # of y^2 / r^3
            xy = xy - sign * r  # of x y / r^3
            log_r = np.log(r)
            x_r2 = x_r2 + sign * (y * log_r + x * np.arctan(y / x))  # of x / r^2; x is never 0 on a grid
            y_r2 = y_r2 + sign * (x * log_r + y * np.arctan(x / y))
    inverse_r = xx + yy
    scale = (1.0 + poisson) / (np.pi * young * spacing**2)
    couple = 0.5 * (1.0 - 2.0 * poisson)
    out = np.empty((m, 3, m, 3))
    out[:, 0, :, 0] = (1.0 - poisson) * inverse_r + poisson * xx
    out[:, 1, :, 1] = (1.0 - poisson) * inverse_r + poisson * yy
    out[:, 0, :, 1] = out[:, 1, :, 0] = poisson * xy
    out[:, 2, :, 2] = (1.0 - poisson) * inverse_r
    out[:, 0, :, 2] = -couple * x_r2
    out[:, 2, :, 0] = couple * x_r2
    out[:, 1, :, 2] = -couple * y_r2
    out[:, 2, :, 1] = couple * y_r2
    matrix = scale * out.reshape(3 * m, 3 * m)
    return 0.5 * (matrix + matrix.T)


def square_grid(radius: float, spacing: float) -> Array:
    """Return the nodes of a square grid within a radius [m], one at the centre, shape (m, 2)."""
    n = int(radius / spacing)
    axis = np.arange(-n, n + 1) * spacing
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis, indexing="ij"))
    inside = np.hypot(x, y) <= radius * (1.0 + 1e-9)
    return np.stack([x[inside], y[inside]], axis=1)


def _log_sum(x: Array, y: Array, r: Array) -> Array:
    """log(x + r), without cancelling where x is negative."""
    return np.where(x >= 0.0, np.log(np.abs(x) + r), 2.0 * np.log(np.abs(y)) - np.log(r + np.abs(x)))
