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
from .mode_fields import ModeFields
from .pair_fields import Slopes, to_nodes
from .pair_modes import PairModes
from .stress_reading import StressReading

AT_ONCE = 12  # displacements whose series are in memory together
CHUNK = 200  # elements whose products of patterns are in memory together
_TWICE = np.sqrt([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def fit_stress(
    linear: HeldTissue, patterns: Array, energy: Energy, samples: Array, products: ModeFields, rank: int
) -> Generator[tuple[int, int], None, StressSeries]:
    """Return the stress of patterns; yields (done, steps).

    Args:
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3).
        energy: of the patterns. samples: amounts that touches bring, which say what matters, shape (s, k).
        products: of the ways that their products go. rank: fields to keep.
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
    cubes, modes = np.zeros((len(right) * len(patterns), len(products.elements))), products.modes
    for done, part in cubes_of(reading, slopes, products):
        cubes += part
        yield len(batches) + 2 + done, steps
    cubes = by_feature(cubes, len(patterns)) - _cubes_of_forces(energy, first, modes)
    fields = np.ascontiguousarray((right / weight).T.reshape(len(mesh.tetrahedra), 6, -1), np.float32)
    kept = squares.astype(np.float32), cubes.astype(np.float32)
    return StressSeries(mesh.nodes, mesh.tetrahedra, fields, *kept, modes.features)


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


def cubes_of(
    reading: StressReading, patterns: Slopes, products: ModeFields
) -> Generator[tuple[int, Array], None, None]:
    """Yield parts of what multiplies a feature of products and one more pattern in the amounts, shape (r k, f)."""
    mesh, first = reading.tissue.mesh, reading.tissue.lame[0]
    pressed = to_nodes(mesh, reading.pressed(patterns).reshape(-1, len(mesh.tetrahedra)))
    by_trace = first * (reading.pressure[:, None] * patterns.nodal).reshape(len(pressed), -1)
    nodal = (11.0 / 6.0 * by_trace - 1.5 * pressed) @ products.nodal
    widened = ((pressed - 3.0 * by_trace) @ mesh.averaging).reshape(len(reading.stress), -1, len(mesh.tetrahedra))
    for n, start in enumerate(range(0, len(mesh.tetrahedra), CHUNK)):
        chunk = slice(start, start + CHUNK)
        dual = reading.dual(patterns.within(chunk), chunk, widened[..., chunk])
        fields = products.elements[:, chunk].reshape(len(products.elements), -1)
        part = (dual.reshape(len(dual), -1) @ fields.T).astype(np.float64)
        yield n + 1, part if n else part + nodal


def by_feature(cubes: Array, count: int) -> Array:
    """Return what `cubes_of` told as series have it, shapes (r k, f) to (r, f, k)."""
    return np.ascontiguousarray(cubes.reshape(-1, count, cubes.shape[1]).transpose(0, 2, 1))


def _slopes_of_squares(energy: Energy) -> Array:
    """Return what multiplies q_a q_b, a <= b, in the slope of Phi3, shape (pairs, k)."""
    i, j = rising(energy.count, 2)
    return np.asarray(3.0 * np.where(i == j, 1.0, 2.0)[:, None] * energy.cubic[i, j])


def _cubes_of_forces(energy: Energy, first: Array, modes: PairModes) -> Array:
    """Return what the slope of Phi4 brings to amounts that are linear in it, first (r, k), to (r, f, k)."""
    along = np.array([energy.features.along(q) for q in modes.samples])
    amounts = np.einsum("sfk,sk->sf", along, modes.samples) * energy.signs
    told = modes.shares.T @ amounts  # features of the energy, for each of these
    forms = np.array([energy.features.summed(w) for w in told])  # f, k, k
    return 4.0 * np.einsum("rc,fck->rfk", first, forms, optimize=True)
