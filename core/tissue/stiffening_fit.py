"""What a fingertip's tissue does beyond linear skin, from a mesh of it: touches, patterns, energy, stress."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from ..arrays import Array, Indices
from ..skin.material import Elastic
from ..skin.model import SkinModel, fingertip_skin
from ..skin.shape import FingertipShape
from ..steps import in_words
from ..stiffening.patterns import Patterns
from ..stiffening.stiffening import Stiffening
from .energy_fit import fit_energy
from .following_fit import fit_following
from .fourth_fit import fit_fourth
from .held_states import held_states
from .held_tissue import HeldTissue
from .learned_fit import fit_learned
from .mirror import MIRROR, mirrored
from .mode_fields import ModeFields
from .neo_hookean import NeoHookean
from .pair_modes import PairModes
from .stress_fit import fit_stress
from .touches import KEPT, PRESSES, loads_of, shown, touches

Made = TypeVar("Made")

STEPS = 100  # that making one is told in
_ENDS = (0, 5, 8, 42, 60, 75, STEPS)  # of the steps: touches, their answers, energy, stress, following, states
AT_ONCE = 12  # loads that are answered together
ANSWERED = 300  # loads at most, whose answers patterns are to hold
SEEN = 300  # samples at most that say which fields of stress matter
RAREST = 0.3  # of all that there is, how much there may be of a pattern that touches hardly bring
MARGIN = 0.6  # of what touches bring: about that the series ends
# Times that, up to which the law is asked of what touches bring, and of their drags; and times their drags, sample by
# sample: tissue that stiffens is pressed harder, and dragged farther, than the linear skin that told the touches.
FARTHEST, DRAGS = (1.35, 2.0), (1.0, 1.4, 1.4, 1.8)
ANSWERS = 3.0  # how much more they count: displacement beyond all patterns is at least linear skin's
EVEN = 1e-6  # of its size, to which a pad's compliance is its own mirror image
_FAINT = 0.05  # of the largest load: smaller ones do not count for as much


@dataclass(frozen=True)
class Size:
    """How much is kept.

    Attributes:
        level: of the mesh. touches: runs that show what skin may be asked.
        patterns: of displacement. samples: touches at which the fourth power of energy is exact.
        modes: ways that their products go, even and odd ones. fields: of stress.
        following: fields of how tissue follows. cubed: of them, the first, with a third power.
    """

    level: str = "standard"
    touches: int = 180
    patterns: int = 120
    samples: int = 120
    modes: int = 30
    fields: int = 30
    following: int = 90
    cubed: int = 40
    asked: int = 400
    learned: int = 64


STANDARD = Size()


def fit_stiffening(
    shape: FingertipShape, poisson: float, size: Size | None = None, *, seed: int = 0, key: str = ""
) -> Generator[tuple[int, int], None, Stiffening]:
    """Return what a fingertip's tissue does beyond linear skin; yields (done, STEPS).

    Args:
        seed: of the touches. key: that the result is to have.

    Raises:
        DermisError: a shape that cannot be meshed.
    """
    size = size or STANDARD
    yield 0, STEPS
    skin = fingertip_skin(shape, Elastic(1.0, poisson, 1.0), level=size.level)
    seen = yield from _within(shown(touches(skin, size.touches, seed), partial(loads_of, skin)), 0)
    loads = np.concatenate(seen)
    linear = HeldTissue(NeoHookean(skin.mesh, poisson))
    answers = yield from _within(_answered(linear, _some(loads, ANSWERED)), 1)
    loaded, even = main_patterns(skin.unit_compliance, loads, answers, size.patterns, mirror_of(skin))
    moved = linear.moved(loaded)
    work = loads @ (skin.unit_compliance @ loaded)
    reach = reach_of(work)
    modes = PairModes.of(_some(work, size.samples), reach, even, size.modes)
    energy = yield from _within(fit_energy(linear.tissue, linear.held, moved.astype(np.float32), modes), 2)
    samples, products = _some(work, SEEN), ModeFields.of(linear, moved, modes)
    stress = yield from _within(fit_stress(linear, moved, energy, samples, products, size.fields), 3)
    following = yield from _within(fit_following(linear, moved, samples, products, size.following, size.cubed), 4)
    reach = MARGIN * reach
    energy = replace(energy, reach=reach, press=main_press(work / reach))
    shares = np.split(work, np.cumsum([len(rows) for rows in seen])[:-1])
    states = yield from _within(held_states(linear, moved, asked_of(shares, reach, size.asked)), 5)
    energy = fit_fourth(energy, modes, states)
    following = fit_learned(linear, following, states, reach, even, size.learned)
    skins = np.unique(skin.mesh.surface)  # beyond the pad, too: at its rim a pattern is then read between places
    known = Patterns.through(skin.mesh.nodes[skins], moved[:, skins].transpose(1, 2, 0))
    return Stiffening(energy, known, stress, key, following)


def reach_of(amounts: Array) -> Array:
    """Return how much of each pattern the series is to be followed to, shape (k,), from what touches bring, (s, k).

    Half of the measure is how much there is in all, half of what kind it is; what touches bring lies within 1 of it.
    """
    size = float(np.linalg.norm(amounts, axis=1).max())
    kind = np.sqrt((amounts * amounts).mean(axis=0))
    kind *= np.linalg.norm(amounts / kind, axis=1).max()
    reach = 1.0 / np.sqrt(0.5 / size**2 + 0.5 / np.maximum(kind, RAREST * size) ** 2)
    return np.asarray(reach * np.linalg.norm(amounts / reach, axis=1).max())


def asked_of(shares: list[Array], reach: Array, count: int) -> Array:
    """Return the amounts that the law is asked for, half of them of drags, shape (s, k).

    Args:
        shares: amounts that each touch brings, pose after pose, shapes (p, k). reach: of the series, shape (k,).
        count: at most, or a few more.
    """
    pressed = PRESSES // KEPT
    drags = [
        rows[pressed - 1] + far * (row - rows[pressed - 1])
        for rows in shares
        if len(rows) == pressed + len(DRAGS)
        for far, row in zip(DRAGS, rows[pressed:], strict=True)
    ]
    out = []
    for amounts, farthest in zip((np.concatenate(shares), np.array(drags)), FARTHEST, strict=True):
        if len(amounts):
            some = _some(amounts, count // 2)
            out.append(some / np.maximum(np.linalg.norm(some / reach, axis=1) / farthest, 1.0)[:, None])
    return np.concatenate(out)


def main_press(amounts: Array) -> Array:
    """Return what amounts over their reach (s, k) bring most of, of unit length, shape (k,)."""
    return np.asarray(np.linalg.svd(amounts, full_matrices=False)[2][0])


def mirror_of(skin: SkinModel) -> Indices | None:
    """Return which pad node is each one's mirror image in x, shape (m,); None of skin that is not its own image."""
    image = mirrored(skin.positions)
    if image is None:
        return None
    blocks = skin.unit_compliance.reshape(len(image), 3, len(image), 3)
    turned = blocks[image][:, :, image] * MIRROR[:, None, None] * MIRROR
    return image if np.abs(turned - blocks).max() <= EVEN * np.abs(blocks).max() else None


def main_patterns(
    compliance: Array, loads: Array, answers: Array, count: int, mirror: Indices | None = None
) -> tuple[Array, int]:
    """Return the loads whose displacements are most of what touches bring, shape (3 m, k): each stores energy 1/2.

    Args:
        compliance: of the pad at E = 1, shape (3 m, 3 m). loads: of touches, over E, shape (s, 3 m).
        answers: forces of the second power that tissue answers some of them with, as evenly spread, shape (a, 3 m).
        mirror: each pad node's image, shape (m,); then patterns are even or odd.

    Returns:
        the loads, those of even patterns first, and how many of these there are; all, where there is no mirror.
    """
    from scipy.linalg import cholesky, solve_triangular

    root = cholesky(compliance, lower=True)
    sizes = np.linalg.norm(loads, axis=1)
    weights = 1.0 / (sizes + _FAINT * sizes.max())
    often = ANSWERS * np.sqrt(len(loads) / len(answers))  # they stand for as many
    seen = np.concatenate([loads * weights[:, None], answers * (often * _some(weights, ANSWERED))[:, None]])
    parts = [seen]
    if mirror is not None:
        image = (seen.reshape(len(seen), -1, 3)[:, mirror] * MIRROR).reshape(seen.shape)
        parts = [0.5 * (seen + image), 0.5 * (seen - image)]
    found = [np.linalg.svd(part @ root, full_matrices=False)[1:] for part in parts]
    order = np.argsort(-np.concatenate([values for values, _ in found]), kind="stable")[:count]
    even = int((order < len(found[0][0])).sum())
    chosen = np.concatenate([rows[:few] for (_, rows), few in zip(found, (even, len(order) - even), strict=False)]).T
    return np.asarray(solve_triangular(root, chosen, lower=True, trans="T")), even


def _answered(linear: HeldTissue, loads: Array) -> Generator[tuple[int, int], None, Array]:
    found = []
    for start in range(0, len(loads), AT_ONCE):
        yield start, len(loads)
        found.append(linear.second_loads(loads[start : start + AT_ONCE]))
    return np.concatenate(found)


def _some(samples: Array, count: int) -> Array:
    """Return so many samples at most, as far apart among all as can be."""
    return samples[:: -(-len(samples) // count)]


def _within(steps: Generator[tuple[int, int], None, Made], stage: int) -> Generator[tuple[int, int], None, Made]:
    """Tell a stage's steps as steps of all."""
    low, high = _ENDS[stage], _ENDS[stage + 1]
    return in_words(steps, lambda step: (low + (high - low) * step[0] // step[1], STEPS))
