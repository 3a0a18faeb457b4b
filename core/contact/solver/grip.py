"""The data of holding: fingers, the context and the grip of each, a frame's answer, and the object's displacement."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import BONE, ContactBody, NodeGaps
from .cone import along
from .history import ContactHistory
from .law_skin import LawSkin


class Displacement(NamedTuple):
    """Of a held object: `shift` of its centre of mass [m], shape (3,), and `turn` about it, shape (3, 3)."""

    shift: Array
    turn: Array

    def then(self, move: Array) -> Displacement:
        """Return this, moved on by a translation [m] and a rotation vector [rad], shape (6,)."""
        return Displacement(self.shift + move[:3], _rotation(move[3:]) @ self.turn)

    def since(self, other: Displacement, centre: Array) -> tuple[float, float]:
        """Return how far it is from another one: at a point of the object [m], and in angle [rad].

        Args:
            centre: that point, from the centre of mass, in world axes [m], shape (3,).
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
    """Rotation matrix of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-15:
        return np.eye(3)
    k = cross_matrix(vector / angle)
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def _vector(rotation: Array) -> Array:
    """Rotation vector [rad] of a rotation by less than half a turn."""
    axis = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    return axis * (angle / sine) if sine > 1e-15 else axis


@dataclass(frozen=True, eq=False)
class HoldingFinger:
    """A finger that may hold.

    Attributes:
        compliance: compliance matrix of the finger's skin [m/N], shape (3 m, 3 m).
        points: pad nodes of the finger [m], shape (m, 3).
        name: for findings.
        areas: skin of each node [m^2], shape (m,); needed where an object is soft.
        bone: a point inside the finger [m]: open surfaces are touched on the side where it lies.
        law: by how much less its skin gives way than by its compliance; None where it is linear.
    """

    compliance: Array
    points: Array
    name: str = "finger"
    areas: Array | None = None
    bone: Array = field(default_factory=lambda: BONE)
    law: LawSkin | None = None


@dataclass(frozen=True, eq=False)
class HoldContext:
    """One finger in a frame: its pose, and the bodies that it touches besides the held object.

    Attributes:
        pose: finger-to-world matrix, rigid, shape (4, 4).
        bodies: everything near, posed in the finger's frame; the held object's own entry is replaced.
        own: index of the held object among them.
        history: where the finger's nodes stick; kept by whoever solves the finger otherwise.
    """

    pose: Array
    bodies: tuple[ContactBody, ...]
    own: int
    history: ContactHistory


@dataclass(frozen=True)
class GripStep:
    """One frame of a held object.

    Attributes:
        forces: on each finger's pad nodes, in that finger's frame [N], one (m, 3) a finger.
        status: OPEN, STICK or SLIP of each finger's nodes.
        on_object: total force and torque (about the centre of mass) of all contacts on the object, in world space
            [N, N m], shape (6,).
            Forces act where the deformed skin is.
        required: the wrench of gravity and inertia, m (a - g) and the rate of angular momentum, shape (6,).
        displacement: displacement of the object from its animated pose: translation [m] and rotation vector [rad],
            shape (6,).
        holds: contacts supply the required wrench; else the nearest that friction can carry.
        residual: residual of the contact laws, see `cone.natural_residual`.
        iterations: number of iterations of the solver.
        gaps: that each finger was solved for.
        slips: relative displacement w of each finger's nodes [m], one (m, 3) a finger.
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
    """One finger's part of a frame: its nodes near the object, and their data.

    Attributes:
        gaps: gaps of the finger's nodes.
        near: indices of the nodes within reach of anything, shape (k,).
        matrix: compliance of the near nodes [m/N], shape (3 k, 3 k).
        inverse: inverse of the matrix plus the weight of the steps [N/m], shape (3 k, 3 k).
        offset: b at them [m], shape (k, 3); less by `bent`.
        bent: by how much less skin with a law gives way than linear skin [m], shape (k, 3).
        pose: pose of the finger in the world, shape (4, 4).
        history: where they stick. own: index of the held object among the frame's bodies.
        wrench: from their forces to force and torque on the skin by the object, shape (6, 3 k).
        arms: vectors from the object's middle to the nodes that touch it, in world axes [m], shape (n, 3).
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
        """Let forces act at places in the finger's frame [m], shape (m, 3), about the object's middle in the world."""
        turn = self.pose[:3, :3]
        arm = places[self.near] @ turn.T + self.pose[:3, 3] - middle
        wrench = np.zeros((6, self.near.size, 3))
        wrench[:3] = turn[:, None, :]
        for axis in range(3):
            wrench[3:, :, axis] = np.cross(arm, turn[:, axis]).T
        mine = self.gaps.body[self.near] == self.own
        wrench[:, ~mine] = 0.0  # nodes that press on another body do not carry this one
        self.wrench, self.arms = wrench.reshape(6, -1), arm[mine]

    @property
    def friction(self) -> Array:
        """Coefficients at the near nodes, shape (k,)."""
        return self.gaps.friction[self.near]

    @property
    def pressing(self) -> bool:
        """Whether a node would sink into the held object if nothing gave way."""
        closest = self.gaps.body[self.near] == self.own
        offset = self.offset if self.bent is None else self.offset - self.bent
        return bool((along(offset, self.gaps.normal[self.near])[closest] < 0.0).any())
