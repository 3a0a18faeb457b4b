"""Bends: how the fourth power of what patterns store bends at an amount of each, exactly, without any fourth power.

The fourth power of k patterns has k^4 / 24 numbers; its second derivative at one displacement has k^2, and a sum over
elements tells them.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Floats32
from .neo_hookean import NeoHookean
from .pair_fields import Slopes, mean_of_nodes

_ONE = np.eye(3)


class Bends:
    """The second derivative of Phi4 of patterns.

    Phi4 is the integral of mu tr(H^4) / 4 + lambda (j2^2 - 3 j1^2 j2 + 11/12 j1^4 + 2 j1 j3) / 2, j the powers of a
    nodal J; less what tissue gains that follows in second order, r' K^-1 r / 2 of the forces r that it was left with.

    Args:
        tissue: of the mesh. slopes: linear fields of the patterns.
        left: R(a, b), symmetric, the forces of the second power on the free nodes beneath the pad being R(q, q);
            follow: how far they move the tissue there while the pad is held, shape (k, k, d). Single precision: it
            shows in an energy's seventh digit.
    """

    def __init__(self, tissue: NeoHookean, slopes: Slopes, left: Floats32, follow: Floats32) -> None:
        self._tissue, self._slopes, self._left, self._follow = tissue, slopes, left, follow
        count = len(slopes.trace)
        self._gradient = np.ascontiguousarray(slopes.gradient.reshape(count, -1, 9).transpose(1, 2, 0))  # e, 9, k
        self._flat = self._gradient.reshape(-1, count).astype(np.float32)

    def at(self, amounts: Array) -> Array:
        """Return the second derivatives at amounts of each pattern, shapes (s, k) to (s, k, k)."""
        out = np.array([self._direct(q) for q in amounts]) - self._gained(amounts)
        return 0.5 * (out + out.transpose(0, 2, 1))

    def _direct(self, q: Array) -> Array:
        """Return that of tissue that does not follow in second order."""
        first, shear = self._tissue.lame
        mesh, geometry, slopes = self._tissue.mesh, self._tissue.geometry, self._slopes
        h = (self._gradient @ q).reshape(-1, 3, 3)
        trace, square = np.einsum("eii->e", h), h @ h
        nodal = q @ slopes.nodal
        widening = 0.5 * (trace**2 - np.einsum("eii->e", square))
        second = mesh.averaging @ widening
        pressed, widened = (mean_of_nodes(mesh, v[None])[0] for v in (nodal, second - 1.5 * nodal * nodal))
        form = shear * (
            np.einsum("jk,eli->eijkl", _ONE, square)
            + np.einsum("ejk,li->eijkl", square, _ONE)
            + np.einsum("ejk,eli->eijkl", h, h)
        )
        both = np.einsum("eij,kl->eijkl", np.swapaxes(h, 1, 2), _ONE)
        turn = np.einsum("jk,eli->eijkl", _ONE, h)
        other = both + both.transpose(0, 3, 4, 1, 2) - turn - turn.transpose(0, 3, 4, 1, 2)
        volume = np.einsum("ij,kl->ijkl", _ONE, _ONE) - np.einsum("jk,li->ijkl", _ONE, _ONE)
        form += first * (pressed * trace + widened)[:, None, None, None, None] * volume
        form -= first * pressed[:, None, None, None, None] * other
        form *= geometry.volumes[:, None, None, None, None]
        bent = (form.reshape(-1, 9, 9) @ self._gradient).reshape(self._flat.shape).astype(np.float32)
        out = (self._flat.T @ bent).astype(np.float64)
        own = trace[:, None, None] * _ONE - np.swapaxes(h, 1, 2)
        wide = self._nodal(own)
        turned = np.swapaxes(h, 1, 2)
        cofactor = widening[:, None, None] * _ONE - trace[:, None, None] * turned + turned @ turned
        volumes, once = first * geometry.nodal_volumes, slopes.nodal
        out += (wide * volumes) @ wide.T
        out += (once * (volumes * (5.5 * nodal**2 - 3.0 * second))) @ once.T
        cross = (once * volumes) @ (self._nodal(cofactor) - 3.0 * nodal * wide).T
        return np.asarray(out + cross + cross.T)

    def _nodal(self, fields: Array) -> Array:
        """Return what patterns' gradients make with a field, averaged around the nodes, (e, 3, 3) to (k, n)."""
        told = np.einsum("ep,epk->ek", fields.reshape(-1, 9), self._gradient, optimize=True)
        return np.asarray((self._tissue.mesh.averaging @ told).T)

    def _gained(self, amounts: Array) -> Array:
        """Return those of r' K^-1 r / 2."""
        q, (count, _, size) = amounts.astype(np.float32), self._left.shape
        left, follow = ((q @ r.reshape(count, -1)).reshape(len(q), count, size) for r in (self._left, self._follow))
        whole = (np.einsum("sad,sa->sd", follow, q, optimize=True) @ self._left.reshape(-1, size).T).astype(np.float64)
        return np.asarray(4.0 * left @ follow.transpose(0, 2, 1) + 2.0 * whole.reshape(-1, count, count))
