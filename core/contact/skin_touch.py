"""SkinSampler: from chunks of poses to the contact forces on every finger's skin, frame after frame.

It is the same broad phase as the pads' (`TouchSampler`), about the whole fingertip instead of its centre: a finger and
a body whose boxes never come together in a chunk cost nothing more. Where they do, the body is posed in the finger's
frame and the path solver takes one step. Kept are the forces of the frames in contact, in single precision; all else
(displacement, stress) follows from them when somebody asks.

What fingers hold together is solved together: the contacts on it sum to m (a - g). Its acceleration is known only when
the whole path is, so from the chunk on in which a finger comes near such a body the poses are kept, and `solve_held`
goes through them at the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding
from ..motion import rotations
from ..parameters.material import BODY
from ..scene.tactile_scene import Chunk, TactileScene
from ..skin.model import SkinModel
from .compliant_bone import Yielding
from .felt import SkinTouch
from .held_body import HeldBody, may_be_held, rigid
from .held_object import HeldStep, HoldingFinger, Reach
from .posed import PosedBody
from .sampled import SampledTouch
from .skin_record import SkinRecord
from .solver.bodies import AWAY, ContactBody
from .solver.path import PathSolver
from .stretch import Stretch

__all__ = ["SkinSampler", "SkinTouch"]

Array = NDArray[np.float64]


class SkinSampler:
    """Solves the contact of the fingers that need it, one chunk after the other.

    Args:
        scene: its header; the chunks are handed to `add`.
        skins: finger index -> its skin. Other fingers are left alone.
        tolerance: of the contact solver.

    Raises:
        DermisError: a touch depth that is unknown, or a spring or force limit that is not above zero.
    """

    def __init__(self, scene: TactileScene, skins: Mapping[int, SkinModel], *, tolerance: float | None = None) -> None:
        self._scene, self._skins = scene, dict(skins)
        self._bodies = [PosedBody(body) for body in scene.bodies]
        self._yielding = {
            f: Yielding.of(skin, scene.fingers[f].parameters, f"finger '{scene.fingers[f].name}'", tolerance)
            for f, skin in self._skins.items()
        }
        self._near: dict[int, list[int]] = {f: [] for f in self._skins}
        self._records = {f: SkinRecord() for f in self._skins}
        self._frames: list[Array] = []
        self._times: list[Array] = []
        self._skipped = dict.fromkeys(self._skins, 0)
        self._extents = {f: (s.positions.min(axis=0), s.positions.max(axis=0)) for f, s in self._skins.items()}
        self._waits = False
        self._kept: list[Stretch] = []
        self._held_findings: tuple[Finding, ...] = ()

    def solver(self, finger: int) -> PathSolver:
        """Return the path solver of a finger, for what it counted and remembers."""
        return self._yielding[finger].solver

    def add(self, chunk: Chunk) -> None:
        """Take in the next samples."""
        if not len(chunk.times):
            return
        for body in self._bodies:
            body.clear()
        stretch = self._broad_phase(chunk)
        self._frames.append(chunk.frames)
        self._times.append(chunk.times)
        self._waits = self._waits or self._near_what_may_be_held(stretch)
        if self._waits:
            self._kept.append(stretch.lighter())
            return
        for f in self._skins:
            if not stretch.near[f]:
                self._yielding[f].idle(len(chunk.times))
                self._records[f].nothing(len(chunk.times))
                continue
            for i in range(len(chunk.times)):
                self._advance(f, stretch, i)

    def solve_held(self, touch: SampledTouch) -> Iterator[int]:
        """Solve the samples that were kept because something may be held in them; yield their number now and then.

        Args:
            touch: of the whole range: it knows when a body is held, and how it is accelerated.
        """
        done = sum(len(t) for t in self._times) - sum(len(s.chunk.times) for s in self._kept)
        skins = {f: self._holding_finger(f) for f in self._skins}
        bodies: list[HeldBody] = []
        if self._kept:
            every, scene = range(len(self._bodies)), self._scene
            candidates = {b for s in self._kept for b in every if may_be_held(scene, b, s.chunk)}
            bodies = [HeldBody(self._scene, touch, b, skins) for b in sorted(candidates)]
        while self._kept:
            stretch = self._kept.pop(0)
            for body in self._bodies:
                body.clear()
            for i in range(len(stretch.chunk.times)):
                solved = self._advance_held(bodies, stretch, i, done)
                for f in self._skins:
                    if f not in solved:
                        self._advance(f, stretch, i)
                done += 1
                if done % 10 == 0:
                    yield done
        self._held_findings = tuple(finding for body in bodies for finding in body.findings)
        self._waits = False

    def finish(self, touch: SampledTouch | None = None) -> dict[int, SkinTouch]:
        """Return what every finger felt.

        Args:
            touch: needed where something may be held and `solve_held` was not drained.

        Raises:
            DermisError: something may be held, and there is no touch to tell whether it is.
        """
        if self._kept:
            if touch is None:
                raise DermisError(
                    "what is held can only be balanced with the touch of the whole range",
                    where=f"scene '{self._scene.name}'",
                )
            for _ in self.solve_held(touch):
                pass
        times = np.concatenate(self._times) if self._times else np.zeros(0)
        frames = np.concatenate(self._frames) if self._frames else np.zeros(0)
        return {f: self._touch(f, times, frames) for f in self._skins}

    # -- one sample ----------------------------------------------------------------------------------------------

    def _advance(self, f: int, stretch: Stretch, i: int) -> None:
        """Solve one finger at a sample by itself."""
        path, record = self._yielding[f], self._records[f]
        if not any(inside[i] for inside in stretch.near[f].values()):
            path.idle()
            record.nothing()
            return
        record.keep(path.step(self._around(f, stretch, i), float(stretch.chunk.frames[i])))

    def _advance_held(self, bodies: Sequence[HeldBody], stretch: Stretch, i: int, sample: int) -> set[int]:
        """Balance what is held at a sample; return the fingers that this solved."""
        solved: set[int] = set()
        for body in bodies:
            fingers = [f for f in body.order if body.index in stretch.near[f] and stretch.near[f][body.index][i]]
            if not body.held[sample] or not fingers or solved.intersection(fingers):
                if body.held[sample] and fingers:
                    body.shared(float(stretch.chunk.frames[i]))
                body.let_go()
                continue
            step, lifts = self._balance(body, fingers, stretch, i, sample)
            if step is None:
                body.let_go()
                continue
            frame = float(stretch.chunk.frames[i])
            for k, f in enumerate(fingers):
                yielded = self._yielding[f].adopt(
                    step.forces[k], step.slips[k], step.frames[k], step.residual, lifts[k], frame
                )
                self._records[f].keep(yielded)
            solved.update(fingers)
        return solved

    def _balance(
        self, body: HeldBody, fingers: Sequence[int], stretch: Stretch, i: int, sample: int
    ) -> tuple[HeldStep | None, list[float]]:
        """Balance one body; also return how far the force limits lift the bones."""
        b, frame = body.index, float(stretch.chunk.frames[i])
        surface, turn, origin, _, _ = self._bodies[b].at(b, stretch.chunk, i)
        reaches: dict[int, Reach] = {}
        lifts = []
        for f in fingers:
            path, own = self._yielding[f], self._near[f].index(b)
            around = list(self._around(f, stretch, i))
            pose = rigid(stretch.turn[f][i], stretch.place[f][i])
            displaced = body.body(pose, surface, turn, origin, sample)
            tried = replace(around[own], rotation=displaced.rotation, translation=displaced.translation)
            lift = path.lift([*around[:own], tried, *around[own + 1 :]], frame)
            if lift > 0.0:
                down = np.array([0.0, 0.0, -lift])
                around = [replace(a, translation=a.translation + down) for a in around]
                pose[:3, 3] -= pose[:3, :3] @ down
            lifts.append(lift)
            reaches[f] = Reach(pose, tuple(around), own, path.solver.history)
        step = body.step(sample, surface, turn, origin, [reaches.get(f) for f in body.order], frame)
        return step, lifts

    def _around(self, f: int, stretch: Stretch, i: int) -> list[ContactBody]:
        """Return the bodies that a finger has ever been near, in an order that never changes."""
        turn, place, near = stretch.turn[f][i], stretch.place[f][i], stretch.near[f]
        return [
            self._posed(b, stretch.chunk, i, turn, place) if b in near and near[b][i] else AWAY for b in self._near[f]
        ]

    def _broad_phase(self, chunk: Chunk) -> Stretch:
        """Find the bodies whose boxes come within reach of each fingertip's, and in which samples."""
        found, turns, places = {}, {}, {}
        for f in self._skins:
            poses = chunk.fingers[f]
            turn, place = rotations(poses[:, :3, :3]), poses[:, :3, 3]
            low, high = self._extents[f]
            middle = place + turn @ ((low + high) / 2)
            half = np.abs(turn) @ ((high - low) / 2) + self._yielding[f].solver.reach
            near = {}
            for b, body in enumerate(self._bodies):
                box_middle, box_half = body.boxes(b, chunk)
                inside = (np.abs(middle - box_middle) <= half + box_half).all(axis=1)
                self._skipped[f] += int((~inside).sum())
                if inside.any():
                    near[b] = inside
            # only ever grows, so that a body keeps its index in the solver's memory
            self._near[f] += [b for b in near if b not in self._near[f]]
            found[f], turns[f], places[f] = near, turn, place
        return Stretch(chunk, found, turns, places)

    def _near_what_may_be_held(self, stretch: Stretch) -> bool:
        close = {b for near in stretch.near.values() for b in near}
        return any(may_be_held(self._scene, b, stretch.chunk) for b in close)

    def _holding_finger(self, f: int) -> HoldingFinger:
        path, skin = self._yielding[f].solver, self._skins[f]
        name = f"finger '{self._scene.fingers[f].name}'"
        return HoldingFinger(path.operator.compliance, skin.positions, name, skin.areas, path.bone)

    def _posed(self, b: int, chunk: Chunk, i: int, turn: Array, place: Array) -> ContactBody:
        """Return a body at a sample, in the finger's frame."""
        surface, rotation, origin, deforms, carry = self._bodies[b].at(b, chunk, i)
        parameters = self._scene.bodies[b].parameters
        stiffness = _value(parameters, chunk, b, i, "surface_stiffness")
        return ContactBody(
            surface,
            turn.T @ rotation,
            turn.T @ (origin - place),
            friction=_value(parameters, chunk, b, i, "friction"),
            softness=1.0 / stiffness if stiffness > 0 else 0.0,
            deforms=deforms,
            carry=carry,
        )

    def _touch(self, f: int, times: Array, frames: Array) -> SkinTouch:
        path = self._yielding[f]
        counters = path.solver.counters
        skipped = {
            "skin_pairs_far": self._skipped[f],
            "skin_frames_idle": counters["idle"],
            "skin_frames_same": counters["same"] + counters["unchanged"],
        }
        findings = path.solver.findings + path.findings
        if f == min(self._skins):  # what is said of a held object is said once
            findings += self._held_findings
        return self._records[f].touch(self._skins[f], times, frames, findings, skipped)


def _value(parameters: Mapping[str, Any], chunk: Chunk, b: int, i: int, name: str) -> float:
    """Return a body's parameter at a sample: animated, constant, or what holds where nobody says."""
    channel = chunk.channels.get(f"body/{b}/{name}")
    value = parameters.get(name, BODY[name].absent) if channel is None else channel[i]
    return float(value)
