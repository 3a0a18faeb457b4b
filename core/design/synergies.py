"""Synergies: how few motors render a touch, and how each must be coupled to the original ones.

Commands are centred and each divided by its motor's range before components are sought, so that mm and degrees weigh
alike. Two ways to choose them stand side by side: those that explain most of the commands' variance (the paper's), and
those that leave least of the *sensed* difference, to first order (ours): components of the commands in contact, weighed
by how much each direction of them changes what is read.

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
from ..matching.table import SkinTable

Choice = Literal["variance", "rendered"]
CHOICES: tuple[Choice, ...] = get_args(Choice)

STILL = 1e-9  # of a motor's range: commands that move less are at rest
ROUNDED = 1.0 / 12.0  # [counts^2] a channel's mean square when read in whole counts: errors below say nothing
FLOOR = 1e-6  # of the largest weight: directions that change nothing sensed keep this much


@dataclass(frozen=True, eq=False)
class Components:
    """Directions of joint movement, the most important first.

    Attributes:
        mean: of the commands, SI, shape (n,). scale: range of each motor, shape (n,).
        directions: columns E, of scaled commands, shape (n, n).
        projection: rows that give each component's amount of centred, scaled commands, shape (n, n).
        variance: of the scaled commands along each component, shape (n,).
    """

    mean: Array
    scale: Array
    directions: Array
    projection: Array
    variance: Array

    @property
    def explained(self) -> Array:
        """Share of the variance that each component explains, sums to 1, shape (n,). Source: [S2] eq. 6."""
        total = float(self.variance.sum())
        return self.variance / total if total > 0 else np.zeros_like(self.variance)

    def amounts(self, commands: Array, k: int) -> Array:
        """Return the reduced commands, shape (q, k). Source: [S2] eq. 5."""
        return ((commands - self.mean) / self.scale) @ self.projection[:k].T

    def reconstructed(self, commands: Array, k: int) -> Array:
        """Return the commands that k components make of the given ones, shape (q, n). Source: [S2] eq. 7."""
        return self.mean + (self.amounts(commands, k) @ self.directions[:, :k].T) * self.scale


@dataclass(frozen=True, eq=False)
class Reduction:
    """What fewer motors cost, for one way to choose the components.

    Attributes:
        choice: 'variance' or 'rendered'. components: of all interactions together.
        error: root mean square of the sensed difference for k = 1..n [counts], one row an interaction, (i, n).
        percent: error over that of all motors, minus 1, in percent, (i, n). Where all motors leave less than whole
            counts can tell, over that. Source: [S2] eq. 12.
        motors: the fewest within the knee, for the mean of the percentages.
    """

    choice: Choice
    components: Components
    error: Array
    percent: Array
    motors: int

    @property
    def mean_percent(self) -> Array:
        """Mean of the interactions' percentages, (n,). The ratio of mean errors would be another number."""
        return self.percent.mean(axis=0)


def components(commands: Array, scale: Array, metric: Array | None = None) -> Components:
    """Return the principal components of centred commands, each over its motor's range.

    Args:
        commands: SI, shape (q, n). scale: range of each motor, shape (n,).
        metric: weight of scaled commands, symmetric positive definite, shape (n, n); none for plain variance.
            Components are then principal in what the metric measures, and their amounts are read obliquely.

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
    root = np.eye(n) if metric is None else _root(metric)
    _, _, vectors = np.linalg.svd(scaled @ root, full_matrices=True)
    vectors = vectors * np.where(vectors.sum(axis=1) < 0.0, -1.0, 1.0)[:, None]  # together is forwards
    directions, projection = np.linalg.solve(root, vectors.T), vectors @ root
    length = np.linalg.norm(directions, axis=0)
    directions, projection = directions / length, projection * length[:, None]
    variance = (scaled @ projection.T).var(axis=0)
    return Components(mean, scale, directions, projection, variance)


def sensed_metric(commands: Array, readings: Array, scale: Array) -> Array:
    """Return how much scaled commands change what is sensed: A'A of the best linear map along the interactions.

    Directions that change nothing keep a small weight, so that the metric can be inverted.
    """
    scaled = (commands - commands.mean(axis=0)) / scale
    centred = readings - readings.mean(axis=0)
    n = scaled.shape[1]
    gram = scaled.T @ scaled
    ridge = FLOOR * max(float(np.trace(gram)), 1e-300) / n
    linear = np.linalg.solve(gram + ridge * np.eye(n), scaled.T @ centred)
    metric = linear @ linear.T
    return metric + FLOOR * max(float(np.trace(metric)), 1e-300) / n * np.eye(n)


def rendering_error(target: Array, rendered: Array) -> float:
    """Return the root mean square over time of the norm of the sensed difference [counts]. Source: [S2] eq. 11."""
    return float(np.sqrt(((rendered - target) ** 2).sum(axis=1).mean()))


def knee(percent: Array, limit: float) -> int:
    """Return the smallest k whose error is less than `limit` (a share) above that of all motors."""
    below = np.flatnonzero(np.asarray(percent) < 100.0 * limit)
    return int(below[0]) + 1 if len(below) else len(percent)


def reduce(
    table: SkinTable, sensed: Sequence[Array], limit: float, *, commands: Sequence[Array] | None = None
) -> tuple[Reduction, ...]:
    """Return what fewer motors cost, by both ways to choose the components.

    Args:
        table: what the device does to the skin.
        sensed: the target readings of each interaction [counts], each (q_i, channels).
        limit: of the knee rule, a share such as 0.1.
        commands: looked up already; else by the table.

    Raises:
        DermisError: no interaction, or one in which the motors never move.
    """
    if not sensed:
        raise DermisError("no interaction", where="design", remedy="Give at least one scene or recording")
    given = [commands_of(table, s) for s in sensed] if commands is None else list(commands)
    every = np.vstack(given)
    n = every.shape[1]
    heard = table.from_rest(np.vstack(list(sensed))) > table.noise_floor
    found = []
    for choice in CHOICES:
        if choice == "rendered" and np.count_nonzero(heard) > n:
            # where nothing is sensed any command will do that does not touch: only what is sensed has a say
            own = every[heard]
            parts = components(own, table.scale, sensed_metric(own, readings_for(table, own), table.scale))
        else:
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
        best = error[:, -1:]
        percent = 100.0 * (error - best) / np.maximum(best, np.sqrt(ROUNDED * table.readings.shape[1]))
        found.append(Reduction(choice, parts, error, percent, knee(percent.mean(axis=0), limit)))
    return tuple(found)


def _root(metric: Array) -> Array:
    """Return the symmetric square root."""
    values, vectors = np.linalg.eigh(metric)
    if values[0] <= 0.0:
        raise DermisError("the metric is not positive definite", where="design", value=float(values[0]))
    return (vectors * np.sqrt(values)) @ vectors.T
