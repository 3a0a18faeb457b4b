"""The values of the devices at the current frame, without a bake.

Where a fresh bake covers the frame, its track is read. Otherwise the frames visited last form a trail: a step forward
extends it. If something changes while the frame stays, the trail's last sample is taken again. Shown frames are kept
until something changes, so that they are there again on the way back. At a frame that was not visited, the trail
continues from the latest kept state before that frame, if it is at most a quarter of a second earlier. Without such a
state (after a longer jump, or undo) a new trail starts from rest. The preview names the frame from which the trail
continues. The engine renders the trail's end as it renders a bake; only the sampling is coarser, one sample a visited
frame. Devices that follow a skin take another road, in `pin_preview`, `thimble_preview` and `platform_preview`: they
match this one frame.
"""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes, scene_time
from .._core import DermisError, core
from ..devices import active_presets
from ..preferences import library
from ..results import store
from ..sampling import scene_header, scene_sweep
from . import moment, pin_preview, platform_preview, skin_preview, thimble_preview
from .kept_states import KeptStates
from .rows import Preview, Row, as_it_was, by_channel, goes_on, origin, row_of

TRAIL_SECONDS = 0.12  # how much of a tactor's path, and of a vibration, the view shows
FOLLOWERS = (pin_preview, thimble_preview, platform_preview)
_PATH = np.arange(61.0)  # numbers of the points of a tactor's path
KEPT = 1000  # at most this many visited frames are kept, to be shown again


class _End(NamedTuple):
    """The end of a trail, to go on from."""

    trail: core.pipeline.trail.Trail
    kept: core.pipeline.trail.Kept
    last: core.scene.tactile_scene.TactileScene
    first: float


@dataclass
class _Live:
    generation: int = -1
    scene: int = 0
    trail: core.pipeline.trail.Trail | None = None
    first: float = 0.0  # frame that it began at
    since: float | None = None  # frame of the kept state from which the last sample was reached; None if there is none
    last: core.scene.tactile_scene.TactileScene | None = None  # the sample that it ends with
    edits: int = -1  # of `changes`, when the last sample was taken
    preview: Preview | None = None
    kept: core.recent.Recent[float, Preview] = field(default_factory=lambda: core.recent.Recent(KEPT))
    ends: KeptStates[_End] = field(default_factory=KeptStates)
    failure: Exception | None = None
    taken: core.scene.tactile_scene.TactileScene | None = None  # the last sample, until `take_sample` hands it on


_live = _Live()
_memo: tuple[Any, Any] = (None, ())  # a result and its key
_memo_preview: Preview | None = None


def computed(scene: bpy.types.Scene) -> Preview | None:
    """Return the preview of the current frame from bake or trail, or None where nothing is known."""
    global _memo, _memo_preview
    frame, state = moment.frame_of(scene), store.state(scene)
    if state != "fresh" and scene.dermis.live_preview and _trail_ends_at(scene, frame):
        return _with_followers(scene, _live.preview)
    result = store.current(scene)
    if result is None:
        return None
    if _memo[0] is not result or _memo[1] != (frame, state):
        _memo, _memo_preview = (result, (frame, state)), _from_bake(result, frame, state)
    return _memo_preview


def on_frame(scene: bpy.types.Scene) -> None:
    """Take the new frame into the trail; called after every frame change in the window."""
    if not _follows(scene):
        return
    if store.state(scene) == "fresh":
        _live.trail = None
        return
    try:
        step(bpy.context)
    except Exception as error:  # the view shows it at every frame, the console only if it is of another kind
        if not isinstance(_live.failure, type(error)):
            traceback.print_exc()
        _live.failure = error
        _note(scene, f"the preview failed ({type(error).__name__}: {error}); the console has more")


def step(context: bpy.types.Context) -> Preview:
    """Extend the trail by the scene as it is now, or start a new one, and render it."""
    scene = context.scene
    frame = moment.frame_of(scene)
    same = _live.scene == scene.session_uid and _live.generation == changes.lineage()
    edited = not same or _live.edits != changes.edits()
    if edited:
        _live.kept.clear()
        _live.ends.clear()
    _live.taken = None
    gap = None if not same or _live.trail is None or _live.last is None else frame - _frame(_live.last)
    again = gap is None or not goes_on(scene_time.clock(scene, 0.0).duration(gap))
    if again and frame in _live.kept and (skin_preview.seen(scene, frame) or not skin_preview.any_solved(scene)):
        _live.preview = replace(_live.kept[frame], note=as_it_was(_live.kept[frame].note))
        return _live.preview
    _live.edits, _live.generation, _live.scene = changes.edits(), changes.lineage(), scene.session_uid
    try:
        sample = _live.taken = scene_sweep.sample_now(scene, context.evaluated_depsgraph_get())
        trail, outputs = _extended(sample, gap, edited)
        _live.trail, _live.last = trail, sample
        _live.preview = _live.kept[frame] = _rendered(trail, sample, outputs, frame)
        _live.ends.keep(frame, lambda: _End(trail, trail.save(), sample, _live.first))
    except DermisError as error:
        return _note(scene, str(scene_header.reason(_live.taken, error) if _live.taken else error))
    return _live.preview


def read(scene: bpy.types.Scene) -> bool:
    """Find the fingers, devices and objects that take part, if a change has made them unknown.

    It is a step of its own, so that `refresh` is short.

    Returns whether anything was read.
    """
    if _is_done(scene) or not _follows(scene) or store.state(scene) == "fresh":
        return False
    try:
        return scene_sweep.read_now(scene, bpy.context.evaluated_depsgraph_get())
    except Exception:  # `refresh` meets it again, and shows it
        return False


def refresh(scene: bpy.types.Scene) -> None:
    """Compute the current frame where it is another than the last, or something has changed."""
    if not _is_done(scene):
        on_frame(scene)


def _is_done(scene: bpy.types.Scene) -> bool:
    return _live.edits == changes.edits() and _trail_ends_at(scene, moment.frame_of(scene))


def _follows(scene: bpy.types.Scene) -> bool:
    """Return whether the preview follows the frames of a scene."""
    return scene == bpy.context.scene and scene.dermis.live_preview and skin_preview.any_finger(scene)


def _note(scene: bpy.types.Scene, text: str) -> Preview:
    """Show a sentence in place of devices; the trail ends here."""
    _live.trail, _live.scene, _live.generation = None, scene.session_uid, changes.lineage()
    _live.preview = Preview(moment.frame_of(scene), "live", text, ())
    return _live.preview


def take_sample() -> core.scene.tactile_scene.TactileScene | None:
    """Return the sample that this frame's preview was made from, once; None where none was taken."""
    sample, _live.taken = _live.taken, None
    return sample


def reset() -> None:
    """Forget the trail; the next frame starts from rest."""
    global _memo, _memo_preview
    _live.trail, _live.preview, _live.taken = None, None, None
    _live.kept.clear()
    _live.ends.clear()
    _memo, _memo_preview = (None, ()), None


def _trail_ends_at(scene: bpy.types.Scene, frame: float) -> bool:
    shown = _live.preview
    same = _live.scene == scene.session_uid and _live.generation == changes.lineage()
    return same and shown is not None and abs(shown.frame - frame) < 1e-6


def _extended(
    sample: core.scene.tactile_scene.TactileScene, gap: float | None, edited: bool
) -> tuple[core.pipeline.trail.Trail, tuple[core.pipeline.bake.Output, ...]]:
    """Add a sample to the trail, or to a new trail; return this trail, and the tracks up to the sample.

    Args:
        gap: frames since the trail's last sample; None if there is no trail of this scene to go on from.
        edited: whether settings may have changed.
    """
    trail, chunk, _live.since = _live.trail, _chunk(sample), None
    clock = scene_time.Clock(sample.fps, 0.0)
    if trail is not None and _live.last is not None and _signature(_live.last) == _signature(sample):
        if gap == 0.0:
            return trail, trail.again(_header(sample), chunk)
        if gap is not None and goes_on(clock.duration(gap)):
            if edited:
                trail.renew(_header(sample))
            return trail, trail.add(chunk)
    near = _live.ends.nearest(_frame(sample), clock)
    if near is not None and _signature(near[1].last) == _signature(sample):
        _live.since, (trail, kept, _, _live.first) = near
        trail.restore(kept)
        return trail, trail.add(chunk)
    trail, _live.first = core.pipeline.trail.Trail(_header(sample), library()), _frame(sample)
    return trail, trail.add(chunk)


def _frame(sample: core.scene.tactile_scene.TactileScene) -> float:
    return float(_chunk(sample).frames[0])


def _chunk(sample: core.scene.tactile_scene.TactileScene) -> core.scene.tactile_scene.Chunk:
    """Return the only chunk of a sample."""
    return next(iter(sample.chunks))


def _signature(sample: core.scene.tactile_scene.TactileScene) -> tuple[Any, ...]:
    """Who takes part; a trail cannot go on where this changes."""
    return (
        tuple((f.name, *(device.preset for device in f.devices)) for f in sample.fingers),
        tuple(b.name for b in sample.bodies),
        tuple(s.name for s in sample.screens),
        tuple(sorted(_chunk(sample).animated)),
        sample.fps,
    )


def _rendered(
    trail: core.pipeline.trail.Trail,
    sample: core.scene.tactile_scene.TactileScene,
    outputs: tuple[Any, ...],
    frame: float,
) -> Preview:
    bake = core.pipeline.bake.Bake(outputs, (), {}, "")
    result = store.Result(bake, scene_time.Clock(sample.fps, trail.first), None, ())
    note = origin(_live.first, _live.since, begins=trail.taken == 1)
    return Preview(frame, "live", note, tuple(baked_row(result, output, frame) for output in outputs))


def _header(sample: core.scene.tactile_scene.TactileScene) -> core.scene.tactile_scene.TactileScene:
    """Return a trail's header. It keeps only the devices that do not follow a skin, and hides the skins."""
    # `skin_preview` shows skins, and `FOLLOWERS` show the devices that follow a skin.
    fingers = tuple(
        replace(
            f,
            parameters={**f.parameters, "skin_shown": False},
            devices=tuple(d for d in f.devices if not active_presets.follows_skin(d.preset)),
        )
        for f in sample.fingers
    )
    return replace(sample, fingers=fingers, rate=float(sample.fps), chunks=())


def _with_followers(scene: bpy.types.Scene, shown: Preview | None) -> Preview | None:
    """Add pin arrays, thimbles and platforms: they follow the skin that `skin_preview` solves."""
    skins = skin_preview.own(scene)
    rows = tuple(row for kind in FOLLOWERS for row in kind.live_rows(scene, skins)) if shown is not None else ()
    return replace(shown, rows=(*shown.rows, *rows)) if shown is not None and rows else shown


def _from_bake(result: store.Result, frame: float, state: str) -> Preview:
    rows = tuple(baked_row(result, output, frame) for output in result.bake.outputs)
    return Preview(frame, "bake" if state == "fresh" else state, store.NOTES[state], rows)


def baked_row(result: store.Result, output: core.pipeline.bake.Output, frame: float) -> Row:
    """Return one output of a bake at a frame."""
    track, spec = output.track, output.track.spec
    values = store.values_at(result, output, frame)
    if values is None:  # outside the range: the device rests
        values = np.array([c.rest for c in spec.channels])
    contact, *errors = (store.signal_at(result, output, n, frame) for n in ("contact", "mismatch", "stress_error"))
    told = zip(("mismatch", "stress_error"), errors, strict=True)
    signals = {name: value for name, value in told if value is not None}
    row = row_of(output.finger, output.device, spec, by_channel(spec, values), contact, signals=signals)
    if row.drawn == "tactor" and len(track.times):
        now = result.clock.seconds(frame)
        start, path = now - TRAIL_SECONDS, np.empty((len(_PATH), 2))
        times = start + _PATH * ((now - start) / _PATH[-1])
        times[-1] = now
        for column, name in enumerate(("tactor_x", "tactor_y")):
            path[:, column] = np.interp(times, track.times, track.column(name))
        row = replace(row, path=path)
    if row.drawn == "coil" and len(track.times):
        now = result.clock.seconds(frame)
        recent = slice(*np.searchsorted(track.times, [now - TRAIL_SECONDS, now]))
        row = replace(row, path=np.stack([track.times[recent] - now, track.column("voltage")[recent]], axis=1))
    return row
