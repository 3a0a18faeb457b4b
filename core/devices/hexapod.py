"""Six-leg platform: a disc under the pad, positioned by six leg lengths.

The legs of the paper's device are compliant wires through a fixed base (a parallel continuum manipulator). Here they
are modelled as rigid, straight, and free to turn at both ends. Their bending and their curved shape are not computed.

In the finger's frame the base joints are above the nail. In the reference configuration the platform's frame is
parallel to the finger's. The normal of the platform's face is +Z.

Source: [S2] II and Fig. 2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .cable_platform import joint_angles, on_circle
from .poses import Poses
from .spec import DeviceSpec

NEWTON_STEPS = 30  # largest number of steps of forward kinematics
CLOSED = 1e-11  # [m] largest error of a leg's length in forward kinematics
SINGULAR = 1e-4  # least allowed `Hexapod.conditioning` of the reference configuration


@dataclass(frozen=True, eq=False)
class Hexapod:
    """Mechanism of a six-leg platform.

    Attributes:
        disc_radius: radius of the face that touches the skin [m].
        joints: joints of the legs on the platform, in its frame [m], shape (6, 3).
        base: joints of the legs on the base, in the finger's frame [m], shape (6, 3).
        height: Z of the platform's face in the reference configuration [m], negative since it is below the pad.
    """

    disc_radius: float
    joints: Array
    base: Array
    height: float

    @property
    def rest(self) -> Array:
        """Leg lengths of the reference configuration [m], shape (6,)."""
        return self.commands(self.rest_poses(1))[0]

    def rest_poses(self, count: int) -> Poses:
        """Return the reference configuration, `count` times."""
        return Poses(np.tile(np.eye(3), (count, 1, 1)), np.tile([0.0, 0.0, self.height], (count, 1)))

    def commands(self, poses: Poses) -> Array:
        """Return leg lengths at poses by inverse kinematics [m], shape (n, 6)."""
        return np.linalg.norm(self._legs(poses)[1], axis=2)

    def carry(self, commands: Array, start: Poses) -> Poses:
        """Return the poses with given leg lengths, by forward kinematics.

        See `press_problem.Carrier`.

        Args:
            commands: leg lengths [m], shape (n, 6).
            start: poses near the result, from which the search starts.

        Raises:
            DermisError: no pose with these lengths was found from `start`.
        """
        poses = start
        wanted = np.asarray(commands, np.float64)
        for _ in range(NEWTON_STEPS):
            at, legs = self._legs(poses)
            length = np.sqrt((legs**2).sum(axis=2))
            miss = wanted - length
            if np.abs(miss).max(initial=0.0) <= CLOSED:
                return poses
            twist = np.linalg.solve(_rows(at, legs / length[:, :, None]), miss[:, :, None])[:, :, 0]
            size = np.maximum(np.abs(twist[:, :3]).max(axis=1) / 5e-3, np.abs(twist[:, 3:]).max(axis=1) / 0.3)
            poses = poses.moved(twist / np.maximum(size, 1.0)[:, None])
        worst = int(np.abs(miss).max(axis=1).argmax())
        raise DermisError(
            "no pose was found at which the legs have these lengths",
            where="six-leg platform",
            value=(1e3 * wanted[worst]).round(3).tolist(),
            limit="lengths [mm] of a pose near the one before",
        )

    def give(self, commands: Array, poses: Poses, *, first: bool) -> None:
        """Return None, since the legs are rigid; see `press_problem.Carrier`."""
        return None

    def conditioning(self, poses: Poses) -> Array:
        """Return the conditioning of the legs at poses, shape (n,).

        It is the ratio of the least to the largest singular value of the legs' directions and moments, with moments
        divided by the platform's radius. It is 0 at a singularity, in which the legs do not hold the platform.
        """
        at, legs = self._legs(poses)
        rows = _rows(at - poses.centre[:, None], legs / np.linalg.norm(legs, axis=2)[:, :, None])
        rows[:, :, 3:] /= np.linalg.norm(self.joints[0])
        values = np.linalg.svd(rows, compute_uv=False)
        return values[:, -1] / values[:, 0]

    def _legs(self, poses: Poses) -> tuple[Array, Array]:
        at = poses.centre[:, None] + self.joints @ poses.rotation.transpose(0, 2, 1)
        return at, at - self.base


def mechanism(spec: DeviceSpec) -> Hexapod:
    """Read the mechanism of a preset.

    Raises:
        DermisError: a parameter is missing or not above zero, the joints do not surround the middle, or the legs do not
            hold the platform in its reference configuration.
    """
    where = f"device preset '{spec.key}'"
    radius, base_radius, disc, drop, base_height = (
        spec.value(name) for name in ("platform_radius", "base_radius", "disc_radius", "rest_distance", "base_height")
    )
    joints = on_circle(radius, joint_angles(spec, "platform_angles"), 0.0)
    base = on_circle(base_radius, joint_angles(spec, "base_angles"), base_height)
    device = Hexapod(disc, joints, base, -drop)
    held = float(device.conditioning(device.rest_poses(1))[0])
    if held < SINGULAR:
        raise DermisError(
            "the legs do not hold the platform",
            where=where,
            value=held,
            limit=f">= {SINGULAR}",
            remedy="Change 'platform_angles' or 'base_angles', so that the joints of the platform are not in line "
            "with those of the base",
        )
    return device


def _rows(at: Array, along: Array) -> Array:
    """Return the derivative of the leg lengths, shape (n, 6, 6).

    The derivative is with respect to a movement of the platform, which is a shift and then a turn.

    Args:
        at: joints of the legs on the platform [m], shape (n, 6, 3), relative to the point about which the platform
            turns.
        along: unit vectors along the legs, shape (n, 6, 3).
    """
    return np.concatenate([along, np.cross(at, along)], axis=2)
