"""Sample Blender's evaluated scene into the engine's `TactileScene`.

Every sample is taken at a frame and sub-frame after full evaluation, never from F-curves, so that constraints, IK,
drivers, NLA and instances need no code of their own. One sweep samples all objects. Blender evaluates time in single
precision. Samples are therefore taken at the nearest frame in single precision, and the chunk holds that very frame
and its time.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes, scene_time
from .._core import Array, DermisError, core
from ..quantities import metres_per_unit
from . import (
    curved_surfaces,
    edit_mode,
    height_maps,
    participants,
    prepass,
    render_differences,
    scene_header,
    screen_sizes,
    script_changes,
    simulated_motion,
    single_precision,
)
from .changes_seen import ChangesSeen
from .frames import frame_range, frame_range_now, sweep_frames
from .instance_samples import InstanceSamples
from .instance_survey import Instances, Present, only_now
from .instances import InstanceReader
from .meshes import MeshReader
from .participants import Entry, InstanceKey, Participants
from .recorder import Recorder

CHUNK = 64
"""[samples] Length of a chunk. It is fixed, because the content hash depends on how samples are chunked."""


_live_reader = MeshReader()
_live_shown = InstanceReader(_live_reader)


@contextmanager
def undisturbed(scene: bpy.types.Scene) -> Iterator[None]:
    """Mute the add-on's handlers, and restore the scene's frame at the end.

    The frame is restored after an error as well.
    """
    name, frame = scene.name_full, scene_time.shown(scene)
    with changes.muted():
        try:
            yield
        finally:
            again = _scene_named(name)
            if again is not None:
                scene_time.go_to(again, frame)


class Sweep:
    """Iterator of chunks that takes the samples while it is read.

    `advance` takes one sample at a time.

    Attributes:
        done, total: number of samples taken so far, and of all samples; both include the frames of simulations.
        findings: findings of the sampling; complete when the sweep has ended.
    """

    def __init__(self, steps: Generator[Any, None, None], total: int, findings: list[Any]) -> None:
        self.done, self.total, self.findings = 0, total, findings
        self._steps = steps
        self._ready: list[Any] = []

    def advance(self) -> bool:
        """Take one sample; return whether `next` needs no further sample.

        That is so when a chunk is ready, and when the sweep has ended.
        """
        if self._ready:
            return True
        try:
            chunk = next(self._steps)
        except StopIteration:
            return True
        if chunk is None:
            self.done += 1
            return False
        self._ready.append(chunk)
        return True

    def __iter__(self) -> Sweep:
        return self

    def __next__(self) -> Any:
        while not self._ready:
            chunk = next(self._steps)
            if chunk is None:
                self.done += 1
            else:
                return chunk
        return self._ready.pop()

    def close(self) -> None:
        """Stop sampling and restore the scene's frame."""
        self._steps.close()


def sample(
    scene: bpy.types.Scene | None = None,
    view_layer: bpy.types.ViewLayer | None = None,
    *,
    span: tuple[int, int] | None = None,
    chunk_size: int = CHUNK,
) -> Any:
    """Return a scene as a `TactileScene` whose chunks are a `Sweep`.

    The scene is sampled while the chunks are read.

    Args:
        scene, view_layer: those of the context if left out; of another scene, its first view layer.
        span: first and last frame, both included; `frame_range(scene)` if left out.

    Raises:
        DermisError: the scene cannot be rendered at all. Reading the chunks may raise further errors.
    """
    scene = scene or bpy.context.scene
    view_layer = view_layer or (bpy.context.view_layer if scene == bpy.context.scene else scene.view_layers[0])
    span = span or frame_range(scene)
    clock, rate = scene_time.clock(scene, span[0]), float(scene.dermis.sample_rate)
    findings = scene_header.scene_findings(scene)
    if span[1] <= span[0]:
        raise DermisError(
            "the frame range has no duration",
            where=f"scene '{scene.name_full}'",
            value=f"{span[0]} to {span[1]}",
            limit="an end frame after the start frame",
            remedy="Set the range in the Output properties, or in the Dermis tab",
        )
    reader, seen = MeshReader(), ChangesSeen(participants.instancers(scene))
    shown = InstanceReader(reader, seen)
    simulations = simulated_motion.find(scene)
    with undisturbed(scene):
        timely = prepass.time_dependent(scene, span[0])
        with seen.watching():
            growing = prepass.growing(scene, timely)
            instances, stretches = prepass.look_through(scene, view_layer, span, simulations, shown, growing)
            scene.frame_set(span[0])
            depsgraph = prepass.depsgraph_of(scene, view_layer)
            swept = scene_header.list_participants(
                scene,
                depsgraph,
                view_layer,
                simulations,
                timely.deforming,
                instances,
                shown,
                stretches,
                scripted=script_changes.run_here(),
            )
            header = scene_header.header(depsgraph, swept, reader, shown)
        swept = header.participants
        gravity = scene_header.gravity(scene, findings)
        findings += edit_mode.findings(swept, scene)
        may_deform = None if script_changes.run_here() else timely.deforming
        screens = list(participants.look_up({entry.uid for entry in swept.screens}).values())
        lookers = [
            *height_maps.frozen(screens, depsgraph, may_deform),
            *screen_sizes.watched(screens, depsgraph, swept.unit, may_deform),
        ]
        surfaces = [body.mesh for body in header.bodies]
        coarse = single_precision.Steps(swept, rate, surfaces)
        watch = None
        if script_changes.needed(scene):
            watch = script_changes.Watch(scene, view_layer, swept, surfaces, reader, timely.all)
    simulated = any(e.simulated for e in swept.entries)
    findings += simulated_motion.stretched(scene) if simulated else ()
    made = core.scene.tactile_scene.TactileScene(
        scene.name_full,
        clock.rate,
        span,
        rate,
        header.fingers,
        header.bodies,
        header.screens,
        (),
        gravity=gravity,
        findings=(*findings, *swept.findings),
    )
    try:
        made.validate()
    except DermisError as error:
        raise scene_header.reason(made, error) from error
    frames, times = sweep_frames(scene, span, rate)
    lookers.append(render_differences.RenderDifferences(swept, scene, view_layer, simulations.uids, may_deform, frames))
    noticed: list[Any] = []
    whole = scene_time.simulated_frames(scene, simulations.start, span) if simulated else np.zeros(0)
    readers = _Readers(reader, shown, seen, instances.bodies, {b.name: b.mesh for b in header.bodies})
    steps = _steps(swept, readers, frames, times, clock, whole, chunk_size, noticed, watch, lookers, coarse)
    return replace(made, chunks=Sweep(steps, len(frames) + len(whole), noticed))


def sample_now(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> core.scene.tactile_scene.TactileScene:
    """Return the present state of a scene as a `TactileScene` of one sample.

    The frame is not changed. The one chunk holds every surface. An unchanged surface is the same object in every call,
    so that the engine keeps its search structures. The chunk also holds the animated parameters; the header has their
    default values, so that the headers of successive frames compare equal.

    Raises:
        DermisError: a value that is not a finite number.
    """
    global _live
    span = frame_range_now(scene)
    clock = scene_time.clock(scene, span[0])
    live = _live_now(scene, depsgraph, span)
    with _live_shown.at_once():
        live.recorder.record(0, depsgraph)
    frames = np.array([scene_time.shown(scene)])
    chunk = live.recorder.chunk(frames, clock.seconds(frames), 1, [])
    if live.frame is not None:
        _live = None
    return core.scene.tactile_scene.TactileScene(
        scene.name_full,
        clock.rate,
        span,
        float(scene.dermis.sample_rate),
        live.header.fingers,
        live.header.bodies,
        live.header.screens,
        (chunk,),
        gravity=scene_header.gravity(scene, list(live.findings)),
        findings=(*live.findings, *live.header.participants.findings),
    )


def read_now(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> bool:
    """Prepare the next `sample_now`; return False if nothing had to be read.

    Raises:
        DermisError: a value that is not a finite number.
    """
    known = _live
    return _live_now(scene, depsgraph, frame_range_now(scene)) is not known


class _Live(NamedTuple):
    """The participants of the live preview at one state of the scene."""

    key: tuple[Any, ...]
    header: Any
    recorder: Recorder  # of one sample
    findings: tuple[Any, ...]
    frame: float | None  # the only frame for which this is valid; None if it is valid for all frames


_live: _Live | None = None
_forms = -1  # value of `changes.forms()` when surfaces and reliefs were last dropped


def _live_now(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, span: tuple[int, int]) -> _Live:
    """Return the live participants; read them anew if the scene has changed."""
    global _live, _forms
    if _forms != changes.forms():
        forget()
        _forms = changes.forms()
    key = (
        scene.session_uid,
        depsgraph.view_layer.name,
        changes.ticks(),
        changes.edits(),
        len(bpy.data.objects),
        metres_per_unit(scene),
    )
    holds = _live is not None and _live.key == key and _live.frame in (None, scene_time.shown(scene))
    if _live is None or not holds or not _live.recorder.holds():
        with _live_shown.at_once():
            _live = _read_live(scene, depsgraph, span, key)
    return _live


def _read_live(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, span: tuple[int, int], key: tuple[Any, ...]
) -> _Live:
    """Read the live participants.

    They are valid until the next change of the scene, but for one frame only where they may vary with time: with
    instances, scripts, unusable meshes, and objects that blink, are mirrored or may grow.
    """
    view_layer = scene.view_layers[depsgraph.view_layer.name]
    findings = scene_header.scene_findings(scene)
    has = participants.instancers(scene)
    instances = only_now(_live_shown, depsgraph, prepass.curved_ones()) if has else Instances({}, {}, {})
    none = simulated_motion.Simulations(frozenset(), span[0], ())
    swept = scene_header.list_participants(scene, depsgraph, view_layer, none, None, instances, _live_shown)
    header = scene_header.header(depsgraph, swept, _live_reader, _live_shown, live=True)
    scene_header.gravity(scene, findings)
    varies = any(e.blinking or e.mirrored for e in header.participants.entries)
    curved = {e.uid for e in header.participants.bodies if e.curved is not None}
    varies |= any(map(curved_surfaces.grows, participants.look_up(curved).values()))
    varies |= any(f.code == "mesh-unusable" for f in header.participants.findings)  # it may get faces at other frames
    lasting = not has and not varies and not script_changes.run_here()
    recorder = _Readers(_live_reader, _live_shown, ChangesSeen(), {}, {}).recorder(header.participants, 1)
    return _Live(key, header, recorder, tuple(findings), None if lasting else scene_time.shown(scene))


def forget() -> None:
    """Drop the surfaces and reliefs kept for the live preview."""
    global _live, _live_shown
    _live = None
    _live_reader.clear()
    _live_shown = InstanceReader(_live_reader)
    height_maps.forget()


class _Readers(NamedTuple):
    """The readers of a sweep, and its known instances and surfaces.

    Attributes:
        instances: the bodies that are instances. surfaces: the surfaces in the header, by the names of bodies.
    """

    meshes: MeshReader
    shown: InstanceReader
    seen: ChangesSeen
    instances: Mapping[InstanceKey, Present]
    surfaces: Mapping[str, Any]

    def recorder(self, swept: Participants, count: int, simulated: Any = None) -> Recorder:
        """Return a recorder of at most `count` samples at a time."""
        made = InstanceSamples(swept.bodies, self.meshes, self.shown, swept.unit, count, self.instances, self.surfaces)
        return Recorder(swept, self.meshes, count, made, simulated)


def _scene_named(name: str) -> bpy.types.Scene | None:
    return next((s for s in bpy.data.scenes if s.name_full == name), None)


def _steps(
    swept: Participants,
    readers: _Readers,
    frames: Array,
    times: Array,
    clock: scene_time.Clock,
    whole: Array,
    chunk_size: int,
    findings: list[Any],
    watch: script_changes.Watch | None,
    lookers: list[Any],
    coarse: single_precision.Steps,
) -> Generator[Any, None, None]:
    """Yield None after each sample, and each chunk when it is complete."""
    scene = _scene_named(swept.scene)
    if scene is None:
        raise DermisError("the scene was removed", where=f"scene '{swept.scene}'")
    showing = any(entry.shown_as is not None for entry in swept.entries)  # only instances need `seen`
    with undisturbed(scene), readers.seen.watching() if showing else nullcontext(), watch or nullcontext():
        simulated = None
        if len(whole):
            simulated = yield from _simulate(swept, readers, whole, clock, findings)
        recorder = readers.recorder(swept, chunk_size, simulated)
        for start in range(0, len(frames), chunk_size):
            part = slice(start, min(start + chunk_size, len(frames)))
            for k, frame in enumerate(frames[part].tolist()):
                depsgraph = _go_to(swept, frame)
                recorder.record(k, depsgraph)
                if watch is not None:
                    watch.look(depsgraph, frame)
                for looker in lookers:
                    looker.look(depsgraph, frame)
                yield None
            chunk = recorder.chunk(frames[part], times[part], part.stop - part.start, findings)
            coarse.look(chunk)
            yield chunk if watch is None else watch.follow(chunk)
        findings += coarse.findings()
        findings += recorder.findings()
        if simulated is not None:
            findings += simulated.findings(clock)
        for looker in lookers:
            findings += looker.findings
        if watch is not None:
            findings += watch.findings


def _go_to(swept: Participants, frame: float) -> bpy.types.Depsgraph:
    scene = bpy.context.scene
    if scene.name_full != swept.scene:
        scene = _scene_named(swept.scene)
    if scene is None:
        raise DermisError("the scene was removed while it was sampled", where=f"scene '{swept.scene}'")
    scene_time.go_to(scene, frame)
    return scene.view_layers[swept.view_layer].depsgraph


def _simulate(
    swept: Participants, readers: _Readers, whole: Array, clock: scene_time.Clock, findings: list[Any]
) -> Generator[None, None, simulated_motion.Recording]:
    """Step through the simulations from their start, and record their motion."""

    def pick(entries: tuple[Entry, ...]) -> tuple[Entry, ...]:
        return tuple(replace(e, animated=()) for e in entries if e.simulated)

    part = replace(swept, fingers=pick(swept.fingers), bodies=pick(swept.bodies), screens=pick(swept.screens))
    recorder = readers.recorder(part, len(whole))
    recording, absent = simulated_motion.Recording(clock.seconds(whole)), core.scene.tactile_scene.ABSENT
    for k, frame in enumerate(whole.tolist()):
        depsgraph = _go_to(swept, frame)
        recorder.record(k, depsgraph)
        for entry, mesh in recorder.surfaces_of(k):
            bare = mesh is absent and entry.shown_as is None and _is_there(entry, depsgraph)
            recording.keep_surface(entry.name, mesh, bare=bare)
        yield None
    chunk = recorder.chunk(whole, recording.times, len(whole), findings, simulating=True)
    for entries, poses in ((part.fingers, chunk.fingers), (part.bodies, chunk.bodies), (part.screens, chunk.screens)):
        for i, (entry, matrices) in enumerate(zip(entries, poses, strict=True)):
            shown = chunk.surfaces.get(i) if entries is part.bodies else None
            here = np.ones(len(whole), bool) if shown is None else np.array([mesh is not absent for mesh in shown])
            recording.keep_poses(entry.name, matrices, here)
    return recording


def _is_there(entry: Entry, depsgraph: bpy.types.Depsgraph) -> bool:
    """Return whether an object that may be hidden is evaluated now."""
    return not entry.blinking or not participants.is_disabled(
        participants.look_up({entry.uid})[entry.uid], depsgraph.view_layer
    )
