"""What the views and panels show of a scene, worked out when the frame changes or in a timer, and kept for drawing.

What a device reports comes before a track from a file, a fresh bake before the live preview, and that before a bake
that is out of date. Draw callbacks call `now`, which reads; where something has happened since, it asks for the work to
be done anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import bpy

from .. import changes, choices, identity, loading, redraw
from .. import doubts as doubtful
from ..devices import readiness, skin_models, thimble_devices
from ..preview import device_preview, live_lanes, moment, pin_preview, platform_preview, skin_preview, thimble_preview
from ..preview.rows import Preview
from ..preview.skin_state import SkinState
from ..results import store
from ..sampling import instances, scene_header, scene_sweep, simulated_motion
from ..streaming import built_devices, reported_values, streamed_track
from . import platform_twin, skin_field, skin_shown, skin_surface, slices, tactor_twin, thimble_twin, twins
from .twin import Twin


class Frame(NamedTuple):
    """Everything that is shown of a scene at one frame.

    Attributes:
        devices: what the devices do; None where nothing is known. twins: of each row, finished for drawing.
        skins: with their values, and the range of the colours.
        active_devices: which device of each family counts on each finger.
        active, ready: a finger's name, and what its devices need, see `readiness`.
        doubts: where the track that would be streamed and its preset disagree, in words.
        lineage: of `changes` when it was worked out; after a rename its names are somebody else's.
    """

    frame: float
    devices: Preview | None
    twins: tuple[Twin | None, ...]
    skins: skin_shown.Shown
    active_devices: readiness.ActiveDevices
    active: str
    ready: Mapping[str, readiness.Ready]
    doubts: str
    lineage: int


_frames: dict[int, Frame] = {}  # by the scene's session uid
_doubts: dict[int, tuple[doubtful.Doubt, ...]] = {}  # about the scene itself
_keys: dict[int, tuple[Any, ...]] = {}  # what they were worked out for
_drawn = {"kept": 0}  # how often a view was drawn from what was worked out
_slices = slices.Slices(lambda: _steps())
_LIGHT = (
    scene_sweep,
    scene_header,
    simulated_motion,
    instances,
    device_preview,
    twins,
    tactor_twin,
    readiness,
    doubtful,
)
_MODULES = (*_LIGHT, skin_field, skin_surface, skin_shown, platform_twin, thimble_twin, thimble_preview, skin_preview)


def devices(scene: bpy.types.Scene) -> Preview | None:
    """Work out what the devices do at the current frame; None where nothing is known."""
    shown = reported_values.preview(scene)
    return shown if shown is not None else device_preview.computed(scene)


def skins(scene: bpy.types.Scene) -> tuple[SkinState, ...]:
    """Work out the skins to show at the current frame, and as pins and thimbles render them; empty if unknown."""
    fingers = ((s, identity.named(scene, s.finger)) for s in skin_preview.own(scene))
    targets = tuple(s for s, obj in fingers if obj is not None and obj.dermis.finger.skin.shown)
    rendered = (*pin_preview.rendered(scene, targets), *thimble_preview.rendered(scene, targets)) if targets else ()
    return (*targets, *rendered)


def on_frame(scene: bpy.types.Scene) -> None:
    """Work out what is shown at a new frame for as long as a view may wait; go on in a timer."""
    if scene == bpy.context.scene and skin_preview.any_finger(scene):
        if _loaded(skins=skin_preview.any_solved(scene)):
            _slices.start(scene)
    else:
        _doubts.pop(scene.session_uid, None)
        renew(scene)


def _loaded(*, skins: bool) -> bool:
    """Return whether the modules are there that the work needs; a thread reads them, so that no view waits."""
    return loading.engine(_MODULES if skins else _LIGHT, skins=skins)


def _steps() -> slices.Steps:
    """Work everything out piece by piece; what was worked out is kept, so that `renew` finds it done."""
    scene = yield
    device_preview.refresh(scene)
    scene = yield
    for _ in skin_preview.on_frame(scene, device_preview.take_sample()):
        scene = yield
    for target in skin_preview.own(scene):
        for kind in device_preview.FOLLOWERS:
            kind.live_rows(scene, (target,))
        scene = yield
    for state in skins(scene) if scene.dermis.skin_view.show else ():
        view = scene.dermis.skin_view
        if state.model is not None:
            for _ in skin_field.learn(state, view.quantity):
                scene = yield
            skin_shown.values(state, view.quantity, view.exaggeration)
        scene = yield
    renew(scene)
    scene = yield
    _doubts[scene.session_uid] = doubtful.of(scene, _layer(scene))


def renew(scene: bpy.types.Scene) -> Frame:
    """Work out everything that is shown at the current frame, and keep it."""
    uid, active = scene.session_uid, _active(scene)
    _keys[uid] = _key(scene)  # first: what cannot be worked out is not tried again at every redraw
    _frames.pop(uid, None)
    shown = devices(scene)
    ready = readiness.of(active) if active is not None and active.dermis.role == "FINGER" else {}
    if active is not None and active.dermis.role in ("FINGER", "TOUCHABLE") and not choices.known():
        choices.refresh()  # panels call its devices or its material by their names
    _frames[uid] = Frame(
        moment.frame_of(scene),
        shown,
        tuple(twins.twin_of(scene, row) for row in shown.rows) if shown is not None else (),
        skin_shown.shown(scene, skins(scene)),
        readiness.active_devices(scene),
        active.name_full if active is not None else "",
        ready,
        streamed_track.doubts(scene),
        changes.lineage(),
    )
    live_lanes.note(scene, _frames[uid])
    return _frames[uid]


def now(scene: bpy.types.Scene) -> Frame | None:
    """Return what is shown at the current frame, None where it has not been worked out. Reads; for drawing."""
    kept = _read(scene)
    if kept is None or kept.frame == moment.frame_of(scene):
        _drawn["kept"] += kept is not None
        return kept
    return _late(kept, scene) if _slices.busy(scene) else None


def draws() -> int:
    """Return how often something was drawn from what had been worked out already."""
    return _drawn["kept"]


def _late(kept: Frame, scene: bpy.types.Scene) -> Frame:
    """Return what is shown until the current frame is worked out; it says so."""
    note = f"frame {kept.frame:g}: {moment.frame_of(scene):g} is being worked out"
    states = tuple(replace(state, note=note) for state in kept.skins.states)
    shown = None if kept.devices is None else replace(kept.devices, note=note)
    return kept._replace(devices=shown, skins=kept.skins._replace(states=states))


def active_device(scene: bpy.types.Scene, obj: bpy.types.Object | None, family: str) -> Any | None:
    """Return the settings of the device of a family that counts on a finger, or None. Reads; for drawing."""
    kept = _read(scene)  # at whatever frame: panels shall not come and go while a bake sweeps
    if kept is None or obj is None or obj.dermis.role != "FINGER":
        return None
    index = kept.active_devices.get(obj.name_full, {}).get(family, -1)
    return obj.dermis.finger.devices[index] if 0 <= index < len(obj.dermis.finger.devices) else None


def ready(scene: bpy.types.Scene, obj: bpy.types.Object, kind: str) -> readiness.Ready | None:
    """Return what the active finger's 'thimble' or 'platform' has; None while that is not known. Reads; for drawing."""
    kept = _read(scene)
    return kept.ready.get(kind) if kept is not None and kept.active == obj.name_full else None


def doubts(scene: bpy.types.Scene) -> str:
    """Return where the track that would be streamed and its preset disagree, '' for nowhere. Reads; for drawing."""
    kept = _read(scene)
    return kept.doubts if kept is not None else ""


def scene_doubts(scene: bpy.types.Scene) -> tuple[doubtful.Doubt, ...]:
    """Return what is doubtful about a scene, as it was worked out last. Reads; for drawing."""
    _read(scene)
    return _doubts.get(scene.session_uid, ())


def work() -> None:
    """Work out what every window shows."""
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
    """Forget what was worked out: another file is opened."""
    _slices.cancel()
    _frames.clear()
    _doubts.clear()
    _keys.clear()


def register() -> None:
    """Work from now on when somebody asks for a redraw."""
    redraw.work = work
    skin_models.on_read = skin_field.prepare


def unregister() -> None:
    """Work no more, and forget everything."""
    redraw.work = skin_models.on_read = None
    redraw.cancel()
    for kept in (pin_preview, platform_preview, thimble_preview):
        kept.reset()
    for cache in (twins, skin_shown, readiness, thimble_devices):
        cache.forget()
    forget()


def _read(scene: bpy.types.Scene) -> Frame | None:
    """Return what was worked out last; ask for the work where something has happened since."""
    if not changes.sweeping() and _keys.get(scene.session_uid) != _key(scene):
        redraw.request()
    kept = _frames.get(scene.session_uid)
    return kept if kept is not None and kept.lineage == changes.lineage() else None


def _active(scene: bpy.types.Scene) -> bpy.types.Object | None:
    return _layer(scene).objects.active


def _layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    return bpy.context.view_layer if scene == bpy.context.scene else scene.view_layers[0]


def _key(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return what the work depends on, but for what is reported: streaming asks for a redraw itself."""
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
