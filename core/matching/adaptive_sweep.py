"""A table whose rows lie where the device touches and where its readings bend: fewer rows for the same error.

A first part of the rows is spread evenly over the sweep's poses. In rounds, each row is then estimated from its
nearest neighbours; where that misses most, relative to how strong the touch is, and where rows are far apart, further
poses are pressed. Nothing is drawn by chance: the same device and skin give the same rows.

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
from .readings import FULL_SCALE, Readings, quantised
from .sweep import commands_at, freedoms, halton, reached, refuse_many
from .table import SkinTable, assemble, noise_floor, press_of, sound

EVEN = 0.25  # of the rows that are spread evenly first: they must find every place that bends
ROUNDS = 6  # in which the others are chosen: each round uses the rows that earlier rounds pressed
LEAST = int(
    4 * NEIGHBOURS / EVEN
)  # rows: with fewer, those that are spread first have no neighbours of their own place
POOL = 6  # evenly spread poses for each row, of which the best are pressed
APART = 0.7  # of a pose's distance from the nearest row: others of its round keep so far from it


def build_adaptive(
    spec: DeviceSpec, skin: SkinModel, sensor: Readings, rows: int, noise: float
) -> Generator[tuple[int, int], None, SkinTable]:
    """Press so many poses, chosen as they go; yield (rows done, rows in all), return the table.

    Args:
        noise: standard deviation of one channel of the sensor [counts]: touches that it hides weigh no more than it.

    Raises:
        DermisError: a table with too few rows or too many, or a preset without a sweep.
    """
    if rows < LEAST:
        raise DermisError("too few rows for an adaptive table", where="look-up table", value=rows, limit=f">= {LEAST}")
    refuse_many(rows)
    press = press_of(skin, spec)
    axes, first = freedoms(spec), int(EVEN * rows)
    sequence = halton(first + POOL * (rows - first), axes)
    floor = noise_floor(noise, len(sensor.rest))
    rest = quantised(sensor.rest[None]).astype(np.float64)[0]
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
        felt = quantised(sensor.counts(pressed.force[good], amounts)).astype(np.float64)
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
    counts = readings[touching].astype(np.uint16)
    return assemble(spec, skin, sensor, commands[touching], counts, {**about, **left})


def _best(
    share: Array, readings: Array, touching: NDArray[np.bool_], rest: Array, floor: float, pool: Array, count: int
) -> Indices:
    """Return which poses of a pool to press next, the most worth while first."""
    from scipy.spatial import cKDTree

    tree = cKDTree(share)
    near, row = tree.query(share, NEIGHBOURS + 1)
    near, row = near[:, 1:], row[:, 1:]  # each row's first neighbour is itself
    estimated = (_weights(near)[:, :, None] * readings[row]).sum(axis=1)
    strength = np.linalg.norm(readings - rest, axis=1) + floor
    bends = np.linalg.norm(estimated - readings, axis=1) / strength / near.mean(axis=1)
    away, beside = tree.query(pool, NEIGHBOURS)
    worth = (_weights(away) * bends[beside]).sum(axis=1) * away[:, 0]
    worth[~touching[beside].any(axis=1)] = 0.0  # in the air among others in the air
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
    """Return inverse squares of distances that sum to 1, a row each."""
    weights = 1.0 / np.maximum(distance, 1e-12) ** 2
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
