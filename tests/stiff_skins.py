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
FEW, LARGE_FIELDS, LARGE_CUBES = 40, 60, 10  # of large tables: patterns to the fourth power, fields, patterns in cubes
USUAL = 1e-4  # amount of a pattern under about a newton [m^1.5]


def stiff_skin(level: str = "draft", seed: int = 0, strength: float = 1.0) -> SkinModel:
    """Return a fingertip of the default preset's shape whose tissue stiffens in a few smooth patterns."""
    skin = fingertip_skin(level=level)
    return skin.with_stiffening(stiffening_of(skin, seed, strength))


def stiffening_of(skin: SkinModel, seed: int = 0, strength: float = 1.0, count: int = COUNT) -> Stiffening:
    """Return a made-up stiffening of a skin, `strength` times as strong as about a third of its force at 1 N.

    Args:
        count: of patterns; with more than `COUNT` it is as large as a table of real tissue, and costs as much.
    """
    rng, positions = np.random.default_rng(seed), skin.positions
    loads = np.zeros((skin.pad_count, 3, count))
    for a in range(count):
        at = np.zeros(2) if a in (0, 1, 2) else rng.uniform(-2e-3, 2e-3, 2)
        bump = np.exp(-((positions[:, :2] - at) ** 2).sum(axis=1) / (2 * 3e-3**2)) * skin.areas
        loads[:, (2, 0, 1)[a % 3], a] = bump
    flat = loads.reshape(-1, count)
    lower = np.linalg.cholesky(flat.T @ skin.unit_compliance @ flat)
    flat = np.linalg.solve(lower, flat.T).T
    patterns = Patterns.through(positions, (skin.unit_compliance @ flat).reshape(-1, 3, count))
    return Stiffening(
        _energy(rng, strength, count), patterns, _stress(rng, skin, strength, count), f"made {seed} {strength} {count}"
    )


def _energy(rng: np.random.Generator, strength: float, k: int) -> Energy:
    cubic = rng.standard_normal((k, k, k))
    cubic = sum(cubic.transpose(p) for p in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))) / 6.0
    one = np.eye(min(k, FEW))
    whole = np.einsum("ab,cd->abcd", one, one)
    whole = (whole + whole.transpose(0, 2, 1, 3) + whole.transpose(0, 3, 2, 1)) / 3.0
    i, j = np.triu_indices(len(one))
    quartic = whole[i, j][:, i, j]
    kept = np.float64 if k <= COUNT else np.float32  # as in files
    third, fourth = 0.02 * strength / USUAL * np.sqrt(COUNT / k) ** 3 * cubic, 0.1 * strength / USUAL**2 * quartic
    return Energy(third.astype(kept), fourth.astype(kept))


def _stress(rng: np.random.Generator, skin: SkinModel, strength: float, count: int) -> StressSeries:
    mesh, rows, few = skin.mesh, (FIELDS, LARGE_FIELDS)[count > COUNT], min(count, LARGE_CUBES)
    places = 1e2 * mesh.nodes[mesh.tetrahedra].mean(axis=1)
    waves = np.stack([np.ones(len(places)), *(np.cos(places @ rng.standard_normal(3)) for _ in range(rows - 1))], 1)
    fields = np.einsum("nr,cr->ncr", waves, rng.standard_normal((6, rows)))
    two, three = count * (count + 1) // 2, few * (few + 1) * (few + 2) // 6
    return StressSeries(
        mesh.nodes,
        mesh.tetrahedra,
        fields.astype(np.float32),
        (0.01 * strength / USUAL**2 * rng.standard_normal((rows, two))).astype(np.float32),
        (0.005 * strength / USUAL**3 * rng.standard_normal((rows, three))).astype(np.float32),
    )
