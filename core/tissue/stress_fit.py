"""The stress of patterns beyond linear tissue's, from a mesh: squares and cubes of how much of each there is.

Which fields of stress matter is seen in what touches bring; how much of each a product of amounts brings is exact.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..arrays import Array
from ..stiffening.energy import Energy
from ..stiffening.stress_series import StressSeries
from ..stiffening.symmetric import rising
from .held_tissue import HeldTissue
from .jets import jets
from .pair_fields import Slopes, pair_fields, second_displacements, to_nodes
from .stress_reading import StressReading

AT_ONCE = 12  # displacements whose series are in memory together
CHUNK = 200  # elements whose products of patterns are in memory together
_TWICE = np.sqrt([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def fit_stress(
    linear: HeldTissue, patterns: Array, energy: Energy, samples: Array, few: int, rank: int
) -> Generator[tuple[int, int], None, StressSeries]:
    """Return the stress of patterns; yields (done, steps).

    Args:
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3).
        energy: of the patterns. samples: amounts that touches bring, which say what matters, shape (s, k).
        few: of how many patterns cubes are kept, as many as the energy's fourth power at most. rank: fields to keep.
    """
    tissue, mesh = linear.tissue, linear.tissue.mesh
    batches = [samples[s : s + AT_ONCE] for s in range(0, len(samples), AT_ONCE)]
    starts = range(0, len(mesh.tetrahedra), CHUNK)
    steps = len(batches) + 2 + len(starts)
    weight = (np.sqrt(mesh.volumes)[:, None] * _TWICE).ravel()
    own = _linear_stress(linear, patterns)
    seen = []
    for n, batch in enumerate(batches):
        yield n + 1, steps
        seen.append(_beyond(linear, patterns, own, energy, batch))
    right = np.linalg.svd(np.concatenate(seen) * weight, full_matrices=False)[2][:rank]
    reading = StressReading.of(linear, (right * weight).reshape(len(right), -1, 6))
    yield len(batches) + 1, steps
    slopes, first = Slopes.of(tissue, patterns), (right * weight) @ own.T
    squares = reading.squares(slopes) - first @ _slopes_of_squares(energy).T
    yield len(batches) + 2, steps
    cubes = np.zeros((len(right) * few, few * (few + 1) // 2))
    for done, part in cubes_of(linear, reading, slopes.first(few)):
        cubes += part
        yield len(batches) + 2 + done, steps
    cubes = rising_cubes(cubes.reshape(len(right), few, -1)) - first[:, : energy.few] @ _slopes_of_cubes(energy, few).T
    fields = np.ascontiguousarray((right / weight).T.reshape(len(mesh.tetrahedra), 6, -1), np.float32)
    return StressSeries(mesh.nodes, mesh.tetrahedra, fields, squares.astype(np.float32), cubes.astype(np.float32))


def _linear_stress(linear: HeldTissue, moved: Array) -> Array:
    """Return the linear stress of displacements, (b, n, 3) to (b, 6 e)."""
    return linear.tissue.response(np.stack([np.zeros_like(moved), moved])).cauchy()[1].reshape(len(moved), -1)


def _beyond(linear: HeldTissue, patterns: Array, own: Array, energy: Energy, amounts: Array) -> Array:
    """Return the second and the third power of the stress beyond linear tissue's, shape (2 s, 6 e)."""
    series = jets(linear.tissue, linear.free_held, np.asarray(np.tensordot(amounts, patterns, axes=1), np.float64), 3)
    stress = linear.tissue.response(series).cauchy().reshape(4, len(amounts), -1)
    force = np.array([energy.force(q) for q in amounts])
    square = 3.0 * np.einsum("abc,sb,sc->sa", energy.cubic, amounts, amounts, optimize=True)
    return np.concatenate([stress[2] - square @ own, stress[3] - (force - square) @ own])


def cubes_of(linear: HeldTissue, reading: StressReading, slopes: Slopes) -> Generator[tuple[int, Array], None, None]:
    """Yield parts of what multiplies a pair and one more pattern in the amounts, shape (r few, pairs)."""
    tissue, mesh = linear.tissue, linear.tissue.mesh
    first, few = tissue.lame[0], len(slopes.trace)
    a, b = rising(few, 2)
    follow = second_displacements(linear, slopes)
    pressed = to_nodes(mesh, reading.pressed(slopes).reshape(-1, len(mesh.tetrahedra)))
    by_trace = first * (reading.pressure[:, None] * slopes.nodal).reshape(len(pressed), -1)
    squares = np.where(a == b, 1.0, 2.0)[:, None] * slopes.nodal[a] * slopes.nodal[b]
    nodal = (11.0 / 6.0 * by_trace - 1.5 * pressed) @ squares.T
    widened = ((pressed - 3.0 * by_trace) @ mesh.averaging).reshape(-1, few, len(mesh.tetrahedra))
    for n, start in enumerate(range(0, len(mesh.tetrahedra), CHUNK)):
        chunk = slice(start, start + CHUNK)
        here = Slopes(slopes.gradient[:, chunk], slopes.trace[:, chunk], slopes.nodal, slopes.mean[:, chunk])
        moved = follow[:, mesh.tetrahedra[chunk]]
        gradients = np.einsum("peai,eaj->peij", moved, tissue.geometry.gradients[chunk], optimize=True)
        fields = pair_fields(here, gradients)
        dual = reading.dual(here, chunk, widened[..., chunk])
        part = (dual.reshape(len(dual), -1) @ fields.reshape(len(fields), -1).T).astype(np.float64)
        yield n + 1, part if n else part + nodal


def rising_cubes(cubes: Array) -> Array:
    """Return what multiplies q_a q_b q_c, a <= b <= c, from pairs and one more, (r, few, pairs) to (r, triples)."""
    few = cubes.shape[1]
    pair, one = np.meshgrid(np.arange(cubes.shape[2]), np.arange(few))
    a, b = rising(few, 2)
    order = np.sort(np.stack([a[pair], b[pair], one]).reshape(3, -1), axis=0)
    code = (order[0] * few + order[1]) * few + order[2]
    i, j, k = rising(few, 3)
    place = np.searchsorted((i * few + j) * few + k, code)
    flat = cubes.reshape(len(cubes), -1)
    return np.stack([np.bincount(place, row, minlength=len(i)) for row in flat])


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
    slope = energy.quartic[at[a, b][:, None], at[c[:, None], np.arange(energy.few)]]
    return np.asarray(4.0 * often[:, None] * slope)
