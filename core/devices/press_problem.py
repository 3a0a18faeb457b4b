"""Contact of a platform under a finger pad, for batches of commands."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arrays import Array, Indices
from ..errors import DermisError
from ..skin.law_tables import LawTables
from .disc_pose import ROUNDING
from .poses import Poses


class Carrier(Protocol):
    """Mechanism that carries a platform."""

    @property
    def disc_radius(self) -> float:
        """Radius of the face that touches [m]."""
        ...

    @property
    def rest(self) -> Array:
        """Command of the reference configuration, shape (motors,)."""
        ...

    def carry(self, commands: Array, start: Poses) -> Poses:
        """Return the poses of the platform without load.

        Args:
            commands: commands of the motors, shape (n, motors).
            start: poses near the result, from which a search starts.
        """
        ...

    def give(self, commands: Array, poses: Poses, *, first: bool) -> tuple[Array, Array] | None:
        """Return the mechanism's forces on the platform and its compliance.

        The result is None for a rigid mechanism.

        Args:
            commands: commands of the motors, shape (n, motors).
            poses: poses of the platform, which need not be in equilibrium.
            first: whether the poses are a first guess. Cables then do not count as slack.

        Returns:
            Force [N] and moment about the finger's origin [N m] on the platform, shape (n, 6). The compliance: movement
            (shift, turn) of the platform for a unit load, symmetric, shape (n, 6, 6).
        """
        ...

    def rest_poses(self, count: int) -> Poses:
        """Return the reference configuration, `count` times."""
        ...


@dataclass(frozen=True, eq=False)
class PressPoints:
    """Points of a finger pad that carry forces when a flat face presses.

    Attributes:
        positions: points of the undeformed skin in the finger's frame [m], shape (n, 3).
        compliance: compliance between the points, symmetric [m/N], shape (3 n, 3 n).
        nodal: maps forces on the points to forces on the pad nodes, shape (3 m, 3 n); None if the points are the nodes.
        law: tables of the nonlinear law of the tissue; None for linear tissue.
        modulus: Young's modulus times the personal stiffness factor, E alpha [Pa].
    """

    positions: Array
    compliance: Array
    nodal: Array | None = None
    law: LawTables | None = None
    modulus: float = 1.0

    @property
    def node_count(self) -> int:
        """Number of nodes of the skin's pad, m."""
        return len(self.positions) if self.nodal is None else len(self.nodal) // 3

    @property
    def on(self) -> str:
        """'points' of the smooth skin, or 'nodes' of the mesh."""
        return "nodes" if self.nodal is None else "points"


class PressProblem:
    """Contact of one skin with one platform.

    Vectors are ordered by component: all x, then all y, then all z. Each component of a batch is then one block of
    columns.

    Args:
        compliance: compliance between points of the skin [m/N], shape (3 m, 3 m).
        positions: positions of these points on the undeformed skin, in the finger's frame [m], shape (m, 3).
        carrier: mechanism that carries the platform.
        friction: Coulomb's coefficient of friction.

    Attributes:
        rho: weight of the identity that is added to C in the alternating method [m/N].
        own: index of each component among the components of the whole skin in the order by point, shape (3 m,). The
            problem of some points, see `part`, has fewer components than the whole skin.
        exact, compliance: C in the order by component, in double and in single precision, shape (3 m, 3 m).
        jacobian: J, movement of the points for (shift, turn) of the platform, shape (3 m, 6).
        inverse: (C + rho I)^-1 and (C + rho I)^-1 J side by side, float32, shape (3 m, 3 m + 6).
        spread: transpose of (C + rho I)^-1 J, float32, shape (6, 3 m).
        gram: J' (C + rho I)^-1 J, shape (6, 6).

    Raises:
        DermisError: the compliance is not positive definite.
    """

    def __init__(self, compliance: Array, positions: Array, carrier: Carrier, friction: float) -> None:
        m = len(positions)
        # Index in the order by point, for each index in the order by component.
        order = np.arange(3 * m).reshape(m, 3).T.ravel()
        ends = np.linalg.eigvalsh(compliance)[[0, -1]]
        if not ends[0] > 0.0:
            raise DermisError("the compliance is not positive definite", where="platform", value=float(ends[0]))
        self.own = order
        self._set(compliance[order][:, order], positions, carrier, float(friction), float(np.sqrt(ends[0] * ends[1])))

    def _set(self, compliance: Array, positions: Array, carrier: Carrier, friction: float, rho: float) -> None:
        m = len(positions)
        self.positions, self.carrier, self.friction, self.count, self.rho = positions, carrier, friction, m, rho
        x, y, z = positions.T
        o, e = np.zeros(m), np.ones(m)
        # Movement of a point of the platform: shift + turn x position.
        self.jacobian = np.concatenate(
            [
                np.column_stack([e, o, o, o, z, -y]),
                np.column_stack([o, e, o, -z, o, x]),
                np.column_stack([o, o, e, y, -x, o]),
            ]
        )
        inverse = np.linalg.inv(compliance + rho * np.eye(3 * m))
        spread = inverse @ self.jacobian
        self.gram = self.jacobian.T @ spread
        self.exact, self.compliance = compliance, np.ascontiguousarray(compliance, np.float32)
        self.inverse = np.ascontiguousarray(np.hstack([inverse, spread]), np.float32)
        self.spread = np.ascontiguousarray(spread.T, np.float32)

    def columns(self, points: Indices) -> Indices:
        """Return the indices of the components of points, shape (3 k,).

        The components are in the order by component.

        Args:
            points: indices of the points, shape (k,).
        """
        return np.concatenate([points, self.count + points, 2 * self.count + points])

    def part(self, points: Indices) -> PressProblem:
        """Return the contact problem in which only given points carry force."""
        made, own = copy(self), self.columns(points)
        made.own = self.own[own]
        made._set(self.exact[np.ix_(own, own)], self.positions[points], self.carrier, self.friction, self.rho)
        return made

    def gap(self, poses: Poses) -> Array:
        """Return the gap of every undeformed point [m], shape (n, m)."""
        return self.local(poses)[1]

    def local(self, poses: Poses) -> tuple[Array, Array]:
        """Return the points in the platform's frame, and their gaps.

        The shapes are (n, m, 3) and (n, m), both in m.
        """
        local = (self.positions[None] - poses.centre[:, None]) @ poses.rotation
        over = np.maximum(np.sqrt(local[:, :, 0] ** 2 + local[:, :, 1] ** 2) - self.carrier.disc_radius, 0.0)
        return local, local[:, :, 2] + over * over * (0.5 / ROUNDING)
