"""Synergies: the fewest motors for a touch, and their coupling.

A new motor drives several of the original motors. Before principal components are computed, the commands are centred
and divided by each motor's range, so that mm and degrees have equal weight. The additional error of fewer motors is
judged by one of two rules. The rule 'touch' divides it by the size of the touch, the rule 'paper' of [S2] by the error
of all motors. The rule 'paper' is not meaningful if the error of all motors is smaller than the differences between a
hand's repetitions: it then requires motors that render these differences.

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

STILL = 1e-9  # share of a motor's range; motors whose commands deviate less from their mean do not move
ROUNDED = 1.0 / 12.0  # [steps^2] mean square error of a channel by rounding to whole steps; smaller errors mean nothing
NOUGHT = 1e-12  # share of the touch; if readings have no step, smaller errors are rounding errors


@dataclass(frozen=True, eq=False)
class Components:
    """Directions of joint movement, the most important first.

    Attributes:
        mean: mean of the commands, in SI, shape (n,).
        scale: range of each motor, shape (n,).
        directions: matrix E, whose columns are the directions of the scaled commands, orthonormal, shape (n, n).
        variance: variance of the scaled commands along each component, shape (n,).
    """

    mean: Array
    scale: Array
    directions: Array
    variance: Array

    @property
    def explained(self) -> Array:
        """Share of the variance that each component explains, shape (n,).

        The shares sum to 1. Source: [S2] eq. 6.
        """
        total = float(self.variance.sum())
        return self.variance / total if total > 0 else np.zeros_like(self.variance)

    def amounts(self, commands: Array, k: int) -> Array:
        """Return the reduced commands, shape (q, k). Source: [S2] eq. 5."""
        return ((commands - self.mean) / self.scale) @ self.directions[:, :k]

    def reconstructed(self, commands: Array, k: int) -> Array:
        """Return the commands restricted to the first k components.

        The shape is (q, n). Source: [S2] eq. 7.
        """
        return self.mean + (self.amounts(commands, k) @ self.directions[:, :k].T) * self.scale


@dataclass(frozen=True, eq=False)
class Reduction:
    """Errors of fewer motors.

    Attributes:
        components: principal components of all interactions together.
        error: RMS error of the readings of each interaction with k = 1..n motors, in the table's unit, shape (i, n).
        touch: RMS difference of the readings of each interaction from rest, over the same samples and in the same unit,
            shape (i,).
        resolution: error caused by readings in whole steps, in the same unit; 0 if the readings have no step.
        limit: limit of the rules, a share such as 0.1.
    """

    components: Components
    error: Array
    touch: Array
    resolution: float
    limit: float

    def percent(self, rule: Rule = "touch") -> Array:
        """Return the additional error of k motors in percent, shape (i, n).

        The reference of 'touch' is the size of the touch: a more sensitive sensor, and rest before or after the touch,
        change both by the same factor. The reference of 'paper' is the error with all motors, but at least `least`.
        Source: [S2] eq. 12.
        """
        best = self.error[:, -1:]
        whole = self.touch[:, None] if rule == "touch" else best
        return 100.0 * (self.error - best) / np.maximum(whole, self.least[:, None])

    @property
    def least(self) -> Array:
        """The smallest meaningful error of each interaction, shape (i,)."""
        return np.maximum(self.resolution, NOUGHT * self.touch)

    def mean_percent(self, rule: Rule = "touch") -> Array:
        """Return the mean of the interactions' percentages, shape (n,).

        It is not the ratio of the mean errors.
        """
        return self.percent(rule).mean(axis=0)

    def motors(self, rule: Rule = "touch") -> int:
        """Return the fewest motors with a mean percentage below the limit."""
        return knee(self.mean_percent(rule), self.limit)

    def limits(self, rule: Rule = "touch") -> tuple[float, float]:
        """Return the range of limits that give the same number of motors.

        Returns:
            Lower end (excluded) and upper end (included), as shares.
        """
        mean, k = self.mean_percent(rule) / 100.0, self.motors(rule)
        return float(max(mean[k - 1], 0.0)), float(mean[: k - 1].min(initial=np.inf))


def components(commands: Array, scale: Array) -> Components:
    """Return the principal components of commands.

    Commands are centred and divided by each motor's range.

    Args:
        commands: commands in SI units, shape (q, n).
        scale: range of each motor, shape (n,).

    Raises:
        DermisError: there are fewer than two samples, the shapes do not fit, or the commands never change.
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
    # The sign of a component is arbitrary; it is chosen so that the sum of the coefficients is not negative.
    vectors = vectors * np.where(vectors.sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    return Components(mean, scale, vectors.T, (scaled @ vectors.T).var(axis=0))


def rendering_error(target: Array, rendered: Array) -> float:
    """Return the root mean square over time of the difference's norm.

    Source: [S2] eq. 11.
    """
    return float(np.sqrt(((rendered - target) ** 2).sum(axis=1).mean()))


def knee(percent: Array, limit: float) -> int:
    """Return the smallest k whose percentage is below the limit.

    The limit is a share. If no percentage is below it, the number of motors is returned.
    """
    below = np.flatnonzero(np.asarray(percent) < 100.0 * limit)
    return int(below[0]) + 1 if len(below) else len(percent)


def reduce(
    table: SkinTable, sensed: Sequence[Array], limit: float, *, commands: Sequence[Array] | None = None
) -> Reduction:
    """Compute the errors of fewer motors.

    Args:
        table: effect of the device on the skin.
        sensed: target readings of each interaction, in the table's unit, shape (q_i, channels) each.
        limit: limit of the rules, a share such as 0.1.
        commands: commands for each interaction's readings, shape (q_i, n) each; None looks them up in the table.

    Raises:
        DermisError: there is no interaction, or the motors move in none of them.
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
    # A simulated table is not rounded, but the virtual sensor reads whole counts.
    step = 1.0 if "mechanism" in table.meta else step_of(table.readings)
    resolution = step * float(np.sqrt(ROUNDED * table.readings.shape[1]))
    return Reduction(parts, error, touch, resolution, limit)
