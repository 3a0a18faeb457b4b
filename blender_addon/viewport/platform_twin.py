"""Twins of platforms, as coloured triangles in the finger's frame.

Cables with springs, or six legs, connect base and disc. Motors are at their commands. A cable platform is in balance
with the skin that it presses, so the tensions of its cables are those under load. The colour of a cable goes from blue
at no tension to orange at the servo's limit. The colour of a leg goes with its share of the stroke.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from .._core import Array, core
from ..devices import skin_models
from .parts import Colour, Part, across, bars, heat, joined, lathe, placed, ribbon
from .thimble_twin import BASE, DISC, DISC_HEIGHT, LINK

CABLE, LEG, RIM, COIL = 0.45e-3, 0.9e-3, 1.0e-3, 0.25e-3  # half widths [m]
TURNS, COIL_RADIUS, PER_TURN = 7, 2.0e-3, 10
SPRING: Colour = (0.60, 0.64, 0.68, 0.55)


class State(NamedTuple):
    """A platform at one moment.

    Attributes:
        base, joints: ends of cables or legs in the finger's frame [m], shape (n, 3).
        pose: pose of the disc, its face towards +Z, shape (4, 4).
        radius: radius of the disc [m].
        share: share of its limit that each cable or leg uses, 0 to 1, shape (n,).
        tension: tension of each cable [N], shape (n,); None for legs.
    """

    base: Array
    joints: Array
    pose: Array
    radius: float
    share: Array
    tension: Array | None


def state(spec: Any, commands: Array, skin: Any | None, touching: bool) -> State:
    """Return the state of a platform for commands of its own channels.

    Args:
        skin: the skin that it presses; None for a platform in the air.

    Raises:
        DermisError: a broken preset, or commands for which there is no pose.
    """
    platforms, coupling = core.matching.platforms, core.devices.coupling.coupling_of(spec)
    device = platforms.mechanism(spec)
    original = np.asarray(commands if coupling is None else coupling.original(commands), np.float64)[None]
    if skin is not None and touching:
        with skin_models.one_thread():
            poses = core.matching.table.press_of(skin, spec).press(original).poses
    else:
        poses = device.carry(original, device.rest_poses(1))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = poses.rotation[0], poses.centre[0]
    joints, radius = device.joints @ pose[:3, :3].T + pose[:3, 3], float(spec.parameters["disc_radius"])
    if isinstance(device, core.devices.cable_platform.CablePlatform):
        tension = device.tensions(poses, original)[0]
        return State(device.base, joints, pose, radius, np.clip(tension / device.tension_limit, 0.0, 1.0), tension)
    channels = platforms.original_channels(spec)
    low, high = np.array([(c.low, c.high) for c in channels]).T
    return State(device.base, joints, pose, radius, np.clip((original[0] - low) / (high - low), 0.0, 1.0), None)


def parts(at: State) -> Part:
    """Return the whole twin."""
    pieces = [rim(at.base), rim(at.joints), placed(disc(at.radius), at.pose)]
    count, middle = len(at.base), at.pose[:3, 3]
    thick = np.full(count, CABLE if at.tension is not None else LEG)
    pieces.append(bars(at.base, at.joints, thick, np.array([heat(share) for share in at.share.tolist()]), sides=4))
    if at.tension is not None:
        pieces += [spring(start, end) for start, end in zip(at.base, at.joints, strict=True)]
    inner = middle + 0.55 * (at.joints - middle)
    pieces.append(bars(at.joints, inner, np.full(count, RIM), np.tile(LINK, (count, 1)), sides=4))
    return joined(pieces)


def spring(start: Array, end: Array) -> Part:
    """Return a coil around a cable, as flat ribbons."""
    along = end - start
    length = max(float(np.linalg.norm(along)), 1e-12)
    side, up = (vectors[0] for vectors in across(along[None] / length))
    t = np.linspace(0.0, 1.0, TURNS * PER_TURN + 1)
    angle = 2.0 * np.pi * TURNS * t
    out = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
    middle = start + t[:, None] * along + COIL_RADIUS * out
    wide = COIL * along / length
    return ribbon(middle - wide, middle + wide, np.tile(SPRING, (len(t), 1)))


def rim(points: Array) -> Part:
    """Return bars from each joint to the next around the middle."""
    middle = points.mean(axis=0)
    order = np.argsort(np.arctan2(points[:, 1] - middle[1], points[:, 0] - middle[0]))
    ring = points[order]
    return bars(ring, np.roll(ring, -1, axis=0), np.full(len(ring), RIM), np.tile(BASE, (len(ring), 1)), sides=4)


@cache
def disc(radius: float) -> Part:
    return lathe([(0.0, -DISC_HEIGHT), (radius, -DISC_HEIGHT), (radius, 0.0), (0.0, 0.0)], DISC)
