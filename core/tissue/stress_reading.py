"""StressReading: amounts of fields of stress, read off tissue that follows its skin, to the third power.

What a held pad's tissue adds to its stress by following is never solved for in the highest power: a field's amount is a
functional of stress, and one linear solve (the adjoint) says what that functional makes of forces in the tissue.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats32
from .held_tissue import HeldTissue
from .neo_hookean import NeoHookean
from .pair_fields import PARTS, Slopes, to_nodes

_WHOLE = np.array([0, 5, 4, 5, 1, 3, 4, 3, 2])  # components of a symmetric tensor, row by row
_HALVES = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])  # a component off the diagonal stands for two


@dataclass(frozen=True, eq=False)
class StressReading:
    """What reads amounts of fields off stress.

    Attributes:
        tissue: whose stress it is.
        stress: w, what the Cauchy stress of the elements is multiplied with, symmetric, shape (r, e, 3, 3).
        follow: g, what the first Piola-Kirchhoff stress that tissue is left with is taken off with, (r, e, 3, 3).
        pressure: what pressures of the nodes are multiplied with, shape (r, n).
    """

    tissue: NeoHookean
    stress: Array
    follow: Array
    pressure: Array

    @classmethod
    def of(cls, linear: HeldTissue, weights: Array) -> StressReading:
        """Return what reads the stress of the elements with weights of shape (r, e, 6)."""
        tissue, mesh = linear.tissue, linear.tissue.mesh
        first, shear = tissue.lame
        stress = (weights * _HALVES)[..., _WHOLE].reshape(*weights.shape[:2], 3, 3)
        trace = np.einsum("reii->re", stress)
        held = 2.0 * shear * stress
        squeeze = first * (to_nodes(mesh, trace) @ mesh.averaging)
        for i in range(3):
            held[..., i, i] += squeeze
        volumes = tissue.geometry.volumes[:, None, None]
        moved = linear.followed_forces(tissue.forces(held / volumes))
        follow = Slopes.of(tissue, moved).gradient * volumes
        return cls(tissue, stress, follow, to_nodes(mesh, trace - np.einsum("reii->re", follow)))

    @classmethod
    def of_following(cls, linear: HeldTissue, weights: Array) -> StressReading:
        """Return what reads displacement [m] and pressure of the nodes with weights of shape (r, n, 4)."""
        tissue, mesh = linear.tissue, linear.tissue.mesh
        squeeze = tissue.lame[0] * (weights[..., 3] @ mesh.averaging)
        volumes = tissue.geometry.volumes[:, None, None]
        held = squeeze[..., None, None] * np.eye(3) / volumes
        moved = linear.followed_forces(tissue.forces(held) + weights[..., :3])
        follow = Slopes.of(tissue, moved).gradient * volumes
        pressure = weights[..., 3] - to_nodes(mesh, np.einsum("reii->re", follow))
        return cls(tissue, np.zeros_like(follow), follow, pressure)

    def first(self, count: int) -> StressReading:
        """Return what reads the first fields."""
        return StressReading(self.tissue, self.stress[:count], self.follow[:count], self.pressure[:count])

    def squares(self, slopes: Slopes) -> Array:
        """Return what multiplies q_a q_b, a <= b, in the amounts, shape (r, pairs)."""
        first, mesh = self.tissue.lame[0], self.tissue.mesh
        count, elements = slopes.trace.shape
        i, j = np.triu_indices(count)
        out = np.empty((len(self.stress), len(i)))
        h = np.ascontiguousarray(slopes.gradient.transpose(1, 2, 3, 0)).reshape(elements, 9, count)
        for n, (form, press) in enumerate(zip(self._forms(), self._presses(), strict=True)):
            pressed = np.einsum("ep,epb->be", press, h, optimize=True)
            nodal = to_nodes(mesh, pressed) - 1.5 * first * self.pressure[n] * slopes.nodal
            whole = h.reshape(-1, count).T @ (form @ h).reshape(-1, count) + slopes.nodal @ nodal.T
            out[n] = np.where(i == j, 0.5, 1.0) * (whole + whole.T)[i, j]
        return out

    def _forms(self) -> Iterator[Array]:
        """Yield the bilinear form of two gradients that each field's amount is, but for pressure, shape (e, 9, 9)."""
        first, shear = self.tissue.lame
        one = np.eye(3)
        for w, g, p in zip(self.stress, self.follow, self.pressure, strict=True):
            spread = 0.5 * first * (p @ self.tissue.mesh.averaging)
            form = shear * (np.einsum("eik,jl->eijkl", w, one) + np.einsum("jk,eli->eijkl", one, g))
            form -= 2.0 * shear * np.einsum("ij,ekl->eijkl", one, w)
            whole = np.einsum("ij,kl->ijkl", one, one) - np.einsum("il,jk->ijkl", one, one)
            form += spread[:, None, None, None, None] * whole
            yield form.reshape(-1, 9, 9)

    def _presses(self) -> Iterator[Array]:
        """Yield what a gradient is multiplied with beside the mean dilatation of an element, shape (e, 9)."""
        for g in self.follow:
            trace = np.einsum("eii->e", g)[:, None, None]
            yield self.tissue.lame[0] * (np.swapaxes(g, -1, -2) - trace * np.eye(3)).reshape(-1, 9)

    def pressed(self, slopes: Slopes) -> Array:
        """Return what multiplies second-order pressures, over Lame's parameter, in the elements, shape (r, c, e)."""
        trace = np.einsum("reii->re", self.follow)
        turned = np.einsum("reij,ceji->rce", self.follow, slopes.gradient, optimize=True)
        return self.tissue.lame[0] * (turned - trace[:, None] * slopes.trace)

    def dual(self, slopes: Slopes, elements: slice, widened: Array) -> Floats32:
        """Return what multiplies the second powers of `square_fields` in some elements, for each field and pattern.

        Args:
            slopes: of the patterns in these elements. widened: what multiplies the second power of J, (r, c, e).

        Returns:
            shape (r c, e, PARTS).
        """
        first, shear = self.tissue.lame
        w = self.stress[:, None, elements].astype(np.float32)
        g = self.follow[:, None, elements].astype(np.float32)
        turned = np.swapaxes(g, -1, -2)
        h, t = slopes.gradient.astype(np.float32), slopes.trace.astype(np.float32)[..., None, None]
        press = np.float32(first) * slopes.mean.astype(np.float32)[..., None, None]
        spread = (first * (self.pressure @ self.tissue.mesh.averaging)[:, None, elements]).astype(np.float32)
        spread = spread[..., None, None]
        across = np.swapaxes(h, -1, -2)
        mu = np.float32(shear)
        wide = widened.astype(np.float32)[..., None, None]
        trace = np.einsum("rceii->rce", g)[..., None, None]
        told = mu * np.einsum("reij,ceij->rce", w[:, 0], h, optimize=True)[..., None, None]
        back = mu * np.swapaxes(g @ h, -1, -2)
        one = np.eye(3, dtype=np.float32)
        out = np.empty((*wide.shape[:3], PARTS), np.float32)
        shape = (*wide.shape[:3], 9)
        part = 2.0 * mu * (w @ h - t * w) + mu * np.swapaxes(h @ g, -1, -2) + back - spread * across + press * turned
        out[..., :9] = (part + (spread * t - 2.0 * told - press * trace + wide) * one).reshape(shape)
        part = (spread / 3.0) * across - back - press * turned
        out[..., 9:18] = (part + (told - spread * t / 6.0 + 0.5 * press * trace - 0.5 * wide) * one).reshape(shape)
        out[..., 18:27] = (press * turned - (spread / 3.0) * across).reshape(shape)
        out[..., 27:36] = (-mu * t * w).reshape(shape)
        out[..., 36] = (told + spread * t / 6.0 - 0.5 * press * trace + 0.5 * wide)[..., 0, 0]
        return out.reshape(-1, *out.shape[2:])
