"""The energy of patterns of displacement, from a mesh, without a single nonlinear solve.

The third power is exact. The fourth has too many numbers to be told, and touches go few ways among them: it bends
exactly there, and elsewhere somewhat more stiffly than on average.
"""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np

from ..arrays import Array, Floats
from ..skin.assembly import degrees
from ..stiffening.cubic import Cubic
from ..stiffening.energy import Energy
from ..stiffening.features import Features
from .bends import Bends
from .neo_hookean import NeoHookean
from .pair_fields import Slopes
from .pair_modes import PairModes, kinds, pair_forms, pair_rows
from .second_forces import SecondForces

Held = Callable[[Array], Array]

SAFE = 3.0  # times the mean stiffness of the fourth power, beyond the ways that touches go
AT_ONCE = 8  # samples whose bends are in memory together
_FAINTEST = 1e-7  # of the fourth power's main part


def fit_energy(
    tissue: NeoHookean, held: Held, patterns: Floats, modes: PairModes
) -> Generator[tuple[int, int], None, Energy]:
    """Return the energy of patterns; yields (done, steps).

    Args:
        held: takes forces on the free nodes beneath the pad to their displacement while the pad is held, in linear
            tissue at E = 1, (d, b) to (d, b).
        patterns: displacement of all nodes in linear tissue [m], shape (k, n, 3); in single precision it takes half
            the time.
        modes: ways that touches go.
    """
    mesh, count = tissue.mesh, len(patterns)
    inner = degrees(np.setdiff1d(mesh.free, mesh.pad))
    once = modes.samples[: len(modes.samples) // 2]
    steps = count + -(-len(once) // AT_ONCE)
    forces, moved = SecondForces(tissue, patterns), patterns.reshape(count, -1)
    left, follow = (np.empty((count, count, len(inner)), np.float32) for _ in range(2))
    slopes = np.zeros((count, count, count))  # by q_c, of what multiplies q_a q_b
    for a in range(count):
        found = forces.of(a)
        slopes[a, a:] = found.T @ moved.T
        half = found[inner].astype(np.float64) * np.where(np.arange(count - a) == 0, 1.0, 0.5)
        left[a, a:], follow[a, a:] = half.T, held(half).T
        left[a:, a], follow[a:, a] = left[a, a:], follow[a, a:]
        yield 1 + a, steps
    cubic = (slopes + slopes.transpose(1, 0, 2)) / 6.0
    cubic = (cubic + cubic.transpose(1, 2, 0) + cubic.transpose(2, 0, 1)) / 3.0
    bends, bent = Bends(tissue, Slopes.of(tissue, patterns.astype(np.float64)), left, follow), []
    for start in range(0, len(once), AT_ONCE):
        bent.append(bends.at(once[start : start + AT_ONCE]))
        yield count + 1 + start // AT_ONCE, steps
    features, signs = _fourth(modes, np.concatenate(bent))
    return Energy(Cubic.of(cubic, modes.even), features, signs)


def _fourth(modes: PairModes, bent: Array) -> tuple[Features, Array]:
    """Return the features of a fourth power and their signs, from how it bends at the samples, shape (s, k, k).

    Of a form M of products, less a multiple of |q|^4, it has Z Z' M + M Z Z' - Z Z' M Z Z': all that has to do with
    the ways Z. The multiple bends `SAFE` times as stiffly as M on average: beyond them it alone keeps tissue stable.
    """
    scale, count, half = modes.scale, len(modes.scale), len(bent)
    told = modes.samples[:half] / scale
    squares = (told * told).sum(axis=1)
    bent = bent * scale[:, None] * scale
    mean = max(float(np.mean(np.einsum("saa->s", bent) / squares)) / (4 * count + 8), 0.0)
    mean *= SAFE
    bent -= mean * (4.0 * squares[:, None, None] * np.eye(count) + 8.0 * told[:, :, None] * told[:, None])
    rows, ways = pair_rows(bent) / 12.0, pair_rows(modes.forms * scale[:, None] * scale)
    made, signs = [np.sqrt(mean) * np.eye(count)[None]], [np.ones(1)]
    alike = len(ways) - modes.unlike
    some = (slice(0, alike), slice(alike, len(ways)))
    for kept, own in zip(kinds(count, modes.even), some, strict=True):
        if not kept.any():
            unlike = 0
            continue
        images = 2.0 * modes.shares[:half, own].T @ (rows * kept)
        forms, kind = _folded(ways[own], images)
        made.append(pair_forms(forms, count))
        signs.append(kind)
        unlike = len(kind)
    return Features.of(np.concatenate(made) / scale[:, None] / scale, modes.even, unlike), np.concatenate(signs)


def folded(rows: Array, middle: Array) -> tuple[Array, Array]:
    """Return rows F and signs s of rows' M rows = F' diag(s) F, shapes (r, p) and (r, r)."""
    basis, upper = np.linalg.qr(rows.T)
    values, vectors = np.linalg.eigh(upper @ (0.5 * (middle + middle.T)) @ upper.T)
    kept = np.abs(values) > _FAINTEST * np.abs(values).max()
    return ((basis @ vectors[:, kept]) * np.sqrt(np.abs(values[kept]))).T, np.sign(values[kept])


def _folded(ways: Array, images: Array) -> tuple[Array, Array]:
    """Return rows F and signs s of Z Z' M + M Z Z' - Z Z' M Z Z' = F' diag(s) F, from rows Z and Z M, (r, p) each."""
    inner, one = ways @ images.T, np.eye(len(ways))
    middle = np.block([[-0.5 * (inner + inner.T), one], [one, np.zeros_like(one)]])
    return folded(np.concatenate([ways, images]), middle)
