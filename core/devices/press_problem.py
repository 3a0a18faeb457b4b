"""The contact problem of a platform under a pad: the skin as batches of rows need it, and what carries the disc."""

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
    """What carries a platform."""

    @property
    def disc_radius(self) -> float:
        """Radius of the face that touches [m]."""
        ...

    @property
    def rest(self) -> Array:
        """Command of the reference configuration, shape (motors,)."""
        ...

    def carry(self, commands: Array, start: Poses) -> Poses:
        """Return where the platform is without load, for commands (n, motors), found from poses nearby."""
        ...

    def give(self, commands: Array, poses: Poses, *, first: bool) -> tuple[Array, Array] | None:
        """Return what carries the platform at poses that need not be in balance; None where it is rigid.

        Args:
            first: poses are a first guess, from which nobody should conclude that a cable hangs slack.

        Returns:
            Force [N] and moment about the finger's origin [N m] on the platform, shape (n, 6), and P, its movement
            (shift, turn) for a load, symmetric, shape (n, 6, 6).
        """
        ...

    def rest_poses(self, count: int) -> Poses:
        """Return the reference configuration, `count` times."""
        ...


@dataclass(frozen=True, eq=False)
class PressPoints:
    """Points of a pad that carry the press of something flat.

    Attributes:
        positions: of undeformed skin in the finger's frame [m], shape (n, 3).
        compliance: between them, symmetric [m/N], shape (3 n, 3 n).
        nodal: forces on the nodes of the skin's mesh for forces on them, shape (3 m, 3 n); None where they are these.
        law: that the skin's tissue follows; None where it is linear. modulus: E alpha [Pa].
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
    """One skin under one platform.

    Vectors are by component, all x first, so that each component of a batch is one block of columns.

    Args:
        compliance: of points of the skin [m/N], shape (3 m, 3 m).
        positions: those points, undeformed, in the finger's frame [m], shape (m, 3).
        carrier: what carries the platform.
        friction: Coulomb's coefficient.

    Attributes:
        rho: penalty of the alternating method [N/m].
        own: of each component, where it is among those of all points by point, shape (3 m,).
        exact, compliance: C by component, in double and in single precision.
        jacobian: movement of the points with the platform's (shift, turn).
        inverse: (C + rho I)^-1, and that times the jacobian J beside it, float32; spread: the latter alone, transposed.
        gram: J' (C + rho I)^-1 J, shape (6, 6).

    Raises:
        DermisError: a compliance that is not positive definite.
    """

    def __init__(self, compliance: Array, positions: Array, carrier: Carrier, friction: float) -> None:
        m = len(positions)
        # by component, so that each component of a batch is one block of columns
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
        # how a node of the platform moves: shift + turn x position
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
        """Return where some points' components are in what is by component, shape (3 k,)."""
        return np.concatenate([points, self.count + points, 2 * self.count + points])

    def part(self, points: Indices) -> PressProblem:
        """Return the problem of some points, the others being free."""
        made, own = copy(self), self.columns(points)
        made.own = self.own[own]
        made._set(self.exact[np.ix_(own, own)], self.positions[points], self.carrier, self.friction, self.rho)
        return made

    def gap(self, poses: Poses) -> Array:
        """Return the gap of every undeformed point [m], shape (n, m)."""
        return self.local(poses)[1]

    def local(self, poses: Poses) -> tuple[Array, Array]:
        """Return the points in the platform's frame, (n, m, 3), and their gaps, (n, m) [m]."""
        local = (self.positions[None] - poses.centre[:, None]) @ poses.rotation
        over = np.maximum(np.sqrt(local[:, :, 0] ** 2 + local[:, :, 1] ** 2) - self.carrier.disc_radius, 0.0)
        return local, local[:, :, 2] + over * over * (0.5 / ROUNDING)
