"""Twins of devices, computed for the rows of a preview.

Slow results are kept while nothing changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from .. import identity
from .._core import Array, DermisError, core
from ..devices import active_presets, platform_devices, thimble_devices
from ..preview import pin_preview
from ..preview.rows import Row
from . import paint, pin_twin, platform_twin, tactor_twin, thimble_twin
from .parts import Line, Part, faint, heat
from .twin import Twin

HIDDEN = 0.45  # opacity of the parts of a twin that an object hides, as the touched object always does
_mechanisms: core.recent.Recent[tuple[Any, ...], core.devices.thimble.Thimble] = core.recent.Recent(8)
_loops: core.recent.Recent[str, list[Array]] = core.recent.Recent(8)
_platforms: core.recent.Recent[tuple[Any, ...], Twin] = core.recent.Recent(8)


def twin_of(scene: bpy.types.Scene, row: Row) -> Twin | None:
    """Return a row's twin; None if its kind has none, or if no pose is found."""
    return twins_of(scene, (row,))[0]


def twins_of(scene: bpy.types.Scene, rows: Sequence[Row]) -> tuple[Twin | None, ...]:
    """Return the twin of each row; the thimbles' parts are made together."""
    twins: list[Twin | None] = [None] * len(rows)
    thimbles: dict[int, tuple[core.devices.thimble.Thimble, float, thimble_twin.Joints]] = {}
    for i, row in enumerate(rows):
        obj = identity.named(scene, row.finger)
        if obj is None:
            continue
        try:
            match row.drawn:
                case "tactor":
                    twins[i] = tactor_twin.tactor(row, scene.dermis.twin_exaggeration)
                case "screen":
                    twins[i] = tactor_twin.screen(row)
                case "pins":
                    twins[i] = _pins(obj, row)
                case "thimble":
                    mounted = mounted_mechanism(obj, row.device)
                    if mounted is not None:
                        thimbles[i] = (*mounted, _joints(*mounted, row))
                case "platform":
                    twins[i] = _platform(obj, row)
        except DermisError:
            pass  # the bake reports the reason
    if thimbles:
        made = thimble_twin.all_parts([(t[0], t[2], thimble_twin.shares(rows[i])) for i, t in thimbles.items()])
        for (i, (device, reference, at)), part in zip(thimbles.items(), made, strict=True):
            loops = workspace_of(device, reference) if scene.dermis.thimble_view.workspace else None
            twins[i] = _of_one_part(part, at, lines=() if loops is None else _workspace(loops, at))
    return tuple(twins)


def mounted_mechanism(obj: bpy.types.Object, preset: str) -> tuple[core.devices.thimble.Thimble, float] | None:
    """Return a thimble as mounted on a finger, and its reference distance [m].

    None while they are unknown.

    Raises:
        DermisError: a preset or settings that cannot be used.
    """
    spec = active_presets.spec_of(preset, "thimble")
    settings = next((d for d in obj.dermis.finger.devices if d.preset == preset), None)
    if spec is None:
        return None
    mark = active_presets.hash_of(preset)
    if settings is None or not settings.thimble_calibrated:
        device = _mechanisms.make((mark,), lambda: core.devices.thimble.mechanism(spec))
    else:
        values, model = thimble_devices.parameters_of(settings), platform_devices.model_of(obj)
        if model is None:
            return None
        model = thimble_devices.pressed(obj, model)
        felt = tuple(values[f"thimble_felt_{i}"] for i in (1, 2, 3))
        key = (mark, model.key, model.tissue, core.surrogate.press_points.pressed_on(model), felt)
        device = _mechanisms.make(key, lambda: core.matching.thimble_use.calibrated_mechanism(spec, model, values)[0])
    return device, core.devices.thimble.reference_distance(spec, device)


def workspace_of(device: core.devices.thimble.Thimble, reference: float) -> list[Array]:
    """Return the loops of a mechanism's workspace, computed once.

    The list is empty if the level platform cannot reach the reference distance.
    """

    def loops() -> list[Array]:
        try:
            return thimble_twin.loops(device, reference)
        except DermisError:
            return []

    return _loops.make(core.surrogate.store.device_key(device), loops)


def forget() -> None:
    """Forget all kept results."""
    for kept in (_mechanisms, _loops, _platforms):
        kept.clear()


def _of_one_part(part: Part, state: Any, *, covers: bool = True, lines: tuple[Line, ...] = ()) -> Twin:
    return Twin(part, faint(part, HIDDEN), covers, lines, state)


def _pins(obj: bpy.types.Object, row: Row) -> Twin | None:
    pins = pin_preview.pins_of(obj, row.device)
    if pins is None or len(pins.points) != len(row.values):
        return None
    return _of_one_part(pin_twin.discs(pins, row.numbers), pins, covers=False)


def _joints(device: core.devices.thimble.Thimble, reference: float, row: Row) -> thimble_twin.Joints:
    start = np.array([row.values.get("pitch", 0.0), row.values.get("roll", 0.0), row.values.get("distance", reference)])
    return thimble_twin.joints(device, thimble_twin.servo_angles(row), start)


def _workspace(loops: list[Array], joints: thimble_twin.Joints) -> tuple[Line, ...]:
    colours = [heat(i / max(len(loops) - 1, 1)) for i in range(len(loops))]
    around = (Line(loop, (*colour[:3], 0.75), 1.3) for loop, colour in zip(loops, colours, strict=True))
    return (*around, Line(thimble_twin.pointer(joints.pose), paint.INK, 2.0))


def _platform(obj: bpy.types.Object, row: Row) -> Twin | None:
    spec = active_presets.spec_of(row.device, "platform")
    if spec is None or len(row.values) != len(spec.channels):
        return None
    touching = row.contact is None or row.contact > 0.5
    skin = platform_devices.model_of(obj) if touching else None

    def build() -> Twin:
        state = platform_twin.state(spec, row.numbers, skin, touching)
        return _of_one_part(platform_twin.parts(state), state)

    key = (
        spec.hash,
        tuple(row.values.values()),
        touching,
        None if skin is None else (skin.key, skin.tissue, skin.material),
    )
    return _platforms.make(key, build)
