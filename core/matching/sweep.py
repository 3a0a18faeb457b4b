"""Which configurations of a platform a look-up table has: by what they do to the skin, not by the motors' angles.

Source: [S2] III.A
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..devices.poses import Poses, rotation
from ..devices.spec import DeviceSpec
from ..errors import DermisError
from .nearest import NEIGHBOURS
from .platforms import ends_of, mechanism, original_channels


def sweep(spec: DeviceSpec, points: Array, rows: int | None = None) -> Array:
    """Return the commands of a data collection, shape (n, motors).

    Three motors: a grid of equal steps over depth and two tilts, the corrected paper's 55^3. Six motors: an evenly
    spread sequence (Halton) over depth, tilts, shifts and yaw. Depth is the platform's, beyond the first touch of the
    undeformed skin.

    Args:
        points: undeformed pad nodes [m], shape (m, 3).
        rows: about how many; as the preset says where None. A grid takes the next smaller cube.

    Raises:
        DermisError: fewer rows than neighbours, or poses that the motors cannot reach.
    """
    device, p = mechanism(spec), spec.parameters
    low, high = (float(v) for v in p["sweep_press"])
    tilt = float(p["sweep_tilt"])
    motors = len(device.rest)
    if motors == 3:
        asked = int(p["sweep_levels"]) if rows is None else int(np.floor(rows ** (1 / 3) + 1e-9))
        _enough(asked**3)
        levels = np.linspace(0.0, 1.0, asked)
        share = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
        extent = np.zeros((len(share), 3))
    else:
        count = int(p["sweep_rows"]) if rows is None else int(rows)
        _enough(count)
        sequence = halton(count, 6)
        share = sequence[:, :3]
        shift, yaw = float(p["sweep_shift"]), float(p["sweep_yaw"])
        extent = (2.0 * sequence[:, 3:] - 1.0) * np.array([shift, shift, yaw])
    poses = platform_poses(
        points,
        low + (high - low) * share[:, 0],
        tilt * (2.0 * share[:, 1] - 1.0),
        tilt * (2.0 * share[:, 2] - 1.0),
        extent[:, :2],
        extent[:, 2],
    )
    commands = device.commands(poses)
    ends = np.array([ends_of(c) for c in original_channels(spec)])
    outside = np.flatnonzero(((commands < ends[:, 0]) | (commands > ends[:, 1])).any(axis=1))
    if len(outside):
        worst = commands[outside[0]]
        raise DermisError(
            "the sweep asks for more than the motors can do",
            where=f"device preset '{spec.key}'",
            value=f"{len(outside)} of {len(commands)} rows, first {worst.round(4).tolist()}",
            limit=f"{ends[:, 0].min():.4g} to {ends[:, 1].max():.4g}",
        )
    return commands


def platform_poses(points: Array, depth: Array, pitch: Array, roll: Array, shift: Array, yaw: Array) -> Poses:
    """Return platform poses by what they do to the skin.

    Args:
        points: undeformed pad nodes [m], shape (m, 3).
        depth: beyond the first touch, along the platform's normal [m], shape (n,).
        pitch, roll, yaw: about X, then the turned Y, then the turned Z [rad]. shift: of the centre, x and y [m].
    """
    zero = np.zeros_like(pitch)
    turn = rotation(np.column_stack([pitch, zero, zero])) @ rotation(np.column_stack([zero, roll, zero]))
    turn = turn @ rotation(np.column_stack([zero, zero, yaw]))
    normal = turn[:, :, 2]
    height = np.concatenate([(normal[i : i + 4096] @ points.T).min(axis=1) for i in range(0, len(normal), 4096)])
    z = (height + depth - (normal[:, :2] * shift).sum(axis=1)) / normal[:, 2]
    return Poses(turn, np.column_stack([shift, z]))


def halton(count: int, dimensions: int) -> Array:
    """Return the Halton sequence in the first primes, without its first point, shape (count, dimensions)."""
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
