"""The contact of every skin at the current frame.

If a fresh bake covers the frame, its forces are read: they are exact along the path. Otherwise each finger has a
contact path of its own through the visited frames:

* A step forward continues the path's history.
* A frame that was visited before is shown as it was.
* A jump goes on from the nearest state that was kept a little before the frame.
* Anything else, such as a farther jump or undo, starts from rest.

The view says which of these it shows. A change within a frame solves the frame anew from the one before. While frames
only pass by, each is solved coarsely, in few steps. When the scene rests, the frame is refined.
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

SEEN = 300  # number of visited frames that are kept, to be shown again as they were
HEAVY = 6  # number of kept states if contact is on points: each takes megabytes a finger; one on nodes takes 0.1 MB


@dataclass
class _FingerPath:
    """One finger's contact path through the frames."""

    key: tuple[Any, ...]
    stepper: core.contact.skin_stepper.SkinStepper
    before: Any  # the stepper's state before the last frame


class _Between(NamedTuple):
    """Kept states of all paths after a frame, from which they can go on.

    Attributes:
        paths: by finger, its path and the state of its stepper. chunk: the last sample of the scene. first: see
            `_Live`.
    """

    paths: dict[str, tuple[_FingerPath, Any]]
    chunk: core.scene.tactile_scene.Chunk
    first: float


@dataclass
class _Live:
    generation: int = -1
    scene: int = 0
    frame: float = 0.0  # frame of `states`
    end: float = 0.0  # frame that the paths have reached
    first: float = 0.0  # frame at which the paths began
    since: float | None = None  # frame of the kept state from which the last frame was reached
    edits: int = -1
    signature: tuple[Any, ...] = ()
    paths: dict[str, _FingerPath] = field(default_factory=dict)
    posed: core.contact.posed_scene.PosedScene | None = None  # for all fingers
    states: tuple[SkinState, ...] = ()
    seen: core.recent.Recent[float, tuple[SkinState, ...]] = field(default_factory=lambda: core.recent.Recent(SEEN))
    kept: KeptStates[_Between] = field(default_factory=KeptStates)
    undone: list[_FingerPath] = field(default_factory=list)  # paths of a frame that was left unfinished: they go back
    failure: str = ""


_live = _Live()
_any: tuple[Any, bool] = ((), False)  # the key of the look-up, and whether there is any finger
_any_solved: tuple[Any, bool] = ((), False)


def any_finger(scene: bpy.types.Scene) -> bool:
    """Return whether there is any finger; looked up once after each change."""
    global _any
    if _any[0] != _look(scene):
        _any = _look(scene), any(obj.dermis.role == "FINGER" for obj in scene.objects)
    return _any[1]


def any_solved(scene: bpy.types.Scene) -> bool:
    """Return whether the skin of any finger is solved.

    Objects and presets are looked up once after each change.
    """
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
    """Return the skins at the current frame under their own contact.

    Hidden skins that a device follows are among them; skins as devices render them are not.
    """
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
    """Return whether a frame is shown as it was when it was visited.

    It is if it was visited since the last change and is not the next frame.
    """
    gap = scene_time.clock(scene, _live.end).seconds(frame)
    return _unchanged(scene) and frame in _live.seen and not goes_on(gap)


def revisited() -> bool:
    """Return whether the shown skins are of another frame than their paths."""
    return _live.frame != _live.end


def coarse() -> bool:
    """Return whether the skins that are shown were only solved coarsely."""
    return any(state.coarse for state in _live.states)


def failure() -> str:
    """Return why the last frame could not be solved, or ''."""
    return _live.failure


def on_frame(scene: bpy.types.Scene, sample: Any = None) -> Iterator[None]:
    """Solve the frame after a frame change in the window; yield after each finger."""
    if scene != bpy.context.scene or not any_solved(scene) or not scene.dermis.live_preview:
        return
    result = store.current(scene)
    if result is not None and result.bake.skins and store.state(scene) == "fresh":
        reset()
        return
    try:
        yield from _solved(bpy.context, sample)
    except Exception as error:  # a defect of the add-on must be seen, but not in the console at every frame
        text = f"{type(error).__name__}: {error}"
        if text != _live.failure:
            traceback.print_exc()
        _live.failure, _live.states = text, ()


def step(context: bpy.types.Context, sample: Any = None) -> tuple[SkinState, ...]:
    """Solve the scene as it is evaluated now, and return the skins.

    Args:
        sample: a sample of the scene by `scene_sweep.sample_now`; if None, it is taken here.
    """
    deque(_solved(context, sample), maxlen=0)
    return _live.states


def _solved(context: bpy.types.Context, sample: Any) -> Iterator[None]:
    """Solve the scene; yield after each finger.

    If the generator is not run to its end, the next call first restores the paths that it had changed.
    """
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
    """Return whether a skin is solved: it is shown, or a device follows it."""
    return shown or any(active_presets.follows_skin(preset) for preset in presets)


def _waits() -> bool:
    """Return whether a skin, or a table of it, is missing so far.

    The same frame is then solved again.
    """
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
    """Pose the scene, and choose the state from which the paths go on.

    Returns:
        The posed scene, and whether the last frame is solved once more.
    """
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
            _live.end = _live.since  # set now, in case the work is left before the frame is solved
            _live.paths, _live.first = {name: path for name, (path, _) in between.paths.items()}, between.first
            for path, state in between.paths.values():
                path.stepper.restore(state)
            assert posed is not None
            posed.take(between.chunk)  # the fingers move on from this sample
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
    """Return whether an object's surface may change from frame to frame.

    Its faces then carry the anchors of friction.
    """
    obj = bpy.data.objects.get(name.split(" @ ")[0])
    if obj is None or obj.type != "MESH":
        return True
    return bool(len(obj.modifiers)) or obj.data.shape_keys is not None


def _solve(
    f: int, finger: Any, posed: core.contact.posed_scene.PosedScene, frame: float, again: bool
) -> Generator[None, None, SkinState]:
    """Return the skin of a finger; slow work runs in a thread, see `loading`."""
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
    # A new path or a jump is solved in several steps, which together take longer than a view may wait.
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
    """Return the path of a finger; a new one is begun in a thread.

    Its stepper needs the skin's stiffness, which may take long.
    """
    p = finger.parameters
    # the path begins anew once the table of a smooth skin has been made
    waits, skin = skin_models.wants_pad(p), (model.key, model.tissue, model.material)
    key = (skin, p["depth_mode"], p["bone_stiffness"], p["force_limit"], p["contact"], waits)
    path = _live.paths.get(finger.name)
    if path is not None and path.key != key:  # the kept frames and states are of another skin
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
