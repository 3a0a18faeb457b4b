"""What a force on the skin of an elastic half-space does: Boussinesq, Cerruti and Love in closed form, for E = 1.

Displacement between pieces of the skin takes their chord, their mean normal and, where they are near, the exact
average over the larger piece. Below the skin, the foot of a point stands in for the plane. Johnson, Contact Mechanics,
chapter 3; Love, Phil. Trans. A 228 (1929).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .pad_chart import Patches

_TIE, _SIDEWAYS = 1e-9, np.array([1.0, 1.41, 1.73])  # of two areas that are equal, a direction decides
NEAR = 2.0  # sides of the larger piece within which it is no point
STRESS_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # xx, yy, zz, yz, xz, xy
_CORNERS, _SIGNS = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]), np.array([1.0, -1.0, -1.0, 1.0])
_TINY, _UNIT, _NEXT, _AFTER = 1e-30, np.eye(3), [1, 2, 0], [2, 0, 1]


def surface_kernel(field: Patches, source: Patches, poisson: float, dtype: type = np.float64) -> NDArray[Any]:
    """Return the displacement of pieces of skin for forces on others at E = 1.

    Transposed when field and source are exchanged, to rounding.

    Args:
        field: where skin moves, I pieces. source: what carries the forces, J pieces.
        poisson: ratio.
        dtype: of the work; single precision is 1e-6 off.

    Returns:
        [1/m], shape (I, 3, J, 3).
    """
    here, there = (np.ascontiguousarray(p.positions.T, dtype=np.float64) for p in (field, source))
    chord: NDArray[Any] = (here[:, :, None] - there[:, None]).astype(dtype)
    turned: list[NDArray[Any]] = [p.normals.astype(dtype) for p in (field, source)]
    cosine = turned[0] @ turned[1].T
    scale = 1.0 / np.sqrt(np.maximum(2.0 + 2.0 * cosine, dtype(1e-6)))
    normal = np.stack([(turned[0][:, k, None] + turned[1][None, :, k]) * scale for k in range(3)])
    r2 = chord[0] ** 2 + chord[1] ** 2 + chord[2] ** 2
    sides = np.sqrt(np.maximum(field.areas[:, None], source.areas[None])).astype(dtype)
    near = np.nonzero(r2 < (NEAR * sides) ** 2)
    r2[near] = 1.0
    inverse = 1.0 / np.sqrt(r2)
    tangent = chord * inverse
    strength = dtype((1.0 + poisson) / np.pi) * inverse
    even, odd = strength * dtype(poisson), strength * dtype(0.5 - poisson)
    out: NDArray[Any] = np.empty((len(field), 3, len(source), 3), dtype)
    for a in range(3):
        along = even * tangent[a]
        np.multiply(along, tangent[a], out=out[:, a, :, a])
        out[:, a, :, a] += dtype(1.0 - poisson) * strength
        for b in range(a):
            symmetric = along * tangent[b]
            turning = odd * (tangent[a] * normal[b] - tangent[b] * normal[a])
            np.add(symmetric, turning, out=out[:, a, :, b])
            np.subtract(symmetric, turning, out=out[:, b, :, a])
    i, j = near
    apart = here[:, i].T - there[:, j].T
    ratio = field.areas[i] / source.areas[j] - 1.0
    first = np.where(np.abs(ratio) < _TIE, apart @ _SIDEWAYS, ratio) > 0  # the same piece from both ends
    larger = np.where(first[:, None, None], field.sides[i], source.sides[j])
    out[i, :, j, :] = rectangle_kernel(apart, normal[:, i, j].T, larger, poisson)
    return out


def rectangle_kernel(chord: Array, normal: Array, sides: Array, poisson: float) -> Array:
    """Return the displacement at points for a unit force spread evenly over rectangles, at E = 1.

    Args:
        chord: from the rectangle's centre to the point, shape (n, 3) [m]. normal: outward, shape (n, 3).
        sides: of the rectangle, shape (n, 2, 3) [m]; their parallelogram counts as the rectangle of its area.
        poisson: ratio.

    Returns:
        [1/m], shape (n, 3, 3).
    """
    normal = np.asarray(normal, np.float64)
    first = sides[:, 0] - _dot(sides[:, 0], normal)[:, None] * normal
    length = np.sqrt(_dot(first, first))
    first = first / length[:, None]
    second = _cross(normal, first)
    halves = np.stack([0.5 * length, 0.5 * np.abs(_dot(second, sides[:, 1]))])
    corners = np.stack([_dot(chord, first), _dot(chord, second)]) + _CORNERS[:, :, None] * halves  # (4, 2, n)
    s, t = corners[:, 0], corners[:, 1]
    r = np.hypot(s, t)
    logarithm = np.log(np.maximum(r, _TINY))
    size, other = np.maximum(np.abs(s), _TINY), np.maximum(np.abs(t), _TINY)  # at zero each term is zero
    xx, yy = _SIGNS @ (t * np.arcsinh(s / other)), _SIGNS @ (s * np.arcsinh(t / size))  # of s^2 / r^3, t^2 / r^3
    xy = _SIGNS @ -r  # of s t / r^3
    ax = _SIGNS @ (t * logarithm + size * np.arctan(t / size))  # of s / r^2
    ay = _SIGNS @ (s * logarithm + other * np.arctan(s / other))
    lengthwise = xx[:, None] * first + xy[:, None] * second
    crosswise = xy[:, None] * first + yy[:, None] * second
    even = lengthwise[:, :, None] * first[:, None] + crosswise[:, :, None] * second[:, None]
    turning = (ax[:, None] * first + ay[:, None] * second)[:, :, None] * normal[:, None]
    out = poisson * even + (0.5 - poisson) * (turning - turning.transpose(0, 2, 1))
    out += ((1.0 - poisson) * (xx + yy))[:, None, None] * _UNIT
    out *= ((1.0 + poisson) / (4.0 * np.pi * halves[0] * halves[1]))[:, None, None]
    return out


class Beneath:
    """Points below the skin, and what forces on the skin do there at E = 1.

    Nine numbers say what happens at a point: displacement x, y, z and stress xx, yy, zz, yz, xz, xy.

    Args:
        feet: points of the skin, shape (k, 3) [m]. normals: outward unit normals there, shape (k, 3).
        depths: below the skin along the normal [m], above zero, shape (k,).
        poisson: ratio.
    """

    def __init__(self, feet: Array, normals: Array, depths: Array, poisson: float) -> None:
        self.feet, self.depths, self.poisson = feet, np.asarray(depths, np.float64), poisson
        inward = -normals
        first = np.cross(np.eye(3)[np.abs(inward).argmin(axis=1)], inward)
        first /= np.sqrt(_dot(first, first))[:, None]
        self.frames = np.stack([first, np.cross(inward, first), inward], axis=1)
        basis = np.zeros((9, 3, 3))  # stress tensors of unit components
        for n, (i, j) in enumerate(STRESS_PAIRS):
            basis[3 + n, i, j] = basis[3 + n, j, i] = 1.0
        turned = self.frames.transpose(0, 2, 1)[:, None] @ basis @ self.frames[:, None]
        self._turn = np.zeros((len(self.depths), 9, 9))
        self._turn[:, 3:] = np.stack([turned[..., i, j] for i, j in STRESS_PAIRS], axis=1)
        self._turn[:, :3, :3] = self.frames.transpose(0, 2, 1)

    def __len__(self) -> int:
        return len(self.depths)

    def kernel(self, positions: Array) -> Array:
        """Return what unit forces at points of the skin do at every probe [1/m and 1/m^2], shape (k, 9, J, 3)."""
        probe = np.repeat(np.arange(len(self)), len(positions))
        local = _point_force(self._places(probe, np.tile(positions, (len(self), 1))), self.poisson)
        local = local.reshape(len(self), len(positions), 9, 3) @ self.frames[:, None]
        return (self._turn @ local.transpose(0, 2, 1, 3).reshape(len(self), 9, -1)).reshape(len(self), 9, -1, 3)

    def sum(self, probe: Indices, positions: Array, forces: Array) -> Array:
        """Return what forces on the skin do at the probes, over pairs of a probe and a force.

        Args:
            probe: of each pair, shape (n,). positions, forces: of each pair [m, N], shape (n, 3).

        Returns:
            Displacement at E = 1 Pa [m] and stress [Pa], shape (k, 9).
        """
        local = _point_force(self._places(probe, positions), self.poisson)
        done = (local @ (self.frames[probe] @ forces[:, :, None]))[:, :, 0]
        total = np.stack([np.bincount(probe, column, minlength=len(self)) for column in done.T], axis=1)
        return (self._turn @ total[:, :, None])[:, :, 0]

    def _places(self, probe: Indices, positions: Array) -> Array:
        """Return where probes lie as seen from points of the skin: the chord in the plane, and the true depth."""
        chord = self.feet[probe] - positions
        x, y = _dot(chord, self.frames[probe, 0]), _dot(chord, self.frames[probe, 1])
        flat = np.hypot(x, y)
        stretch = np.sqrt(_dot(chord, chord)) / np.where(flat > 0, flat, 1.0)
        return np.stack([x * stretch, y * stretch, self.depths[probe]], axis=1)


def _point_force(place: Array, poisson: float) -> Array:
    """Return displacement (E = 1) and stress at places (n, 3) for unit forces at the origin of z > 0, (n, 9, 3)."""
    x, y, z = place.T
    free = 1.0 - 2.0 * poisson
    r = np.sqrt(x * x + y * y + z * z)
    deep = 1.0 / (r + z)
    cube = 1.0 / r**3
    q = deep / r
    out = np.empty((len(place), 9, 3))
    coordinates = (x, y, z)
    for i in range(3):
        for k in range(3):
            out[:, i, k] = coordinates[i] * coordinates[k] * cube
        out[:, i, i] += 1.0 / r
    for i, a in enumerate((x, y)):
        for k, b in enumerate((x, y)):
            out[:, i, k] -= free * a * b * q * deep
        out[:, i, i] += free * deep
        out[:, i, 2] -= free * a * q
        out[:, 2, i] += free * a * q
    out[:, 2, 2] += free / r
    out[:, :3] *= 1.0 + poisson
    main = -3.0 * cube / r**2
    e, g, h = q * deep, (3.0 * r + z) * (deep * cube * deep * deep), (2.0 * r + z) * deep * deep * cube
    for n, (i, j) in enumerate(STRESS_PAIRS):
        pair = coordinates[i] * coordinates[j]
        for k in range(3):
            out[:, 3 + n, k] = main * pair * coordinates[k]
        if 2 in (i, j):
            continue
        for k in range(2):
            extra = g * pair * coordinates[k]
            if i == j:
                extra += (cube - e) * coordinates[k]
            for one, other in ((i, j), (j, i)):
                if one == k:
                    extra -= e * coordinates[other]
            out[:, 3 + n, k] += free * extra
        out[:, 3 + n, 2] += free * (h * pair + ((z * cube - q) if i == j else 0.0))
    return out / (2.0 * np.pi)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ij,ij->i", a, b)


def _cross(a: Array, b: Array) -> Array:
    """Return a x b, shape (n, 3): numpy's own takes three times as long for few."""
    return a[:, _NEXT] * b[:, _AFTER] - a[:, _AFTER] * b[:, _NEXT]
