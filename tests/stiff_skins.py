"""Skin that stiffens for tests: smooth patterns of a small skin, with an energy and fields of stress made up.

What is asked of those who use such skin is that they obey its law, whatever it is: a made one is ready at once, and
as strong as one likes.
"""

from __future__ import annotations

import numpy as np

from core.skin.model import SkinModel, fingertip_skin
from core.stiffening.cubic import Cubic
from core.stiffening.energy import Energy
from core.stiffening.features import Features
from core.stiffening.patterns import Patterns
from core.stiffening.stiffening import Stiffening
from core.stiffening.stress_series import StressSeries

COUNT, FIELDS = 5, 4
LARGE_FIELDS, LARGE_FORMS = 60, 80  # of large tables: fields, features of either kind
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
    """Return a random third power and c |q|^4; large, with as many features as a table of real tissue."""
    cubic = rng.standard_normal((k, k, k))
    cubic = sum(cubic.transpose(p) for p in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))) / 6.0
    third = 0.02 * strength / USUAL * np.sqrt(COUNT / k) ** 3 * cubic
    root = np.sqrt(0.1 * strength) / USUAL
    if k <= COUNT:
        return Energy(Cubic.of(third, k), Features.of(root * np.eye(k)[None], k, 0), np.ones(1))
    forms = rng.standard_normal((2 * LARGE_FORMS + 1, k, k))
    forms = 0.01 * root / k * (forms + forms.transpose(0, 2, 1))
    forms[0] = root * np.eye(k)
    features = Features.of(forms.astype(np.float32), k // 2, LARGE_FORMS)
    return Energy(Cubic.of(third.astype(np.float32), k // 2), features, np.ones(len(forms)))


def _stress(rng: np.random.Generator, skin: SkinModel, strength: float, count: int) -> StressSeries:
    mesh, rows = skin.mesh, (FIELDS, LARGE_FIELDS)[count > COUNT]
    places = 1e2 * mesh.nodes[mesh.tetrahedra].mean(axis=1)
    waves = np.stack([np.ones(len(places)), *(np.cos(places @ rng.standard_normal(3)) for _ in range(rows - 1))], 1)
    fields = np.einsum("nr,cr->ncr", waves, rng.standard_normal((6, rows)))
    two, forms = count * (count + 1) // 2, rng.standard_normal((FIELDS, count, count))
    features = Features.of((forms + forms.transpose(0, 2, 1)).astype(np.float32), count, 0)
    return StressSeries(
        mesh.nodes,
        mesh.tetrahedra,
        fields.astype(np.float32),
        (0.01 * strength / USUAL**2 * rng.standard_normal((rows, two))).astype(np.float32),
        (0.005 * strength / USUAL**3 * rng.standard_normal((rows, FIELDS, count))).astype(np.float32),
        features,
    )
