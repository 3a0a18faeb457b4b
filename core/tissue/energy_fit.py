"""The energy of patterns of displacement, from a mesh: exact to the fourth power, without a single nonlinear solve."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..skin.assembly import degrees
from ..stiffening.energy import Energy
from .neo_hookean import NeoHookean

AT_ONCE = 400  # elements whose products of patterns are in memory together

Held = Callable[[Array], Array]


def fit_energy(tissue: NeoHookean, held: Held, patterns: Array, few: int) -> Generator[tuple[int, int], None, Energy]:
    """Return the energy of patterns; yields (done, steps).

    Args:
        held: takes forces on the free nodes beneath the pad to their displacement while the pad is held, in linear
            tissue at E = 1, (d, b) to (d, b).
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3).
        few: for how many of the patterns the fourth power is kept.
    """
    mesh, count = tissue.mesh, len(patterns)
    elements = np.arange(len(mesh.tetrahedra))
    chunks = [elements[s : s + AT_ONCE] for s in range(0, len(elements), AT_ONCE)]
    steps = count + 2 * len(chunks)
    fields = _Fields.of(tissue, patterns)
    work = fields.gradient.reshape(count, -1) * np.repeat(tissue.geometry.volumes, 9)
    cubic = []
    for b in range(count):
        pairs = fields.pairs(b, elements)
        stress = _second_order(tissue, fields, pairs, b, elements, pairs.widening @ mesh.averaging.T)
        cubic.append(stress.reshape(len(stress), -1) @ work.T)
        yield 1 + b, steps
    fields = _Fields.of(tissue, patterns[:few])
    quartic = yield from _quartic(tissue, held, fields, chunks, count, steps)
    return Energy(_symmetric_cubic(np.concatenate(cubic)), _symmetric_quartic(quartic, few))


def _symmetric_cubic(slopes: Array) -> Array:
    """Return T from what multiplies q_a q_b, a <= b, in the slope by q_c of Phi3, shapes (pairs, k) to (k, k, k)."""
    count = slopes.shape[1]
    i, j = np.triu_indices(count)
    out = np.zeros((count, count, count))
    out[i, j] = slopes * np.where(i == j, 1.0, 0.5)[:, None] / 3.0
    out[j, i] = out[i, j]
    return (out + out.transpose(1, 2, 0) + out.transpose(2, 0, 1)) / 3.0


def _symmetric_quartic(form: Array, few: int) -> Array:
    """Return R from Phi4 as a quadratic form of the products q_a q_b, a <= b: each product of four has three of it."""
    i, j = np.triu_indices(few)
    twice = np.where(i == j, 1.0, 2.0)
    form = form / (twice[:, None] * twice)
    at = np.zeros((few, few), np.int64)
    at[i, j] = at[j, i] = np.arange(len(i))
    a, b, c, d = i[:, None], j[:, None], i[None], j[None]
    return (form + form[at[a, c], at[b, d]] + form[at[a, d], at[b, c]]) / 3.0


class _Pairs(NamedTuple):
    """What multiplies q_a q_b, for one a and all b from a on; fields that are second powers of the gradient H.

    Attributes:
        square: H H, shape (b, e, 3, 3). widening: the second-order part of J, shape (b, e).
        share: 1, or 1/2 where b is a, shape (b, 1).
    """

    square: Array
    widening: Array
    share: Array


@dataclass(frozen=True, eq=False)
class _Fields:
    """Linear fields of patterns: gradients (k, e, 3, 3), traces (k, e), traces averaged around nodes (k, n)."""

    gradient: Array
    trace: Array
    nodal: Array

    @classmethod
    def of(cls, tissue: NeoHookean, patterns: Array) -> _Fields:
        slopes = tissue.geometry.gradients
        gradient = np.einsum("beai,eaj->beij", patterns[:, tissue.mesh.tetrahedra], slopes, optimize=True)
        trace = np.einsum("beii->be", gradient)
        return cls(gradient, trace, trace @ tissue.mesh.averaging.T)

    def pairs(self, a: int, elements: Indices) -> _Pairs:
        one, others = self.gradient[a, elements], self.gradient[a:, elements]
        share = np.where(np.arange(len(others)) == 0, 0.5, 1.0)[:, None]
        square = share[..., None, None] * (one @ others + others @ one)
        product = self.trace[a, elements] * self.trace[a:, elements] - np.einsum("eij,beji->be", one, others)
        return _Pairs(square, share * product, share)

    def nodal_squares(self, a: int) -> Array:
        """Return what multiplies q_a q_b in the square of the nodal dilatation, shape (b, n)."""
        out: Array = 2.0 * self.nodal[a] * self.nodal[a:]
        out[0] *= 0.5
        return out


def _cofactor(fields: _Fields, pairs: _Pairs, a: int, elements: Indices) -> Array:
    """Return the second-order part of the cofactor of 1 + H, shape (b, e, 3, 3)."""
    turned = np.swapaxes(fields.gradient[:, elements], -1, -2)
    trace = fields.trace[:, elements, None, None]
    out = np.swapaxes(pairs.square, -1, -2) - pairs.share[..., None, None] * (
        trace[a] * turned[a:] + trace[a:] * turned[a]
    )
    for i in range(3):
        out[..., i, i] += pairs.widening
    return out


def _second_order(
    tissue: NeoHookean, fields: _Fields, pairs: _Pairs, a: int, elements: Indices, nodal_widening: Array
) -> Array:
    """Return the second-order stress of linear fields, first Piola-Kirchhoff, shape (b, e, 3, 3)."""
    first, shear = tissue.lame
    tetra = tissue.mesh.tetrahedra[elements]
    pressure = first * fields.nodal[:, tetra].mean(axis=-1)[..., None, None]
    slope = -np.swapaxes(fields.gradient[:, elements], -1, -2)  # of the cofactor: tr H 1 - H'
    for i in range(3):
        slope[..., i, i] += fields.trace[:, elements]
    out = pairs.share[..., None, None] * (pressure[a] * slope[a:] + pressure[a:] * slope[a])
    out -= shear * np.swapaxes(pairs.square, -1, -2)
    squeeze = first * (nodal_widening - 1.5 * fields.nodal_squares(a))[:, tetra].mean(axis=-1)
    for i in range(3):
        out[..., i, i] += squeeze
    return out


def _quartic(
    tissue: NeoHookean, held: Held, fields: _Fields, chunks: list[Indices], done: int, steps: int
) -> Generator[tuple[int, int], None, Array]:
    """Return the fourth power as a quadratic form of pairs.

    mu tr(H^4) / 4 and lambda (j2^2 - 3 j1^2 j2 + 11/12 j1^4 + 2 j1 j3) / 2, j the powers of a nodal J; less what tissue
    gains that follows in second order, r' K^-1 r / 2 of the forces r that it was left with.
    """
    mesh, few = tissue.mesh, len(fields.gradient)
    first, shear = tissue.lame
    rows = np.concatenate([[0], np.cumsum(np.arange(few, 0, -1))])
    size = int(rows[-1])
    widening = np.zeros((size, len(mesh.nodes)))
    for n, chunk in enumerate(chunks):
        averaging = mesh.averaging[:, chunk].T
        for a in range(few):
            widening[rows[a] : rows[a + 1]] += fields.pairs(a, chunk).widening @ averaging
        yield done + n + 1, steps
    squares = np.concatenate([fields.nodal_squares(a) for a in range(few)])
    volumes = tissue.geometry.nodal_volumes
    out = 0.5 * first * ((widening - 3.0 * squares) * volumes) @ widening.T
    out += (11.0 / 24.0) * first * (squares * volumes) @ squares.T
    left = np.zeros((size, len(mesh.nodes), 3))
    for n, chunk in enumerate(chunks):
        shape = (size, len(chunk), 3, 3)
        square, cofactor, pressed = np.empty(shape), np.empty(shape), np.empty(shape)
        nodes, places = np.unique(mesh.tetrahedra[chunk], return_inverse=True)
        gather = np.zeros((len(nodes), 4 * len(chunk)))
        gather[places.ravel(), np.arange(4 * len(chunk))] = 1.0
        weight = tissue.geometry.volumes[chunk]
        slopes = tissue.geometry.gradients[chunk] * weight[:, None, None]
        mean = fields.nodal[:, mesh.tetrahedra[chunk]].mean(axis=-1)[..., None, None]
        for a in range(few):
            own = slice(rows[a], rows[a + 1])
            pairs = fields.pairs(a, chunk)
            gradient = fields.gradient[:, chunk]
            square[own], cofactor[own] = pairs.square, _cofactor(fields, pairs, a, chunk)
            pressed[own] = pairs.share[..., None, None] * (mean[a] * gradient[a:] + mean[a:] * gradient[a])
            stress = _second_order(tissue, fields, pairs, a, chunk, widening[own])
            held_by = np.einsum("beij,eaj->beai", stress, slopes).reshape(len(stress), -1, 3)
            left[own, nodes] += np.einsum("nc,bci->bni", gather, held_by, optimize=True)
        turned = np.swapaxes(square, -1, -2).reshape(size, -1)
        square *= weight[:, None, None]
        cofactor *= weight[:, None, None]
        out += 0.25 * shear * square.reshape(size, -1) @ turned.T
        out += first / 3.0 * pressed.reshape(size, -1) @ cofactor.reshape(size, -1).T
        yield done + len(chunks) + n + 1, steps
    forces = left.reshape(size, -1)[:, degrees(np.setdiff1d(mesh.free, mesh.pad))]
    out -= 0.5 * forces @ held(np.ascontiguousarray(forces.T))
    return 0.5 * (out + out.T)
