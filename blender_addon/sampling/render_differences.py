"""Compare the surfaces in renders with those in the viewport.

The surfaces in the viewport are felt. A render shows whole frames, so only whole frames are compared. Settings are
compared at the first frame, and at every frame if they are animated or scripts run. The distance of the surfaces is
measured only for objects whose settings differ, at a few frames.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np

from .._core import Array, Finding, core
from . import participants, render_settings, render_surfaces
from .participants import Participants
from .render_causes import RenderCauses

LARGEST = 200_000
"""[triangles] Size up to which surfaces are compared; at this size it takes seconds."""
FRAMES = 9
"""Number of frames at which a changing surface is measured: the ends of the range, and each eighth of it between.
Large surfaces are measured at fewer frames."""
STATES = 8
"""Number of further times that an object is measured because its settings change."""
_SAME = 1e-3  # relative change of a stretch that needs no new measurement: distances are given with three digits
_LISTED = 4  # number of differences that a finding lists at most
_UNKNOWN = "how far apart they are is not known"


@dataclass
class _Known:
    """The state of the comparison of an object whose settings differ.

    Attributes:
        stride: it is measured at each `stride`-th of the frames for measurement. measured: number of measurements.
        states: the settings with which it was measured. missed: it was not measured with some settings.
        stretch: the stretch of its pose at the last measurement.
        since: first frame at which the surfaces differ; None if they have not differed so far.
        distance: [m] largest distance of the surfaces; None if unknown. at: frame of this distance.
        said: the differences of settings at that frame.
    """

    said: list[str]
    stride: int = 1
    measured: int = 0
    states: set[tuple[str, ...]] = field(default_factory=set)
    missed: bool = False
    stretch: float = 1.0
    since: float | None = None
    distance: float | None = 0.0
    at: float = 0.0

    def note(self, distance: float | None, said: list[str], frame: float) -> None:
        """Note a distance between the surfaces; None if it is unknown."""
        if self.distance is None or (distance is not None and distance <= core.surface.curved.TOLERANCE):
            return
        self.since = frame if self.since is None else self.since
        if distance is None or distance > self.distance:
            self.distance, self.said, self.at = distance, said, frame


class RenderDifferences:
    """Watcher of a sweep for differences between renders and the viewport.

    Args:
        simulated: session uids of data that depend on simulations; these are not measured, as that would run the
            simulations again.
        deforming: session uids of the objects whose shape may change; None if that of every object may.
        frames: frames of the samples, shape (n,).
    """

    def __init__(
        self,
        swept: Participants,
        scene: bpy.types.Scene,
        view_layer: bpy.types.ViewLayer,
        simulated: frozenset[int],
        deforming: frozenset[int] | None,
        frames: Array,
    ) -> None:
        self._scene, self._view_layer, self._simulated = scene, view_layer, simulated
        self._causes = RenderCauses(swept, scene, view_layer)
        self._hosts = {e.uid for e in swept.bodies if e.shows_instances}
        self._instanced = {e.uid for e in swept.bodies if e.instance is not None}
        self._bodies = {e.uid for e in swept.bodies}
        self._changing = None if deforming is None else deforming | {e.uid for e in swept.bodies if e.deforming}
        places = np.linspace(0, len(frames) - 1, FRAMES).round().astype(int)
        self._places = {whole: i for i, whole in enumerate(sorted({math.floor(f) for f in frames[places].tolist()}))}
        self._length = math.floor(frames[-1]) - math.floor(frames[0]) + 1  # in whole frames
        self._whole: int | None = None
        self._known: dict[int, _Known] = {}
        self._hidden: dict[int, float] = {}
        self._displaced: dict[int, list[str]] = {}

    def look(self, depsgraph: bpy.types.Depsgraph, frame: float) -> None:
        """Compare the frame that is evaluated now."""
        whole = math.floor(frame)
        if whole == self._whole:
            return
        first, self._whole = self._whole is None, whole
        if first or self._causes.vary or (self._known and whole in self._places):
            self._judge(depsgraph, frame, first)

    @property
    def findings(self) -> list[Any]:
        """Return the findings at the frames so far."""
        uids = self._hidden.keys() | self._known.keys() | self._displaced.keys()
        felt = sorted(participants.look_up(set(uids)).values(), key=lambda o: str(o.name_full))
        out = [_hidden(o, self._hidden[o.session_uid]) for o in felt if o.session_uid in self._hidden]
        out += [f for o in felt if o.session_uid in self._known for f in self._differing(o)]
        for obj in felt:
            said = [f"displacement of {name}" for name in self._displaced.get(obj.session_uid, ())]
            out += [_other(obj, said, _UNKNOWN, None)] if said else []
        return out

    def _judge(self, depsgraph: bpy.types.Depsgraph, frame: float, first: bool) -> None:
        objects = {o.session_uid: o for o in bpy.data.objects}
        self._causes.look(objects)
        hidden = self._causes.hidden(objects)
        for uid in sorted(hidden):
            self._hidden.setdefault(uid, frame)
        differing = self._causes.differing(objects)
        due = {objects[uid]: differing[uid] for uid in sorted(differing.keys() - hidden)}
        due = {obj: said for obj, said in due.items() if self._is_due(obj, said)}
        displacing = {m for m in bpy.data.materials if render_settings.displaces(m)} if first else set()
        if due or displacing:  # else the instances, of which there may be many, are not listed
            pieces = render_surfaces.Pieces(self._hosts, self._instanced, depsgraph, self._scene)
            for uid in self._bodies - hidden if displacing else ():
                shown = (objects[uid], *pieces.shown_by(objects[uid]))
                slots = [slot.material for obj in shown for slot in obj.material_slots]
                self._displaced[uid] = sorted({m.name_full for m in slots if m in displacing})
            self._measure(due, pieces, frame)

    def _is_due(self, obj: bpy.types.Object, said: list[str]) -> bool:
        uid = obj.session_uid
        if uid not in self._known:
            self._known[uid] = _Known(said)
            return True
        known = self._known[uid]
        if known.distance is None:
            return False
        if tuple(said) not in known.states:
            if len(known.states) <= STATES:
                return True
            known.missed = True
        place = self._places.get(self._whole)
        if place is None or place % known.stride:
            return False
        return self._may_change(uid) or abs(_stretch(obj) - known.stretch) > _SAME * known.stretch

    def _may_change(self, uid: int) -> bool:
        return self._changing is None or uid in self._changing

    def _measure(self, due: dict[Any, list[str]], pieces: render_surfaces.Pieces, frame: float) -> None:
        known = {obj: pieces.triangles(obj) for obj in due}
        known = {o: n for o, n in known.items() if n <= LARGEST and o.session_uid not in self._simulated}
        distances = render_surfaces.distances(list(known), self._scene, self._view_layer)
        apart = dict(zip(known, distances, strict=True))
        for obj, said in due.items():
            found, distance = self._known[obj.session_uid], apart.get(obj)
            found.note(None if distance is None else distance * pieces.enlarged(obj), said, frame)
            found.measured += 1
            found.states.add(tuple(said))
            found.stretch, found.stride = _stretch(obj), _stride(known.get(obj, 0.0))

    def _differing(self, obj: bpy.types.Object) -> Iterator[Any]:
        known = self._known[obj.session_uid]
        if known.since is None:
            if known.missed or (self._may_change(obj.session_uid) and known.measured < self._length):
                how_far = f"they are the same at the {known.measured} frames that were compared"
                yield replace(_other(obj, known.said, how_far, None, "may show"), severity="info")
        elif known.distance is None:
            yield _other(obj, known.said, _UNKNOWN, known.since)
        else:
            at = f", at frame {known.at:g}" if known.measured > 1 else ""
            yield _other(obj, known.said, f"up to {1e3 * known.distance:.3g} mm apart{at}", known.since)


def _stretch(obj: bpy.types.Object) -> float:
    return float(core.surface.curved.stretch_of(np.array(obj.matrix_world, np.float64)))


def _stride(triangles: float) -> int:
    """Return the stride between the frames at which a surface is measured.

    It lets at most 2 * `LARGEST` triangles be measured in all.
    """
    stride = 1
    while stride < FRAMES - 1 and triangles * (FRAMES - 1) > stride * LARGEST:
        stride *= 2
    return stride


def _hidden(obj: bpy.types.Object, frame: float) -> Any:
    return Finding(
        "info",
        "render-differs",
        "renders do not show it, but it is touchable",
        where=f"object '{obj.name_full}'",
        remedy="Show it in renders, or ignore this if it is a stand-in",
        frame=frame,
    )


def _other(obj: bpy.types.Object, said: list[str], how_far: str, frame: float | None, verb: str = "show") -> Any:
    more = len(said) - _LISTED
    return Finding(
        "warning",
        "render-differs",
        f"renders {verb} another surface than the viewport, whose surface is felt: {how_far}",
        where=f"object '{obj.name_full}'",
        value="; ".join([*said[:_LISTED], *([f"{more} more"] if more > 0 else [])]),
        remedy="Give the viewport and renders the same settings, or ignore this where the viewport's surface is meant",
        frame=frame,
    )
