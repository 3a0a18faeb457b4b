"""Shared pulleys: original motors that move nearly alike.

One pulley may drive original motors that all new motors move nearly alike. This costs little.

Source: [S2] VI ('finding subsets of the coefficients that are similar, and coupling the corresponding cables')
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..matching.lookup import readings_for
from ..matching.table import SkinTable
from .synergies import Components, Reduction, rendering_error

# Share of a component's largest coefficient by which similar coefficients may differ. [S2] calls 0.65 and 0.61 similar,
# and also -0.34 and -0.30 beside 0.89; these differ by 6 % and 4 % of the largest.
ALIKE = 0.1


@dataclass(frozen=True)
class SharedPulleys:
    """Original motors that may share a pulley.

    Attributes:
        groups: indices of two or more motors that may share a pulley, rising; empty if none may.
        percent: excess over the error with all original motors if there are only the new motors and each group shares a
            pulley, relative to the size of the touch; mean over the interactions [%].
    """

    groups: tuple[tuple[int, ...], ...] = ()
    percent: float = 0.0

    def words(self) -> tuple[str, ...]:
        """Return the groups as text, counted from 1, such as '2 and 3'."""
        return tuple(" and ".join(str(i + 1) for i in group) for group in self.groups)


def alike(directions: Array, share: float = ALIKE) -> tuple[tuple[int, ...], ...]:
    """Return groups of motors with similar coefficients.

    In every component they differ by at most a share of the largest coefficient.

    Args:
        directions: coefficients of each original motor in each component, shape (n, k).
    """
    largest = np.maximum(np.abs(directions).max(axis=0), 1e-300)
    scaled = directions / largest
    groups: list[list[int]] = []
    for i in range(len(scaled)):
        for group in groups:
            if (np.abs(scaled[group] - scaled[i]) <= share).all():
                group.append(i)
                break
        else:
            groups.append([i])
    return tuple(tuple(group) for group in groups if len(group) > 1)


def with_shared(parts: Components, commands: Array, k: int, groups: Sequence[Sequence[int]]) -> Array:
    """Return the commands with equal coefficients within each group.

    The commands are restricted to k components, shape (q, n).
    """
    e = parts.directions[:, :k].copy()
    for group in groups:
        e[list(group)] = e[list(group)].mean(axis=0)
    scaled = (commands - parts.mean) / parts.scale
    amounts = np.linalg.lstsq(e, scaled.T, rcond=None)[0]
    moved: Array = parts.mean + (e @ amounts).T * parts.scale
    return moved


def shared_pulleys(
    table: SkinTable, sensed: Sequence[Array], commands: Sequence[Array], found: Reduction, motors: int
) -> SharedPulleys:
    """Find original motors that may share a pulley, and the error then.

    Args:
        table: effect of the device on the skin.
        sensed: target readings of each interaction, shape (q_i, channels) each.
        commands: commands looked up for these readings, shape (q_i, n) each.
        found: errors and principal components of these interactions.
        motors: number of new motors.
    """
    groups = alike(found.components.directions[:, :motors])
    if not groups:
        return SharedPulleys()
    lost = [
        rendering_error(target, readings_for(table, with_shared(found.components, m, motors, groups)))
        for target, m in zip(sensed, commands, strict=True)
    ]
    percent = 100.0 * (np.array(lost) - found.error[:, -1]) / np.maximum(found.touch, found.least)
    return SharedPulleys(groups, float(percent.mean()))
