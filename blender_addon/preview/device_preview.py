"""What the devices do at the current frame, without a bake.

Where a fresh bake covers the frame, its track is read. Otherwise the frames visited last form a trail: a step forward
extends it, anything else (a jump, a step back, undo) starts a new one from rest, and the preview says so. The engine
renders that trail as it renders a bake; only the sampling is coarser, one sample a visited frame. Devices that follow
a skin which `skin_preview` solves anyway take another road, in `pin_preview`, `thimble_preview` and `platform_preview`:
they match this one frame.
"""

from __future__ import annotations

import traceback
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np

from .. import changes
from .._core import DermisError, core
from ..devices import active_presets, platform_devices, skin_models
from ..preferences import library, setting
from ..results import store
from ..sampling import scene_header, scene_sweep
from . import pin_preview, platform_preview, skin_preview, thimble_preview
from .rows import Preview, Row, by_channel, goes_on, row_of

TRAIL_SECONDS = 0.12  # how much of a tactor's path the view shows


@dataclass
class _Trail:
    generation: int = -1
    scene: int = 0
    samples: list[core.scene.tactile_scene.TactileScene] = field(default_factory=list)  # of one sample each
    edits: int = -1  # of `changes`, when `scene_sweep` last forgot its surfaces and reliefs
    preview: Preview | None = None
    failure: Exception | None = None
    taken: core.scene.tactile_scene.TactileScene | None = None  # the last sample, until `take_sample` hands it on


_trail = _Trail()
_memo: tuple[Any, ...] = ()
_memo_preview: Preview | None = None


def frame_of(scene: bpy.types.Scene) -> float:
    """Return the scene's frame with its sub-frame."""
    return float(scene.frame_current_final)


def computed(scene: bpy.types.Scene) -> Preview | None:
    """Return what bake or trail give for the current frame, or None where nothing is known."""
    global _memo, _memo_preview
    frame, state = frame_of(scene), store.state(scene)
    if state != "fresh" and scene.dermis.live_preview and _trail_ends_at(scene, frame):
        return _with_followers(scene, _trail.preview)
    result = store.current(scene)
    if result is None:
        return None
    memo = (id(result), frame, state)
    if memo != _memo:
        _memo, _memo_preview = memo, _from_bake(result, frame, state)
    return _memo_preview


def on_frame(scene: bpy.types.Scene) -> None:
    """Take the new frame into the trail; called after every frame change in the window."""
    if scene != bpy.context.scene or not scene.dermis.live_preview:
        return
    if not any(o.dermis.role == "FINGER" for o in scene.objects):
        return
    if store.state(scene) == "fresh":
        _trail.samples.clear()
        return
    try:
        step(bpy.context)
    except Exception as error:  # a defect of ours must be seen, but not once a frame in the console
        if not isinstance(_trail.failure, type(error)):
            traceback.print_exc()
        _trail.failure = error
        _note(scene, f"the preview failed ({type(error).__name__}: {error}); the console has more")


def step(context: bpy.types.Context) -> Preview:
    """Extend the trail by the scene as it is now, or start a new one, and render it."""
    scene = context.scene
    frame = frame_of(scene)
    if _trail.edits != changes.edits():
        scene_sweep.forget()
        _trail.edits = changes.edits()
    _trail.taken = None
    try:
        sample = _trail.taken = scene_sweep.sample_now(scene, context.evaluated_depsgraph_get())
        if not _continues(scene, sample, frame):
            _trail.samples = []
        _trail.samples.append(sample)
        del _trail.samples[: -int(setting("live_trail"))]
        _trail.generation, _trail.scene = changes.generation(), scene.session_uid
        _trail.preview = _render(frame)
    except DermisError as error:
        return _note(scene, str(scene_header.reason(_trail.taken, error) if _trail.taken else error))
    return _trail.preview


def _note(scene: bpy.types.Scene, text: str) -> Preview:
    """Show a sentence in place of devices; the trail ends here."""
    _trail.samples, _trail.scene, _trail.generation = [], scene.session_uid, changes.generation()
    _trail.preview = Preview(frame_of(scene), "live", text, ())
    return _trail.preview


def take_sample() -> core.scene.tactile_scene.TactileScene | None:
    """Return the sample that this frame's preview was made from, once; None where none was taken."""
    sample, _trail.taken = _trail.taken, None
    return sample


def reset() -> None:
    """Forget the trail; the next frame starts from rest."""
    global _memo, _memo_preview
    _trail.samples, _trail.preview, _trail.taken = [], None, None
    _memo, _memo_preview = (), None


def _trail_ends_at(scene: bpy.types.Scene, frame: float) -> bool:
    shown = _trail.preview
    same = _trail.scene == scene.session_uid and _trail.generation == changes.generation()
    return same and shown is not None and abs(shown.frame - frame) < 1e-6


def _continues(scene: bpy.types.Scene, sample: core.scene.tactile_scene.TactileScene, frame: float) -> bool:
    if not _trail.samples or _trail.scene != scene.session_uid or _trail.generation != changes.generation():
        return False
    before = _trail.samples[-1]
    gap = (frame - _frame(before)) / float(sample.fps)
    return goes_on(gap) and _signature(before) == _signature(sample)


def _frame(sample: core.scene.tactile_scene.TactileScene) -> float:
    return float(_chunk(sample).frames[0])


def _chunk(sample: core.scene.tactile_scene.TactileScene) -> core.scene.tactile_scene.Chunk:
    """Return the only chunk of a sample."""
    return next(iter(sample.chunks))


def _signature(sample: core.scene.tactile_scene.TactileScene) -> tuple[Any, ...]:
    """Who takes part; a trail cannot go on where this changes."""
    return (
        tuple(f.name for f in sample.fingers),
        tuple(b.name for b in sample.bodies),
        tuple(s.name for s in sample.screens),
        sample.fps,
    )


def _render(frame: float) -> Preview:
    samples = _trail.samples
    bake = _run(_joined(samples))
    first = _frame(samples[0])
    result = store.Result(bake, float(samples[0].fps), first - 1.0, -1, ())
    note = f"live, from rest at frame {first:g}" + (": play or step forward" if len(samples) == 1 else "")
    rows = tuple(baked_row(result, output, frame) for output in bake.outputs)
    return Preview(frame, "live", note, rows)


def _joined(samples: list[core.scene.tactile_scene.TactileScene]) -> core.scene.tactile_scene.TactileScene:
    """Return the trail as a scene of its own; it starts one frame earlier, at rest in the first pose."""
    chunk = core.scene.tactile_scene.Chunk
    parts = [_chunk(s) for s in (samples[0], *samples)]
    frames = np.array([float(p.frames[0]) for p in parts])
    frames[0] -= 1.0
    keys = set.intersection(*(set(p.animated) for p in parts))
    surfaces = set.intersection(*(set(p.surfaces) for p in parts))
    joined = chunk(
        frames=frames,
        times=(frames - frames[0]) / float(samples[0].fps),
        fingers=np.concatenate([p.fingers for p in parts], axis=1),
        bodies=np.concatenate([p.bodies for p in parts], axis=1),
        screens=np.concatenate([p.screens for p in parts], axis=1),
        surfaces={i: tuple(p.surfaces[i][0] for p in parts) for i in sorted(surfaces)},
        animated={k: np.concatenate([p.animated[k] for p in parts]) for k in sorted(keys)},
    )
    last = samples[-1]
    # Skins have a path of their own, in `skin_preview`, and so have the devices that follow one that is solved there.
    # A trail ends at the frame that is shown, so nothing may fade out there.
    unfaded = {"pin_fade_in": 0.0, "pin_fade_out": 0.0}
    fingers = tuple(
        replace(
            f,
            parameters={**f.parameters, "skin_shown": False},
            devices=tuple(
                replace(d, parameters={**d.parameters, **unfaded})
                for d in f.devices
                if not (skin_preview.solved(f) and _has_live_follower(d.preset))  # see `_with_followers`
                and not platform_devices.waits(f.name, d.preset)
            ),
        )
        for f in last.fingers
    )
    span = (int(np.floor(frames[0])), int(np.ceil(frames[-1])))
    return replace(last, fingers=fingers, frame_range=span, rate=float(last.fps), chunks=(joined,))


def _run(tactile: core.scene.tactile_scene.TactileScene) -> core.pipeline.bake.Bake:
    presets = library()
    steps = core.pipeline.render.render(tactile, presets, cache=skin_models.cache())
    with skin_models.one_thread() if skin_models.solved_in(tactile, presets) else nullcontext():
        return core.steps.drain(steps)


def _has_live_follower(preset: str) -> bool:
    return any(active_presets.spec_of(preset, family) is not None for family in active_presets.FAMILIES)


def _with_followers(scene: bpy.types.Scene, shown: Preview | None) -> Preview | None:
    """Add pin arrays, thimbles and platforms: they follow the skin that `skin_preview` solves."""
    followers = (pin_preview, thimble_preview, platform_preview)
    rows = tuple(row for kind in followers for row in kind.live_rows(scene)) if shown is not None else ()
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
    contact, mismatch = (store.signal_at(result, output, name, frame) for name in ("contact", "mismatch"))
    signals = {} if mismatch is None else {"mismatch": mismatch}
    row = row_of(output.finger, output.device, spec, by_channel(spec, values), contact, signals=signals)
    if row.drawn == "tactor" and len(track.times):
        now = (frame - result.first) / result.fps
        times = np.linspace(now - TRAIL_SECONDS, now, 61)
        path = np.stack([np.interp(times, track.times, track.column(n)) for n in ("tactor_x", "tactor_y")], axis=1)
        row = replace(row, path=path)
    return row
