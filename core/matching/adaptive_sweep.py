"""Adaptive choice of the poses of a look-up table, for fewer rows at the same error.

A first part of the poses is spread evenly over the sweep. The others are chosen in rounds. In each round, the readings
of every row are estimated from its nearest neighbours. Further poses are pressed where this estimate is worst, relative
to the strength of the touch, and where rows are far apart. No random numbers are used: the same device and skin give
the same rows.

Source: [S2] VI ('discarding areas of the workspace that are not interesting ... while focusing on those configurations
bringing the most salient information')
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..devices.spec import DeviceSpec
from ..errors import DermisError
from ..skin.model import SkinModel
from .nearest import NEIGHBOURS
from .readings import FULL_SCALE, Readings, within_scale
from .sweep import commands_at, freedoms, halton, reached, refuse_many
from .table import SkinTable, assemble, noise_floor, press_of, sound

EVEN = 0.25  # share of the rows that is spread evenly; they must reveal every region where the readings are curved
ROUNDS = 6  # rounds in which the other rows are chosen
# Smallest number of rows; with fewer, the first rows are too far apart to estimate each other.
LEAST = int(4 * NEIGHBOURS / EVEN)
POOL = 6  # candidates for each further row
APART = 0.7  # distance that two poses of a round keep, as a share of the later one's distance from the nearest row


def build_adaptive(
    spec: DeviceSpec, skin: SkinModel, sensor: Readings, rows: int, noise: float
) -> Generator[tuple[int, int], None, SkinTable]:
    """Build a table whose poses are chosen adaptively.

    Args:
        spec: preset of the platform.
        skin: model of the finger's skin.
        sensor: virtual sensor of this skin.
        rows: number of poses to choose. Those that the platform cannot reach are left out.
        noise: standard deviation of one channel of the sensor [counts]. A floor that follows from it is added to the
            strength of every touch, so that relative errors of touches weaker than the noise stay small.

    Yields:
        Number of finished rows and number of all rows.

    Returns:
        The table.

    Raises:
        DermisError: there are too few rows or too many, or the preset has no sweep.
    """
    if rows < LEAST:
        raise DermisError("too few rows for an adaptive table", where="look-up table", value=rows, limit=f">= {LEAST}")
    refuse_many(rows)
    press = press_of(skin, spec)
    axes, first = freedoms(spec), int(EVEN * rows)
    sequence = halton(first + POOL * (rows - first), axes)
    floor = noise_floor(noise, len(sensor.rest))
    rest = sensor.rest
    share, pool = np.empty((0, axes)), sequence[first:]
    commands, readings = np.empty((0, axes)), np.empty((0, len(rest)))
    touching: NDArray[np.bool_] = np.empty(0, bool)
    left = {"unreached_rows": 0, "unbalanced_rows": 0, "saturated_rows": 0, "law_unsettled_rows": 0}
    new = sequence[:first]
    rounds = np.diff(np.linspace(first, rows, ROUNDS + 1).astype(int)).tolist()
    for size in [*rounds, 0]:
        asked = commands_at(spec, press.points.positions, new)
        within = reached(spec, asked)
        asked, new = asked[within], new[within]
        pressed = press.press(asked)
        good = sound(pressed)
        amounts = None if pressed.amounts is None else pressed.amounts[good]
        felt = within_scale(sensor.counts(pressed.force[good], amounts))
        felt[~pressed.touching[good]] = rest
        left["unreached_rows"] += int((~within).sum())
        left["unbalanced_rows"] += int((~good).sum())
        left["law_unsettled_rows"] += int((pressed.left[good] > 0.0).sum())
        left["saturated_rows"] += int(((felt <= 0.0) | (felt >= FULL_SCALE)).any(axis=1).sum())
        share, commands = np.vstack([share, new[good]]), np.vstack([commands, asked[good]])
        readings, touching = np.vstack([readings, felt]), np.concatenate([touching, pressed.touching[good]])
        yield min(len(share), rows), rows
        if not size:
            break
        best = _best(share, readings, touching, rest, floor, pool, size)
        new, pool = pool[best], np.delete(pool, best, axis=0)
    about = {"asked": rows, "pressed_on": press.points.on, "rest_rows": int((~touching).sum()), "spread": "adaptive"}
    return assemble(spec, skin, sensor, commands[touching], readings[touching], {**about, **left})


def _best(
    share: Array, readings: Array, touching: NDArray[np.bool_], rest: Array, floor: float, pool: Array, count: int
) -> Indices:
    """Return the indices of the `count` best candidates in a pool, the best first.

    Args:
        share: poses pressed so far, as for `commands_at`, shape (n, freedoms).
        readings: their readings, shape (n, channels).
        touching: whether they touch, shape (n,).
        rest: readings of untouched skin, shape (channels,).
        floor: strength that is added to that of every touch.
        pool: candidates, shape (p, freedoms).
        count: number of poses to choose.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(share)
    near, row = tree.query(share, NEIGHBOURS + 1)
    near, row = near[:, 1:], row[:, 1:]  # each row's first neighbour is itself
    estimated = (_weights(near)[:, :, None] * readings[row]).sum(axis=1)
    strength = np.linalg.norm(readings - rest, axis=1) + floor
    bends = np.linalg.norm(estimated - readings, axis=1) / strength / near.mean(axis=1)
    away, beside = tree.query(pool, NEIGHBOURS)
    worth = (_weights(away) * bends[beside]).sum(axis=1) * away[:, 0]
    worth[~touching[beside].any(axis=1)] = 0.0  # no neighbour touches, so it would not either
    chosen: list[int] = []
    places = np.empty((count, pool.shape[1]))
    for candidate in np.argsort(-worth, kind="stable").tolist():
        if len(chosen) == count:
            break
        apart = ((places[: len(chosen)] - pool[candidate]) ** 2).sum(axis=1)
        if not (apart < (APART * away[candidate, 0]) ** 2).any():
            places[len(chosen)] = pool[candidate]
            chosen.append(candidate)
    return np.array(chosen, np.intp)


def _weights(distance: Array) -> Array:
    """Return weights by the inverse square of the distance; those of each row sum to 1."""
    weights = 1.0 / np.maximum(distance, 1e-12) ** 2
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
