"""Skin that stiffens for tests: smooth patterns of a small skin, with an energy and fields of stress made up.

What is asked of those who use such skin is that they obey its law, whatever it is: a made one is ready at once, and
as strong as one likes.
"""

from __future__ import annotations

import numpy as np

from core.skin.model import SkinModel, fingertip_skin
from core.stiffening.energy import Energy
from core.stiffening.patterns import Patterns
from core.stiffening.stiffening import Stiffening
from core.stiffening.stress_series import StressSeries

COUNT, FIELDS = 5, 4
USUAL = 1e-4  # amount of a pattern under about a newton [m^1.5]


def stiff_skin(level: str = "draft", seed: int = 0, strength: float = 1.0) -> SkinModel:
    """Return a fingertip of the default preset's shape whose tissue stiffens in a few smooth patterns."""
    skin = fingertip_skin(level=level)
    return skin.with_stiffening(stiffening_of(skin, seed, strength))


def stiffening_of(skin: SkinModel, seed: int = 0, strength: float = 1.0) -> Stiffening:
    """Return a made-up stiffening of a skin, `strength` times as strong as about a third of its force at 1 N."""
    rng, positions = np.random.default_rng(seed), skin.positions
    loads = np.zeros((skin.pad_count, 3, COUNT))
    for a in range(COUNT):
        at = np.zeros(2) if a in (0, 1, 2) else rng.uniform(-2e-3, 2e-3, 2)
        bump = np.exp(-((positions[:, :2] - at) ** 2).sum(axis=1) / (2 * 3e-3**2)) * skin.areas
        loads[:, (2, 0, 1)[a % 3], a] = bump
    flat = loads.reshape(-1, COUNT)
    lower = np.linalg.cholesky(flat.T @ skin.unit_compliance @ flat)
    flat = np.linalg.solve(lower, flat.T).T
    patterns = Patterns.through(positions, (skin.unit_compliance @ flat).reshape(-1, 3, COUNT))
    return Stiffening(_energy(rng, strength), patterns, _stress(rng, skin, strength), f"made {seed} {strength}")


def _energy(rng: np.random.Generator, strength: float) -> Energy:
    k = COUNT
    cubic = rng.standard_normal((k, k, k))
    cubic = sum(cubic.transpose(p) for p in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))) / 6.0
    one = np.eye(k)
    whole = np.einsum("ab,cd->abcd", one, one)
    whole = (whole + whole.transpose(0, 2, 1, 3) + whole.transpose(0, 3, 2, 1)) / 3.0
    i, j = np.triu_indices(k)
    quartic = whole[i, j][:, i, j]
    return Energy(0.02 * strength / USUAL * cubic, 0.1 * strength / USUAL**2 * quartic)


def _stress(rng: np.random.Generator, skin: SkinModel, strength: float) -> StressSeries:
    mesh = skin.mesh
    places = 1e2 * mesh.nodes
    waves = np.stack([np.ones(len(places)), *(np.cos(places @ rng.standard_normal(3)) for _ in range(FIELDS - 1))], 1)
    fields = np.einsum("nr,cr->ncr", waves, rng.standard_normal((6, FIELDS)))
    two, three = COUNT * (COUNT + 1) // 2, COUNT * (COUNT + 1) * (COUNT + 2) // 6
    return StressSeries(
        mesh.nodes,
        mesh.tetrahedra,
        fields.astype(np.float32),
        (0.01 * strength / USUAL**2 * rng.standard_normal((FIELDS, two))).astype(np.float32),
        (0.005 * strength / USUAL**3 * rng.standard_normal((FIELDS, three))).astype(np.float32),
    )
