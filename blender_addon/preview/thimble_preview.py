"""What thimbles do and make felt at the current frame: followed live, or played again from a bake.

Live, a thimble follows the skin that `skin_preview` solves, one search a frame: a step forward goes on from the frame
before, anything else starts from rest, and a change within a frame searches it anew. From a bake, the servo angles are
replayed on the skin, with friction's memory, so that what is shown is what the track does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np

from .. import changes
from .._core import Array, DermisError, core
from ..devices import skin_models, thimble_devices
from ..results import store
from . import followers, skin_preview
from .rows import Row, goes_on, row_of
from .skin_state import SkinState


@dataclass
class _Track:
    """One finger's thimble on its way through the frames."""

    key: tuple[Any, ...]
    follower: Any = None
    use: Any = None
    frame: float = 0.0
    target: Any = None  # the `SkinState` that was followed last
    before: Any = None  # what the last step began with
    found: Any = None  # the engine's `ThimbleFrame`
    error: str = ""


@dataclass
class _Played:
    """A baked track on a skin."""

    result: Any
    output: Any
    replay: Any
    shown: dict[float, Any] = field(default_factory=dict)


_tracks: dict[str, _Track] = {}
_played: dict[str, _Played] = {}
_made: dict[str, tuple[Any, Any, SkinState]] = {}


def rendered(scene: bpy.types.Scene, targets: Sequence[SkinState]) -> tuple[SkinState, ...]:
    """Return, for every touched skin that wears a thimble, the skin as the thimble renders it at this frame."""
    if not scene.dermis.thimble_view.split:
        return ()
    out = []
    for target, _, device, _ in followers.of(scene, targets, thimble_devices.KINDS):
        if target.touching:
            state = (_live_state if target.source == "live" else _baked_state)(scene, target, device)
            out += [state] if state is not None else []
    for gone in set(_made) - {t.finger for t in targets}:
        del _made[gone]
    return tuple(out)


def live_rows(scene: bpy.types.Scene) -> tuple[Row, ...]:
    """Return what the thimbles of fingers whose skin is shown do at the current frame, without a bake."""
    rows = []
    for target, _, device, spec in followers.of(scene, skin_preview.own(scene), thimble_devices.KINDS):
        if target.source != "live" or (track := follow(scene, target, device)).found is None:
            continue
        values, touching = values_of(track.found.angles, track.found.x), float(track.found.minimum is not None)
        signals = {"mismatch": track.found.mismatch}
        rows.append(row_of(target.finger, device.preset, spec, values, touching, signals=signals))
    return tuple(rows)


def values_of(angles: Array, x: Array) -> Mapping[str, float]:
    """Return channel values by name for servo angles and pitch, roll, distance."""
    values = {f"servo_{i + 1}": float(a) for i, a in enumerate(angles)}
    values.update(zip(("pitch", "roll", "distance"), map(float, x), strict=True))
    return values


def follow(scene: bpy.types.Scene, target: SkinState, device: Any) -> _Track:
    """Let a finger's thimble follow the skin of the current frame, once."""
    frame, fps = float(scene.frame_current_final), scene.render.fps / scene.render.fps_base
    settings = tuple(
        sorted((k, v) for k, v in thimble_devices.parameters_of(device).items() if k.startswith("thimble_"))
    )
    key = (device.preset, settings, target.model.key, repr(target.model.material), changes.generation())
    track = _tracks.get(target.finger)
    if track is None or track.key != key:
        track = _tracks[target.finger] = _Track(key)
    elif track.target is target:
        return track
    with skin_models.one_thread():
        try:
            if track.follower is None:
                track.use = thimble_devices.used(device, target.model)
                track.follower = core.matching.thimble.follower(track.use)
            _step(track, target, frame, fps)
        except DermisError as error:
            track.error, track.found = str(error), None
    track.target, track.frame = target, frame
    return track


def failure(finger: str) -> str:
    """Return why a finger's thimble does nothing, or ''."""
    track = _tracks.get(finger)
    return track.error if track is not None else ""


def reset() -> None:
    """Forget every way through the frames."""
    for kept in (_tracks, _played, _made):
        kept.clear()


def _step(track: _Track, target: SkinState, frame: float, fps: float) -> None:
    matching, gap = track.follower.matching, (frame - track.frame) / fps
    again = track.before is not None and frame == track.frame
    if again:
        matching.restore(track.before)
    elif track.before is None or not goes_on(gap):
        matching.reset()
        matching.change = None  # the first frame shows where it would be, not the way there
    else:
        matching.change = track.use.device.servo_speed * gap
    track.before = matching.save()
    track.found, track.error = track.follower.step(target.force), ""


def _live_state(scene: bpy.types.Scene, target: SkinState, device: Any) -> SkinState | None:
    track = follow(scene, target, device)
    if track.found is None:
        return None
    found = track.found
    known = _made.get(target.finger)
    if known is None or known[0] is not found:
        contact = track.follower.matching.contact
        state = _state(target, track.use.method, found.solution, contact, found.mismatch)
        known = _made[target.finger] = (found, None, state)
    return known[2]


def _baked_state(scene: bpy.types.Scene, target: SkinState, device: Any) -> SkinState | None:
    result = store.current(scene)
    if result is None:
        return None
    played = _replay(result, target, device)
    if played is None:
        return None
    frame = float(scene.frame_current_final)
    known = _made.get(target.finger)
    if known is not None and known[0] is played and known[1] == frame:
        return known[2]
    track = played.output.track
    t = float(np.clip((frame - result.first) / result.fps, track.times[0], track.times[-1]))
    sample = max(int(np.searchsorted(track.times, t + 1e-9)) - 1, 0)
    share = 0.0
    if sample + 1 < len(track.times):
        share = (t - track.times[sample]) / (track.times[sample + 1] - track.times[sample])
    x = played.replay.x
    ahead = x[sample] + share * (x[sample + 1] - x[sample]) if share > 1e-6 else None
    with skin_models.one_thread():
        solution = played.replay.solution(sample, ahead)
    mismatch = store.signal_at(result, played.output, "mismatch", frame) or 0.0
    state = _state(target, str(track.meta.get("method", "")), solution, played.replay.contact, mismatch)
    _made[target.finger] = (played, frame, state)
    return state


def _replay(result: Any, target: SkinState, device: Any) -> _Played | None:
    """Return a finger's baked track as something to play on its skin."""
    known = _played.get(target.finger)
    if known is not None and known.result is result:
        return known
    own = (o for o in result.bake.outputs if o.finger == target.finger)
    output = next((o for o in own if o.track.spec.kind == "thimble"), None)
    if output is None or not len(output.track.times):
        return None
    replay = core.matching.replay
    use = core.matching.thimble_use
    try:
        with skin_models.one_thread():
            fitted, friction = use.calibrated_mechanism(
                output.track.spec, target.model, thimble_devices.parameters_of(device)
            )
            poses = replay.configurations(output.track, fitted)
            made = replay.Replay(fitted, target.model, friction, poses)
    except DermisError:
        return None  # a track of other channels: the twin and its values are shown all the same
    _played[target.finger] = _Played(result, output, made)
    return _played[target.finger]


def _state(target: SkinState, method: str, solution: Any, contact: Any, mismatch: float) -> SkinState:
    """Return the skin under the disc in the place of the target."""
    force, cone = solution.spread(contact.count), core.contact.solver.cone
    total = force.sum(axis=0)
    normal = solution.pose.normal
    along = float(total @ normal)
    return replace(
        target,
        finger=f"{target.finger}: thimble",
        force=force,
        normal_force=along,
        tangential_force=float(np.linalg.norm(total - along * normal)),
        depth=max(-float(contact.gap(solution.pose).min()), 0.0),
        lift=0.0,
        sticking=int((solution.status == cone.STICK).sum()),
        slipping=int((solution.status == cone.SLIP).sum()),
        note=f"{method}, {100 * mismatch:.0f} % off",
        work="rendered",
        converged=bool(solution.converged),
        counters={},
    )
