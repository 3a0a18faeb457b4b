"""The exact law of a mesh's tissue in a few fields and on a few of its elements, from displacements that show it.

What is beneath a pad that is held is smooth and alike from touch to touch, what the pad does is not: fields are sought
for each alone. Linear tissue beneath follows the pad exactly; fields and pressures are what comes beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Floats32, Indices
from ..skin.assembly import degrees
from ..stiffening.beyond_law import BeyondLaw
from ..stiffening.sampled_tissue import SampledTissue
from .cubature import sampled
from .held_tissue import HeldTissue
from .neo_hookean import NeoHookean

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SUMS = 40  # random sums over elements that each state is judged by
_FAINT = 0.05  # of the largest state: smaller ones do not count for as much
_ALONE = 1e-10  # of the largest share of what is seen: less is noise


@dataclass(frozen=True)
class SampledSize:
    """How much is kept: patterns of the pad, fields beneath it, pressures, elements, states that judge these."""

    patterns: int = 400
    beneath: int = 300
    pressures: int = 300
    elements: int = 1800
    judged: int = 300


@dataclass(frozen=True, eq=False)
class Bases:
    """Fields that displacements are told in.

    Attributes:
        pad: patterns of the pad, each storing energy 1/2 in linear tissue at E = 1, shape (k, 3 m).
        linear: displacement of all nodes that follows them in linear tissue, shape (k, n, 3).
        beneath: displacement beyond it, zero on the pad, shape (j, n, 3).
        pressure: of the nodes beyond linear tissue's, shape (r, n).
        amounts: of each pattern, field and pressure in the displacements that they were made of, (s, k + j + r).
    """

    pad: Array
    linear: Array
    beneath: Array
    pressure: Array
    amounts: Array


def fit_bases(held: HeldTissue, stiffness: Array, states: Array, size: SampledSize) -> Bases:
    """Return the fields that hold most of what displacements of all nodes show.

    Args:
        stiffness: of the pad in linear tissue at E = 1, shape (3 m, 3 m). states: balanced tissue, shape (s, n, 3) [m].
    """
    tissue = held.tissue
    flat = states.reshape(len(states), -1)
    pads = np.ascontiguousarray(flat[:, degrees(tissue.mesh.pad)])
    linear = held.followed(np.ascontiguousarray(pads.T))
    sheared = distortion(tissue)
    sizes = np.sqrt(np.einsum("sd,sd->s", pads, pads @ stiffness))
    weight = 1.0 / (sizes + _FAINT * sizes.max())
    pad = _main(pads, pads @ stiffness, weight, size.patterns)
    beyond = (states - linear).reshape(len(states), -1)
    beneath = _main(beyond, (sheared @ beyond.T).T, weight, size.beneath)
    volumes = tissue.geometry.nodal_volumes
    pressure = np.array([tissue.response(u[None, None]).nodal[0, 0] for u in states]) - linear_pressure(tissue, linear)
    pressures = _main(pressure, pressure * volumes, weight, size.pressures)
    amounts = [pads @ stiffness @ pad.T, (sheared @ beyond.T).T @ beneath.T, (pressure * volumes) @ pressures.T]
    moved = held.followed(np.ascontiguousarray(pad.T))
    return Bases(pad, moved, beneath.reshape(len(beneath), -1, 3), pressures, np.concatenate(amounts, axis=1))


def fit_sampled(tissue: NeoHookean, bases: Bases, size: SampledSize, *, seed: int = 0) -> SampledTissue:
    """Return tissue on the elements that stand for all in the states that the bases were made of."""
    return on_elements(tissue, bases, *fit_elements(tissue, bases, size, seed=seed))


def fit_elements(tissue: NeoHookean, bases: Bases, size: SampledSize, *, seed: int = 0) -> tuple[Indices, Array]:
    """Return the elements that stand for all, rising, and for what volume each does [m^3]."""
    whole = on_elements(tissue, bases, np.arange(len(tissue.mesh.tetrahedra)), np.asarray(tissue.geometry.volumes))
    judged = bases.amounts[:: -(-len(bases.amounts) // size.judged)]
    rows = _shares(whole, judged, np.random.default_rng(seed))
    elements, share, _ = sampled(rows, size.elements)
    return elements, share * tissue.geometry.volumes[elements]


def on_elements(tissue: NeoHookean, bases: Bases, elements: Indices, weights: Array) -> SampledTissue:
    """Return tissue summed over some elements, which stand for so much volume [m^3]."""
    mesh, (first, shear) = tissue.mesh, tissue.lame
    moved = np.concatenate([bases.linear, bases.beneath])
    pressed = np.concatenate([linear_pressure(tissue, bases.linear), bases.pressure])
    own = bases.beneath.reshape(len(bases.beneath), -1)
    widening = np.stack([_trace(tissue, u) for u in bases.beneath]) * tissue.geometry.volumes
    mean = bases.pressure[:, mesh.tetrahedra].mean(axis=-1)
    below, half = own @ (distortion(tissue) @ own.T), widening @ mean.T
    squeezed = -(bases.pressure * tissue.geometry.nodal_volumes) @ bases.pressure.T / first
    inner = np.block([[below, half], [half.T, squeezed]])
    nodes, corners = np.unique(mesh.tetrahedra[elements], return_inverse=True)
    return SampledTissue(
        BeyondLaw(first, shear),
        np.ascontiguousarray(moved[:, nodes].reshape(len(moved), -1).T, np.float32),
        np.ascontiguousarray(pressed[:, nodes].T, np.float32),
        corners.reshape(-1, 4),
        tissue.geometry.gradients[elements].astype(np.float32),
        weights.astype(np.float32),
        0.5 * (inner + inner.T),
    )


def distortion(tissue: NeoHookean) -> csr_array:
    """Return the stiffness of linear tissue at E = 1 without its pressure, mu (|H|^2 + tr H^2) / 2, (3 n, 3 n)."""
    from scipy.sparse import coo_array

    g, mesh, shear = tissue.geometry, tissue.mesh, tissue.lame[1]
    blocks = np.einsum("eaj,ebi->eaibj", g.gradients, g.gradients)
    dots = np.einsum("eak,ebk->eab", g.gradients, g.gradients)
    for i in range(3):
        blocks[:, :, i, :, i] += dots
    blocks *= (shear * g.volumes)[:, None, None, None, None]
    rows = degrees(mesh.tetrahedra.ravel()).reshape(-1, 12)
    at = (np.repeat(rows, 12, axis=1).ravel(), np.tile(rows, (1, 12)).ravel())
    size = mesh.nodes.size
    return coo_array((blocks.ravel(), at), shape=(size, size)).tocsr()


def linear_pressure(tissue: NeoHookean, displacements: Array) -> Array:
    """Return the pressure of the nodes in linear tissue, (b, n, 3) to (b, n)."""
    traces = np.stack([_trace(tissue, u) for u in displacements])
    return np.asarray(tissue.lame[0] * (traces @ tissue.mesh.averaging.T))


def _trace(tissue: NeoHookean, displacement: Array) -> Array:
    return np.einsum("eai,eai->e", displacement[tissue.mesh.tetrahedra], tissue.geometry.gradients)


def _main(values: Array, dual: Array, weight: Array, count: int) -> Array:
    """Return the main components of rows, orthonormal in the form that `dual` has been through, (c, d)."""
    gram = (values @ dual.T) * weight * weight[:, None]
    found, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    chosen = np.argsort(-found, kind="stable")[:count]
    chosen = chosen[found[chosen] > _ALONE * found[chosen[0]]]
    return np.asarray((vectors[:, chosen] / np.sqrt(found[chosen])).T @ (weight[:, None] * values))


def _shares(tissue: SampledTissue, amounts: Array, rng: np.random.Generator) -> Floats32:
    """Return what each element brings to random sums of the forces of states, shape (sums, e)."""
    k = tissue.count
    sizes = np.linalg.norm(amounts[:, :k], axis=1) ** 1.5
    out = []
    for state, size in zip(amounts, sizes + 0.1 * sizes.max(), strict=True):
        mix = rng.standard_normal((amounts.shape[1], SUMS)).astype(np.float32)
        out.append(tissue.shares(state[:k], state[k:], mix) / np.float32(size))
    return np.concatenate(out)
