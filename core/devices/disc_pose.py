"""Data of contact with a rigid disc.

They are the pose and the surface of the disc, the friction state, and a solution.

Source: [S0] 3.1 (rigid disc on the skin), 3.4 (friction state)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.solver.bodies import ContactBody
from ..contact.solver.cone import OPEN
from ..contact.solver.law_skin import TOLERANCE as LAW_TOLERANCE
from ..contact.solver.law_skin import LawState
from ..surface.gap import GapQuery
from ..surface.plane import Plane
from .disc_device import DiscDevice
from .linkage import PlatformPose
from .poses import crossing

TOLERANCE = 1e-6  # largest residual of Newton's method, relative to the forces
FALLBACK_TOLERANCE = 1e-8  # largest residual of the slower method
ROUNDING = 1.0e-3  # [m] radius of the disc's rounded rim


@dataclass(frozen=True)
class DiscPose:
    """Pose of the disc in the finger's frame, with its derivatives.

    The derivatives are with respect to the configuration.

    Attributes:
        rotation: rotation from the disc's frame to the finger's, shape (3, 3). The touching face points along -Z of the
            disc.
        centre: position of the disc's centre [m], shape (3,).
        spin: derivative of the rotation; row j is the rotation vector per unit of x_j, shape (n, 3).
        shift: derivative of the centre; column j is for x_j, shape (3, n).
        x: the configuration, shape (n,).
    """

    rotation: Array
    centre: Array
    spin: Array
    shift: Array
    x: Array

    @property
    def normal(self) -> Array:
        """Unit normal out of the disc, into the finger, shape (3,)."""
        return -self.rotation[:, 2]

    @property
    def turning(self) -> int:
        """Number of values, from the first on, that can turn the disc.

        It is 2 for a configuration of three values, otherwise the number of all values.
        """
        return 2 if len(self.spin) == 3 else len(self.spin)

    def motion(self) -> Array:
        """Return the derivative of the disc's movement, shape (n, 3, 4).

        A point of the disc at p in the finger's frame moves by `motion[j] @ (p, 1)` per unit of x_j.
        """
        out = np.empty((len(self.spin), 3, 4))
        turns = out[:, :, :3]
        turns[:] = crossing(self.spin)
        out[:, :, 3] = self.shift.T
        out[:, :, 3] -= turns @ self.centre
        return out


def placed(device: DiscDevice, pose: PlatformPose) -> DiscPose:
    """Transform a platform's pose from the base's frame to the finger's."""
    turn, origin = device.mount[:3, :3], device.mount[:3, 3]
    return DiscPose(turn @ pose.rotation, turn @ pose.centre + origin, pose.spin @ turn.T, turn @ pose.d_centre, pose.x)


@dataclass(frozen=True, eq=False)
class Disc(Plane):
    """Surface of the disc in its own frame: flat up to `radius`, then rounded.

    The rim falls as a parabola, whose radius of curvature is `rounding` where it leaves the face. All gaps are measured
    along the normal of the face. Points of a device's disc are 1.6 mm apart, which is too far for normals that turn
    about a rim of 1 mm.

    Attributes:
        radius: radius of the flat face [m].
        rounding: radius of the rounded rim [m].
    """

    normal: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    point: Array = field(default_factory=lambda: np.zeros(3))
    radius: float = 8.0e-3
    rounding: float = ROUNDING

    @property
    def rim(self) -> tuple[float, float]:
        """Radii of the face and of the rim [m]."""
        return self.radius, self.rounding

    def query(self, points: Array, search_radius: float = np.inf) -> GapQuery:
        """Return gaps, closest points and normals for points in the disc's frame.

        The rim has the normal of the face.

        Args:
            points: the points [m], shape (n, 3).
            search_radius: largest gap [m]. Points with a larger gap have an infinite gap in the result.
        """
        over = np.maximum(np.hypot(points[:, 0], points[:, 1]) - self.radius, 0.0)
        gap = -points[:, 2] + over**2 / (2 * self.rounding)
        n = len(gap)
        near = gap <= search_radius
        normal = np.where(near[:, None], self.normal, 0.0)
        point = np.where(near[:, None], points - gap[:, None] * self.normal, np.nan)
        triangle = np.where(near, 0, -1)
        return GapQuery(np.where(near, gap, np.inf), normal, point, triangle, np.zeros((n, 3)), np.zeros(n, bool))

    def body(self, pose: DiscPose, friction: float) -> ContactBody:
        """Return the disc at a pose as a contact body with a friction coefficient."""
        return ContactBody(self, pose.rotation, pose.centre, friction)


@dataclass(frozen=True, eq=False)
class FrictionState:
    """Friction state after a step: the history of the contact.

    Attributes:
        anchored: whether each point of the skin has an anchor, shape (m,).
        anchor: anchor of each point, x and y in the disc's frame [m], shape (m, 2).
        force: force on each point at the end of the last step [N], shape (m, 3).
        sticking: whether each point sticks, shape (m,).
        moved: displacement of the points at the end of the last step [m], shape (m, 3).
        last: contact at the end of the last step, from which the first guess of the next step is made.
        law: state of the nonlinear law at the end of the last step; None at rest and on linear skin.
    """

    anchored: NDArray[np.bool_]
    anchor: Array
    force: Array
    sticking: NDArray[np.bool_]
    moved: Array
    last: DiscSolution | None = None
    law: LawState | None = None

    @classmethod
    def rest(cls, count: int) -> FrictionState:
        """Return the state of `count` points before any contact."""
        nothing = np.zeros((count, 3))
        return cls(np.zeros(count, bool), np.zeros((count, 2)), nothing, np.zeros(count, bool), nothing)


@dataclass(frozen=True, eq=False)
class DiscSolution:
    """Contact with the disc at one pose.

    Attributes:
        pose: pose of the disc.
        near: indices of the candidates, the points of the skin that may touch, shape (s,); all other points carry no
            force.
        answer: forces on the candidates [N], each followed by its derivative with respect to the configuration, shape
            (s, 3, 1 + n).
        displacement: relative displacement w = C f + b of the candidates [m], shape (s, 3).
        status: OPEN, STICK or SLIP, shape (s,).
        residual: |f - P(f - r w)|, divided by the larger of |f| and |P(f - r w)|, with Coulomb's projection P and the
            weight r of displacements. For forces of the fallback it is that of `contact.solver.sweeps.Swept`.
        iterations: number of Newton steps, plus that of iterations of the fallback.
        method: 'none' (nothing touches), 'newton', or 'fallback' if Newton's method did not converge.
        amounts: correction c of nonlinear skin at the pad nodes [m], see `Stimulus.given`, shape (3 m,); None if the
            law was not evaluated.
        law: state of the nonlinear law; None if it was not evaluated.
        less: correction c at all points with which contact was solved [m], shape (points, 3); None on linear skin.
    """

    pose: DiscPose
    near: NDArray[np.intp]
    answer: Array
    displacement: Array
    status: NDArray[np.int8]
    residual: float
    iterations: int
    method: str
    amounts: Array | None = None
    law: LawState | None = None
    less: Array | None = None

    @property
    def force(self) -> Array:
        """Forces on the candidates [N], shape (s, 3)."""
        return self.answer[:, :, 0]

    @property
    def slope(self) -> Array:
        """Derivative of the forces with respect to the configuration, shape (s, 3, n)."""
        return self.answer[:, :, 1:]

    @property
    def converged(self) -> bool:
        """Whether the forces obey Coulomb's law within the tolerance."""
        return self.residual <= max(TOLERANCE, 10 * FALLBACK_TOLERANCE)

    @property
    def settled(self) -> bool:
        """Whether the residual of the nonlinear law is within its tolerance.

        True if the law was not evaluated.
        """
        return self.law is None or self.law.left <= LAW_TOLERANCE

    @cached_property
    def touching(self) -> bool:
        """Whether any point carries force."""
        return bool((self.status != OPEN).any())

    def spread(self, count: int) -> Array:
        """Return the forces on all points [N], shape (count, 3)."""
        out = np.zeros((count, 3))
        out[self.near] = self.force
        return out
