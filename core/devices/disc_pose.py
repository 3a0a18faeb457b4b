"""DiscPose, Disc and what contact with it is described by: a pose, a surface, friction's memory, a solution.

Source: [S0] 3.1 (rigid disc on the skin), 3.4 (friction state)
"""

from __future__ import annotations

from dataclasses import dataclass, field

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

TOLERANCE = 1e-6  # of the natural residual, relative to the forces
FALLBACK_TOLERANCE = 1e-8
ROUNDING = 1.0e-3  # [m] radius by which the disc's rim falls away


@dataclass(frozen=True)
class DiscPose:
    """A pose of the disc in the finger's frame, with its derivatives by the device's configuration.

    Attributes:
        rotation: disc to finger, shape (3, 3). The side that touches faces -Z of the disc.
        centre: [m], shape (3,).
        spin: row j is the rotation vector for a unit of x_j, shape (n, 3). shift: column j moves the centre, (3, n).
        x: the configuration, shape (n,).
    """

    rotation: Array
    centre: Array
    spin: Array
    shift: Array
    x: Array

    @property
    def normal(self) -> Array:
        """Out of the disc, into the finger, shape (3,)."""
        return -self.rotation[:, 2]

    @property
    def turning(self) -> int:
        """How many of a configuration's first values may turn the disc: pitch and roll, or of more than three all."""
        return 2 if len(self.spin) == 3 else len(self.spin)

    def motion(self) -> Array:
        """Return how the disc moves with its configuration: at a place p by motion_j @ (p, 1), shape (n, 3, 4)."""
        out = np.empty((len(self.spin), 3, 4))
        turns = out[:, :, :3]
        turns[:] = crossing(self.spin)
        out[:, :, 3] = self.shift.T
        out[:, :, 3] -= turns @ self.centre
        return out


def placed(device: DiscDevice, pose: PlatformPose) -> DiscPose:
    """Return a platform's pose in the finger's frame."""
    turn, origin = device.mount[:3, :3], device.mount[:3, 3]
    return DiscPose(turn @ pose.rotation, turn @ pose.centre + origin, pose.spin @ turn.T, turn @ pose.d_centre, pose.x)


@dataclass(frozen=True, eq=False)
class Disc(Plane):
    """The disc as a surface for the path solver, in its own frame: flat up to `radius`, then rounded off.

    Attributes:
        radius, rounding: [m].
    """

    normal: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    point: Array = field(default_factory=lambda: np.zeros(3))
    radius: float = 8.0e-3
    rounding: float = ROUNDING

    def query(self, points: Array, search_radius: float = np.inf) -> GapQuery:
        """Return gap, closest point and normal of each point; the normal of the rim is that of the face."""
        over = np.maximum(np.hypot(points[:, 0], points[:, 1]) - self.radius, 0.0)
        gap = -points[:, 2] + over**2 / (2 * self.rounding)
        n = len(gap)
        near = gap <= search_radius
        normal = np.where(near[:, None], self.normal, 0.0)
        point = np.where(near[:, None], points - gap[:, None] * self.normal, np.nan)
        triangle = np.where(near, 0, -1)
        return GapQuery(np.where(near, gap, np.inf), normal, point, triangle, np.zeros((n, 3)), np.zeros(n, bool))

    def body(self, pose: DiscPose, friction: float) -> ContactBody:
        """Return the disc as something to touch, at a pose."""
        return ContactBody(self, pose.rotation, pose.centre, friction)


@dataclass(frozen=True, eq=False)
class FrictionState:
    """What friction remembers of the path so far.

    Attributes:
        anchored: points of the skin with an anchor, shape (m,).
        anchor: the point of the disc that each sticks to, x and y in the disc's frame [m], shape (m, 2).
        force: on the skin at the end of the last step [N], shape (m, 3).
        sticking: points that the disc carries along, shape (m,).
        moved: how far the points were from rest then [m], shape (m, 3).
        last: the contact that the last step ended in, from which the next one is guessed.
        law: of skin that follows it, at the end of the last step; None at rest.
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
        """Return the state of skin that touched nothing yet."""
        nothing = np.zeros((count, 3))
        return cls(np.zeros(count, bool), np.zeros((count, 2)), nothing, np.zeros(count, bool), nothing)


@dataclass(frozen=True, eq=False)
class DiscSolution:
    """Contact with the disc at one pose.

    Attributes:
        pose: of the disc.
        near: the points of the skin that may touch, shape (s,); all others carry no force.
        force: on them [N], shape (s, 3). displacement: w = C f + b of them [m], shape (s, 3).
        slope: derivative of the forces by the configuration, column j of point i at [i, :, j], shape (s, 3, n).
        status: OPEN, STICK or SLIP, shape (s,).
        residual: |f - P(f - w / rho)| / |f|. iterations: Newton steps.
        method: 'none', 'newton', or 'fallback' where Newton did not settle.
        amounts: of skin with a law by how much less than linear skin the pad nodes give way [m], shape (3 m,), see
            `Stimulus.given`; None where the law was not asked.
        law: its state there. less: the same as `amounts` at the points, that the contact was solved with, shape (n, 3).
    """

    pose: DiscPose
    near: NDArray[np.intp]
    force: Array
    displacement: Array
    slope: Array
    status: NDArray[np.int8]
    residual: float
    iterations: int
    method: str
    amounts: Array | None = None
    law: LawState | None = None
    less: Array | None = None

    @property
    def converged(self) -> bool:
        """Whether the forces obey the laws of contact."""
        return self.residual <= max(TOLERANCE, 10 * FALLBACK_TOLERANCE)

    @property
    def settled(self) -> bool:
        """Whether the law of skin that follows one has what it wants, too."""
        return self.law is None or self.law.left <= LAW_TOLERANCE

    @property
    def touching(self) -> bool:
        """Whether any point carries force."""
        return bool((self.status != OPEN).any())

    def spread(self, count: int) -> Array:
        """Return the forces on all points [N], shape (count, 3)."""
        out = np.zeros((count, 3))
        out[self.near] = self.force
        return out
