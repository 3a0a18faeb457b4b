"""The data of holding: the fingers, the context of each, its grip, and one frame's answer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import BONE, ContactBody, NodeGaps
from .cone import along
from .history import ContactHistory
from .law_skin import LawSkin


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
