"""BeyondLaw: what neo-Hookean tissue stores beyond linear tissue, point by point, with a pressure of its own.

Told in displacement and pressure, a nodal average of J is an average of pressures: sum_a V_a p_a (J_a - 1) is
sum_e V_e (mean of p) (J_e - 1). No element asks its neighbours, and any of them can be left out of a sum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

Floats = NDArray[np.floating[Any]]

FLATTEST = 0.25  # J below which ln J goes on as its parabola there: what is pressed flat stays hard, not infinitely so
_NEXT = ((1, 2), (2, 0), (0, 1))


@dataclass(frozen=True)
class BeyondLaw:
    """phi(H, p) = -mu (ln J - tr H + tr H^2 / 2) + p (J - 1 - tr H) - (s^3 / 2 + 2/3 s^4) lambda, s = p / lambda.

    The last term is what (lambda / 2) (ln J)^2, seen from p = lambda ln J / J, has beyond p^2 / 2 lambda; the next
    power of s is left out. phi is of third order in a displacement and its pressure.

    Attributes:
        first, shear: Lame's parameters at E = 1.

    It answers in the precision that it is asked in.
    """

    first: float
    shear: float

    def value(self, h: Floats, p: Floats) -> Array:
        """Return phi, shape (e,), of gradients (3, 3, e) and pressures (e,)."""
        _, _, volume, trace = _volumes(h)
        log, _, _ = _logarithm(volume)
        s = p / np.float32(self.first)
        square = np.einsum("ije,jie->e", h, h)
        squeezed = self.first * s**3 * (0.5 + 2.0 / 3.0 * s)
        return np.asarray(
            -self.shear * (log - trace + 0.5 * square) + p * (volume - 1.0 - trace) - squeezed, np.float64
        )

    def slopes(self, h: Floats, p: Floats) -> tuple[Floats, Floats]:
        """Return the slopes of phi by H, shape (3, 3, e), and by p, shape (e,)."""
        _, cofactor, volume, trace = _volumes(h)
        _, over, _ = _logarithm(volume)
        shear = np.float32(self.shear)
        stress = cofactor * (p - shear * over)
        stress -= shear * h.transpose(1, 0, 2)
        rest = shear - p
        for i in range(3):
            stress[i, i] += rest
        s = p / np.float32(self.first)
        return stress, volume - 1.0 - trace - s * s * (np.float32(1.5) + np.float32(8.0 / 3.0) * s)

    def bends(self, h: Floats, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the second derivatives by H twice, (e, 9, 9), by H and p, (e, 9), and by p twice, (e,)."""
        f, cofactor, volume, _ = _volumes(h)
        _, over, fall = _logarithm(volume)
        count, shear = len(p), np.float32(self.shear)
        flat = np.ascontiguousarray(cofactor.reshape(9, count).T)
        out = (-shear * fall)[:, None, None] * flat[:, :, None] * flat[:, None]
        turned = (np.ascontiguousarray(f.reshape(9, count).T) @ _SECOND).reshape(count, 9, 9)
        out += (p - shear * over)[:, None, None] * turned
        out -= shear * _SWAP
        s = p / np.float32(self.first)
        return out, flat - _ONE, -(s * (3.0 + 8.0 * s)) / np.float32(self.first)


def _volumes(h: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return F = 1 + H, its cofactor, J and tr H."""
    f = h.copy()
    for i in range(3):
        f[i, i] += 1.0
    cofactor = np.empty_like(f)
    for i, (a, b) in enumerate(_NEXT):
        for j, (c, d) in enumerate(_NEXT):
            cofactor[i, j] = f[a, c] * f[b, d] - f[a, d] * f[b, c]
    volume = f[0, 0] * cofactor[0, 0] + f[0, 1] * cofactor[0, 1] + f[0, 2] * cofactor[0, 2]
    return f, cofactor, volume, h[0, 0] + h[1, 1] + h[2, 2]


def _logarithm(volume: Floats) -> tuple[Floats, Floats, Floats]:
    """Return ln J, its slope and its second derivative, a parabola below `FLATTEST`."""
    kept = np.maximum(volume, np.float32(FLATTEST))
    below = (np.minimum(volume, np.float32(FLATTEST)) - np.float32(FLATTEST)) / np.float32(FLATTEST)
    over = 1.0 / kept
    return np.log(kept) + below - 0.5 * below * below, over * (1.0 - below), -over * over


def _second() -> tuple[Floats, Floats, Floats]:
    """Return d cof / d F as what F is multiplied with, (9, 81), the swap of H and H' and the identity, flat."""
    turn = np.zeros((3, 3, 3))
    for i, (j, k) in enumerate(_NEXT):
        turn[i, j, k], turn[i, k, j] = 1.0, -1.0
    whole = np.einsum("ikm,jln->mnijkl", turn, turn).reshape(9, 81)
    one = np.eye(3)
    swap = np.einsum("il,jk->ijkl", one, one).reshape(9, 9)
    return whole.astype(np.float32), swap.astype(np.float32), one.ravel().astype(np.float32)


_SECOND, _SWAP, _ONE = _second()
