"""Contents of a scene's views and panels, kept for drawing.

They are computed when the frame changes, or in a timer. Reported values of a device take precedence over a track from
a file, a fresh bake over the live preview, and the live preview over a bake that is out of date. Draw callbacks call
`now`, which only reads. If something has changed since, `now` requests that the work is done anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import bpy

from .. import changes, choices, identity, loading, redraw
from .. import doubts as doubtful
from ..devices import active_presets, platform_devices, readiness, skin_models, thimble_adaptation, thimble_devices
from ..placing import surfaces
from ..preview import (
    device_preview,
    followers,
    live_lanes,
    moment,
    pin_preview,
    platform_preview,
    skin_preview,
    thimble_preview,
)
from ..preview.rows import Preview
from ..preview.skin_state import SkinState
from ..results import store
from ..sampling import (
    curved_surfaces,
    frames,
    height_maps,
    image_files,
    instances,
    recorder,
    scene_header,
    scene_sweep,
    script_changes,
    simulated_motion,
    touched_frames,
)
from ..streaming import built_devices, reported_values, streamed_track
from . import display_surface, pin_twin, platform_twin, skin_field, skin_shown, slices, tactor_twin, thimble_twin, twins
from .twin import Twin


class Frame(NamedTuple):
    """The contents of all views of a scene at one frame.

    Attributes:
        devices: a row for each device; None if nothing is known. twins: the twin of each row, ready for drawing.
        skins: the skins with their values, and the range of the colours.
        active_devices: which device of each family counts on each finger.
        active, ready: name of the active object, and the readiness of its devices if it is a finger, see `readiness`.
        doubts: in words, how the track that would be streamed disagrees with its preset.
        span: the first and the last frame that a bake would take; None without a finger.
        lineage: `changes.lineage()` of this frame; after a rename, its names may belong to other objects.
    """

    frame: float
    devices: Preview | None
    twins: tuple[Twin | None, ...]
    skins: skin_shown.Shown
    active_devices: readiness.ActiveDevices
    active: str
    ready: Mapping[str, readiness.Ready]
    doubts: str
    span: tuple[int, int] | None
    lineage: int


COLOURS_FOLLOW = "from the bake; its colours are being computed"
BAKE_FOLLOWS = "the baked touch is being computed"  # of a skin as a device renders it

_frames: dict[int, Frame] = {}  # by the scene's session uid
_doubts: dict[int, tuple[doubtful.Doubt, ...]] = {}  # about the scene itself
_keys: dict[int, tuple[Any, ...]] = {}  # by the scene's session uid: the inputs of the last work, see `_key`
_drawn = {"kept": 0}  # how often a view was drawn from a kept frame
_slices = slices.Slices(lambda: _steps())
_LIGHT = (
    scene_sweep,
    scene_header,
    simulated_motion,
    instances,
    curved_surfaces,
    frames,
    height_maps,
    image_files,
    recorder,
    script_changes,
    touched_frames,
    device_preview,
    twins,
    tactor_twin,
    readiness,
    doubtful,
    surfaces,
    active_presets,
    platform_devices,
    thimble_devices,
    followers,
    pin_preview,
    platform_preview,
    thimble_preview,
)
_MODULES = (
    *_LIGHT,
    skin_field,
    display_surface,
    skin_shown,
    pin_twin,
    platform_twin,
    thimble_twin,
    thimble_adaptation,
    skin_preview,
)


def devices(scene: bpy.types.Scene) -> Preview | None:
    """Return the preview of the devices at this frame; None if nothing is known."""
    shown = reported_values.preview(scene)
    return shown if shown is not None else device_preview.computed(scene)


def skins(scene: bpy.types.Scene) -> tuple[SkinState, ...]:
    """Return the skins to show at this frame, then those that devices render.

    The devices are pins and thimbles. The tuple is empty if nothing is known.
    """
    fingers = ((s, identity.named(scene, s.finger)) for s in skin_preview.own(scene))
    targets = tuple(s for s, obj in fingers if obj is not None and obj.dermis.finger.skin.shown)
    rendered = (*pin_preview.rendered(scene, targets), *thimble_preview.rendered(scene, targets)) if targets else ()
    return (*targets, *rendered)


def on_frame(scene: bpy.types.Scene) -> None:
    """Compute the contents of a new frame, in a timer if a view would wait long."""
    if scene == bpy.context.scene and skin_preview.any_finger(scene):
        if _loaded(scene):
            _slices.start(scene)
    else:
        _doubts.pop(scene.session_uid, None)
        renew(scene)


def _loaded(scene: bpy.types.Scene) -> bool:
    """Return whether the modules that the work needs have been loaded.

    A thread loads them, so that no view waits. It reads the presets, too. These decide whether skins are solved, which
    needs further modules.
    """
    if not loading.engine(_LIGHT, skins=False, more=choices.reader):
        return False
    if skin_preview.any_solved(scene):
        skin_models.on_read = skin_field.prepare
        return loading.engine(_MODULES, skins=True)
    return True


def _steps() -> slices.Steps:
    """Compute everything piece by piece; `renew` then finds the results."""
    scene = yield
    _take_bake(scene)
    while not loading.at_rest():  # unfinished work of an earlier frame
        scene = yield
    if device_preview.read(scene):
        scene = yield
    device_preview.refresh(scene)
    scene = yield
    for _ in skin_preview.on_frame(scene, device_preview.take_sample()):
        scene = yield
    for target in skin_preview.own(scene):
        for kind in device_preview.FOLLOWERS:
            for _ in kind.prepare(scene, target):
                scene = yield
        scene = yield
    states: tuple[SkinState, ...] | None = skins(scene)
    for state in states or () if scene.dermis.skin_view.show else ():
        view = scene.dermis.skin_view
        if state.model is not None and not skin_field.is_light(state):  # `renew` draws the others together
            for _ in skin_field.learn(state, view.quantity):
                scene = yield
            skin_shown.values(state, view.quantity, view.exaggeration)
            scene, states = (yield), None  # something may have changed meanwhile
    renew(scene, states)
    scene = yield
    _doubts[scene.session_uid] = doubtful.of(scene, _layer(scene))


def _take_bake(scene: bpy.types.Scene) -> None:
    """Put a fresh bake in place of the live preview at once; its colours follow when they are computed."""
    kept = _frames.get(scene.session_uid)
    if kept is None or kept.frame != moment.frame_of(scene) or store.state(scene) != "fresh":
        return
    if any(state.source != "bake" for state in kept.skins.states):
        baked = {s.finger: replace(s, note=COLOURS_FOLLOW) for s in skin_preview.own(scene)}
        states = (baked.get(s.finger, replace(s, source="none", note=BAKE_FOLLOWS)) for s in kept.skins.states)
        kept = kept._replace(skins=kept.skins._replace(states=tuple(states)))
    if kept.devices is not None and kept.devices.source == "live":
        shown = devices(scene)
        rows = shown.rows if shown is not None else ()
        kept = kept._replace(devices=shown, twins=twins.twins_of(scene, rows))
    _frames[scene.session_uid] = kept


def renew(scene: bpy.types.Scene, states: tuple[SkinState, ...] | None = None) -> Frame:
    """Compute everything that is shown at the current frame, and keep it.

    Args:
        states: the skins; if None, they are computed, too.
    """
    uid, active = scene.session_uid, _active(scene)
    _keys[uid] = _key(scene)  # first: work that fails is not tried again at every redraw
    _frames.pop(uid, None)
    shown = devices(scene)
    ready = readiness.of(active) if active is not None and active.dermis.role == "FINGER" else {}
    if active is not None and active.dermis.role in ("FINGER", "TOUCHABLE") and not choices.known():
        choices.refresh()  # panels show the names of its devices or its material
    _frames[uid] = Frame(
        moment.frame_of(scene),
        shown,
        twins.twins_of(scene, shown.rows) if shown is not None else (),
        skin_shown.shown(scene, skins(scene) if states is None else states),
        readiness.active_devices(scene),
        active.name_full if active is not None else "",
        ready,
        streamed_track.doubts(scene),
        frames.frame_range_now(scene) if skin_preview.any_finger(scene) else None,
        changes.lineage(),
    )
    live_lanes.note(scene, _frames[uid])
    return _frames[uid]


def now(scene: bpy.types.Scene) -> Frame | None:
    """Return the contents of the current frame for drawing; compute nothing.

    While the current frame is computed, they are those of an earlier frame with a note. None if nothing is known.
    """
    kept = _read(scene)
    if kept is None or kept.frame == moment.frame_of(scene):
        _drawn["kept"] += kept is not None
        return kept
    return _late(kept, scene) if _slices.busy(scene) else None


def draws() -> int:
    """Return how often something was drawn from a kept frame."""
    return _drawn["kept"]


def _late(kept: Frame, scene: bpy.types.Scene) -> Frame:
    """Return the kept frame with a note that the current one is being computed."""
    note = f"shows frame {kept.frame:g}; computing frame {moment.frame_of(scene):g}"
    states = tuple(replace(state, note=note) for state in kept.skins.states)
    shown = None if kept.devices is None else replace(kept.devices, note=note)
    return kept._replace(devices=shown, skins=kept.skins._replace(states=states))


def active_device(scene: bpy.types.Scene, obj: bpy.types.Object | None, family: str) -> Any | None:
    """Return the settings of a finger's device that counts in a family, or None.

    For drawing: the function only reads.
    """
    kept = _read(scene)  # of any frame, so that panels do not come and go while a bake sweeps
    if kept is None or obj is None or obj.dermis.role != "FINGER":
        return None
    index = kept.active_devices.get(obj.name_full, {}).get(family, -1)
    return obj.dermis.finger.devices[index] if 0 <= index < len(obj.dermis.finger.devices) else None


def ready(scene: bpy.types.Scene, obj: bpy.types.Object, kind: str) -> readiness.Ready | None:
    """Return the readiness of the active finger's 'thimble' or 'platform'.

    None while it is unknown. For drawing: the function only reads.
    """
    kept = _read(scene)
    return kept.ready.get(kind) if kept is not None and kept.active == obj.name_full else None


def doubts(scene: bpy.types.Scene) -> str:
    """Return in words how the track to be streamed disagrees with its preset.

    '' if they agree. For drawing: the function only reads.
    """
    kept = _read(scene)
    return kept.doubts if kept is not None else ""


def span(scene: bpy.types.Scene) -> tuple[int, int] | None:
    """Return the first and the last frame that a bake would take.

    None while they are not known. For drawing: the function only reads.
    """
    kept = _read(scene)
    return kept.span if kept is not None else None


def scene_doubts(scene: bpy.types.Scene) -> tuple[doubtful.Doubt, ...]:
    """Return the last computed doubts about a scene.

    For drawing: the function only reads.
    """
    _read(scene)
    return _doubts.get(scene.session_uid, ())


def work() -> None:
    """Compute the contents of every window."""
    if changes.sweeping():
        return
    built_devices.read()
    scenes = {window.scene.session_uid: window.scene for window in bpy.context.window_manager.windows}
    for gone in set(_keys) - set(scenes):
        del _keys[gone]
        _frames.pop(gone, None)
        _doubts.pop(gone, None)
    for scene in scenes.values():
        on_frame(scene)


def forget() -> None:
    """Forget all frames and doubts, and stop the running work."""
    _slices.cancel()
    _frames.clear()
    _doubts.clear()
    _keys.clear()


def _read(scene: bpy.types.Scene) -> Frame | None:
    """Return the last computed frame; request the work if its inputs have changed.

    None if there is no such frame, or if its names may be out of date.
    """
    if not changes.sweeping() and _keys.get(scene.session_uid) != _key(scene):
        redraw.request()
    kept = _frames.get(scene.session_uid)
    return kept if kept is not None and kept.lineage == changes.lineage() else None


def _active(scene: bpy.types.Scene) -> bpy.types.Object | None:
    return _layer(scene).objects.active


def _layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    return bpy.context.view_layer if scene == bpy.context.scene else scene.view_layers[0]


def _key(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return the inputs of the work, except reported values.

    For these, streaming requests a redraw itself.
    """
    settings, active = scene.dermis, _active(scene)
    view, thimble = settings.skin_view, settings.thimble_view
    return (
        moment.frame_of(scene),
        store.state(scene),
        id(store.current(scene)),
        changes.edits(),
        settings.live_preview,
        settings.twin_exaggeration,
        active.name_full if active is not None else "",
        (view.show, view.quantity, view.exaggeration, view.range_mode, view.maximum),
        (thimble.split, thimble.workspace),
    )
