"""SkinSampler: contact forces on every finger's skin, from chunks of poses.

The broad phase is like that of `PadSampler`, but for the whole fingertip instead of the pad's centre. Bodies whose
bounding boxes are farther from the fingertip's than the search radius are skipped, first for a chunk and then for each
sample. For the others, `Strides` leads a `SkinStepper` through the samples. The forces of the samples in contact are
stored in single precision. Displacement and stress are computed from them on demand.

The contacts of fingers that hold a body are solved together, because their sum must equal m (a - g). The acceleration
of the body is known only after the whole sweep. From the chunk in which a finger first comes near a body that may be
held, the poses are therefore stored, and `solve_held` solves them at the end. If a skin is solved on points and a body
can be held, they are stored from the first chunk.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from ..arrays import Array
from ..errors import DermisError, Finding
from ..scene.regrouped import Regrouped
from ..scene.tactile_scene import Chunk, TactileScene
from ..skin.model import SkinModel
from .held_bodies import HeldBodies
from .held_body import can_be_held, lots_of, may_be_held
from .holding_times import holding_times
from .pad_contact import PadContact, PairContact
from .pad_sampler import PadSampler
from .posed_scene import PosedScene
from .sample_window import SampleWindow
from .skin_contact import SkinContact
from .skin_record import SkinRecord
from .skin_stepper import SkinStepper
from .strides import Strides, longest

__all__ = ["SkinSampler", "SkinContact"]


class SkinSampler:
    """Solves the contact of fingers, one chunk after the other.

    Args:
        scene: the scene's header; its chunks are passed to `add`.
        skins: models of the fingers' skins, by the index of the finger. Other fingers are not solved.
        tolerance: largest residual of the contact solver, see `Solution.residual`; None for its default.

    Raises:
        DermisError: the mode of a touch depth is unknown, or a spring or force limit is not above zero.
    """

    def __init__(self, scene: TactileScene, skins: Mapping[int, SkinModel], *, tolerance: float | None = None) -> None:
        self._scene = scene
        self._posed = PosedScene(scene.bodies)
        self._steppers = {
            f: SkinStepper(skin, f, scene.fingers[f], self._posed, tolerance=tolerance) for f, skin in skins.items()
        }
        self._records = {f: SkinRecord() for f in skins}
        self._frames: list[Array] = []
        self._times: list[Array] = []
        self._waits = False
        self._cuts: Regrouped | None = None  # made at the first chunk
        self._strides: dict[int, Strides] = {}
        self._kept: list[SampleWindow] = []
        self._held_findings: dict[int, tuple[Finding, ...]] = {}  # by the first finger of a lot, see `lots_of`

    def add(self, chunk: Chunk) -> None:
        """Take the next samples."""
        if not len(chunk.times):
            return
        if self._cuts is None:
            self._cuts = self._begun(chunk)
        for whole in self._cuts.take(chunk):
            self._add(whole)

    def _begun(self, chunk: Chunk) -> Regrouped:
        """Determine properties of the sweep from its first chunk; return the division of the sweep into chunks."""
        holds = any(can_be_held(self._scene, b, chunk.animated) for b in range(len(self._scene.bodies)))
        # Contact on points cannot be balanced, so a finger that holds a body is solved at nodes from its first sample.
        # All samples wait until it is known which fingers these are.
        self._waits = holds and any(stepper.on_points for stepper in self._steppers.values())
        for f, stepper in self._steppers.items():
            self._strides[f] = Strides(stepper, longest(self._scene.rate) if stepper.strides else 1)
        return Regrouped(max((strides.count for strides in self._strides.values()), default=1))

    def _add(self, chunk: Chunk) -> None:
        """Take a chunk as `Regrouped` forms it, which ends where strides end."""
        self._posed.take(chunk)
        window = SampleWindow(chunk, {f: stepper.approach() for f, stepper in self._steppers.items()})
        self._frames.append(chunk.frames)
        self._times.append(chunk.times)
        self._waits = self._waits or self._near_what_may_be_held(window)
        if self._waits:
            self._kept.append(window.lighter())
            return
        for f, approach in window.fingers.items():
            if not approach.near:
                self._strides[f].idle(len(chunk.times))
                self._records[f].nothing(len(chunk.times))
                continue
            for step in self._strides[f].steps(approach, len(chunk.times)):
                self._records[f].keep(step)

    def _end(self) -> None:
        """Take the remaining samples at the end of the sweep."""
        for rest in [] if self._cuts is None else self._cuts.rest():
            self._add(rest)

    def solve_held(self, pad_contact: PadContact) -> Iterator[int]:
        """Solve the stored samples, in which a body may be held.

        Args:
            pad_contact: contact of the pads over the whole range. It determines the samples at which a body is held,
                and the body's acceleration.

        Yields:
            Number of finished samples of the whole range, after every tenth sample.
        """
        self._end()
        done = sum(len(t) for t in self._times) - sum(len(s.chunk.times) for s in self._kept)
        scene = self._scene
        met = {b for f, b in pad_contact.pairs if f in self._steppers}  # other bodies are not balanced
        candidates = {b for s in self._kept for b in met if may_be_held(scene, b, s.chunk)}
        balanced = [f for f in sorted(self._balanced_with(pad_contact, candidates)) if self._steppers[f].on_points]
        for f in balanced:
            self._steppers[f].stay_on_nodes()
        on_nodes = {f: stepper for f, stepper in self._steppers.items() if not stepper.on_points}
        held = HeldBodies(scene, pad_contact, candidates, self._posed, on_nodes)
        while self._kept:
            window = self._kept.pop(0)
            self._posed.take(window.chunk)
            count = len(window.chunk.times)
            free = {f: self._strides[f].steps(window.fingers[f], count) for f in self._steppers.keys() - on_nodes}
            for i in range(count):
                steps = held.step(window, i, done) | {f: next(ahead) for f, ahead in free.items()}
                for f, stepper in self._steppers.items():
                    self._records[f].keep(steps[f] if f in steps else stepper.step(window.fingers[f], i))
                done += 1
                if done % 10 == 0:
                    yield done
        for lot in lots_of(pad_contact.pairs, candidates, self._steppers):
            theirs = [b for b in held.findings if any((f, b) in pad_contact.pairs for f in lot)]
            told = _held_on_nodes([self._steppers[f].name for f in balanced if f in lot])
            self._held_findings[lot[0]] = sum((held.findings[b] for b in theirs), told)
        self._waits = False

    def finish(self, pad_contact: PadContact | None = None) -> dict[int, SkinContact]:
        """Return the touch on every finger's skin.

        Args:
            pad_contact: contact of the pads over the whole range, needed if a body may be held and `solve_held` was not
                completed.

        Raises:
            DermisError: a body may be held, and `pad_contact` is missing.
        """
        self._end()
        if self._kept:
            if pad_contact is None:
                raise DermisError(
                    "a held object can only be balanced with the contact of the whole range",
                    where=f"scene '{self._scene.name}'",
                )
            for _ in self.solve_held(pad_contact):
                pass
        times = np.concatenate(self._times) if self._times else np.zeros(0)
        frames = np.concatenate(self._frames) if self._frames else np.zeros(0)
        return {f: self._finished(f, times, frames) for f in self._steppers}

    def _near_what_may_be_held(self, window: SampleWindow) -> bool:
        close = {b for approach in window.fingers.values() for b in approach.near}
        return any(may_be_held(self._scene, b, window.chunk) for b in close)

    def _balanced_with(self, pad_contact: PadContact, candidates: Iterable[int]) -> set[int]:
        """Return the fingers that may touch a body held by solved skins alone.

        At some sample, only fingers with a solved skin hold this body.
        """
        found: set[int] = set()
        for b in candidates:
            fingers = range(len(self._scene.fingers))
            times = {f: holding_times(pad_contact, self._scene, f, b, pad_contact.times) for f in fingers}
            holds = {f: held for f, held in times.items() if held is not None}
            unseen = sum(held for f, held in holds.items() if f not in self._steppers)
            if any((held & np.logical_not(unseen)).any() for held in holds.values()):
                found |= {
                    f for f, stepper in self._steppers.items() if _may_touch(stepper, pad_contact.pairs.get((f, b)))
                }
        return found

    def _finished(self, f: int, times: Array, frames: Array) -> SkinContact:
        stepper, counters = self._steppers[f], self._steppers[f].counters
        skipped = {
            "skin_pairs_far": stepper.far,
            "skin_frames_idle": counters["idle"],
            "skin_frames_same": counters["same"] + counters["unchanged"],
            "skin_frames_between": self._strides[f].between if f in self._strides else 0,
        }
        findings = stepper.findings + self._held_findings.get(f, ())
        return self._records[f].finished(stepper.skin, stepper.surface, times, frames, findings, skipped)


def _held_on_nodes(names: list[str]) -> tuple[Finding, ...]:
    """Return a finding if fingers whose contact should be solved on points hold something."""
    if not names:
        return ()
    they, their = ("they", "their") if len(names) > 1 else ("it", "its")
    nodes = "at the nodes of the skin's mesh, a millimetre or two apart"
    what = f"{they} may hold something, so {their} contact is solved {nodes}"
    remedy = "Edges and small things are felt too weakly there: hold what is flat or gently curved, or use a finer skin"
    return (Finding("info", "contact-on-nodes", what, ", ".join(names), remedy=remedy),)


def _may_touch(stepper: SkinStepper, pair: PairContact | None) -> bool:
    """Return whether, at some sample, a body may come near a skin.

    It does if it is nearer to the pad's centre than the farthest point of the pad is.
    """
    reach = float(np.sqrt((stepper.skin.positions**2).sum(axis=1).max()))
    return pair is not None and bool(pair.gap.min() < reach)


def skin_contacts(scene: TactileScene, skins: Mapping[int, SkinModel]) -> dict[int, SkinContact]:
    """Return the touch on skins over a whole scene, by the index of the finger.

    Args:
        scene: the scene with its chunks.
        skins: models of the skins, by the index of the finger.
    """
    pads, sampler = PadSampler(scene), SkinSampler(scene, skins)
    for chunk in scene.chunks:
        sampler.add(pads.add(chunk))
    return sampler.finish(pads.finish())
