"""Sweep: poses of a platform for a look-up table, spread evenly by their effect on the skin.

Source: [S2] III.A
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.poses import Poses, rotation
from ..devices.spec import DeviceSpec
from ..errors import DermisError
from .nearest import NEIGHBOURS
from .platforms import ends_of, mechanism, original_channels

MOST_ROWS = 10_000_000  # largest number of rows of a table: two hours at 1,700 rows a second, and 2 GB
UNREACHED = 0.25  # largest share of poses out of reach; with more, a part of the touches is missing in the table


def sweep(spec: DeviceSpec, points: Array, rows: int | None = None) -> tuple[Array, int]:
    """Return the commands of a data collection, shape (n, motors), and the number of poses out of reach.

    Args:
        spec, points, rows: as for `commands_swept`.

    Raises:
        DermisError: there are fewer rows than neighbours, or too many poses are out of the motors' reach.
    """
    commands = commands_swept(spec, points, rows)
    within = reached(spec, commands)
    outside = int(np.count_nonzero(~within))
    if outside > UNREACHED * len(commands):
        ends = np.array([ends_of(c) for c in original_channels(spec)])
        raise DermisError(
            "the sweep exceeds the range of the motors",
            where=f"device preset '{spec.key}'",
            value=f"{outside} of {len(commands)} rows, first {commands[~within][0].round(4).tolist()}",
            limit=f"{ends[:, 0].min():.4g} to {ends[:, 1].max():.4g}, but for {100 * UNREACHED:g} % of the rows",
            remedy="Let the preset sweep less depth or tilt, or give its motors more range",
        )
    return commands[within], outside


def reached(spec: DeviceSpec, commands: Array) -> NDArray[np.bool_]:
    """Return whether commands, shape (n, motors), are within the motors' ranges, shape (n,)."""
    ends = np.array([ends_of(c) for c in original_channels(spec)])
    return np.asarray(((commands >= ends[:, 0]) & (commands <= ends[:, 1])).all(axis=1))


def commands_swept(spec: DeviceSpec, points: Array, rows: int | None = None) -> Array:
    """Return the commands of all poses of a data collection, also those out of reach, shape (n, motors).

    Three motors have a regular grid over depth and two tilts (55^3 poses in the corrected paper). Six motors have an
    evenly spread Halton sequence over depth, tilts, shifts and yaw. The depth is that of the platform beyond first
    contact with the undeformed skin.

    Args:
        spec: preset of the platform.
        points: points of the undeformed skin that are pressed [m], shape (m, 3).
        rows: approximate number of poses; None for that of the preset. A grid has the next smaller cube.

    Raises:
        DermisError: there are fewer rows than neighbours, or more than `MOST_ROWS`.
    """
    p = spec.parameters
    refuse_many(rows or 0)
    if freedoms(spec) == 3:
        asked = int(p["sweep_levels"]) if rows is None else int(np.floor(rows ** (1 / 3) + 1e-9))
        _enough(asked**3)
        levels = np.linspace(0.0, 1.0, asked)
        share = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    else:
        count = int(p["sweep_rows"]) if rows is None else int(rows)
        _enough(count)
        share = halton(count, 6)
    return commands_at(spec, points, share)


def refuse_many(rows: int) -> None:
    """Raise an error for more rows than `MOST_ROWS`.

    Raises:
        DermisError: there are more rows.
    """
    if rows > MOST_ROWS:
        raise DermisError("too many rows for a table", where="look-up table", value=rows, limit=f"<= {MOST_ROWS:,}")


def freedoms(spec: DeviceSpec) -> int:
    """Return the number of freedoms of the poses in a sweep, which is the number of original motors."""
    return len(mechanism(spec).rest)


def commands_at(spec: DeviceSpec, points: Array, share: Array) -> Array:
    """Return the commands of poses within a preset's sweep, also those out of reach, shape (n, motors).

    Args:
        spec: preset of the platform.
        points: points of the undeformed skin that are pressed [m], shape (m, 3).
        share: positions from 0 to 1 between the least and the greatest depth, pitch and roll, and for six motors also
            both shifts and yaw, shape (n, freedoms).
    """
    p = spec.parameters
    low, high = (float(v) for v in p["sweep_press"])
    tilt = float(p["sweep_tilt"])
    extent = np.zeros((len(share), 3))
    if share.shape[1] == 6:
        shift, yaw = float(p["sweep_shift"]), float(p["sweep_yaw"])
        extent = (2.0 * share[:, 3:] - 1.0) * np.array([shift, shift, yaw])
    poses = platform_poses(
        points,
        low + (high - low) * share[:, 0],
        tilt * (2.0 * share[:, 1] - 1.0),
        tilt * (2.0 * share[:, 2] - 1.0),
        extent[:, :2],
        extent[:, 2],
    )
    return mechanism(spec).commands(poses)


def platform_poses(points: Array, depth: Array, pitch: Array, roll: Array, shift: Array, yaw: Array) -> Poses:
    """Return poses of a platform from depth, tilt, shift and yaw.

    Args:
        points: points of the undeformed skin [m], shape (m, 3).
        depth: depth beyond first contact along the platform's normal [m], shape (n,).
        pitch, roll, yaw: angles about X, then the turned Y, then the turned Z [rad], shape (n,) each.
        shift: x and y of the centre [m], shape (n, 2).
    """
    zero = np.zeros_like(pitch)
    turn = rotation(np.column_stack([pitch, zero, zero])) @ rotation(np.column_stack([zero, roll, zero]))
    turn = turn @ rotation(np.column_stack([zero, zero, yaw]))
    normal = turn[:, :, 2]
    height = np.concatenate([(normal[i : i + 4096] @ points.T).min(axis=1) for i in range(0, len(normal), 4096)])
    z = (height + depth - (normal[:, :2] * shift).sum(axis=1)) / normal[:, 2]
    return Poses(turn, np.column_stack([shift, z]))


def halton(count: int, dimensions: int) -> Array:
    """Return the Halton sequence for the first primes, without the origin, shape (count, dimensions)."""
    primes = (2, 3, 5, 7, 11, 13)[:dimensions]
    out = np.zeros((count, dimensions))
    for j, prime in enumerate(primes):
        number, factor = np.arange(1, count + 1), 1.0 / prime
        while number.any():
            out[:, j] += factor * (number % prime)
            number, factor = number // prime, factor / prime
    return out


def _enough(rows: int) -> None:
    if rows < NEIGHBOURS:
        raise DermisError("too few rows", where="look-up table", value=rows, limit=f">= {NEIGHBOURS}")
