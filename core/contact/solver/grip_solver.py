"""GripSolver: contact of an object held by fingers, with balance of contact, gravity and inertia.

The object follows its animated pose up to a small displacement d (translation and rotation), which is solved together
with the contact forces f: w = C f + b - G' d at the nodes and G f = h for the object. G maps forces to a wrench, and h
is the wrench of gravity and inertia. Forces act at the deformed skin, so a frame is balanced again until the points of
action no longer change.

If friction cannot supply h, the object slips. It then keeps its displacement from the animated path, its material
slides along the skin, and the forces are the nearest to h that friction admits. A finding reports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import Array
from ...errors import DermisError, Finding
from ...surface.gap import Surface
from ...surface.plane import Plane
from .balance import Balance, balance
from .bodies import ContactBody, moved
from .cone import SLIP, STICK, along
from .grip import NOWHERE, SEARCH_RADIUS, Displacement, Grip, GripStep, HoldContext, HoldingFinger
from .notes import Notes
from .solution import status_of

# A frame is balanced again after a displacement above this [m], or an error of the torque above this [N m].
STILL, TORQUE = 2e-5, 1e-6
# Largest number of balances in a frame, and of those before which gaps are measured again.
MAX_ROUNDS, MEASURED = 8, 3
LAW_ROUNDS = 30  # largest number of balances in a frame on nonlinear skin
# Weight of the steps of the method, relative to a node's own compliance. With this one, iterations are fewest.
WEIGHT = 1.5
# Largest displacement from one frame to the next without a warning [m], [rad].
SUDDEN = 1e-3, 0.05
# Largest displacement from the animated path [m], [rad].
FAR = 3e-3, 0.2


class GripSolver:
    """Solves the grip on one object, frame after frame.

    Args:
        surface: surface of the object in its own space [m].
        fingers: fingers that may touch the object.
        centre: centre of mass, in the object's own space [m], shape (3,).
        inertia: inertia tensor for a mass of 1 kg about the centre of mass, in the object's own space [m^2], shape (3,
            3).
        gravity: acceleration of gravity in world axes [m/s^2], shape (3,).
        name: name of the object, for findings.

    Attributes:
        mass: mass in the next frame [kg]; 0 for an object without weight and inertia.
        friction, softness, deforms, carry: as in `ContactBody`, in the next frame.

    Raises:
        DermisError: there is no finger.
    """

    def __init__(
        self,
        surface: Surface | Plane,
        fingers: Sequence[HoldingFinger],
        *,
        centre: Array,
        inertia: Array,
        gravity: Array,
        name: str,
    ) -> None:
        if not fingers:
            raise DermisError("no contact can hold the object", where=name, remedy="Add a finger")
        self.centre, self.inertia, self.gravity = centre, inertia, gravity
        self.surface = surface
        self.fingers = tuple(fingers)
        self._rho = WEIGHT * float(np.median(np.concatenate([np.diag(f.nodes.exact) for f in fingers])))
        self.mass, self.friction, self.softness, self.deforms = 0.0, 0.0, 0.0, False
        self.carry: Array | None = None
        self._inverses: dict[int, tuple[bytes, Array, Array]] = {}
        self._notes = Notes(name)
        self.let_go()

    def let_go(self) -> None:
        """Reset the displacement and the forces to zero; the fingers keep their friction history."""
        self._displacement = NOWHERE
        self._forces = [np.zeros_like(f.points) for f in self.fingers]
        self._scaled = [np.zeros_like(f.points) for f in self.fingers]
        self._deformed = [f.points for f in self.fingers]
        self._loaded = False
        self._more_torque = np.zeros(3)  # change of torque by the skin's deformation in the last frame [N m]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Frames in which the object slipped, moved far from its path, or was not touched."""
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
        """Solve the next frame; the fingers may touch other bodies too.

        Args:
            pose: animated object-to-world matrix, rigid, shape (4, 4).
            contexts: context of each finger; None for a finger that is not near any body.
            acceleration: acceleration of the centre of mass in world axes [m/s^2], shape (3,).
            angular_velocity, angular_acceleration: in world axes [rad/s], [rad/s^2], shape (3,) each.
            scene_frame: scene frame, for findings.
            only_if_pressed: whether to return None without changing the state if no finger presses the object.
        """
        rotation, middle = began = self.placed(pose)
        laws = [f.law for f, c in zip(self.fingers, contexts, strict=True) if c is not None and f.law is not None]
        for law in laws:
            law.begin()
        grips = [None if c is None else self._grip(i, c, began, began) for i, c in enumerate(contexts)]
        pressing = any(g is not None and g.pressing for g in grips)
        if only_if_pressed and not pressing:
            for law in laws:
                law.go_back()
            return None
        before, lost = self._displacement, 0
        for again in range(LAW_ROUNDS if laws else MAX_ROUNDS):
            required = self._required(rotation, acceleration, angular_velocity, angular_acceleration)
            asked = required.copy()
            if not again:
                asked[3:] -= self._more_torque
            self._bend(grips)
            found = self._balanced(grips, asked, pressing)
            if found.holds:
                self._displacement = self._displacement.then(found.move)
                rotation, middle = self.placed(pose)
            self._look(grips)
            torque = self._act(grips, middle)
            if not again:
                self._more_torque = torque - asked[3:] if found.holds else np.zeros(3)
            agreed = all(law.settled or law.lost for law in laws)
            still = found.size <= STILL and agreed
            if not agreed or lost < sum(law.lost for law in laws):  # once more, with the best correction
                lost = sum(law.lost for law in laws)
                continue
            turned = np.abs(torque - required[3:]).max() > TORQUE
            if again + 1 >= MAX_ROUNDS or not found.holds or ((still or again > MEASURED) and not turned):
                break
            if not still and again < MEASURED:  # limited, since the closest faces may alternate at an edge
                now = rotation, middle
                grips = [None if c is None else self._grip(i, c, now, began) for i, c in enumerate(contexts)]
        if not (pressing and found.holds):
            self._note_failure(pressing, scene_frame)
        if self._loaded:
            what = "the held object leaves its animated path far in one sample"
            self._too_far("gives-way", what, before, found.centre, SUDDEN, scene_frame)
        self._loaded = pressing
        what = "the held object creeps off its animated path, and is kept near it"
        creeps = found.holds and self._too_far("creeps", what, NOWHERE, found.centre, FAR, scene_frame)
        if creeps:
            self._displacement = before
        return self._finish(grips, found, contexts, required, pose, drawn=creeps or not found.holds)

    # -- one frame -----------------------------------------------------------------------------------------------

    def placed(self, pose: Array) -> tuple[Array, Array]:
        """Return rotation and centre of mass of the displaced object in the world, for an animated pose."""
        rotation = self._displacement.turn @ pose[:3, :3]
        middle = pose[:3, :3] @ self.centre + pose[:3, 3] + self._displacement.shift
        return rotation, middle

    def _required(self, rotation: Array, a: Array, omega: Array, alpha: Array) -> Array:
        inertia = self.mass * (rotation @ self.inertia @ rotation.T)
        return np.concatenate([self.mass * (a - self.gravity), inertia @ alpha + np.cross(omega, inertia @ omega)])

    def body(self, finger_pose: Array, rotation: Array, middle: Array) -> ContactBody:
        """Return the object in a finger's frame.

        Args:
            finger_pose: finger-to-world matrix, shape (4, 4).
            rotation: rotation of the object to the world, shape (3, 3).
            middle: its centre of mass in the world [m], shape (3,).
        """
        turn = finger_pose[:3, :3].T @ rotation
        origin = middle - rotation @ self.centre
        place = finger_pose[:3, :3].T @ (origin - finger_pose[:3, 3])
        return ContactBody(self.surface, turn, place, self.friction, self.softness, self.deforms, carry=self.carry)

    def _grip(self, index: int, context: HoldContext, now: tuple[Array, Array], began: tuple[Array, Array]) -> Grip:
        """Measure the grip of one finger.

        Args:
            index: index of the finger.
            context: its context in this frame.
            now: rotation and centre of mass of the object at its present displacement.
            began: the same at the begin of the frame.
        """
        finger, pose = self.fingers[index], context.pose
        body = self.body(pose, *now)
        bodies = (*context.bodies[: context.own], body, *context.bodies[context.own + 1 :])
        expected = context.history.expected(bodies, self._deformed[index], SEARCH_RADIUS)
        gaps = finger.contact.look(finger.nodes, bodies, expected - finger.points)
        near = np.flatnonzero(gaps.body >= 0)
        offset = context.history.offset(gaps, finger.points)[near]
        new = np.flatnonzero((gaps.body[near] == context.own) & (context.history.body[near] != context.own))
        if now is not began and new.size:  # a node without an anchor is anchored at the object's pose at the begin
            points, normal, then = finger.points[near[new]], gaps.normal[near[new]], self.body(pose, *began)
            went = moved(then, body, points)
            offset[new] -= went - along(went, normal)[:, None] * normal
        soft = gaps.compliance(finger.nodes.areas)[near]
        key = near.tobytes() + soft.tobytes()
        kept, bent = self._inverses.get(index), None
        if kept is None or kept[0] != key:
            rows = (3 * near[:, None] + np.arange(3)).reshape(-1)
            matrix = finger.nodes.exact[rows[:, None], rows] + np.diag(np.repeat(soft, 3))
            inverse: Array = np.asarray(np.linalg.inv(matrix + self._rho * np.eye(rows.size)), dtype=np.float64)
            kept = self._inverses[index] = (key, matrix, inverse)
        if finger.law is not None:
            bent = -finger.law.beyond[near]
            offset = offset + bent
        grip = Grip(gaps, near, kept[1], kept[2], offset, pose, context.history, context.own, bent)
        grip.act_at(expected, now[1])
        return grip

    def _balanced(self, everybody: Sequence[Grip | None], required: Array, pressing: bool) -> Balance:
        """Balance the grips, and add the effect of the object's displacement to the nodes' offsets.

        Args:
            everybody: grip of each finger, or None.
            required: required wrench on the object, shape (6,).
            pressing: whether any finger presses the object; otherwise all forces are zero.
        """
        index = [i for i, g in enumerate(everybody) if g is not None]
        grips = [g for g in everybody if g is not None]
        if pressing:
            forces, scaled = (
                [kept[i][g.near] for i, g in zip(index, grips, strict=True)] for kept in (self._forces, self._scaled)
            )
            found = balance(grips, forces, scaled, required, self._rho)
        else:
            nothing = [np.zeros((g.near.size, 3)) for g in grips]
            found = Balance(nothing, nothing, nothing, np.zeros(6), 0.0, np.zeros(3), False, 0.0, 0)
        self._forces, self._scaled = ([np.zeros_like(f.points) for f in self.fingers] for _ in range(2))
        for i, grip, force, ended, shift in zip(index, grips, found.forces, found.scaled, found.shifts, strict=True):
            self._forces[i][grip.near], self._scaled[i][grip.near] = force, ended
            grip.offset += shift
        for i, (finger, force) in enumerate(zip(self.fingers, self._forces, strict=True)):
            self._deformed[i] = finger.points + (finger.nodes.exact @ force.reshape(-1)).reshape(-1, 3)
            if finger.law is not None:
                self._deformed[i] -= finger.law.beyond
        return found

    def _bend(self, grips: Sequence[Grip | None]) -> None:
        """Update the offsets for the present correction of nonlinear skin."""
        for i, grip in enumerate(grips):
            law = self.fingers[i].law
            if grip is not None and law is not None and grip.bent is not None:
                change = -law.beyond[grip.near] - grip.bent
                grip.offset += change
                grip.bent = grip.bent + change

    def _look(self, grips: Sequence[Grip | None]) -> None:
        """Evaluate the nonlinear laws of the skins for the present forces."""
        for i, grip in enumerate(grips):
            law = self.fingers[i].law
            if grip is None or law is None or law.lost:
                continue
            law.look(self._forces[i])

    def _act(self, grips: Sequence[Grip | None], middle: Array) -> Array:
        """Set the points of action to the deformed skin; return the torque on the object's centre of mass [N m]."""
        torque = np.zeros(3)
        for i, grip in enumerate(grips):
            if grip is not None:
                grip.act_at(self._deformed[i], middle)
                torque -= grip.wrench[3:] @ self._forces[i][grip.near].reshape(-1)
        return torque

    def _finish(
        self,
        grips: Sequence[Grip | None],
        found: Balance,
        contexts: Sequence[HoldContext | None],
        required: Array,
        pose: Array,
        *,
        drawn: bool,
    ) -> GripStep:
        """Sum up the forces and update the friction histories.

        Args:
            grips: grip of each finger, or None.
            found: result of the last balance.
            contexts: context of each finger, or None.
            required: required wrench on the object, shape (6,).
            pose: animated pose of the object, shape (4, 4).
            drawn: whether the object kept its displacement while its material slid along the skin.
        """
        on_object = np.zeros(6)
        met = [f.law for f, c in zip(self.fingers, contexts, strict=True) if c is not None and f.law is not None]
        unsettled = [law.left for law in met if not law.settled]
        forces, statuses, gaps, slips = [], [], [], []
        rotation, middle = self.placed(pose)
        for i, (grip, context) in enumerate(zip(grips, contexts, strict=True)):
            if grip is None or context is None:
                continue
            finger, whole, w = self.fingers[i], self._forces[i], np.zeros_like(self._forces[i])
            force = whole[grip.near].reshape(-1)
            on_object -= grip.wrench @ force
            w[grip.near] = (grip.matrix @ force).reshape(-1, 3) + grip.offset
            body = self.body(context.pose, rotation, middle)
            bodies = (*grip.gaps.bodies[: grip.own], body, *grip.gaps.bodies[grip.own + 1 :])
            ended = replace(grip.gaps, bodies=bodies)
            status = status_of(whole, grip.gaps.normal, grip.gaps.friction)
            # No node sticks to material that slid along the skin.
            held = np.where((grip.gaps.body == grip.own) & drawn & (status == STICK), SLIP, status).astype(np.int8)
            soft = grip.gaps.compliance(finger.nodes.areas)
            grip.history.keep(ended, held, whole, w, self._deformed[i], soft)
            forces.append(whole)
            statuses.append(status)
            gaps.append(ended)
            slips.append(w)
        return GripStep(
            tuple(forces),
            tuple(statuses),
            on_object,
            required,
            self._displacement.vector,
            found.holds,
            max([found.residual, *unsettled]),
            found.iterations,
            tuple(gaps),
            tuple(slips),
        )

    def _note_failure(self, pressing: bool, frame: float) -> None:
        code, what = "slips", "friction cannot hold the object"
        if not pressing:
            code, what = "dropped", "nothing touches the held object"
        remedy = "Press harder, raise the friction, make it lighter, or key when it is held"
        self._notes.warn(code, what, frame, value=f"{self.mass:g} kg", remedy=remedy)

    def _too_far(
        self, code: str, what: str, since: Displacement, centre: Array, limits: tuple[float, float], frame: float
    ) -> bool:
        """Warn if the object is farther from a displacement than limits [m], [rad]; return whether it is."""
        far, angle = self._displacement.since(since, centre)
        beyond = far > limits[0] or angle > limits[1]
        if beyond:
            value, limit = (f"{1e3 * m:.2g} mm, {np.degrees(a):.2g} deg" for m, a in ((far, angle), limits))
            remedy = "Press harder, make it lighter, or round the kinks of its motion over a longer time"
            self._notes.warn(code, what, frame, value=value, limit=f"<= {limit}", remedy=remedy)
        return beyond
