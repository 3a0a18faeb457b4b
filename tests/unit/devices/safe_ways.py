"""Ways to a safe pose by forward kinematics: where the platform is at every moment, and how deep it presses."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.devices import cable_platform, hexapod, thimble
from core.devices.disc_pose import ROUNDING, placed
from core.devices.inverse_kinematics import inverse_kinematics
from core.devices.poses import Poses
from core.devices.retraction import FITTED
from core.errors import DermisError
from core.matching.sweep import halton, platform_poses
from core.presets import Library
from core.skin.disk import disk_quads
from core.skin.shape import FingertipShape, shape_from_parameters

Array = NDArray[np.float64]
Way = Callable[[Array, Array, Array, float], Array]

MATERIAL = ("young", "poisson", "alpha")
MOMENTS = 16  # of a way


def together(start: Array, goal: Array, slew: Array, part: float) -> Array:
    """All channels begin and arrive together, the slowest at its own speed: the sender's ramp, and a receiver's."""
    return start + part * (goal - start)


def each(start: Array, goal: Array, slew: Array, part: float) -> Array:
    """Each channel at its own speed, whatever the others do: a receiver that knows no better."""
    longest = (np.abs(goal - start) / slew).max(axis=-1, keepdims=True)
    return start + np.clip(goal - start, -slew * longest * part, slew * longest * part)


def shapes() -> dict[str, FingertipShape]:
    """Return the fingers that ship."""
    library = Library()
    return {
        entry.key: shape_from_parameters({k: v for k, v in library.skin(entry.key).items() if k not in MATERIAL})
        for entry in library.list("skins")
    }


def pad(shape: FingertipShape) -> Array:
    """Return points of a pad in the frame of the device that sits on its nail [m], shape (n, 3)."""
    points = shape.skin(disk_quads(8, 10, 6).chart)
    return points[points[:, 2] < shape.height_palm] - [0.0, 0.0, shape.thickness - FITTED]


def depth(points: Array, poses: Poses, radius: float) -> Array:
    """Return how deep the platform stands in the undeformed pad [m], (n,); its face looks along its +Z."""
    local = (points[None] - poses.centre[:, None]) @ poses.rotation
    over = np.maximum(np.hypot(local[:, :, 0], local[:, :, 1]) - radius, 0.0)
    gap: Array = local[:, :, 2] + over**2 / (2 * ROUNDING)
    return np.maximum(-gap.min(axis=1), 0.0)


class Thimbles:
    """Thimbles side by side; a pose that the servos' angles cannot hold is lost."""

    def __init__(self, spec: Any) -> None:
        self.device = thimble.mechanism(spec)
        self.radius = self.device.disc_radius
        tilts, heights = np.radians(np.arange(-36.0, 37.0, 8.0)), np.arange(11.5e-3, 26e-3, 1.5e-3)
        grid = [np.array(x) for x in itertools.product(tilts, tilts, heights)]
        self.at = [x for x in grid if self.device.feasible(x)]
        self.starts = np.array([self.device.servo_angles(x)[0] for x in self.at]) - self.device.servo_zero
        self.lost = np.zeros(len(self.at), bool)

    def go(self, commands: Array) -> Poses:
        """Go on from pose to pose."""
        for i, angles in enumerate(commands):
            try:
                if not self.lost[i]:
                    self.at[i] = self.device.forward(angles, self.at[i])
                    self.lost[i] = inverse_kinematics(self.device, *self.at[i].tolist())[1] <= 0.0
            except DermisError:
                self.lost[i] = True
        found = [placed(self.device, self.device.pose(x)) for x in self.at]
        # the thimble's disc looks along its -Z
        turned = np.stack([p.rotation for p in found]) @ np.diag([1.0, -1.0, -1.0])
        return Poses(turned, np.stack([p.centre for p in found]))


class Platforms:
    """Cable or six-leg platforms side by side, over what a look-up table sweeps and all the way down to rest."""

    def __init__(self, spec: Any, count: int) -> None:
        self.device = {"cable_platform": cable_platform, "hexapod": hexapod}[spec.kind].mechanism(spec)
        self.radius = self.device.disc_radius
        p, share = spec.parameters, halton(count, 6)
        tilt, deep = p["sweep_tilt"], p["rest_distance"] + p["sweep_press"][1]
        extent = np.array([p.get("sweep_shift", 0.0)] * 2 + [p.get("sweep_yaw", 0.0)]) * (2.0 * share[:, 3:] - 1.0)
        poses = platform_poses(
            pad(FingertipShape()),
            deep * share[:, 0] - p["rest_distance"],
            tilt * (2.0 * share[:, 1] - 1.0),
            tilt * (2.0 * share[:, 2] - 1.0),
            extent[:, :2],
            extent[:, 2],
        )
        commands = self.device.commands(poses)
        low, high = (np.array([getattr(c, k) for c in spec.channels if c.actuator]) for k in ("low", "high"))
        kept = np.flatnonzero(((commands >= low) & (commands <= high)).all(axis=1))
        self.starts, self.at = commands[kept], poses.take(kept)
        self.lost = np.zeros(len(kept), bool)

    def go(self, commands: Array) -> Poses:
        """Go on from pose to pose."""
        live = np.flatnonzero(~self.lost)
        try:
            self._put(live, self.device.carry(commands[live], self.at.take(live)))
        except DermisError:
            for i in live:
                try:
                    self._put([i], self.device.carry(commands[[i]], self.at.take(np.array([i]))))
                except DermisError:
                    self.lost[i] = True
        return Poses(self.at.rotation.copy(), self.at.centre.copy())

    def _put(self, rows: Any, poses: Poses) -> None:
        self.at.rotation[rows], self.at.centre[rows] = poses.rotation, poses.centre


def follow(devices: Thimbles | Platforms, way: Way, goal: Array, slew: Array) -> list[Poses]:
    """Return the poses at every moment of the way from every start."""
    starts = devices.starts.copy()
    return [devices.go(way(starts, goal, slew, part)) for part in np.linspace(0.0, 1.0, MOMENTS + 1)]


def deepened(poses: list[Poses], points: Array, radius: float) -> tuple[Array, Array]:
    """Return by how much each way presses deeper than its start [m], and how deep that was [m], shape (n,) each."""
    deep = np.stack([depth(points, p, radius) for p in poses])
    return deep.max(axis=0) - deep[0], deep[0]
