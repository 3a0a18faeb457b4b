"""The contact of every skin at the current frame.

Where a fresh bake covers the frame, its forces are read: they are exact along the path. Otherwise each finger has a
contact path of its own through the frames visited: a step forward continues its history, a frame that was visited is
shown as it was, a jump goes on from the nearest state that was kept a little before, anything else (a jump farther,
undo) starts from rest, and the view says which. A change within a frame solves that frame anew from the one before.
While frames are only passed, each is walked to in few steps; where the scene rests, that is made good.
"""

from __future__ import annotations

import math
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes, loading, scene_time
from .._core import DermisError, core
from ..devices import active_presets, skin_models
from ..results import store
from ..sampling import scene_sweep
from . import baked_skins, moment
from .kept_states import STATES, KeptStates
from .rows import as_it_was, goes_on, origin
from .skin_state import SkinState

SEEN = 300  # frames that were visited are shown again as they were
HEAVY = 6  # states that are kept where contact is on points: megabytes a finger each, where one on nodes has 0.1


@dataclass
class _FingerPath:
    """One finger's way through the frames."""

    key: tuple[Any, ...]
    stepper: core.contact.skin_stepper.SkinStepper
    before: Any  # the stepper's state before the last frame


class _Between(NamedTuple):
    """All paths between two frames, to go on from.

    Attributes:
        paths: of the fingers, and the state of each. chunk: the sample that they had taken. first: see `_Live`.
    """

    paths: dict[str, tuple[_FingerPath, Any]]
    chunk: core.scene.tactile_scene.Chunk
    first: float


@dataclass
class _Live:
    generation: int = -1
    scene: int = 0
    frame: float = 0.0  # that the states are of
    end: float = 0.0  # that the paths have come to
    first: float = 0.0  # that they began at
    since: float | None = None  # of the kept state that the last frame was reached from
    edits: int = -1
    signature: tuple[Any, ...] = ()
    paths: dict[str, _FingerPath] = field(default_factory=dict)
    posed: core.contact.posed_scene.PosedScene | None = None  # for all fingers
    states: tuple[SkinState, ...] = ()
    seen: core.recent.Recent[float, tuple[SkinState, ...]] = field(default_factory=lambda: core.recent.Recent(SEEN))
    kept: KeptStates[_Between] = field(default_factory=KeptStates)
    undone: list[_FingerPath] = field(default_factory=list)  # fingers of a frame that was left: they go back
    failure: str = ""


_live = _Live()
_any: tuple[Any, bool] = ((), False)  # the key of the look-up, and whether there is any
_any_solved: tuple[Any, bool] = ((), False)


def any_finger(scene: bpy.types.Scene) -> bool:
    """Return whether there is any finger; looked up once after each change."""
    global _any
    if _any[0] != _look(scene):
        _any = _look(scene), any(obj.dermis.role == "FINGER" for obj in scene.objects)
    return _any[1]


def any_solved(scene: bpy.types.Scene) -> bool:
    """Return whether the skin of any finger is solved; looked up once after each change, in presets too."""
    global _any_solved
    if _any_solved[0] != _look(scene):
        fingers = [obj.dermis.finger for obj in scene.objects if obj.dermis.role == "FINGER"]
        solved = any(_is_solved(f.skin.shown, (d.preset for d in f.devices if d.enabled)) for f in fingers)
        _any_solved = _look(scene), solved
    return _any_solved[1]


def _look(scene: bpy.types.Scene) -> tuple[int, int, int]:
    return scene.session_uid, changes.edits(), len(scene.objects)


def solved(finger: core.scene.tactile_scene.Finger) -> bool:
    """Return whether the skin of a sampled finger is solved here."""
    return _is_solved(bool(finger.parameters.get("skin_shown")), (device.preset for device in finger.devices))


def own(scene: bpy.types.Scene) -> tuple[SkinState, ...]:
    """Return the skins at the current frame as they are touched, hidden ones that a thimble follows among them."""
    if not any_solved(scene):
        return ()
    frame, state = moment.frame_of(scene), store.state(scene)
    result = store.current(scene)
    baked = result is not None and bool(result.bake.skins)
    if not (baked and state == "fresh") and scene.dermis.live_preview and _holds(scene, frame):
        return _live.states
    if result is None or not baked:
        return ()
    return baked_skins.states(scene, result, frame, state)


def seen(scene: bpy.types.Scene, frame: float) -> bool:
    """Return whether a frame, other than the next one, was visited since the last change and is shown as it was."""
    gap = scene_time.clock(scene, _live.end).seconds(frame)
    return _unchanged(scene) and frame in _live.seen and not goes_on(gap)


def revisited() -> bool:
    """Return whether the skins are shown as they were, while their paths are elsewhere."""
    return _live.frame != _live.end


def coarse() -> bool:
    """Return whether the skins that are shown were only solved coarsely."""
    return any(state.coarse for state in _live.states)


def failure() -> str:
    """Return why the last frame could not be solved, or ''."""
    return _live.failure


def on_frame(scene: bpy.types.Scene, sample: Any = None) -> Iterator[None]:
    """Take in the new frame, after every frame change in the window; yield after each finger."""
    if scene != bpy.context.scene or not any_solved(scene) or not scene.dermis.live_preview:
        return
    result = store.current(scene)
    if result is not None and result.bake.skins and store.state(scene) == "fresh":
        reset()
        return
    try:
        yield from _solved(bpy.context, sample)
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
    deque(_solved(context, sample), maxlen=0)
    return _live.states


def _solved(context: bpy.types.Context, sample: Any) -> Iterator[None]:
    """Solve the scene, yield after each finger; who does not come back leaves each finger as it was before."""
    scene = context.scene
    frame = moment.frame_of(scene)
    for path in _live.undone:
        path.stepper.restore(path.before)
    _live.undone = []
    refined = coarse() and frame == _live.frame and not moment.passing()
    if refined:
        _live.seen.pop(frame, None)
    elif frame == _live.frame and changes.edits() == _live.edits and _holds(scene, frame) and not _waits():
        return
    if seen(scene, frame):
        _live.frame = frame
        _live.states = _live.seen[frame] = tuple(replace(s, note=as_it_was(s.note)) for s in _live.seen[frame])
        return
    try:
        if sample is None:
            sample = scene_sweep.sample_now(scene, context.evaluated_depsgraph_get())
        posed, again = _prepare(scene, sample, frame)
        states = []
        for f, finger in enumerate(sample.fingers):
            if solved(finger):
                states.append((yield from _solve(f, finger, posed, frame, again)))
                yield
        _live.states, _live.failure, _live.undone = tuple(states), "", []
    except DermisError as error:
        _live.states, _live.failure = (), str(error)
        _live.paths = {}
    _live.frame, _live.end, _live.edits = frame, frame, changes.edits()
    if _live.states and not _waits():
        _live.seen[frame] = _live.states
        heavy = any(path.stepper.on_points for path in _live.paths.values())
        _live.kept.keep(frame, _between, HEAVY if heavy else STATES)


def reset() -> None:
    """Forget the history: the next frame is solved from rest."""
    _live.paths = {}
    _live.posed = None
    _live.undone = []
    _live.seen.clear()
    _live.kept.clear()
    _live.states, _live.failure, _live.generation = (), "", -1


def _is_solved(shown: bool, presets: Iterable[str]) -> bool:
    """Return whether a skin is solved: also where it is hidden and a device follows it."""
    return shown or any(active_presets.follows_skin(preset) for preset in presets)


def _waits() -> bool:
    """Return whether a skin, or a table of it, is being made: then the same frame is solved anew now and then."""
    return any(state.model is None or state.waits for state in _live.states)


def _unchanged(scene: bpy.types.Scene) -> bool:
    """Return whether nothing but the frame has changed since the last one was solved."""
    return (_live.generation, _live.scene, _live.edits) == (changes.lineage(), scene.session_uid, changes.edits())


def _between() -> _Between:
    assert _live.posed is not None
    paths = {name: (path, path.stepper.save()) for name, path in _live.paths.items()}
    return _Between(paths, _live.posed.chunk, _live.first)


def _holds(scene: bpy.types.Scene, frame: float) -> bool:
    return (
        _live.generation == changes.lineage()
        and _live.scene == scene.session_uid
        and _live.frame == frame
        and bool(_live.states)
    )


def _prepare(scene: bpy.types.Scene, sample: Any, frame: float) -> tuple[core.contact.posed_scene.PosedScene, bool]:
    """Pose the scene, and decide whether the history goes on; return whether this is the frame of before, once more."""
    names = tuple(b.name for b in sample.bodies)
    signature = (tuple(f.name for f in sample.fingers), names, sample.fps)
    clock = scene_time.Clock(sample.fps, _live.end)
    gap = clock.seconds(frame)
    if not _unchanged(scene) or _live.signature != signature:
        _live.seen.clear()
        _live.kept.clear()
    same = _live.generation == changes.lineage() and _live.scene == scene.session_uid and _live.signature == signature
    again = same and frame == _live.end and bool(_live.paths)
    _live.since, posed = None, _live.posed
    if not again and not (same and goes_on(gap)):
        near = _live.kept.nearest(frame, clock)
        if near is None:
            _live.paths, _live.end, _live.first = {}, math.nan, frame
        else:
            _live.since, between = near
            _live.end = _live.since  # also where the work is left before the frame is done
            _live.paths, _live.first = {name: path for name, (path, _) in between.paths.items()}, between.first
            for path, state in between.paths.values():
                path.stepper.restore(state)
            assert posed is not None
            posed.take(between.chunk)  # the fingers come from it
    if posed is None or not same:
        posed = core.contact.posed_scene.PosedScene(sample.bodies, [may_deform(name) for name in names])
    _live.generation, _live.scene, _live.signature, _live.posed = (
        changes.lineage(),
        scene.session_uid,
        signature,
        posed,
    )
    posed.take(sample.chunks[0], sample.bodies)
    return posed, again


def may_deform(name: str) -> bool:
    """Return whether an object's surface may be another at another frame: friction is then carried by its faces."""
    obj = bpy.data.objects.get(name.split(" @ ")[0])
    if obj is None or obj.type != "MESH":
        return True
    return bool(len(obj.modifiers)) or obj.data.shape_keys is not None


def _solve(
    f: int, finger: Any, posed: core.contact.posed_scene.PosedScene, frame: float, again: bool
) -> Generator[None, None, SkinState]:
    """Return the skin of a finger; slow work is done aside, see `loading`."""
    where = f"finger '{finger.name}'"
    level = str(finger.parameters["skin_level"])
    try:
        model = skin_models.of(finger.parameters, where=f"{where}, skin")
    except DermisError as error:  # the other fingers go on
        return SkinState(finger.name, None, np.zeros((0, 3)), note=str(error))
    if model is None:
        done = skin_models.progress(finger.parameters["skin"], level)
        note = (
            f"making the {level} skin: {done:.0%}" if done is not None and done < 1.0 else f"reading the {level} skin"
        )
        return SkinState(finger.name, None, np.zeros((0, 3)), note=note)
    begun = finger.name not in _live.paths
    path = yield from _path_of(f, finger, model, posed)
    if again:
        path.stepper.restore(path.before)
    path.before = path.stepper.save()
    _live.undone.append(path)
    stepped = _stepped(path.stepper, coarse=moment.passing())
    # a jump is walked to from rest, in steps that together take longer than a view may wait
    walked = begun or not (again or goes_on(scene_time.clock(bpy.context.scene, _live.end).seconds(frame)))
    step = (yield from loading.aside(stepped)) if walked else stepped()
    note = origin(_live.first, _live.since, begins=frame == _live.first)
    if path.stepper.cut:
        note += "; coarse while it moves"
    waits = False
    if skin_models.wants_pad(finger.parameters):
        made = skin_models.make_pad(finger.parameters["skin"])
        waits = made is not None
        note += "; at the mesh's nodes" + (f" while the smooth skin is made: {made:.0%}" if made is not None else "")
    state = SkinState.of(finger.name, model, step, "live", note, _counters(path.stepper))
    return replace(state, coarse=path.stepper.cut, waits=waits)


def _stepped(stepper: core.contact.skin_stepper.SkinStepper, *, coarse: bool) -> Callable[[], Any]:
    """Return the work of one step."""

    def work() -> Any:
        with skin_models.one_thread():
            return stepper.step(stepper.approach(), 0, coarse=coarse)

    return work


def _path_of(
    f: int, finger: Any, model: Any, posed: core.contact.posed_scene.PosedScene
) -> Generator[None, None, _FingerPath]:
    """Return the way of a finger; a new one is begun aside, since the skin's stiffness is looked at."""
    p = finger.parameters
    # a smooth skin whose table has been made since begins a new path
    waits, skin = skin_models.wants_pad(p), (model.key, model.tissue, model.material)
    key = (skin, p["depth_mode"], p["bone_stiffness"], p["force_limit"], p["contact"], waits)
    path = _live.paths.get(finger.name)
    if path is not None and path.key != key:  # the seen frames are of another skin
        _live.seen.clear()
        _live.kept.clear()
    if path is None or path.key != key:
        stepper = yield from loading.aside(lambda: core.contact.skin_stepper.SkinStepper(model, f, finger, posed))
        path = _live.paths[finger.name] = _FingerPath(key, stepper, stepper.save())
    return path


def _counters(stepper: core.contact.skin_stepper.SkinStepper) -> dict[str, int]:
    c = stepper.counters
    return {
        "solved": c["solved"],
        "skipped, forces still hold": c["unchanged"],
        "skipped, same pose": c["same"],
        "skipped, nothing near": c["idle"],
        "skipped, objects far away": stepper.far,
        "not converged": c["unconverged"],
    }
