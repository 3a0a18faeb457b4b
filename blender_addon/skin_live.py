"""What every skin feels at the current frame.

Where a fresh bake covers the frame, its forces are read: they are exact along the path. Otherwise each finger has a
contact path of its own through the frames visited: a step forward continues its history, anything else (a jump, a step
back, undo) starts from rest, and the view says so. A change within a frame solves that frame anew from the one before.
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from . import handlers, results, skin_models
from .preferences import core_module

Array = NDArray[np.float64]

STEP_SECONDS = 0.25  # playback may skip frames; a longer step forward is a jump
SETTLE = 0.05  # [s] after a change of the scene until the frame is solved anew


@dataclass(frozen=True, eq=False)
class SkinState:
    """One finger's skin at one frame.

    Attributes:
        finger: the object's name.
        model: the skin, or None while it is being made, or where it cannot be made (`note` says why).
        force: on the pad nodes in the finger's frame [N], shape (m, 3).
        normal_force, tangential_force: totals [N]. depth, lift: [m], see the engine's `SkinTouch`.
        sticking, slipping: number of nodes.
        source: 'bake', 'live', 'stale', 'earlier' or 'none'. note: what a reader should know about it.
        work: what the contact solver did: 'solved', 'unchanged', 'same', 'idle' or 'baked'.
        converged: whether the frame passed the solver's own check.
        counters: what was solved and what was skipped, by name.
    """

    finger: str
    model: Any
    force: Array
    normal_force: float = 0.0
    tangential_force: float = 0.0
    depth: float = 0.0
    lift: float = 0.0
    sticking: int = 0
    slipping: int = 0
    source: str = "none"
    note: str = ""
    work: str = "idle"
    converged: bool = True
    counters: Mapping[str, int] = field(default_factory=dict)

    @property
    def touching(self) -> bool:
        """Whether any node carries force."""
        return self.normal_force > 0.0


class _Shape:
    """The surface of a body, kept while its mesh and its scale stay."""

    def __init__(self, deforms: bool) -> None:
        self.deforms = deforms
        self._mesh: Any = None
        self._stretch = np.eye(3)
        self._surface: Any = None
        self._pose: Any = None
        self._placed: Any = None
        self.low, self.high = np.zeros(3), np.zeros(3)

    def see(self, mesh: Any) -> None:
        """Take the mesh of this frame."""
        if mesh is not self._mesh:
            self._mesh, self._surface, self._pose = mesh, None, None
            if len(mesh.vertices):
                self.low, self.high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)

    def placed(self, pose: Array) -> tuple[Any, Array]:
        """Return the surface and its rotation to the world for an object's matrix; most objects stand still."""
        if self._pose is None or not np.array_equal(self._pose, pose):
            rotation = core_module("motion").rotations(pose[None, :3, :3])[0]
            self._placed = self.surface(rotation.T @ pose[:3, :3]), rotation
            self._pose = pose.copy()
        return self._placed

    def surface(self, stretch: Array) -> Any:
        """Return the surface after scale and shear."""
        if self._surface is None or np.abs(stretch - self._stretch).max() > 1e-5 * np.abs(self._stretch).max():
            plain = np.abs(stretch - np.eye(3)).max() <= 1e-5
            surface_of = core_module("contact.gap").surface_of
            self._surface = surface_of(self._mesh) if plain else surface_of(self._mesh, stretch)
            self._stretch = np.eye(3) if plain else stretch
        return self._surface


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
    shapes: dict[str, _Shape] = field(default_factory=dict)
    states: tuple[SkinState, ...] = ()
    failure: str = ""
    middles: Array = field(default_factory=lambda: np.zeros((0, 3)))  # of the bodies' boxes in the world, this frame
    halves: Array = field(default_factory=lambda: np.zeros((0, 3)))


_live = _Live()
_shown: tuple[Any, ...] = ()
_baked: tuple[Any, tuple[SkinState, ...]] = ((), ())


def any_shown(scene: bpy.types.Scene) -> bool:
    """Tell whether any finger shows its skin; looked up once after each change."""
    global _shown
    key = (scene.session_uid, handlers.edits(), len(scene.objects))
    if not _shown or _shown[0] != key:
        _shown = (key, any(o.dermis.role == "FINGER" and o.dermis.finger.skin.shown for o in scene.objects))
    return bool(_shown[1])


def states(scene: bpy.types.Scene) -> tuple[SkinState, ...]:
    """Return the skins to show at the current frame, and as pins and thimbles render them; empty if unknown."""
    from . import pin_view, thimble_live

    targets = own(scene)
    return (*targets, *pin_view.rendered(scene, targets), *thimble_live.rendered(scene, targets)) if targets else ()


def own(scene: bpy.types.Scene) -> tuple[SkinState, ...]:
    """Return the skins at the current frame as they are touched."""
    if not any_shown(scene):
        return ()
    frame, state = float(scene.frame_current_final), results.state(scene)
    result = results.current(scene)
    baked = result is not None and bool(result.bake.skins)
    if not (baked and state == "fresh") and scene.dermis.live_preview and _holds(scene, frame):
        return _live.states
    if result is None or not baked:
        return ()
    return _from_bake(scene, result, frame, state)


def failure() -> str:
    """Return why the last frame could not be solved, or ''."""
    return _live.failure


def on_frame(scene: bpy.types.Scene, sample: Any = None) -> None:
    """Take in the new frame; called after every frame change in the window."""
    if scene != bpy.context.scene or not any_shown(scene) or not scene.dermis.live_preview:
        return
    result = results.current(scene)
    if result is not None and result.bake.skins and results.state(scene) == "fresh":
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
        sample: the scene as `sampling.sample_now` gives it, where somebody has just taken it.
    """
    from . import sampling

    errors = core_module("errors")
    scene = context.scene
    frame = float(scene.frame_current_final)
    if frame == _live.frame and handlers.edits() == _live.edits and _holds(scene, frame) and not _pending():
        return _live.states
    try:
        if sample is None:
            if _live.edits != handlers.edits():
                sampling.forget()
            sample = sampling.sample_now(scene, context.evaluated_depsgraph_get())
        again = _prepare(scene, sample, frame)
        with skin_models.one_thread():
            _live.states = tuple(
                _solve(sample, f, finger, frame, again)
                for f, finger in enumerate(sample.fingers) if finger.parameters.get("skin_shown")
            )  # fmt: skip
        _live.failure = ""
    except errors.DermisError as error:
        _live.states, _live.failure = (), str(error)
        _live.tracks.clear()
    _live.frame, _live.edits = frame, handlers.edits()
    return _live.states


def reset() -> None:
    """Forget the history: the next frame is solved from rest."""
    _live.tracks.clear()
    _live.shapes.clear()
    _live.states, _live.failure, _live.generation = (), "", -1


def refresh() -> float | None:
    """Solve the current frame anew, because something changed that no frame change told; a timer may call it."""
    scene = bpy.context.scene
    if scene is not None and any_shown(scene) and not bpy.app.background:
        on_frame(scene)
        redraw()
    return None


def request() -> None:
    """Ask for a refresh once the scene has settled; many requests give one."""
    if not bpy.app.background and not bpy.app.timers.is_registered(refresh):
        bpy.app.timers.register(refresh, first_interval=SETTLE)


def redraw() -> None:
    """Draw the views again."""
    if not bpy.app.background:
        from . import overlay

        overlay.redraw()


def _pending() -> bool:
    return any(state.model is None for state in _live.states)


def _holds(scene: bpy.types.Scene, frame: float) -> bool:
    return (_live.generation == handlers.generation() and _live.scene == scene.session_uid and _live.frame == frame
            and bool(_live.states))  # fmt: skip


def _prepare(scene: bpy.types.Scene, sample: Any, frame: float) -> bool:
    """Decide whether the history goes on; return whether this is the frame of before, once more."""
    names = tuple(b.name for b in sample.bodies)
    cast = (tuple(f.name for f in sample.fingers), names, sample.fps)
    gap = (frame - _live.frame) / float(sample.fps)
    same = _live.generation == handlers.generation() and _live.scene == scene.session_uid and _live.cast == cast
    again = same and frame == _live.frame and bool(_live.tracks)
    if not again and not (same and 1e-9 < gap <= STEP_SECONDS):
        _live.tracks.clear()
        _live.first = frame
    if _live.cast != cast or not same:
        _live.shapes = {name: _Shape(_may_deform(name)) for name in names}
    _live.generation, _live.scene, _live.cast = handlers.generation(), scene.session_uid, cast
    for b, name in enumerate(names):
        _live.shapes[name].see(sample.chunks[0].surfaces[b][0])
    shapes = list(_live.shapes.values())
    if shapes:
        lows, highs = np.array([s.low for s in shapes]), np.array([s.high for s in shapes])
        linear = sample.chunks[0].bodies[:, 0, :3, :3]
        _live.middles = np.einsum("bij,bj->bi", linear, (lows + highs) / 2) + sample.chunks[0].bodies[:, 0, :3, 3]
        _live.halves = np.einsum("bij,bj->bi", np.abs(linear), (highs - lows) / 2)
    return again


def _may_deform(name: str) -> bool:
    """Tell whether an object's surface may be another at another frame: friction is then carried by its faces."""
    obj = bpy.data.objects.get(name.split(" @ ")[0])
    if obj is None or obj.type != "MESH":
        return True
    return bool(len(obj.modifiers)) or obj.data.shape_keys is not None


def _solve(sample: Any, f: int, finger: Any, frame: float, again: bool) -> SkinState:
    where = f"finger '{finger.name}'"
    parameters = finger.parameters
    level = str(parameters["skin_level"])
    try:
        model = skin_models.get(parameters["skin"], level, where=f"{where}, skin")
    except core_module("errors").DermisError as error:  # the other fingers go on
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
        return SkinState(finger.name, model, np.zeros((model.pad_count, 3)), source="live", note=note,
                         counters=_counters(track))  # fmt: skip
    bodies = [_body(sample, b, turn, place) for b in track.order]
    yielded = track.path.step(bodies, frame)
    solution = yielded.step.solution
    cone = core_module("contact.cone")
    normal = solution.normal_force
    across = (solution.force - normal[:, None] * solution.normals).sum(axis=0)
    return SkinState(
        finger.name, model, solution.force, float(normal.sum()), float(np.linalg.norm(across)),
        yielded.depth if solution.force.any() else 0.0, yielded.lift, int((solution.status == cone.STICK).sum()),
        int((solution.status == cone.SLIP).sum()), "live", note, yielded.step.work, bool(solution.converged),
        _counters(track),
    )  # fmt: skip


def _track(finger: Any, model: Any, where: str) -> _Track:
    p = finger.parameters
    key = (id(model), p["depth_mode"], p["bone_stiffness"], p["force_limit"])
    track = _live.tracks.get(finger.name)
    if track is None or track.key != key:
        path = core_module("contact.yielding").Yielding.of(model, p, where)
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
    return core_module("contact.bodies").ContactBody(
        surface, turn.T @ rotation, turn.T @ (pose[:3, 3] - place),
        friction=_value(sample, b, "friction", 0.6), softness=1.0 / stiffness if stiffness > 0 else 0.0,
        deforms=shape.deforms,
    )  # fmt: skip


def _value(sample: Any, b: int, name: str, default: float) -> float:
    channel = sample.chunks[0].channels.get(f"body/{b}/{name}")
    return float(sample.bodies[b].parameters.get(name, default) if channel is None else channel[0])


def _counters(track: _Track) -> dict[str, int]:
    solver = track.path.solver
    c = solver.counters
    return {
        "solved": c["solved"], "skipped, forces still hold": c["unchanged"], "skipped, same pose": c["same"],
        "skipped, nothing near": c["idle"], "skipped, objects far away": track.far,
        "solved by the fallback": c["fallback"], "not converged": c["unconverged"],
    }  # fmt: skip


def _from_bake(scene: bpy.types.Scene, result: Any, frame: float, state: str) -> tuple[SkinState, ...]:
    global _baked
    memo = (id(result), frame, state, handlers.edits())
    if _baked[0] != memo:
        _baked = (memo, tuple(
            _baked_state(name, touch, frame, state) for name, touch in result.bake.skins.items()
            if name in scene.objects and scene.objects[name].dermis.finger.skin.shown
        ))  # fmt: skip
    return _baked[1]


def _baked_state(name: str, touch: Any, frame: float, state: str) -> SkinState:
    notes = {"fresh": "from the bake", "stale": "from a bake that is out of date",
             "earlier": "from an earlier session's bake"}  # fmt: skip
    source = "bake" if state == "fresh" else state
    counters = {k.removeprefix("skin_").replace("_", " "): int(v) for k, v in touch.skipped.items()}
    frames = touch.frames
    if not len(frames) or frame < frames[0] - 0.5 or frame > frames[-1] + 0.5:
        return SkinState(name, touch.model, np.zeros((touch.model.pad_count, 3)), source=source,
                         note="outside the baked range", counters=counters)  # fmt: skip
    after = min(int(np.searchsorted(frames, frame)), len(frames) - 1)
    i = after - 1 if after > 0 and frame - frames[after - 1] < frames[after] - frame else after
    unconverged = any(f.code == "not-converged" for f in touch.findings)
    return SkinState(
        name, touch.model, touch.force_at(i), float(touch.normal_force[i]), float(touch.tangential_force[i]),
        float(touch.depth[i]), float(touch.lift[i]), int(touch.sticking[i]), int(touch.slipping[i]), source,
        notes[state], "baked", not unconverged, counters,
    )  # fmt: skip


def register() -> None:
    """Nothing to register: `handlers` calls this module."""


def unregister() -> None:
    """Forget everything, and end what still runs."""
    reset()
    skin_models.forget()
    if bpy.app.timers.is_registered(refresh):
        bpy.app.timers.unregister(refresh)
