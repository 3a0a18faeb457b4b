"""GripSolver: an object held by fingers; its six degrees of freedom balance contact, gravity and inertia.

The object follows its animated pose up to a small displacement d (translation and turn) that is found with the contact
forces: w = C f + b - G' d at the nodes, G f = h on the object, where G sums forces and torques and h is what gravity
and inertia ask for. Where friction cannot supply h, the object stays on its animated path, the forces are those that
friction can carry, and a finding says that it slips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import Array
from ...errors import DermisError, Finding
from ...surface.gap import Surface
from ...surface.plane import Plane
from .balance import TOLERANCE, balance
from .bodies import ContactBody, node_gaps
from .cone import STICK, along
from .grip import Grip, GripStep, HoldContext, HoldingFinger
from .notes import Notes
from .solve import solve, status_of

SEARCH_RADIUS = 3e-3


class GripSolver:
    """Solves the grip on one object, frame after frame.

    Args:
        surface: of the object, in its own space [m].
        mass: [kg].
        fingers: that may touch it.
        friction: Coulomb coefficient against skin.
        centre: of mass, in its own space [m].
        inertia: about the centre, in its own space [kg m^2], shape (3, 3).
        gravity: in world space [m/s^2].
        name: for findings.

    Raises:
        DermisError: a mass that is not positive, or no finger.
    """

    def __init__(
        self,
        surface: Surface | Plane,
        mass: float,
        fingers: Sequence[HoldingFinger],
        friction: float,
        *,
        centre: Array,
        inertia: Array,
        gravity: Array,
        name: str,
    ) -> None:
        if not (np.isfinite(mass) and mass > 0.0):
            raise DermisError("a held object needs a mass", where=name, value=mass, limit="> 0 kg")
        if not fingers:
            raise DermisError("nothing can hold the object", where=name, remedy="Add a finger")
        self.centre, self.inertia, self.gravity = centre, inertia, gravity
        self.surface, self.mass, self.friction, self.name = surface, mass, friction, name
        self.fingers = tuple(fingers)
        self._rho = float(np.median(np.concatenate([np.diag(f.compliance) for f in fingers])))
        self.softness, self.deforms = 0.0, False
        self.carry: Array | None = None  # as in `ContactBody`
        self._inverses: dict[int, tuple[bytes, Array, Array]] = {}
        self._notes = Notes(name)
        self.let_go()

    def let_go(self) -> None:
        """Put the object back on its animated path; the fingers keep their friction's history."""
        self._turn = np.eye(3)
        self._shift = np.zeros(3)
        self._forces = [np.zeros_like(f.points) for f in self.fingers]
        self._scaled = [np.zeros_like(f.points) for f in self.fingers]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Frames in which the object slipped or was not touched at all."""
        return self._notes.findings()

    def step_among(
        self,
        pose: Array,
        contexts: Sequence[HoldContext | None],
        acceleration: Array,
        angular_velocity: Array,
        angular_acceleration: Array,
        *,
        scene_frame: float,
        only_if_pressed: bool = False,
    ) -> GripStep | None:
        """Solve the next frame of fingers that may touch other bodies too.

        Args:
            pose: animated object-to-world matrix, rigid, shape (4, 4).
            contexts: of each finger; None for one that is nowhere near.
            acceleration: of the centre of mass, in world space [m/s^2].
            angular_velocity, angular_acceleration: in world space [rad/s], [rad/s^2].
            scene_frame: of the scene, for findings.
            only_if_pressed: return None, and change nothing, where no finger presses the object.
        """
        rotation, middle = self.placed(pose)
        required = self._required(rotation, acceleration, angular_velocity, angular_acceleration)
        grips = [None if r is None else self._grip(i, r, rotation, middle) for i, r in enumerate(contexts)]
        there = [g for g in grips if g is not None]
        if only_if_pressed and not any(g.pressing for g in there):
            return None
        step = None
        if any(g.pressing for g in there):
            step = self._balanced(grips, required)
            if step is None:
                self._note("slips", "friction cannot hold the object", scene_frame)
        else:
            self._note("dropped", "nothing touches the held object", scene_frame)
        if step is None:
            step = self._carried(grips)
            holds = False
        else:
            self._shift = self._shift + step[1][:3]
            self._turn = _rotation(step[1][3:]) @ self._turn
            holds = True
        return self._finish(grips, step, contexts, required, pose, holds)

    # -- one frame -----------------------------------------------------------------------------------------------

    def placed(self, pose: Array) -> tuple[Array, Array]:
        """Return rotation and centre of mass [m] where the object is now: animated, then displaced."""
        rotation = self._turn @ pose[:3, :3]
        middle = pose[:3, :3] @ self.centre + pose[:3, 3] + self._shift
        return rotation, middle

    def _required(self, rotation: Array, a: Array, omega: Array, alpha: Array) -> Array:
        inertia = rotation @ self.inertia @ rotation.T
        return np.concatenate([self.mass * (a - self.gravity), inertia @ alpha + np.cross(omega, inertia @ omega)])

    def body(self, finger_pose: Array, rotation: Array, middle: Array) -> ContactBody:
        """Return the object in a finger's frame, its centre of mass at `middle` in the world [m]."""
        turn = finger_pose[:3, :3].T @ rotation
        origin = middle - rotation @ self.centre
        place = finger_pose[:3, :3].T @ (origin - finger_pose[:3, 3])
        return ContactBody(self.surface, turn, place, self.friction, self.softness, self.deforms, carry=self.carry)

    def _grip(self, index: int, context: HoldContext, rotation: Array, middle: Array) -> Grip:
        finger, pose = self.fingers[index], context.pose
        body = self.body(pose, rotation, middle)
        bodies = (*context.bodies[: context.own], body, *context.bodies[context.own + 1 :])
        last = self._forces[index]
        deformed = finger.points + (finger.compliance @ last.reshape(-1)).reshape(-1, 3)
        expected = context.history.expected(bodies, deformed, SEARCH_RADIUS)
        gaps = node_gaps(finger.points, bodies, SEARCH_RADIUS, finger.bone, expected)
        near = np.flatnonzero(gaps.body >= 0)
        offset = context.history.offset(gaps, finger.points)[near]
        turn = pose[:3, :3]
        arm = finger.points[near] @ turn.T + pose[:3, 3] - middle
        wrench = np.zeros((6, near.size, 3))
        wrench[:3] = turn[:, None, :]
        for axis in range(3):
            wrench[3:, :, axis] = np.cross(arm, turn[:, axis]).T
        wrench[:, gaps.body[near] != context.own] = 0.0  # what presses on another body does not carry this one
        soft = gaps.compliance(finger.areas, finger.name)[near]
        key = near.tobytes() + soft.tobytes()
        kept = self._inverses.get(index)
        if kept is None or kept[0] != key:
            rows = (3 * near[:, None] + np.arange(3)).reshape(-1)
            matrix = finger.compliance[rows[:, None], rows] + np.diag(np.repeat(soft, 3))
            inverse: Array = np.asarray(np.linalg.inv(matrix + self._rho * np.eye(rows.size)), dtype=np.float64)
            kept = self._inverses[index] = (key, matrix, inverse)
        return Grip(gaps, near, kept[1], kept[2], offset, wrench.reshape(6, -1), context.history, context.own)

    def _balanced(
        self, everybody: Sequence[Grip | None], required: Array
    ) -> tuple[list[Array], Array, float, int] | None:
        """Forces that supply what is required; None if it slips."""
        index = [i for i, g in enumerate(everybody) if g is not None]
        grips = [g for g in everybody if g is not None]
        forces, scaled = (
            [kept[i][g.near] for i, g in zip(index, grips, strict=True)] for kept in (self._forces, self._scaled)
        )
        found = balance(grips, forces, scaled, required, self._rho)
        if found is None:
            return None
        for i, grip, ended, shift in zip(index, grips, found.scaled, found.shifts, strict=True):
            self._scaled[i] = np.zeros_like(self.fingers[i].points)
            self._scaled[i][grip.near] = ended
            grip.offset += shift
        return found.forces, found.move, found.residual, found.iterations

    def _carried(self, grips: Sequence[Grip | None]) -> tuple[list[Array], Array, float, int]:
        """Forces with the object on its animated path: what friction can carry."""
        forces, residual, iterations = [], 0.0, 0
        self._scaled = [np.zeros_like(f.points) for f in self.fingers]
        for grip in grips:
            if grip is None:
                continue
            normals = grip.gaps.normal[grip.near]
            s = solve(grip.matrix, grip.offset, grip.friction, normals=normals, tolerance=TOLERANCE)
            forces.append(s.force)
            residual, iterations = max(residual, s.residual), iterations + s.iterations
        return forces, np.zeros(6), residual, iterations

    def _finish(
        self,
        grips: Sequence[Grip | None],
        step: tuple[list[Array], Array, float, int],
        contexts: Sequence[HoldContext | None],
        required: Array,
        pose: Array,
        holds: bool,
    ) -> GripStep:
        """Sum the forces up and move the anchors to where the nodes are now."""
        forces, _, residual, iterations = step
        on_object = np.zeros(6)
        status, gaps, slips = [], [], []
        rotation, middle = self.placed(pose)
        rest = iter(forces)
        for i, (grip, context) in enumerate(zip(grips, contexts, strict=True)):
            finger = self.fingers[i]
            whole, w = np.zeros_like(finger.points), np.zeros_like(finger.points)
            if grip is None or context is None:
                self._forces[i] = whole
                continue
            force = next(rest)
            whole[grip.near] = force
            self._forces[i] = whole
            on_object -= grip.wrench @ force.reshape(-1)
            w[grip.near] = (grip.matrix @ force.reshape(-1)).reshape(-1, 3) + grip.offset
            body = self.body(context.pose, rotation, middle)
            bodies = (*grip.gaps.bodies[: grip.own], body, *grip.gaps.bodies[grip.own + 1 :])
            moved = replace(grip.gaps, bodies=bodies)
            found = status_of(whole, w, grip.gaps.normal, grip.gaps.friction)
            gap = along(w, grip.gaps.normal)
            # on the body's surface: what is pressed into a soft one lies on it all the same
            soft = grip.gaps.compliance(finger.areas, finger.name)
            deformed = finger.points + (finger.compliance @ whole.reshape(-1)).reshape(-1, 3)
            on_body = deformed + soft[:, None] * whole - gap[:, None] * moved.normal
            grip.history.keep(moved, found == STICK, on_body, gap)
            status.append(found)
            gaps.append(moved)
            slips.append(w)
        displacement = np.concatenate([self._shift, _vector(self._turn)])
        here = tuple(self._forces[i] for i, g in enumerate(grips) if g is not None)
        return GripStep(
            here,
            tuple(status),
            on_object,
            required,
            displacement,
            holds,
            residual,
            iterations,
            tuple(gaps),
            tuple(slips),
        )

    def _note(self, code: str, what: str, where: float) -> None:
        remedy = "Press harder, raise the friction, make it lighter, or key when it is held"
        self._notes.warn(code, what, where, value=f"{self.mass:g} kg", remedy=remedy)


def _rotation(vector: Array) -> Array:
    """Rotation matrix of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def _vector(rotation: Array) -> Array:
    """Rotation vector [rad] of a rotation by less than half a turn."""
    axis = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    return axis * (angle / sine) if sine > 1e-15 else axis
