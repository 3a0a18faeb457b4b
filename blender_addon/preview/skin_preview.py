"""What every skin feels at the current frame.

Where a fresh bake covers the frame, its forces are read: they are exact along the path. Otherwise each finger has a
contact path of its own through the frames visited: a step forward continues its history, anything else (a jump, a step
back, undo) starts from rest, and the view says so. A change within a frame solves that frame anew from the one before.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import changes, redraw
from .._core import DermisError, core
from ..devices import skin_models, thimble_devices
from ..results import store
from ..sampling import scene_sweep
from . import baked_skins
from .preview_surfaces import Shape, may_deform
from .skin_state import SkinState

Array = NDArray[np.float64]

STEP_SECONDS = 0.25  # playback may skip frames; a longer step forward is a jump


@dataclass
class _Track:
    """One finger's way through the frames."""

    key: tuple[Any, ...]
    path: Any
    box: tuple[Array, Array]  # of the pad at rest
    order: list[int] = field(default_factory=list)
    before: Any = None  # the path's state before the last frame
    far: int = 0


@dataclass
class _Live:
    generation: int = -1
    scene: int = 0
    frame: float = 0.0
    first: float = 0.0
    edits: int = -1
    cast: tuple[Any, ...] = ()
    tracks: dict[str, _Track] = field(default_factory=dict)
    shapes: dict[str, Shape] = field(default_factory=dict)
    states: tuple[SkinState, ...] = ()
    failure: str = ""
    requested: bool = False  # the frame shall be solved anew, without a change of the frame
    middles: Array = field(default_factory=lambda: np.zeros((0, 3)))  # of the bodies' boxes in the world, this frame
    halves: Array = field(default_factory=lambda: np.zeros((0, 3)))


_live = _Live()
_shown: tuple[Any, ...] = ()
_wanted: tuple[Any, ...] = ()


def any_shown(scene: bpy.types.Scene) -> bool:
    """Tell whether any finger shows its skin; looked up once after each change."""
    global _shown
    key = (scene.session_uid, changes.edits(), len(scene.objects))
    if not _shown or _shown[0] != key:
        _shown = (key, any(o.dermis.role == "FINGER" and o.dermis.finger.skin.shown for o in scene.objects))
    return bool(_shown[1])


def any_needed(scene: bpy.types.Scene) -> bool:
    """Tell whether any finger shows its skin or wears a thimble, which follows it; looked up once after each change."""
    global _wanted
    key = (scene.session_uid, changes.edits(), len(scene.objects))
    if not _wanted or _wanted[0] != key:
        fingers = (o.dermis.finger for o in scene.objects if o.dermis.role == "FINGER")
        _wanted = (key, any(f.skin.shown or _followed(d.preset for d in f.devices if d.enabled) for f in fingers))
    return bool(_wanted[1])


def own(scene: bpy.types.Scene) -> tuple[SkinState, ...]:
    """Return the skins at the current frame as they are touched, hidden ones that a thimble follows among them."""
    if not any_needed(scene):
        return ()
    frame, state = float(scene.frame_current_final), store.state(scene)
    result = store.current(scene)
    baked = result is not None and bool(result.bake.skins)
    if not (baked and state == "fresh") and scene.dermis.live_preview and _holds(scene, frame):
        return _live.states
    if result is None or not baked:
        return ()
    return baked_skins.states(scene, result, frame, state)


def failure() -> str:
    """Return why the last frame could not be solved, or ''."""
    return _live.failure


def on_frame(scene: bpy.types.Scene, sample: Any = None) -> None:
    """Take in the new frame; called after every frame change in the window."""
    if scene != bpy.context.scene or not any_needed(scene) or not scene.dermis.live_preview:
        return
    result = store.current(scene)
    if result is not None and result.bake.skins and store.state(scene) == "fresh":
        reset()
        return
    try:
        step(bpy.context, sample)
    except Exception as error:  # a defect of ours must be seen, but not once a frame in the console
        text = f"{type(error).__name__}: {error}"
        if text != _live.failure:
            traceback.print_exc()
        _live.failure, _live.states = text, ()


def step(context: bpy.types.Context, sample: Any = None) -> tuple[SkinState, ...]:
    """Solve the scene as it is evaluated now, from the frame before or from rest, and return the skins.

    Args:
        sample: the scene as `scene_sweep.sample_now` gives it, where somebody has just taken it.
    """
    scene = context.scene
    frame = float(scene.frame_current_final)
    if frame == _live.frame and changes.edits() == _live.edits and _holds(scene, frame) and not _pending():
        return _live.states
    try:
        if sample is None:
            if _live.edits != changes.edits():
                scene_sweep.forget()
            sample = scene_sweep.sample_now(scene, context.evaluated_depsgraph_get())
        again = _prepare(scene, sample, frame)
        with skin_models.one_thread():
            _live.states = tuple(
                _solve(sample, f, finger, frame, again)
                for f, finger in enumerate(sample.fingers)
                if finger.parameters.get("skin_shown") or _followed(d.preset for d in finger.devices)
            )
        _live.failure = ""
    except DermisError as error:
        _live.states, _live.failure = (), str(error)
        _live.tracks.clear()
    _live.frame, _live.edits = frame, changes.edits()
    return _live.states


def reset() -> None:
    """Forget the history: the next frame is solved from rest."""
    _live.tracks.clear()
    _live.shapes.clear()
    _live.states, _live.failure, _live.generation = (), "", -1


def request() -> None:
    """Ask for the current frame to be solved anew: something changed that no frame change told."""
    _live.requested = True
    redraw.request()


def refresh() -> None:
    """Solve the current frame anew, if somebody has asked for it."""
    requested, _live.requested = _live.requested, False
    if requested and bpy.context.scene is not None:
        on_frame(bpy.context.scene)


def _followed(presets: Iterable[str]) -> bool:
    """Tell whether a skin is solved even where it is hidden: a thimble has a path to go on, and a trail is slow."""
    return any(thimble_devices.spec_of(preset) is not None for preset in presets)


def _pending() -> bool:
    return any(state.model is None for state in _live.states)


def _holds(scene: bpy.types.Scene, frame: float) -> bool:
    return (
        _live.generation == changes.generation()
        and _live.scene == scene.session_uid
        and _live.frame == frame
        and bool(_live.states)
    )


def _prepare(scene: bpy.types.Scene, sample: Any, frame: float) -> bool:
    """Decide whether the history goes on; return whether this is the frame of before, once more."""
    names = tuple(b.name for b in sample.bodies)
    cast = (tuple(f.name for f in sample.fingers), names, sample.fps)
    gap = (frame - _live.frame) / float(sample.fps)
    same = _live.generation == changes.generation() and _live.scene == scene.session_uid and _live.cast == cast
    again = same and frame == _live.frame and bool(_live.tracks)
    if not again and not (same and 1e-9 < gap <= STEP_SECONDS):
        _live.tracks.clear()
        _live.first = frame
    if _live.cast != cast or not same:
        _live.shapes = {name: Shape(may_deform(name)) for name in names}
    _live.generation, _live.scene, _live.cast = changes.generation(), scene.session_uid, cast
    for b, name in enumerate(names):
        _live.shapes[name].see(sample.chunks[0].surfaces[b][0])
    shapes = list(_live.shapes.values())
    if shapes:
        lows, highs = np.array([s.low for s in shapes]), np.array([s.high for s in shapes])
        linear = sample.chunks[0].bodies[:, 0, :3, :3]
        _live.middles = np.einsum("bij,bj->bi", linear, (lows + highs) / 2) + sample.chunks[0].bodies[:, 0, :3, 3]
        _live.halves = np.einsum("bij,bj->bi", np.abs(linear), (highs - lows) / 2)
    return again


def _solve(sample: Any, f: int, finger: Any, frame: float, again: bool) -> SkinState:
    where = f"finger '{finger.name}'"
    parameters = finger.parameters
    level = str(parameters["skin_level"])
    try:
        model = skin_models.get(parameters["skin"], level, where=f"{where}, skin")
    except DermisError as error:  # the other fingers go on
        return SkinState(finger.name, None, np.zeros((0, 3)), note=str(error))
    if model is None:
        done = skin_models.progress(parameters["skin"], level) or 0.0
        return SkinState(finger.name, None, np.zeros((0, 3)), note=f"making the {level} skin: {done:.0%}")
    track = _track(finger, model, where)
    if again:
        track.path.solver.restore(track.before)
    track.before = track.path.solver.save()
    chunk = sample.chunks[0]
    pose = chunk.fingers[f, 0]
    turn, place = pose[:3, :3], pose[:3, 3]
    near = _near(track, turn, place) if sample.bodies else []
    track.far += len(sample.bodies) - len(near)
    track.order += [b for b in near if b not in track.order]
    starts = frame == _live.first
    note = f"live, from rest at frame {_live.first:g}" + (": play or step forward" if starts else "")
    if not near:
        track.path.idle()
        return SkinState(
            finger.name, model, np.zeros((model.pad_count, 3)), source="live", note=note, counters=_counters(track)
        )
    bodies = [_body(sample, b, turn, place) for b in track.order]
    yielded = track.path.step(bodies, frame)
    solution = yielded.step.solution
    cone = core.contact.solver.cone
    normal = solution.normal_force
    across = (solution.force - normal[:, None] * solution.normals).sum(axis=0)
    return SkinState(
        finger.name,
        model,
        solution.force,
        float(normal.sum()),
        float(np.linalg.norm(across)),
        yielded.depth if solution.force.any() else 0.0,
        yielded.lift,
        int((solution.status == cone.STICK).sum()),
        int((solution.status == cone.SLIP).sum()),
        "live",
        note,
        yielded.step.work,
        bool(solution.converged),
        _counters(track),
    )


def _track(finger: Any, model: Any, where: str) -> _Track:
    p = finger.parameters
    key = (id(model), p["depth_mode"], p["bone_stiffness"], p["force_limit"])
    track = _live.tracks.get(finger.name)
    if track is None or track.key != key:
        path = core.contact.compliant_bone.Yielding.of(model, p, where)
        points = model.positions
        track = _live.tracks[finger.name] = _Track(key, path, (points.min(axis=0), points.max(axis=0)))
        track.before = path.solver.save()
    return track


def _near(track: _Track, turn: Array, place: Array) -> list[int]:
    """Return the bodies whose boxes come within reach of the fingertip's."""
    low, high = track.box
    middle, half = place + turn @ ((low + high) / 2), np.abs(turn) @ ((high - low) / 2) + track.path.solver.reach
    inside = (np.abs(middle - _live.middles) <= half + _live.halves).all(axis=1)
    return np.flatnonzero(inside).tolist()


def _body(sample: Any, b: int, turn: Array, place: Array) -> Any:
    """Return a body in the finger's frame."""
    chunk = sample.chunks[0]
    pose, shape = chunk.bodies[b, 0], _live.shapes[sample.bodies[b].name]
    surface, rotation = shape.placed(pose)
    stiffness = _value(sample, b, "surface_stiffness", 0.0)
    return core.contact.solver.bodies.ContactBody(
        surface,
        turn.T @ rotation,
        turn.T @ (pose[:3, 3] - place),
        friction=_value(sample, b, "friction", 0.6),
        softness=1.0 / stiffness if stiffness > 0 else 0.0,
        deforms=shape.deforms,
        carry=shape.carry,
    )


def _value(sample: Any, b: int, name: str, default: float) -> float:
    channel = sample.chunks[0].channels.get(f"body/{b}/{name}")
    return float(sample.bodies[b].parameters.get(name, default) if channel is None else channel[0])


def _counters(track: _Track) -> dict[str, int]:
    solver = track.path.solver
    c = solver.counters
    return {
        "solved": c["solved"],
        "skipped, forces still hold": c["unchanged"],
        "skipped, same pose": c["same"],
        "skipped, nothing near": c["idle"],
        "skipped, objects far away": track.far,
        "solved by the fallback": c["fallback"],
        "not converged": c["unconverged"],
    }


def register() -> None:
    """Nothing to register: `handlers` calls this module."""


def unregister() -> None:
    """Forget everything, and end what still runs."""
    reset()
    skin_models.forget()
