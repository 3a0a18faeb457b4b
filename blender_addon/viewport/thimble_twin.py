"""The thimble's twin: base, cranks, rods and disc as coloured triangles.

They are in the finger's frame. Every part is placed by the servos' angles: the platform by forward kinematics, as the
real one would be.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from .._core import Array, DermisError, core
from ..preview.rows import Row
from .parts import Colour, Part, bars, joined, lathe, placed

BASE: Colour = (0.24, 0.27, 0.31, 0.55)
LINK: Colour = (0.62, 0.66, 0.70, 0.95)
DISC: Colour = (0.36, 0.62, 1.0, 0.60)
NEAR_LIMIT = 0.85  # share of a servo's range from which on its crank turns orange
WARNING: Colour = (1.0, 0.52, 0.10, 1.0)
CRANK, ROD = 1.0e-3, 0.7e-3  # half widths [m]
DISC_HEIGHT, RING = 1.2e-3, 1.2e-3
POINTER = 8e-3  # [m] below the disc
CLOSED = 1e-10  # [rad] a configuration whose servo angles are off by less is that of the angles


class Joints(NamedTuple):
    """Positions of a thimble's joints in the finger's frame [m].

    Attributes:
        servo, knee, platform: joints of the three legs, shape (3, 3).
        pose: pose of the platform in the finger's frame, shape (4, 4); the disc touches with its -Z side.
        x: pitch, roll [rad], distance [m], shape (3,).
    """

    servo: Array
    knee: Array
    platform: Array
    pose: Array
    x: Array


def joints(device: Any, angles: Array, start: Array) -> Joints:
    """Return a thimble's joints for servo angles from neutral [rad].

    Args:
        start: configuration at which the search starts: pitch, roll [rad], distance [m].

    Raises:
        DermisError: no pose of the platform has these angles.
    """
    absolute = np.asarray(angles, np.float64) + device.servo_zero
    x = start if _closes(device, angles, start) else device.forward(angles, start)
    pose = device.in_finger(device.pose(x))
    out = core.devices.linkage.LEG_DIRECTIONS
    servo = device.base_radius * out
    knee = servo + device.crank * (np.cos(absolute)[:, None] * out + np.sin(absolute)[:, None] * [[0.0, 0.0, 1.0]])
    turn, origin = device.mount[:3, :3], device.mount[:3, 3]
    platform = device.platform_radius * out @ pose[:3, :3].T + pose[:3, 3]
    return Joints(servo @ turn.T + origin, knee @ turn.T + origin, platform, pose, x)


def _closes(device: Any, angles: Array, x: Array) -> bool:
    """Return whether a configuration has servo angles, and is on the side of the singular poses that can be reached."""
    if max(abs(x[0]), abs(x[1])) >= core.devices.thimble.QUARTER:
        return False
    try:
        found, margin = core.devices.inverse_kinematics.inverse_kinematics(device, *x.tolist())
    except DermisError:
        return False
    off = max(abs(one - other) for one, other in zip(found, angles.tolist(), strict=True))
    return margin > 0.0 and off < CLOSED


def parts(device: Any, at: Joints, shares: Array) -> Part:
    """Return the whole twin.

    Args:
        shares: share of its range that each servo uses, 0 to 1, shape (3,).
    """
    return all_parts([(device, at, shares)])[0]


def all_parts(several: Sequence[tuple[Any, Joints, Array]]) -> list[Part]:
    """Return `parts` for each of several thimbles; their links are made together."""
    starts, ends, colours = [], [], []
    for _, at, shares in several:
        warm = np.clip((shares - NEAR_LIMIT) / (1.0 - NEAR_LIMIT), 0.0, 1.0)[:, None]
        middle = at.pose[:3, 3] + 0.5 * (at.platform - at.pose[:3, 3])
        starts += [at.servo, at.knee, at.platform]
        ends += [at.knee, at.platform, middle]
        colours += [(1.0 - warm) * LINK + warm * WARNING, _LINKS]
    halves = np.tile(_HALVES, len(several))
    links = bars(np.concatenate(starts), np.concatenate(ends), halves, np.concatenate(colours))
    count, out = len(several), []
    positions, shades = links.positions.reshape(count, -1, 3), links.colours.reshape(count, -1, 4)
    for i, (device, at, _) in enumerate(several):
        still, own = _still(device.base_radius, device.disc_radius, tuple(device.mount.ravel().tolist()))
        part = Part(still.positions.copy(), still.colours.copy(), still.triangles)
        part.positions[own], part.colours[own] = positions[i], shades[i]
        part.positions[own.stop :] = placed(disc(device.disc_radius), at.pose).positions
        out.append(part)
    return out


def pointer(pose: Array) -> Array:
    """Return a line from the disc's middle to the tip of its pointer [m], shape (2, 3)."""
    return np.array([pose[:3, 3], pose[:3, 3] + POINTER * pose[:3, 2]])


def loops(device: Any, around: float) -> list[Array]:
    """Return closed loops that bound the pointer's reach at several heights.

    They are in the finger's frame [m], one for each height.

    Raises:
        DermisError: the level platform does not reach `around`.
    """
    reach = core.devices.workspace.workspace(device, around)
    out = []
    for level in range(len(reach.distance)):
        tips = np.array([pointer(device.in_finger(device.pose(x)))[1] for x in reach.configurations(level)])
        out.append(np.vstack([tips, tips[:1]]))
    return out


def servo_angles(row: Row) -> Array:
    """Return a row's servo angles from neutral [rad], shape (3,)."""
    return np.array([row.values[name] for name in core.devices.servo_limits.SERVOS])


def shares(row: Row) -> Array:
    """Return the share of its range that each servo uses, 0 to 1, shape (3,)."""
    used = []
    for name in core.devices.servo_limits.SERVOS:
        angle = row.values[name]
        limit = (row.high if angle >= 0 else row.low).get(name)
        used.append(abs(angle / limit) if limit else 0.0)
    return np.array(used)


@cache
def disc(radius: float) -> Part:
    return lathe([(0.0, 0.0), (radius, 0.0), (radius, DISC_HEIGHT), (0.0, DISC_HEIGHT)], DISC)


_HALVES = np.repeat([CRANK, ROD, ROD], 3)
_LINKS = np.tile(LINK, (6, 1))


@lru_cache(16)
def _still(base: float, radius: float, mount: tuple[float, ...]) -> tuple[Part, slice]:
    """Return a whole twin of which no servo moves the base's ring, and which of its vertices are links.

    Those after the links are the disc's, at no pose.

    Args:
        base, radius: radii of base and disc [m]. mount: the device's mount, shape (4, 4), in a row.
    """
    fixed, nowhere = placed(ring(base), np.array(mount).reshape(4, 4)), np.zeros((len(_HALVES), 3))
    links = bars(nowhere, nowhere + (0.0, 0.0, 1.0), _HALVES, np.tile(LINK, (len(_HALVES), 1)))
    whole = joined([fixed, links, disc(radius)])
    for array in whole:
        array.flags.writeable = False
    return whole, slice(len(fixed.positions), len(fixed.positions) + len(links.positions))


@cache
def ring(radius: float) -> Part:
    return lathe(
        [
            (radius - RING, -RING),
            (radius + RING, -RING),
            (radius + RING, 0.0),
            (radius - RING, 0.0),
            (radius - RING, -RING),
        ],
        BASE,
    )
