"""Trial of the design rules on the six interactions of [S2].

The interactions are sensed with noise and wobble, and the resulting numbers of motors are compared with those of [S2].

Source: [S2] V; the rule, the noise and the wobble are those fixed in `interactions`
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contact.skin_contact import SkinContact
from ..contact.skin_sampler import SkinSampler
from ..matching.readings import Counts, quantised, readings_of
from ..matching.table import SkinTable
from ..skin.model import SkinModel
from .interactions import EXPECTED, KNEE, NAMES, NOISE, WOBBLE, Wobble, interaction
from .synergies import RULES, reduce


@dataclass(frozen=True)
class Verdict:
    """Result for one interaction and one seed.

    Attributes:
        name, seed: name of the interaction, and seed.
        expected: number of motors in [S2].
        found: number of motors by each of `RULES`.
        percent: additional error of k = 1..n motors by each of `RULES` [%], see `Reduction.percent`.
        error: RMS error with all motors [counts].
        touch: RMS difference of the touch from rest [counts].
    """

    name: str
    seed: int
    expected: int
    found: tuple[int, ...]
    percent: tuple[tuple[float, ...], ...]
    error: float
    touch: float


def felt(skin: SkinModel, name: str, seed: int, wobble: Wobble = WOBBLE) -> SkinContact:
    """Return the states of the skin in one of the six interactions."""
    scene = interaction(name, skin.positions, seed=seed, wobble=wobble)
    sampler = SkinSampler(scene, {0: skin})
    for chunk in scene.chunks:
        sampler.add(chunk)
    return sampler.finish()[0]


def sense(touch: SkinContact, noise: float = NOISE, seed: int = 0) -> Counts:
    """Return the virtual sensor's readings of a touch, shape (n, 20).

    Noise from a seed is added.
    """
    sensor = readings_of(touch.model)
    exact = np.tile(sensor.rest, (len(touch.times), 1))
    if len(touch.contact):
        exact[touch.contact] = sensor.counts(touch.force, touch.amounts)
    rng = np.random.default_rng([seed, 977])
    return quantised(exact + noise * rng.standard_normal(exact.shape)) if noise > 0.0 else quantised(exact)


def judge(table: SkinTable, sensed: NDArray[Any], name: str, seed: int, limit: float = KNEE) -> Verdict:
    """Find how many motors one interaction needs.

    The principal components are those of this interaction alone.
    """
    found = reduce(table, [np.asarray(sensed, np.float64)], limit)
    return Verdict(
        name,
        seed,
        EXPECTED[name],
        tuple(found.motors(rule) for rule in RULES),
        tuple(tuple(found.percent(rule)[0].tolist()) for rule in RULES),
        float(found.error[0, -1]),
        float(found.touch[0]),
    )


def trial(
    tables: Sequence[SkinTable], skin: SkinModel, seeds: Sequence[int]
) -> Generator[tuple[int, int], None, tuple[tuple[Verdict, ...], ...]]:
    """Judge all six interactions for each seed and each device's table.

    Yields (finished, total) and returns the verdicts for each table.
    """
    tables = [table.heard_with(NOISE) for table in tables]
    verdicts: list[list[Verdict]] = [[] for _ in tables]
    total = len(seeds) * len(NAMES)
    for i, seed in enumerate(seeds):
        for j, name in enumerate(NAMES):
            sensed = sense(felt(skin, name, seed), seed=100 * seed + j)
            for found, table in zip(verdicts, tables, strict=True):
                found.append(judge(table, sensed, name, seed))
            yield i * len(NAMES) + j + 1, total
    return tuple(tuple(v) for v in verdicts)


def exceptions(verdicts: Sequence[Verdict]) -> tuple[str, ...]:
    """Return a line for each unexpected number of motors.

    There can be one for each verdict and rule.
    """
    lines = []
    for v in verdicts:
        for rule, found, percent in zip(RULES, v.found, v.percent, strict=True):
            if found != v.expected:
                shown = ", ".join(f"{p:.1f}" for p in percent)
                lines.append(f"{v.name}, seed {v.seed}, by {rule}: {found} instead of {v.expected} ({shown} %)")
    return tuple(lines)
