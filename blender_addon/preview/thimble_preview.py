"""Motion of thimbles and the skin that they render, live or from a bake.

Devices of six legs whose pose is searched are treated in the same way.

Live, a thimble follows the skin that `skin_preview` solves, with one search a frame. The search starts from the frame
before, from a kept state, or from rest. A change within a frame repeats that frame's search from the same start. From a
bake, the servo angles are replayed on the skin, with the history of friction, so that the view shows the effect of the
track.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes, loading, scene_time
from .._core import DermisError, core
from ..devices import active_presets, skin_models, thimble_devices
from ..results import store
from . import followers, moment, skin_preview
from .kept_states import KeptStates
from .rows import Row, by_channel, goes_on, row_of
from .skin_state import SkinState


@dataclass
class _FingerPath:
    """State of one finger's thimble, carried from frame to frame."""

    key: tuple[Any, ...]
    follower: Any = None
    use: Any = None
    frame: float = 0.0
    target: Any = None  # the `SkinState` that was followed last
    before: Any = None  # the follower's state before the last step
    rendered: Any = None  # the engine's `ThimbleFrame`
    # The preset, `changes.edits()` and `changes.lineage()` at the last query. While they are the same, so is `key`.
    asked: tuple[Any, ...] = ()
    refused: tuple[Any, ...] = ()  # value of `asked` when the preparation failed; no new try until `asked` changes
    waits_at: Any = None  # the `SkinState` at which the thimble waited for its tables or could not be prepared
    edits: int = -1  # `changes.edits()` for which `seen` and `kept` hold
    seen: core.recent.Recent[float, Any] = field(default_factory=lambda: core.recent.Recent(skin_preview.SEEN))
    kept: KeptStates[Any] = field(default_factory=KeptStates)
    error: str = ""
    undone: bool = False  # the last step was not finished: the next one starts from `before`


class _Played(NamedTuple):
    """A baked track on a skin."""

    result: Any
    output: Any
    replay: Any


_settings: core.recent.Recent[tuple[str, str, int], tuple[Any, ...]] = core.recent.Recent(16)
_paths: dict[str, _FingerPath] = {}
_played: dict[str, _Played] = {}
_states: dict[str, tuple[Any, Any, SkinState]] = {}


def rendered(scene: bpy.types.Scene, targets: Sequence[SkinState]) -> tuple[SkinState, ...]:
    """Return the skins as thimbles render them at this frame.

    There is one for every touched skin that wears a thimble.
    """
    if not scene.dermis.thimble_view.split:
        return ()
    out = []
    for target, obj, device, spec in followers.searched_of(scene, targets):
        if target.touching:
            live = target.source == "live"
            state = (
                _live_state(scene, target, obj, device, spec.kind)
                if live
                else _baked_state(scene, target, device, spec.kind)
            )
            out += [state] if state is not None else []
    for gone in set(_states) - {t.finger for t in targets}:
        del _states[gone]
    return tuple(out)


def live_rows(scene: bpy.types.Scene, skins: Sequence[SkinState]) -> tuple[Row, ...]:
    """Return the rows of thimbles that follow a live skin at this frame."""
    rows = []
    for target, obj, device, spec in followers.searched_of(scene, skins):
        if target.source != "live":
            continue
        path = follow(scene, target, obj, device)
        if path.rendered is None:
            rows += [row_of(target.finger, device.preset, spec, {}, None, note=path.error)] if path.error else []
            continue
        if spec.kind == "thimble":
            values = core.devices.thimble.channel_values(path.rendered.angles, path.rendered.x)
            plain = {name: float(value) for name, value in values.items()}
        else:
            plain = by_channel(spec, path.rendered.angles)
        touching, errors = float(path.rendered.minimum is not None), path.rendered
        signals = {"mismatch": errors.mismatch, "stress_error": errors.stress_error}
        rows.append(row_of(target.finger, device.preset, spec, plain, touching, signals=signals))
    return tuple(rows)


def prepare(scene: bpy.types.Scene, target: SkinState) -> Iterator[None]:
    """Let a finger's thimble follow the skin of this frame; yield meanwhile."""
    for skin, obj, device, _ in followers.searched_of(scene, (target,)):
        if skin.source == "live":
            yield from _followed(scene, skin, obj, device)


def follow(scene: bpy.types.Scene, target: SkinState, obj: bpy.types.Object, device: Any) -> _FingerPath:
    """Let a finger's thimble follow the skin of the current frame, once.

    `prepare` may have found that the thimble has to wait or cannot be prepared. Then nothing is tried again for this
    skin, so that the rows and the rendered skins of one moment agree.
    """
    path = _paths.get(target.finger)
    if path is None or path.waits_at is not target or path.asked != _asked(device):
        path = core.steps.drain(_followed(scene, target, obj, device))
    return path


def _followed(
    scene: bpy.types.Scene, target: SkinState, obj: bpy.types.Object, device: Any
) -> Generator[None, None, _FingerPath]:
    path, asked = _paths.get(target.finger), _asked(device)
    if path is not None and path.target is target and path.asked == asked:
        return path
    frame, clock = moment.frame_of(scene), scene_time.clock(scene, 0.0)
    settings = _settings.make((target.finger, device.preset, changes.edits()), lambda: _settings_of(device))
    model = thimble_devices.pressed(obj, target.model)
    on = core.surrogate.press_points.pressed_on(model)
    key = (device.preset, settings, model.key, model.tissue, on, model.material, changes.lineage())
    if path is None or path.key != key:
        path = _paths[target.finger] = _FingerPath(key)
    path.asked = asked
    if path.target is target:
        return path
    if path.edits != changes.edits():
        path.edits = changes.edits()
        path.seen.clear()
        path.kept.clear()
    if skin_preview.revisited() and frame in path.seen:
        path.target, path.rendered, path.error = target, path.seen[frame], ""
        return path
    if path.follower is None:
        # A new try would start the preparation again, and its progress would hide the reason of the failure.
        if path.refused == asked:
            return path
        try:
            path.error = thimble_devices.waits(obj, device, model)
        except DermisError as error:
            path.error, path.refused = str(error), asked
        path.waits_at = target if path.error else None
        if path.error:
            path.rendered = None
            return path
    try:
        if path.follower is None:
            path.use = thimble_devices.prepared(device, model)
            path.follower = core.matching.thimble.follower(path.use)
        if path.undone:
            path.follower.matching.restore(path.before)
        path.undone = True
        if goes_on(clock.duration(frame - path.frame)):
            _step(path, target, frame, clock)
        else:  # a step after a jump in time runs in a thread
            yield from loading.aside(lambda: _step(path, target, frame, clock))
        path.undone = False
        path.seen[frame] = path.rendered
        path.kept.keep(frame, path.follower.matching.save)
    except DermisError as error:
        path.error, path.rendered = str(error), None
    path.target, path.frame = target, frame
    return path


def _asked(device: Any) -> tuple[Any, ...]:
    return device.preset, changes.edits(), changes.lineage()


def failure(finger: str) -> str:
    """Return why a finger's thimble does nothing, '' if it works."""
    path = _paths.get(finger)
    return path.error if path is not None else ""


def reset() -> None:
    """Forget the states of all thimbles, live and replayed."""
    for kept in (_paths, _played, _states, _settings):
        kept.clear()


def _settings_of(device: Any) -> tuple[Any, ...]:
    return tuple(sorted(thimble_devices.use_of(device).items()))


def _step(path: _FingerPath, target: SkinState, frame: float, clock: scene_time.Clock) -> None:
    matching, gap = path.follower.matching, clock.duration(frame - path.frame)
    again = path.before is not None and frame == path.frame
    if again:
        matching.restore(path.before)
    else:
        near = None if goes_on(gap) else path.kept.nearest(frame, clock)
        if near is not None:
            matching.restore(near[1])
            gap = clock.duration(frame - near[0])
        if path.before is not None and goes_on(gap):
            matching.change = path.use.device.servo_speed * gap
        else:
            matching.reset()
            matching.change = None  # no limit of speed: the first frame shows the pose, not the motion to it
    path.before = matching.save()
    with skin_models.one_thread():
        path.rendered, path.error = path.follower.step(target.force, target.amounts), ""


def _live_state(
    scene: bpy.types.Scene, target: SkinState, obj: bpy.types.Object, device: Any, kind: str
) -> SkinState | None:
    path = follow(scene, target, obj, device)
    rendered = path.rendered
    if rendered is None:
        return None
    kept = _states.get(target.finger)
    if kept is None or kept[0] is not rendered:
        contact = path.follower.matching.contact
        how = rendered.solution, contact, rendered.mismatch, rendered.stress_error
        state = _state(target, kind, *how)
        kept = _states[target.finger] = (rendered, None, state)
    return kept[2]


def _baked_state(scene: bpy.types.Scene, target: SkinState, device: Any, kind: str) -> SkinState | None:
    result = store.current(scene)
    if result is None:
        return None
    played = _replay(result, target, device)
    if played is None:
        return None
    frame = moment.frame_of(scene)
    kept = _states.get(target.finger)
    if kept is not None and kept[0] is played and kept[1] == frame:
        return kept[2]
    track = played.output.track
    t = float(np.clip(result.clock.seconds(frame), track.times[0], track.times[-1]))
    sample = max(int(np.searchsorted(track.times, t + 1e-9)) - 1, 0)
    share = 0.0
    if sample + 1 < len(track.times):
        share = (t - track.times[sample]) / (track.times[sample + 1] - track.times[sample])
    x = played.replay.x
    ahead = x[sample] + share * (x[sample + 1] - x[sample]) if share > 1e-6 else None
    with skin_models.one_thread():
        solution = played.replay.solution(sample, ahead)
    mismatch = store.signal_at(result, played.output, "mismatch", frame) or 0.0
    whole = store.signal_at(result, played.output, "stress_error", frame)
    state = _state(target, kind, solution, played.replay.contact, mismatch, whole)
    _states[target.finger] = (played, frame, state)
    return state


def _replay(result: Any, target: SkinState, device: Any) -> _Played | None:
    """Return a finger's baked track with a replay on its skin.

    The result is None if the finger has no such track.
    """
    played = _played.get(target.finger)
    if played is not None and played.result is result:
        return played
    own = (o for o in result.bake.outputs if o.finger == target.finger)
    spec = active_presets.searched(device)
    output = next((o for o in own if spec is not None and o.track.spec.kind == spec.kind), None)
    if output is None or not len(output.track.times):
        return None
    replay, thimble_use = core.matching.replay, core.matching.thimble_use
    try:
        with skin_models.one_thread():
            model = result.bake.skins[target.finger].pressed
            calibrated, friction = thimble_use.disc_device(
                output.track.spec, model, thimble_devices.parameters_of(device)
            )
            x = replay.configurations(output.track, calibrated)
            track_on_skin = replay.Replay(calibrated, model, friction, x)
    except DermisError:
        return None  # a track of other channels; the twin and its values are shown all the same
    _played[target.finger] = _Played(result, output, track_on_skin)
    return _played[target.finger]


def _state(
    target: SkinState, kind: str, solution: Any, contact: Any, mismatch: float, whole: float | None
) -> SkinState:
    """Return the target's skin as the disc of a device deforms it.

    The label of the state ends with the form in which Blender draws devices of `kind`.
    """
    force, cone = contact.nodal(solution), core.contact.solver.cone
    total = force.sum(axis=0)
    normal = solution.pose.normal
    along = float(total @ normal)
    on_points = contact.points.on == "points"
    spread = solution.spread(contact.count)
    return replace(
        target,
        finger=f"{target.finger}: {core.devices.kinds.KINDS[kind].drawn}",
        force=force,
        normal_force=along,
        tangential_force=float(np.linalg.norm(total - along * normal)),
        depth=max(-float(contact.gap(solution.pose).min()), 0.0),
        lift=0.0,
        sticking=int((solution.status == cone.STICK).sum()),
        slipping=int((solution.status == cone.SLIP).sum()),
        note=f"{100 * mismatch:.0f} % off" + ("" if whole is None else f", whole stress {100 * whole:.0f} %"),
        work="rendered",
        converged=bool(solution.converged and solution.settled),
        counters={},
        points=core.surrogate.press_points.point_forces(target.model, spread) if on_points else None,
        amounts=solution.amounts,
    )
