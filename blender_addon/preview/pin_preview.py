"""Pin arrays at the current frame: forces, rendered skin, points of action.

Pins follow the skin that `skin_preview` solves, or that a bake has kept. A point of action is the point at which the
line of a pin meets the skin at rest. The engine computes these points once for a skin and a device.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes, loading
from .._core import Array, DermisError, core
from ..devices import active_presets, skin_models
from ..properties import skin_properties
from . import followers
from .rows import Row, by_channel, row_of
from .skin_state import SkinState


class Pins(NamedTuple):
    """Points of action of a device's pins, in the finger's frame.

    Attributes:
        points: points of action [m], shape (pins, 3); NaN for a pin that misses the skin.
        directions: directions of the pins' motion, shape (pins, 3).
        radius: radius of a pin [m].
        force_limit: largest force of each pin [N], shape (pins,).
        rows, columns: number of rows and columns of the array.
    """

    points: Array
    directions: Array
    radius: float
    force_limit: Array
    rows: int
    columns: int


_pins: core.recent.Recent[tuple[str, str], Pins] = core.recent.Recent(8)
_states: dict[str, tuple[SkinState, tuple[Any, ...], tuple[SkinState, Array]]] = {}
_ready: dict[str, tuple[Any, ...]] = {}  # by finger, the inputs for which its matrices have been made


def pins_of(obj: bpy.types.Object, device: str) -> Pins | None:
    """Return the pins of a device on a finger.

    None while the skin is being made, or if the preset cannot be read.

    Raises:
        DermisError: a skin or a layout that cannot be used.
    """
    skin, spec = skin_properties.parameters(obj.dermis.finger.skin), active_presets.spec_of(device, "pins")
    model = skin_models.of(skin)
    if model is None or spec is None:
        return None
    return _pins.make((model.key, spec.hash), lambda: _pins_on(model, spec))


def rendered(scene: bpy.types.Scene, targets: Sequence[SkinState]) -> tuple[SkinState, ...]:
    """Return the skins as pin arrays render them at this frame.

    There is one for every touched skin with a pin array. Fades and lead belong to the track and are left out, so that
    the result is the best that the method can do for the target.
    """
    followed = followers.wearers_of(scene, targets, "pins")
    states = tuple(_matched(target, device, spec)[0] for target, _, device, spec in followed if target.touching)
    for gone in set(_states) - {t.finger for t in targets}:
        del _states[gone]
    return states


def live_rows(scene: bpy.types.Scene, skins: Sequence[SkinState]) -> tuple[Row, ...]:
    """Return the rows of pin arrays that follow a live skin at this frame."""
    rows = []
    for target, _, device, spec in followers.wearers_of(scene, skins, "pins"):
        if target.source != "live":
            continue
        low = np.array([-np.inf if c.low is None else c.low for c in spec.channels])
        high = np.array([np.inf if c.high is None else c.high for c in spec.channels])
        forces = _matched(target, device, spec)[1] if target.touching else np.zeros(len(low))
        values = by_channel(spec, np.clip(forces, low, high))
        rows.append(row_of(target.finger, device.preset, spec, values, float(target.touching)))
    return tuple(rows)


def prepare(scene: bpy.types.Scene, target: SkinState) -> Iterator[None]:
    """Match a finger's pins with the skin of this frame; yield during the set-up."""
    for skin, _, device, spec in followers.wearers_of(scene, (target,), "pins"):
        model, nodes = skin.model, device.pin_nodes
        if skin.source == "live" and skin.touching and _ready.get(skin.finger) != (model, spec.hash, nodes):
            with suppress(DermisError):  # `_matched` gives the reason
                yield from loading.aside(lambda: _set_up(model, spec, nodes))  # noqa: B023 (done within the turn)
            _ready[skin.finger] = (model, spec.hash, nodes)
        if skin.source == "live" and skin.touching:
            _matched(skin, device, spec)


def reset() -> None:
    """Forget all results."""
    _pins.clear()
    _states.clear()
    _ready.clear()


def _pins_on(model: core.skin.model.SkinModel, spec: core.devices.spec.DeviceSpec) -> Pins:
    layout = core.devices.pin_array.layout(spec)
    met = core.devices.pin_array.on_pad(layout, model.mesh.nodes, model.mesh.surface, model.positions)
    points = np.where(met.hits[:, None], met.points, np.nan)
    rows, columns = int(spec.parameters["rows"]), int(spec.parameters["columns"])
    return Pins(points, layout.directions, float(spec.parameters["pin_radius"]), layout.force_limit, rows, columns)


def _set_up(model: core.skin.model.SkinModel, spec: core.devices.spec.DeviceSpec, nodes: Any) -> None:
    nothing = core.skin.stimulus.Stimulus(model, np.zeros((model.pad_count, 3)))
    with skin_models.one_thread():
        core.matching.pins.setup(model, spec, nodes)
        core.skin.observation.stress_error(nothing, nothing)  # makes the matrices that `stress_error` needs


def _matched(target: SkinState, device: Any, spec: Any) -> tuple[SkinState, Array]:
    """Return the skin as the pins render it, and the pins' forces [N].

    The result is kept while skin and settings stay the same.
    """
    key = (device.preset, device.pin_method, device.pin_nodes, device.pin_bounded, changes.lineage())
    kept = _states.get(target.finger)
    if kept is not None and kept[0] is target and kept[1] == key:
        return kept[2]
    forces: Array = np.zeros(len(spec.channels))
    pins, own, amounts = core.matching.pins, target, None
    with skin_models.one_thread():
        try:
            ready = pins.setup(own.model, spec, device.pin_nodes)
            solver = pins.make_solver(ready, spec, device.pin_method, None, bounded=device.pin_bounded)
            matched = solver.solve(own.force, own.amounts)
            forces, force = matched.forces, pins.rendered_force(ready, matched.forces)
            felt = core.skin.stimulus.Stimulus(own.model, own.force, None, own.amounts)
            made = core.skin.stimulus.Stimulus(own.model, force)
            if matched.look is not None:
                made, amounts = matched.look.felt(own.model, force), matched.look.amounts
            left = core.skin.observation.stress_error(felt, made)
            note = f"{1e3 * matched.displacement_error:.2f} mm off, whole stress {100 * left:.0f} %"
        except DermisError as error:
            force, note = np.zeros_like(target.force), str(error)
    total = force.sum(axis=0)
    state = replace(
        own,
        finger=f"{target.finger}: {device.pin_method} pins",
        force=force,
        normal_force=float(total[2]),
        note=note,
        points=None,  # pins act on nodes
        amounts=amounts,
        sticking=0,
        slipping=0,
        tangential_force=float(np.hypot(total[0], total[1])),
        work="rendered",
        counters={},
    )
    _states[target.finger] = (target, key, (state, forces))
    return state, forces
