"""Synergies: how few motors render a touch, and how each must be coupled to the original ones.

Commands are centred and each divided by its motor's range before components are sought, so that mm and degrees weigh
alike. The additional error of fewer motors is judged by one of two rules: as a share of the touch itself, or,
as the paper does, of the error of all motors. The paper's has no answer where all motors together leave less than the
hand wobbles from one repetition to the next: it then asks for motors that render the wobble.

Source: [S2] IV with the corrections: eq. 5 on centred commands, eq. 7 with the mean of all N columns
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..matching.lookup import commands_of, readings_for
from ..matching.readings import step_of
from ..matching.table import SkinTable

Rule = Literal["touch", "paper"]
RULES: tuple[Rule, ...] = get_args(Rule)

STILL = 1e-9  # of a motor's range: commands that move less are at rest
ROUNDED = 1.0 / 12.0  # [steps^2] a channel's mean square when read in whole steps: errors below say nothing
NOUGHT = 1e-12  # of the touch: where readings have no step, errors below are rounding's


@dataclass(frozen=True, eq=False)
class Components:
    """Directions of joint movement, the most important first.

    Attributes:
        mean: mean of the commands, in SI, shape (n,).
        scale: range of each motor, shape (n,).
        directions: columns E, of scaled commands, orthonormal, shape (n, n).
        variance: variance of the scaled commands along each component, shape (n,).
    """

    mean: Array
    scale: Array
    directions: Array
    variance: Array

    @property
    def explained(self) -> Array:
        """Share of the variance that each component explains, sums to 1, shape (n,). Source: [S2] eq. 6."""
        total = float(self.variance.sum())
        return self.variance / total if total > 0 else np.zeros_like(self.variance)

    def amounts(self, commands: Array, k: int) -> Array:
        """Return the reduced commands, shape (q, k). Source: [S2] eq. 5."""
        return ((commands - self.mean) / self.scale) @ self.directions[:, :k]

    def reconstructed(self, commands: Array, k: int) -> Array:
        """Return the commands that k components make of the given ones, shape (q, n). Source: [S2] eq. 7."""
        return self.mean + (self.amounts(commands, k) @ self.directions[:, :k].T) * self.scale


@dataclass(frozen=True, eq=False)
class Reduction:
    """What fewer motors cost.

    Attributes:
        components: principal components of all interactions together.
        error: root mean square of the sensed difference for k = 1..n, in the table's unit, a row a touch, (i, n).
        touch: root mean square of how far each interaction is from rest, over the same samples and unit, shape (i,).
        resolution: error caused by readings in whole steps, in the same unit; 0 if the readings have no step.
        limit: limit of the rules, a share such as 0.1.
    """

    components: Components
    error: Array
    touch: Array
    resolution: float
    limit: float

    def percent(self, rule: Rule = "touch") -> Array:
        """Return the additional error of k motors, in percent of the rule's reference, shape (i, n).

        'touch': of the touch; a stronger sensor, and rest before and after it, change both alike. 'paper': of the
        error that all motors leave, or that whole steps leave where that is less. Source: [S2] eq. 12.
        """
        best = self.error[:, -1:]
        whole = self.touch[:, None] if rule == "touch" else best
        return 100.0 * (self.error - best) / np.maximum(whole, self.least[:, None])

    @property
    def least(self) -> Array:
        """The least error of each interaction that says anything, shape (i,)."""
        return np.maximum(self.resolution, NOUGHT * self.touch)

    def mean_percent(self, rule: Rule = "touch") -> Array:
        """Return the mean of the interactions' percentages, (n,). The ratio of mean errors would be another number."""
        return self.percent(rule).mean(axis=0)

    def motors(self, rule: Rule = "touch") -> int:
        """Return the fewest motors within the rule, for the mean of the percentages."""
        return knee(self.mean_percent(rule), self.limit)

    def limits(self, rule: Rule = "touch") -> tuple[float, float]:
        """Return above which limit and up to which the rule gives the same number of motors, as shares."""
        mean, k = self.mean_percent(rule) / 100.0, self.motors(rule)
        return float(max(mean[k - 1], 0.0)), float(mean[: k - 1].min(initial=np.inf))


def components(commands: Array, scale: Array) -> Components:
    """Return the principal components of centred commands, each over its motor's range.

    Args:
        commands: SI, shape (q, n). scale: range of each motor, shape (n,).

    Raises:
        DermisError: fewer than two samples, shapes that do not fit, or commands that never change.
    """
    q, n = commands.shape
    if q < 2 or scale.shape != (n,):
        raise DermisError(
            "components need at least two samples, and a range for each motor",
            where="design",
            value=f"{commands.shape}, {scale.shape}",
        )
    mean = commands.mean(axis=0)
    scaled = (commands - mean) / scale
    if np.abs(scaled).max() <= STILL:
        raise DermisError("the motors never move", where="design", remedy="Choose a scene in which something touches")
    _, _, vectors = np.linalg.svd(scaled, full_matrices=True)
    vectors = vectors * np.where(vectors.sum(axis=1) < 0.0, -1.0, 1.0)[:, None]  # together is forwards
    return Components(mean, scale, vectors.T, (scaled @ vectors.T).var(axis=0))


def rendering_error(target: Array, rendered: Array) -> float:
    """Return the root mean square over time of the norm of the sensed difference. Source: [S2] eq. 11."""
    return float(np.sqrt(((rendered - target) ** 2).sum(axis=1).mean()))


def knee(percent: Array, limit: float) -> int:
    """Return the smallest k whose percentage is less than `limit` (a share)."""
    below = np.flatnonzero(np.asarray(percent) < 100.0 * limit)
    return int(below[0]) + 1 if len(below) else len(percent)


def reduce(
    table: SkinTable, sensed: Sequence[Array], limit: float, *, commands: Sequence[Array] | None = None
) -> Reduction:
    """Return what fewer motors cost.

    Args:
        table: effect of the device on the skin.
        sensed: the target readings of each interaction, in the table's unit, each (q_i, channels).
        limit: limit of the rules, a share such as 0.1.
        commands: looked up already; else by the table.

    Raises:
        DermisError: no interaction, or one in which the motors never move.
    """
    if not sensed:
        raise DermisError("no interaction", where="design", remedy="Give at least one scene or recording")
    given = [commands_of(table, s) for s in sensed] if commands is None else list(commands)
    every = np.vstack(given)
    n = every.shape[1]
    parts = components(every, table.scale)
    error = np.array(
        [
            [
                rendering_error(target, readings_for(table, m if k == n else parts.reconstructed(m, k)))
                for k in range(1, n + 1)
            ]
            for target, m in zip(sensed, given, strict=True)
        ]
    )
    touch = np.array([float(np.sqrt((table.from_rest(target) ** 2).mean())) for target in sensed])
    resolution = step_of(table.readings) * float(np.sqrt(ROUNDED * table.readings.shape[1]))
    return Reduction(parts, error, touch, resolution, limit)
