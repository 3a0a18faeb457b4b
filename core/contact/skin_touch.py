"""SkinSampler: from chunks of poses to the contact forces on every finger's skin, frame after frame.

It is the same broad phase as the pads' (`TouchSampler`), about the whole fingertip instead of its centre: a finger and
a body whose boxes never come together in a chunk cost nothing more. Where they do, the body is posed in the finger's
frame and the path solver takes one step. Kept are the forces of the frames in contact, in single precision; all else
(displacement, stress) follows from them when somebody asks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Finding
from ..motion import rotations
from ..scene import Chunk, TactileScene
from ..skin.model import SkinModel
from .bodies import ContactBody
from .cone import SLIP, STICK
from .path import PathSolver
from .posed import PosedBody
from .yielding import Yielding

Array = NDArray[np.float64]

FRICTION = 0.6  # of a body that does not say


@dataclass(frozen=True, eq=False)
class SkinTouch:
    """What one finger's skin felt over a scene.

    Attributes:
        model: the skin.
        times, frames: of the samples, shape (n,).
        contact: samples in which the skin touches, rising, shape (k,).
        force: on the pad nodes in the finger's frame in those samples [N], shape (k, m, 3), float32.
        normal_force, tangential_force: total over the pad [N], shape (n,).
        depth: how deep the undeformed skin is in an object, 0 without contact [m], shape (n,).
        lift: how far the bone gave way (compliant touch depth) [m], shape (n,).
        sticking, slipping: number of nodes, shape (n,).
        findings: what did not converge and what was too deep.
        skipped: what was not computed, by name.
    """

    model: SkinModel
    times: Array
    frames: Array
    contact: NDArray[np.intp]
    force: NDArray[np.float32]
    normal_force: Array
    tangential_force: Array
    depth: Array
    lift: Array
    sticking: NDArray[np.int32]
    slipping: NDArray[np.int32]
    findings: tuple[Finding, ...]
    skipped: Mapping[str, int]

    def force_at(self, sample: int) -> Array:
        """Return the forces of one sample [N], shape (m, 3); zeros without contact."""
        at = int(np.searchsorted(self.contact, sample))
        if at < len(self.contact) and self.contact[at] == sample:
            return self.force[at].astype(np.float64)
        return np.zeros((self.model.pad_count, 3))


@dataclass
class _Record:
    """One finger's samples so far."""

    contact: list[int] = field(default_factory=list)
    force: list[NDArray[np.float32]] = field(default_factory=list)
    scalars: list[tuple[float, float, float, float, int, int]] = field(default_factory=list)


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
        self._records = {f: _Record() for f in self._skins}
        self._frames: list[Array] = []
        self._times: list[Array] = []
        self._skipped = dict.fromkeys(self._skins, 0)

    def solver(self, finger: int) -> PathSolver:
        """Return the path solver of a finger, for what it counted and remembers."""
        return self._yielding[finger].solver

    def add(self, chunk: Chunk) -> None:
        """Take in the next samples."""
        if not len(chunk.times):
            return
        for body in self._bodies:
            body.clear()
        for f in self._skins:
            self._add_finger(f, chunk)
        self._frames.append(chunk.frames)
        self._times.append(chunk.times)

    def finish(self) -> dict[int, SkinTouch]:
        """Return what every finger felt."""
        times = np.concatenate(self._times) if self._times else np.zeros(0)
        frames = np.concatenate(self._frames) if self._frames else np.zeros(0)
        return {f: self._touch(f, times, frames) for f in self._skins}

    def _add_finger(self, f: int, chunk: Chunk) -> None:
        poses = chunk.fingers[f]
        turn = rotations(poses[:, :3, :3])
        place = poses[:, :3, 3]
        path = self._yielding[f]
        near = self._broad_phase(f, chunk, turn, place, path.solver.reach)
        order = self._near[f]  # only ever grows, so that a body keeps its index in the solver's memory
        order += [b for b in near if b not in order]
        any_near = np.zeros(len(chunk.times), dtype=bool)
        for inside in near.values():
            any_near |= inside
        record = self._records[f]
        for i in range(len(chunk.times)):
            if not any_near[i]:
                path.idle()
                record.scalars.append((0.0, 0.0, 0.0, 0.0, 0, 0))
                continue
            bodies = [self._posed(b, chunk, i, turn[i], place[i]) for b in order]
            self._record(record, path, bodies, float(chunk.frames[i]))

    def _record(self, record: _Record, path: Yielding, bodies: Sequence[ContactBody], frame: float) -> None:
        yielded = path.step(bodies, frame)
        solution = yielded.step.solution
        if not solution.force.any():
            record.scalars.append((0.0, 0.0, 0.0, yielded.lift, 0, 0))
            return
        normal = solution.normal_force
        total = float(normal.sum())
        across = solution.force - normal[:, None] * solution.normals
        record.contact.append(len(record.scalars))
        record.force.append(solution.force.astype(np.float32))
        record.scalars.append(
            (
                total,
                float(np.linalg.norm(across.sum(axis=0))),
                yielded.depth,
                yielded.lift,
                int((solution.status == STICK).sum()),
                int((solution.status == SLIP).sum()),
            )
        )

    def _broad_phase(
        self, f: int, chunk: Chunk, turn: Array, place: Array, reach: float
    ) -> dict[int, NDArray[np.bool_]]:
        """Return the bodies whose boxes come within reach of the fingertip's, and in which samples."""
        points = self._skins[f].positions
        low, high = points.min(axis=0), points.max(axis=0)
        middle = place + turn @ ((low + high) / 2)
        half = np.abs(turn) @ ((high - low) / 2) + reach
        near = {}
        for b, body in enumerate(self._bodies):
            box_middle, box_half = body.boxes(b, chunk)
            inside = (np.abs(middle - box_middle) <= half + box_half).all(axis=1)
            self._skipped[f] += int((~inside).sum())
            if inside.any():
                near[b] = inside
        return near

    def _posed(self, b: int, chunk: Chunk, i: int, turn: Array, place: Array) -> ContactBody:
        """Return a body at a sample, in the finger's frame."""
        surface, rotation, origin, deforms = self._bodies[b].at(b, chunk, i)
        parameters = self._scene.bodies[b].parameters
        stiffness = _value(parameters, chunk, b, i, "surface_stiffness", 0.0)
        return ContactBody(
            surface,
            turn.T @ rotation,
            turn.T @ (origin - place),
            friction=_value(parameters, chunk, b, i, "friction", FRICTION),
            softness=1.0 / stiffness if stiffness > 0 else 0.0,
            deforms=deforms,
        )

    def _touch(self, f: int, times: Array, frames: Array) -> SkinTouch:
        record, path = self._records[f], self._yielding[f]
        scalars = np.array(record.scalars, dtype=np.float64).reshape(-1, 6)
        skin = self._skins[f]
        counters = path.solver.counters
        skipped = {
            "skin_pairs_far": self._skipped[f],
            "skin_frames_idle": counters["idle"],
            "skin_frames_same": counters["same"] + counters["unchanged"],
        }
        return SkinTouch(
            model=skin,
            times=times,
            frames=frames,
            contact=np.array(record.contact, dtype=np.intp),
            force=np.array(record.force, dtype=np.float32).reshape(-1, skin.pad_count, 3),
            normal_force=scalars[:, 0],
            tangential_force=scalars[:, 1],
            depth=scalars[:, 2],
            lift=scalars[:, 3],
            sticking=scalars[:, 4].astype(np.int32),
            slipping=scalars[:, 5].astype(np.int32),
            findings=tuple(path.solver.findings) + tuple(path.findings),
            skipped={name: count for name, count in skipped.items() if count},
        )


def _value(parameters: Mapping[str, Any], chunk: Chunk, b: int, i: int, name: str, default: float) -> float:
    """Return a body's parameter at a sample: animated, constant, or the default."""
    channel = chunk.channels.get(f"body/{b}/{name}")
    value = parameters.get(name, default) if channel is None else channel[i]
    return float(value)
