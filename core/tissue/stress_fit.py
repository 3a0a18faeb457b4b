"""The stress of patterns beyond linear tissue's, from a mesh: squares and cubes of how much of each there is."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..arrays import Array
from ..skin.stress import nodal_average
from ..stiffening.energy import Energy
from ..stiffening.stress_series import StressSeries
from ..stiffening.symmetric import rising
from .held_tissue import HeldTissue
from .jets import jets

AT_ONCE = 24  # displacements whose series are in memory together
_TWICE = np.sqrt([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def fit_stress(
    linear: HeldTissue, patterns: Array, energy: Energy, samples: Array, few: int, rank: int
) -> Generator[tuple[int, int], None, StressSeries]:
    """Return the stress of patterns; yields (done, steps).

    Args:
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3).
        energy: of the patterns. samples: amounts that touches bring, which say what matters, shape (s, k).
        few: of how many patterns cubes are kept. rank: fields to keep.
    """
    mesh, count = linear.tissue.mesh, len(patterns)
    pairs, triples = rising(count, 2).T, rising(few, 3).T
    steps = -(-len(pairs) // AT_ONCE) - (-len(triples) // AT_ONCE)
    first = nodal_average(mesh, _linear_stress(linear, patterns).transpose(1, 0, 2)).transpose(1, 0, 2)
    tables = []
    done = 0
    for combined, power in ((pairs, 2), (triples, 3)):
        parts = []
        for start in range(0, len(combined), AT_ONCE):
            done += 1
            yield done, steps
            parts.append(_coefficients(linear, patterns, combined[start : start + AT_ONCE], power))
        tables.append(np.concatenate(parts))
    size = first[0].size
    flat = first.reshape(count, size)
    tables[0] -= (_slopes_of_squares(energy) @ flat).astype(np.float32)
    tables[1] -= (_slopes_of_cubes(energy, few) @ flat[:few]).astype(np.float32)
    values = [_monomials(samples, pairs), _monomials(samples, triples)]
    weight = np.repeat(np.sqrt(linear.tissue.geometry.nodal_volumes), 6) * np.tile(_TWICE, len(mesh.nodes))
    seen = np.concatenate([v @ t for v, t in zip(values, tables, strict=True)]) * weight
    right = np.linalg.svd(seen, full_matrices=False)[2][:rank]
    amounts = [(right * weight) @ t.T for t in tables]
    fields = (right / weight).T.reshape(len(mesh.nodes), 6, -1)
    return StressSeries(
        mesh.nodes,
        mesh.tetrahedra,
        np.ascontiguousarray(fields, np.float32),
        *(np.ascontiguousarray(a, np.float32) for a in amounts),
    )


def _linear_stress(linear: HeldTissue, moved: Array) -> Array:
    """Return the linear stress of displacements, (b, n, 3) to (b, e, 6)."""
    return np.asarray(linear.tissue.response(np.stack([np.zeros_like(moved), moved])).cauchy()[1])


def _coefficients(linear: HeldTissue, patterns: Array, combined: Array, power: int) -> Array:
    """Return what multiplies products of amounts in the stress at the nodes, shape (b, 6 n), by polarisation."""
    # of q_a q_b q_c it is the sum over the subsets S of {a, b, c} of (-1)^(3 - |S|) f(S), over how often each comes
    out = np.zeros((len(combined), 6 * len(linear.tissue.mesh.nodes)))
    for subset in range(1, 2**power):
        chosen = [i for i in range(power) if subset >> i & 1]
        moved = patterns[combined[:, chosen]].sum(axis=1)
        sign = (-1.0) ** (power - len(chosen))
        out += sign * _stress_of_power(linear, moved, power).reshape(len(combined), -1)
    repeats = np.ones(len(combined))
    for i in range(power):
        repeats *= 1.0 + (combined[:, :i] == combined[:, i : i + 1]).sum(axis=1)
    return (out / repeats[:, None]).astype(np.float32)


def _stress_of_power(linear: HeldTissue, moved: Array, power: int) -> Array:
    """Return the part of a power in the stress of displaced skin, averaged around the nodes, (b, n, 3) to (b, n, 6)."""
    tissue = linear.tissue
    series = jets(tissue, linear.free_held, moved, power)
    stress = tissue.response(series).cauchy()[power]
    return nodal_average(tissue.mesh, stress.transpose(1, 0, 2)).transpose(1, 0, 2)


def _monomials(samples: Array, combined: Array) -> Array:
    return np.asarray(samples[:, combined].prod(axis=2))


def _slopes_of_squares(energy: Energy) -> Array:
    """Return what multiplies q_a q_b, a <= b, in the slope of Phi3, shape (pairs, k)."""
    i, j = rising(energy.count, 2)
    return np.asarray(3.0 * np.where(i == j, 1.0, 2.0)[:, None] * energy.cubic[i, j])


def _slopes_of_cubes(energy: Energy, few: int) -> Array:
    """Return what multiplies q_a q_b q_c, a <= b <= c, in the slope of Phi4, shape (triples, few)."""
    a, b, c = rising(few, 3)
    i, j = rising(energy.few, 2)
    at = np.zeros((energy.few, energy.few), np.int64)
    at[i, j] = at[j, i] = np.arange(len(i))
    same = np.stack([a == b, b == c])
    often = np.where(same.all(axis=0), 1.0, np.where(same.any(axis=0), 3.0, 6.0))
    rows = energy.quartic[at[a, b]]
    slope = rows[np.arange(len(a))[:, None], at[c[:, None], np.arange(few)]]
    return np.asarray(4.0 * often[:, None] * slope)
