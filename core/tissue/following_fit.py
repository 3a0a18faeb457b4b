"""How tissue follows patterns beyond linear tissue, from a mesh: squares and cubes of how much of each there is."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..arrays import Array
from ..stiffening.following import Following
from .held_tissue import HeldTissue
from .jets import jets
from .pair_fields import Slopes
from .pair_modes import PairModes
from .stress_fit import AT_ONCE, CHUNK, by_feature, cubes_of
from .stress_reading import StressReading

LENGTH = 2e-3  # [m] over which a displacement counts as the strain that it is


def fit_following(
    linear: HeldTissue, patterns: Array, samples: Array, modes: PairModes, rank: int
) -> Generator[tuple[int, int], None, Following]:
    """Return how tissue follows patterns; yields (done, steps).

    Args:
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3).
        samples: amounts that touches bring, which say what matters, shape (s, k).
        modes: ways that their products go. rank: fields to keep.
    """
    tissue, mesh = linear.tissue, linear.tissue.mesh
    batches = [samples[s : s + AT_ONCE] for s in range(0, len(samples), AT_ONCE)]
    chunks = -(-len(mesh.tetrahedra) // CHUNK)
    steps = len(batches) + 1 + chunks
    shear = tissue.lame[1]
    weight = np.sqrt(tissue.geometry.nodal_volumes)[:, None] * np.array([shear / LENGTH] * 3 + [1.0])
    flat = weight.ravel()
    seen = []
    for n, batch in enumerate(batches):
        yield n + 1, steps
        seen.append(_followed(linear, patterns, batch))
    right = np.linalg.svd(np.concatenate(seen) * flat, full_matrices=False)[2][:rank]
    reading = StressReading.of_following(linear, (right * flat).reshape(len(right), -1, 4))
    squares = reading.squares(Slopes.of(tissue, patterns))
    yield len(batches) + 1, steps
    cubes = np.zeros((len(right) * len(patterns), modes.shares.shape[1]))
    for done, part in cubes_of(linear, reading, patterns, modes):
        cubes += part
        yield len(batches) + 1 + done, steps
    fields = (right / flat).T.reshape(len(mesh.nodes), 4, -1)
    return Following(
        np.ascontiguousarray(fields, np.float32),
        squares.astype(np.float32),
        by_feature(cubes, len(patterns)).astype(np.float32),
        modes.features,
    )


def _followed(linear: HeldTissue, patterns: Array, amounts: Array) -> Array:
    """Return displacement and nodal pressure of the second and the third power, shape (2 s, 4 n)."""
    moved = np.asarray(np.tensordot(amounts, patterns, axes=1), np.float64)
    series = jets(linear.tissue, linear.free_held, moved, 3)
    nodal = linear.tissue.response(series).nodal
    both = np.concatenate([series[2:], nodal[2:, ..., None]], axis=-1)
    return both.reshape(2 * len(amounts), -1)
