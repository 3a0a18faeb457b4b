"""Cable platform: a disc under the pad on three cables and springs.

The cables pull the disc to the finger, and the springs around them push it away. The servos stand above the nail and
wind the cables on pulleys, so a command is three pulley angles. All are zero in the reference configuration, in which
the springs hold the platform away from the fingertip.

The pose is a static equilibrium. Cables pull or hang slack, but never push. Springs press along their axis and resist
sideways bending. The skin pushes back. The platform's weight (a few grams) is left out.

In the finger's frame the base joints are above the nail. In the reference configuration the platform's frame is
parallel to the finger's. The normal of the platform's face is +Z.

Source: [S2] II and Fig. 1; [S2] corrections (tensions >= 0, springs, contact)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .poses import Poses, crossing, inverted, limited
from .spec import DeviceSpec

NEWTON_STEPS = 40
# [N] A pose is in balance if its forces, and its moments divided by the disc's radius, are at most this.
BALANCE = 1e-6
MOTORS = 3


@dataclass(frozen=True, eq=False)
class CablePlatform:
    """Mechanism of a cable platform.

    Attributes:
        disc_radius: radius of the face that touches the skin [m].
        joints: ends of the cables on the platform, in its frame [m], shape (3, 3).
        base: points where the cables leave the base, in the finger's frame [m], shape (3, 3).
        height: Z of the platform's face in the reference configuration [m], negative since it is below the pad.
        pulley: radius of a pulley [m].
        spring: axial stiffness of a spring [N/m].
        bending: sideways stiffness of a spring [N/m].
        free_length: free length of a spring [m].
        cable: stiffness of a cable [N/m].
        tension_limit: largest pull of a servo [N].
    """

    disc_radius: float
    joints: Array
    base: Array
    height: float
    pulley: float
    spring: float
    bending: float
    free_length: float
    cable: float
    tension_limit: float

    @property
    def rest(self) -> Array:
        """Pulley angles of the reference configuration [rad], shape (3,)."""
        return np.zeros(MOTORS)

    @property
    def rest_lengths(self) -> Array:
        """Cable lengths in the reference configuration [m], shape (3,)."""
        return np.linalg.norm(self._arms_at_rest, axis=1)

    @property
    def _arms_at_rest(self) -> Array:
        return self.joints + np.array([0.0, 0.0, self.height]) - self.base

    def rest_poses(self, count: int) -> Poses:
        """Return the reference configuration, `count` times."""
        return Poses(np.tile(np.eye(3), (count, 1, 1)), np.tile([0.0, 0.0, self.height], (count, 1)))

    def lengths(self, commands: Array) -> Array:
        """Return the lengths of the unstretched cables [m], shape (n, 3).

        Args:
            commands: pulley angles [rad], shape (n, 3).
        """
        return self.rest_lengths - self.pulley * np.asarray(commands, np.float64)

    def commands(self, poses: Poses) -> Array:
        """Return pulley angles at poses by inverse kinematics [rad], shape (n, 3).

        The cables are then just straight, without tension.
        """
        arms = poses.centre[:, None] + self.joints @ poses.rotation.transpose(0, 2, 1) - self.base
        return (self.rest_lengths - np.linalg.norm(arms, axis=2)) / self.pulley

    def carry(self, commands: Array, start: Poses) -> Poses:
        """Return the static equilibrium without load; see `press_problem.Carrier`.

        Without load the springs' preload keeps all cables taut, so a cable counts as a rod, which may also push. In
        `give` a cable may hang slack, unless `first` is true.
        """
        lengths = self.lengths(commands)
        poses = start
        scale = np.array([1.0, 1.0, 1.0, *(1.0 / self.disc_radius,) * 3])
        rotation, centre = poses.rotation.copy(), poses.centre.copy()
        active = np.arange(len(lengths))
        for _ in range(NEWTON_STEPS):
            wrench, stiffness = self._balance(poses, lengths[active], taut=True)
            left = np.abs(wrench * scale).max(axis=1, initial=0.0) > BALANCE
            if left.sum() < len(left):
                active, poses = active[left], poses.take(np.flatnonzero(left))
                wrench, stiffness = wrench[left], stiffness[left]
            if not len(active):
                break
            twist = np.asarray(np.linalg.solve(stiffness, wrench[:, :, None])[:, :, 0], np.float64)
            poses = poses.moved(limited(twist))
            rotation[active], centre[active] = poses.rotation, poses.centre
        return Poses(rotation, centre)

    def give(self, commands: Array, poses: Poses, *, first: bool) -> tuple[Array, Array]:
        """Return the forces of cables and springs, and their compliance.

        See `press_problem.Carrier`.
        """
        wrench, stiffness = self._balance(poses, self.lengths(commands), taut=first)
        symmetric = 0.5 * (stiffness + stiffness.transpose(0, 2, 1))
        return wrench, inverted(symmetric)

    def tensions(self, poses: Poses, commands: Array) -> Array:
        """Return cable tensions [N] at poses, never negative, shape (n, 3)."""
        arms = poses.centre[:, None] + self.joints @ poses.rotation.transpose(0, 2, 1) - self.base
        return self.cable * np.maximum(np.linalg.norm(arms, axis=2) - self.lengths(commands), 0.0)

    def _balance(self, poses: Poses, lengths: Array, *, taut: bool = False) -> tuple[Array, Array]:
        """Return force and moment of springs and cables, and their stiffness.

        Args:
            poses: poses of the platform.
            lengths: lengths of the unstretched cables [m], shape (n, 3).
            taut: whether cables count as rods, which never hang slack.

        Returns:
            Force [N] and moment about the finger's origin [N m] on the platform, shape (n, 6). Stiffness: their
            decrease for a unit movement (shift, turn), shape (n, 6, 6).
        """
        at = poses.centre[:, None] + self.joints @ poses.rotation.transpose(0, 2, 1)
        arms = at - self.base
        length = np.sqrt((arms**2).sum(axis=2))
        along = arms / length[:, :, None]
        stretch = length - lengths
        pulls = np.ones_like(stretch, bool) if taut else stretch > 0.0
        tension = self.cable * np.where(pulls, stretch, 0.0)
        pull = tension + self.spring * (length - self.free_length)
        axial = np.where(pulls, self.cable, 0.0) + self.spring
        aside = self.bending * (arms - self._arms_at_rest)
        aside[:, :, 2] = 0.0
        force = -pull[:, :, None] * along - aside
        across = pull / length
        k = (axial - across)[:, :, None, None] * (along[:, :, :, None] * along[:, :, None, :])
        k += across[:, :, None, None] * np.eye(3)
        k[:, :, 0, 0] += self.bending
        k[:, :, 1, 1] += self.bending
        lever = crossing(at)
        wrench = np.concatenate([force.sum(axis=1), np.cross(at, force).sum(axis=1)], axis=1)
        stiffness = np.empty((len(at), 6, 6))
        moved = k @ lever  # force for a turn w, since -(k (w x r)) = k [r] w
        turned = lever @ k
        pushed = crossing(force)
        stiffness[:, :3, :3] = k.sum(axis=1)
        stiffness[:, :3, 3:] = -moved.sum(axis=1)
        stiffness[:, 3:, :3] = (turned + pushed).sum(axis=1)
        stiffness[:, 3:, 3:] = -(lever @ moved + pushed @ lever).sum(axis=1)
        return wrench, stiffness


def mechanism(spec: DeviceSpec) -> CablePlatform:
    """Read the mechanism of a preset.

    Raises:
        DermisError: a parameter is missing or not above zero, or the joints do not surround the middle.
    """
    where = f"device preset '{spec.key}'"
    radius, base_radius, disc, drop, base_height, pulley, spring, bending, preload, cable, limit = (
        spec.value(name)
        for name in (
            "platform_radius",
            "base_radius",
            "disc_radius",
            "rest_distance",
            "base_height",
            "pulley_radius",
            "spring_stiffness",
            "spring_bending",
            "spring_preload",
            "cable_stiffness",
            "tension_limit",
        )
    )
    angles = joint_angles(spec, "joint_angles")
    joints, base = on_circle(radius, angles, 0.0), on_circle(base_radius, angles, base_height)
    rest = np.linalg.norm(joints + np.array([0.0, 0.0, -drop]) - base, axis=1)
    if np.ptp(rest) > 1e-9:
        raise DermisError("the cables must be equally long at rest", where=where, value=rest.tolist())
    return CablePlatform(
        disc, joints, base, -drop, pulley, spring, bending, float(rest[0]) + preload / spring, cable, limit
    )


def joint_angles(spec: DeviceSpec, name: str) -> Array:
    """Return the angles of joints around the pad's normal [rad], shape (n,).

    They count from +X to +Y.

    Raises:
        DermisError: the preset has not as many angles as the kind of device needs, two are equal, or two neighbours
            are 180 degrees or more apart.
    """
    value = spec.value(name)
    angles = np.sort(np.mod(np.asarray(value, np.float64), 2 * np.pi))
    between = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    if between.min() < 1e-6 or between.max() >= np.pi:
        raise DermisError(
            f"'{name}' must surround the middle",
            where=f"device preset '{spec.key}'",
            value=np.degrees(value).round(3).tolist(),
            limit="no two alike, none 180 degrees or more apart from the next",
        )
    return np.asarray(value, np.float64)


def on_circle(radius: float, angles: Array, height: float) -> Array:
    """Return points on a circle about the pad's normal [m], shape (n, 3)."""
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(len(angles), height)])
