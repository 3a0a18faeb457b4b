"""Skin that stiffens by a made-up law: what is shown, stored and solved with it need not wait for a real table.

The energy is convex and its fourth power is felt from half a millimetre on; fields of stress are smooth.
"""

from __future__ import annotations

import numpy as np

from core.arrays import Array, Floats32
from core.cache import Cache
from core.skin.model import SkinModel, fingertip_skin
from core.skin.shape import FingertipShape
from core.stiffening.energy import Energy
from core.stiffening.features import Features
from core.stiffening.patterns import Patterns
from core.stiffening.stiffening import Stiffening
from core.stiffening.stress_series import StressSeries
from core.tissue.stiffening_store import stiffening_key

TYPICAL = 5e-5  # |q| of a press of a millimetre at 100 kPa [m^1.5]


def made_up(skin: SkinModel, count: int = 5, hardening: float = 0.3, key: str = "made up") -> Stiffening:
    """Return a table for a skin of any level, whose patterns are those of smooth loads on its pad.

    Args:
        hardening: force beyond linear skin's, as a share of it, in a typical press.
    """
    x, y, _ = (skin.positions / 5e-3).T
    waves = [np.exp(-(x**2) - y**2), x, y, x * y, x**2 - y**2, x**2 + y**2][:count]
    loads = np.stack(
        [np.outer(wave, axis).ravel() for wave, axis in zip(waves, np.eye(3)[[2, 0, 1, 2, 0, 1]], strict=False)], 1
    )
    loads = loads @ np.linalg.inv(np.linalg.cholesky(loads.T @ skin.unit_compliance @ loads)).T
    moved = (skin.unit_compliance @ loads).reshape(-1, 3, count)
    i, j = np.triu_indices(count)
    s = np.eye(count)
    four = np.einsum("ab,cd->abcd", s, s)
    four = (four + four.transpose(0, 2, 1, 3) + four.transpose(0, 3, 2, 1)) / 3.0
    quartic = four[i[:, None], j[:, None], i, j] * hardening / (4.0 * TYPICAL**2)
    middles = skin.mesh.nodes[skin.mesh.tetrahedra].mean(axis=1)
    fields = np.stack([np.sin(200.0 * middles @ turn) for turn in _directions(3)], axis=1)
    shares = np.array([1.0, -0.5, 0.8, 0.3, -0.2, 0.4])
    squares = np.ones((3, count * (count + 1) // 2)) * 0.05 / TYPICAL**2
    stress = StressSeries(
        skin.mesh.nodes,
        skin.mesh.tetrahedra,
        (fields[:, None, :] * shares[:, None]).astype(np.float32),
        squares.astype(np.float32),
        *no_cubes(3, count),
    )
    return Stiffening(
        Energy.of_forms(np.zeros((count,) * 3), quartic), Patterns.through(skin.positions, moved), stress, key
    )


def no_cubes(fields: int, count: int) -> tuple[Floats32, Features]:
    """Return what a series has of the third power where it has none."""
    none = Features.of(np.zeros((0, count, count), np.float32), count, 0)
    return np.zeros((fields, 0, count), np.float32), none


def kept(cache: Cache, shape: FingertipShape, poisson: float) -> str:
    """Put a made-up table of a fingertip's draft mesh into a cache, where it is found as a real one; return its key."""
    skin = fingertip_skin(shape, level="draft")
    key = stiffening_key(shape, poisson)
    cache.put(key, made_up(skin, key=key).write)
    return key


def _directions(count: int) -> Array:
    return np.random.default_rng(5).standard_normal((count, 3))
