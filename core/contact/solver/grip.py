"""Data of held objects: fingers, contexts and grips, displacement, and the result of a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import BONE, ContactBody, NodeGaps
from .cone import along
from .history import ContactHistory
from .law_skin import LawSkin
from .nodes import Nodes
from .smooth_contact import SmoothContact

SEARCH_RADIUS = 3e-3  # largest gap that is measured [m]


class Displacement(NamedTuple):
    """Displacement of a held object from its animated pose.

    Attributes:
        shift: translation of its centre of mass [m], shape (3,).
        turn: rotation about the centre of mass, shape (3, 3).
    """

    shift: Array
    turn: Array

    def then(self, move: Array) -> Displacement:
        """Return this displacement followed by a translation [m] and a rotation vector [rad], shape (6,)."""
        return Displacement(self.shift + move[:3], _rotation(move[3:]) @ self.turn)

    def since(self, other: Displacement, centre: Array) -> tuple[float, float]:
        """Return the distance from another displacement at a point of the object [m], and the angle [rad].

        Args:
            other: the other displacement.
            centre: the point, relative to the centre of mass, in world axes [m], shape (3,).
        """
        move = self.shift - other.shift + centre - other.turn @ self.turn.T @ centre
        return float(np.linalg.norm(move)), float(np.linalg.norm(_vector(self.turn @ other.turn.T)))

    @property
    def vector(self) -> Array:
        """Translation [m] and rotation vector [rad], shape (6,)."""
        return np.concatenate([self.shift, _vector(self.turn)])


NOWHERE = Displacement(np.zeros(3), np.eye(3))


def cross_matrix(v: Array) -> Array:
    """Return the matrix of the cross product with a vector, shape (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _rotation(vector: Array) -> Array:
    """Return the rotation matrix, shape (3, 3), of a rotation vector [rad], shape (3,), by Rodrigues."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-15:
        return np.eye(3)
    k = cross_matrix(vector / angle)
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def _vector(rotation: Array) -> Array:
    """Return the rotation vector [rad], shape (3,), of a rotation by less than half a turn."""
    axis = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    return axis * (angle / sine) if sine > 1e-15 else axis


@dataclass(frozen=True, eq=False)
class HoldingFinger:
    """Finger that may hold objects.

    Attributes:
        nodes: the pad nodes.
        name: name of the finger, for findings.
        bone: a point inside the finger [m], shape (3,); open surfaces are touched on the side of this point.
        law: nonlinear law of the skin; None for linear skin.
    """

    nodes: Nodes
    name: str = "finger"
    bone: Array = field(default_factory=lambda: BONE)
    law: LawSkin | None = None

    @property
    def points(self) -> Array:
        """Positions of the pad nodes [m], shape (m, 3)."""
        return self.nodes.positions

    @cached_property
    def contact(self) -> SmoothContact:
        """Gaps of the nodes."""
        return SmoothContact(SEARCH_RADIUS, self.bone)


@dataclass(frozen=True, eq=False)
class HoldContext:
    """One finger in a frame, with the bodies near it.

    Attributes:
        pose: rigid finger-to-world matrix, shape (4, 4).
        bodies: all near bodies in the finger's frame. The entry of the held object is replaced by the solver.
        own: index of the held object among them.
        history: friction history of the finger's nodes, which the finger's own solver also uses.
    """

    pose: Array
    bodies: tuple[ContactBody, ...]
    own: int
    history: ContactHistory


@dataclass(frozen=True)
class GripStep:
    """Result of one frame of a held object.

    Attributes:
        forces: forces on each finger's pad nodes in that finger's frame [N], shape (m, 3) each.
        status: OPEN, STICK or SLIP of each finger's nodes, shape (m,) each.
        on_object: total force [N] and torque about the centre of mass [N m] of all contacts on the object, in world
            axes, shape (6,). Forces act at the deformed skin.
        required: wrench of inertia and gravity: m (a - g) and the rate of angular momentum, shape (6,).
        displacement: displacement of the object from its animated pose: translation [m] and rotation vector [rad],
            shape (6,).
        holds: whether the contacts supply the required wrench. If not, the forces are the nearest that friction admits.
        residual: residual of the contact laws, see `cone.assess`.
        iterations: number of iterations of the solver.
        gaps: gaps of each finger's nodes.
        slips: relative displacement w of each finger's nodes [m], shape (m, 3) each.
    """

    forces: tuple[Array, ...]
    status: tuple[NDArray[np.int8], ...]
    on_object: Array
    required: Array
    displacement: Array
    holds: bool
    residual: float
    iterations: int
    gaps: tuple[NodeGaps, ...] = ()
    slips: tuple[Array, ...] = ()


@dataclass
class Grip:
    """One finger's part of a frame: its nodes near bodies, and their data.

    Attributes:
        gaps: gaps of the finger's nodes.
        near: indices of the nodes within reach of a body, shape (k,).
        matrix: compliance of the near nodes [m/N], shape (3 k, 3 k).
        inverse: inverse of the matrix plus the weight of the steps [N/m], shape (3 k, 3 k).
        offset: offset b of the near nodes, with `bent` added [m], shape (k, 3).
        bent: minus the correction of nonlinear skin at the near nodes [m], shape (k, 3); None for linear skin.
        pose: pose of the finger in the world, shape (4, 4).
        history: friction history of the finger's nodes.
        own: index of the held object among the bodies.
        wrench: map from the forces on the near nodes to the wrench of the object on the skin, shape (6, 3 k).
        arms: vectors from the object's centre of mass to the near nodes that are closest to it, in world axes [m],
            shape (n, 3).
    """

    gaps: NodeGaps
    near: Indices
    matrix: Array
    inverse: Array
    offset: Array
    pose: Array
    history: ContactHistory
    own: int
    bent: Array | None = None
    wrench: Array = field(init=False)
    arms: Array = field(init=False)

    def act_at(self, places: Array, middle: Array) -> None:
        """Set the points at which forces act, and compute `wrench` and `arms`.

        Args:
            places: points in the finger's frame [m], shape (m, 3).
            middle: the object's centre of mass in the world [m], shape (3,).
        """
        turn = self.pose[:3, :3]
        arm = places[self.near] @ turn.T + self.pose[:3, 3] - middle
        wrench = np.zeros((6, self.near.size, 3))
        wrench[:3] = turn[:, None, :]
        for axis in range(3):
            wrench[3:, :, axis] = np.cross(arm, turn[:, axis]).T
        mine = self.gaps.body[self.near] == self.own
        wrench[:, ~mine] = 0.0  # nodes on other bodies do not carry the object
        self.wrench, self.arms = wrench.reshape(6, -1), arm[mine]

    @property
    def friction(self) -> Array:
        """Friction coefficients at the near nodes, shape (k,)."""
        return self.gaps.friction[self.near]

    @property
    def pressing(self) -> bool:
        """Whether a node would penetrate the held object without any force."""
        closest = self.gaps.body[self.near] == self.own
        offset = self.offset if self.bent is None else self.offset - self.bent
        return bool((along(offset, self.gaps.normal[self.near])[closest] < 0.0).any())
