"""How tissue follows patterns beyond linear tissue, from a mesh: squares and cubes of how much of each there is."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..arrays import Array
from ..stiffening.following import Following
from .held_tissue import HeldTissue
from .jets import jets
from .mode_fields import ModeFields
from .pair_fields import Slopes
from .stress_fit import AT_ONCE, CHUNK, by_feature, cubes_of
from .stress_reading import StressReading

LENGTH = 2e-3  # [m] over which a displacement counts as the strain that it is


def fit_following(
    linear: HeldTissue, patterns: Array, samples: Array, products: ModeFields, rank: int, cubed: int
) -> Generator[tuple[int, int], None, Following]:
    """Return how tissue follows patterns; yields (done, steps).

    Args:
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3).
        samples: amounts that touches bring, which say what matters, shape (s, k).
        products: of the ways that their products go. rank: fields to keep.
        cubed: how many of them, the first, have a third power, which is smoother than the second.
    """
    tissue, mesh = linear.tissue, linear.tissue.mesh
    batches = [samples[s : s + AT_ONCE] for s in range(0, len(samples), AT_ONCE)]
    chunks = -(-len(mesh.tetrahedra) // CHUNK)
    steps = len(batches) + 1 + chunks
    flat = nodal_weight(linear).ravel()
    seen = []
    for n, batch in enumerate(batches):
        yield n + 1, steps
        seen.append(_followed(linear, patterns, batch) * flat)
    powers = np.concatenate(seen, axis=1)
    powers /= np.linalg.norm(powers[0], axis=1)[:, None]  # a faint touch is told as well as a strong one
    right = np.linalg.svd(powers.reshape(-1, powers.shape[2]), full_matrices=False)[2][:rank]
    reading = StressReading.of_following(linear, (right * flat).reshape(len(right), -1, 4))
    slopes, main = Slopes.of(tissue, patterns), reading.first(cubed)
    squares = reading.squares(slopes)
    yield len(batches) + 1, steps
    cubes = np.zeros((len(main.stress) * len(patterns), len(products.elements)))
    for done, part in cubes_of(main, slopes, products):
        cubes += part
        yield len(batches) + 1 + done, steps
    fields = (right / flat).T.reshape(len(mesh.nodes), 4, -1)
    return Following(
        np.ascontiguousarray(fields, np.float32),
        squares.astype(np.float32),
        by_feature(cubes, len(patterns)).astype(np.float32),
        products.modes.features,
    )


def nodal_weight(linear: HeldTissue) -> Array:
    """Return what displacement [m] and pressure of the nodes count for, shape (n, 4)."""
    tissue = linear.tissue
    return np.sqrt(tissue.geometry.nodal_volumes)[:, None] * np.array([tissue.lame[1] / LENGTH] * 3 + [1.0])


def _followed(linear: HeldTissue, patterns: Array, amounts: Array) -> Array:
    """Return displacement and nodal pressure of the second and the third power, shape (2, s, 4 n)."""
    moved = np.asarray(np.tensordot(amounts, patterns, axes=1), np.float64)
    series = jets(linear.tissue, linear.free_held, moved, 3)
    nodal = linear.tissue.response(series).nodal
    return np.concatenate([series[2:], nodal[2:, ..., None]], axis=-1).reshape(2, len(amounts), -1)
