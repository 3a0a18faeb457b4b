"""HeldBody: a body while fingers hold it, with its mass, its motion and its balance of forces.

`holding_times` determines when it is held, as for the weight and the content that a shear tactor renders. The body is
balanced only if the skin of every finger that holds it is simulated, because the load on other fingers is not known.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import Finding
from ..motion import RoundedPath, accumulated
from ..parameters.material import BODY
from ..scene.tactile_scene import Body, Chunk, TactileScene
from ..surface.gap import Surface
from .holding_times import holding_times
from .pad_contact import PadContact
from .solver.bodies import ContactBody
from .solver.grip_solver import GripSolver, GripStep, HoldContext, HoldingFinger

# Smallest change of velocity between two samples that counts as a kink [m/s], [rad/s].
KINK, TURNING_KINK = 1e-3, 0.02


def can_be_held(scene: TactileScene, b: int, animated: Collection[str]) -> bool:
    """Return whether a body can ever be held: it must have a mass, constant or animated, and a mode of holding.

    Args:
        scene: the scene's header.
        b: index of the body.
        animated: names of the animated parameters.
    """
    given = scene.bodies[b].parameters
    if "mass" not in given and f"body/{b}/mass" not in animated:
        return False  # a body without a mass is not held
    mode = BODY["held_mode"].of(given, f"object '{scene.bodies[b].name}'")
    return mode == "keyed" or (mode == "auto" and len(scene.fingers) > 1)


def lots_of(met: Iterable[tuple[int, int]], bodies: Collection[int], fingers: Iterable[int]) -> list[tuple[int, ...]]:
    """Divide fingers into lots: two fingers that meet the same body are in one lot.

    Args:
        met: pairs of a finger and a body that come near each other at some time.
        bodies: bodies that count.
        fingers: fingers to divide.

    Returns:
        Fingers of each lot in rising order; lots in the order of their first finger.
    """
    lots = {f: {f} for f in fingers}
    first: dict[int, int] = {}
    for f, b in sorted(met):
        if b not in bodies or f not in lots:
            continue
        other = first.setdefault(b, f)
        if lots[f] is not lots[other]:
            lots[other] |= lots[f]
            for member in lots[f]:
                lots[member] = lots[other]
    return sorted({tuple(sorted(lot)) for lot in lots.values()})


def may_be_held(scene: TactileScene, b: int, chunk: Chunk) -> bool:
    """Return whether body `b` may be held in a chunk, by its parameters alone."""
    if not can_be_held(scene, b, chunk.animated):
        return False
    given = scene.bodies[b].parameters
    if BODY["held_mode"].of(given) == "keyed":
        switch = chunk.animated.get(f"body/{b}/held")
        return bool(given.get("held", BODY["held"].absent) if switch is None else (switch > 0.5).any())
    return True


class HeldBody:
    """One body that may be held.

    Args:
        scene: the scene's header.
        pad_contact: contact of the pads over the whole range.
        b: index of the body.
        skins: skins of the fingers that are simulated, by the index of the finger.
    """

    def __init__(
        self, scene: TactileScene, pad_contact: PadContact, b: int, skins: Mapping[int, HoldingFinger]
    ) -> None:
        self.index = b
        self._body: Body = scene.bodies[b]
        self._gravity = np.asarray(scene.gravity, dtype=np.float64)
        self.order = tuple(sorted(skins))
        self._fingers = [skins[f] for f in self.order]
        self._object: GripSolver | None = None
        self._shared: tuple[float, int] | None = None
        times = pad_contact.times
        nobody = np.zeros(len(times), dtype=bool)
        whole, unseen = nobody.copy(), nobody.copy()
        for f in range(len(scene.fingers)):
            holds = holding_times(pad_contact, scene, f, b, times)
            if holds is not None:
                whole |= holds
                unseen |= holds & (f not in skins)
        self.keyed = BODY["held_mode"].of(self._body.parameters) == "keyed"
        self.held: NDArray[np.bool_] = whole & ~unseen
        self._kinks = np.zeros(0)  # frames
        self._unseen = int(unseen.sum())
        self._first_unseen = float(pad_contact.frames[np.argmax(unseen)])
        if not self.held.any():
            return
        mass = pad_contact.series(f"body/{b}", BODY["mass"], self._body.parameters, times)
        self._mass = np.broadcast_to(mass, times.shape)
        centre = pad_contact.centre(b, self._body.mesh)
        motion = pad_contact.body_motion(b)
        self._centre, self._spin = centre.at(times), motion.at(times).angular_velocity
        over = BODY["kink_time"].of(self._body.parameters, f"object '{self._body.name}'")
        path = RoundedPath(times, centre.values, over, KINK)
        turning = RoundedPath(times, accumulated(motion.rotations.values), over, TURNING_KINK)
        self._acceleration, self._spin_rate = path.acceleration, turning.acceleration
        kinks = np.union1d(path.samples, turning.samples)
        self._kinks = pad_contact.frames[kinks[self.held[kinks]]]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings: frames of slip, kinks in its motion, and fingers without a simulated skin that hold it."""
        found = () if self._object is None else self._object.findings
        if len(self._kinks):
            what = "its motion has kinks, where it changes its velocity from one sample to the next"
            remedy = "Smooth its keys, or say over which time a kink is rounded for its weight and inertia"
            found = (*found, self._finding("kinks", what, self._kinks[0], len(self._kinks), remedy))
        if self._shared:
            what = "a finger holds another object too: this one follows its animated path there"
            found = (*found, self._finding("held-together", what, *self._shared))
        if self._unseen:
            what = (
                "it is held by a finger whose skin is not simulated: it follows its animated path there, and the "
                "contacts need not carry its weight"
            )
            remedy = "Show the skin of every finger that holds it"
            found = (*found, self._finding("held-unseen", what, self._first_unseen, self._unseen, remedy))
        return found

    def _finding(self, code: str, what: str, frame: float, count: int, remedy: str = "") -> Finding:
        where = f"object '{self._body.name}'"
        return Finding("info", code, what, where=where, remedy=remedy, frame=float(frame), count=count)

    def shared(self, frame: float) -> None:
        """Record a frame in which a finger that holds the body also holds another one."""
        self._shared = (self._shared[0], self._shared[1] + 1) if self._shared else (frame, 1)

    def let_go(self) -> None:
        """Take a sample in which the body is not held."""
        if self._object is not None:
            self._object.let_go()

    def step(
        self,
        sample: int,
        surface: Surface,
        turn: Array,
        origin: Array,
        contexts: Sequence[HoldContext | None],
        frame: float,
    ) -> GripStep | None:
        """Balance the body at a sample; None if it is held automatically and no finger presses it yet.

        Args:
            sample: index of the sample in the whole range.
            surface: surface of the body in its own space.
            turn: rotation of the body to the world, shape (3, 3).
            origin: position of its origin in the world [m], shape (3,).
            contexts: contexts of the fingers, in the order of `order`.
            frame: scene frame, for findings.
        """
        held_object = self._at(surface, turn.T @ (self._centre[sample] - origin))
        held_object.mass = float(self._mass[sample])
        mine = next((r.bodies[r.own] for r in contexts if r is not None), None)
        if mine is not None:
            held_object.friction, held_object.softness, held_object.deforms = mine.friction, mine.softness, mine.deforms
            held_object.carry = mine.carry
        return held_object.step_among(
            rigid(turn, origin),
            contexts,
            self._acceleration[sample],
            self._spin[sample],
            self._spin_rate[sample],
            scene_frame=frame,
            only_if_pressed=not self.keyed,
        )

    def body(self, finger_pose: Array, surface: Surface, turn: Array, origin: Array, sample: int) -> ContactBody:
        """Return the body in a finger's frame, displaced as after its last balance; arguments as for `step`."""
        held_object = self._at(surface, turn.T @ (self._centre[sample] - origin))
        return held_object.body(finger_pose, *held_object.placed(rigid(turn, origin)))

    def _at(self, surface: Surface, centre: Array) -> GripSolver:
        """Return the grip solver, made at the first sample; a new surface renews its inertia."""
        known = self._object
        if known is None:
            known = self._object = GripSolver(
                surface,
                self._fingers,
                centre=centre,
                inertia=inertia_of(surface, centre),
                gravity=self._gravity,
                name=f"object '{self._body.name}'",
            )
        elif known.surface is not surface:
            known.surface, known.centre = surface, centre
            known.inertia = inertia_of(surface, centre)
        return known


def inertia_of(surface: Surface, centre: Array) -> Array:
    """Return the inertia tensor about a point of a homogeneous body of 1 kg [m^2], shape (3, 3).

    It is summed over the tetrahedra between the surface's triangles and the point. For a surface that is not closed it
    is that of the bounding box.

    Args:
        surface: surface of the body.
        centre: the point [m], shape (3,).
    """
    a, b, c = (surface.vertices[surface.triangles[:, k]] - centre for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    total = float(volume.sum())
    size = surface.box[1] - surface.box[0]
    if not surface.closed or not abs(total) > 1e-6 * float(size.max()) ** 3:
        return np.asarray(np.diag((size @ size - size**2) / 12.0))
    # The integral of x x' over a tetrahedron with a corner at the origin is V/20 (sum of x_k x_k' + s s'), where s is
    # the sum of its other corners x_k.
    corners = a + b + c
    second = sum(np.einsum("n,ni,nj->ij", volume, x, x) for x in (a, b, c, corners)) / 20.0
    second = np.asarray(second) / total
    return np.asarray(np.trace(second) * np.eye(3) - second)


def rigid(turn: Array, place: Array) -> Array:
    """Return the matrix of a rotation, shape (3, 3), and a translation [m], shape (3,); shape (4, 4)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, place
    return out
