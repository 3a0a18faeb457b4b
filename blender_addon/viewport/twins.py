"""Where the parts of each device's twin are, worked out for a row of the preview and kept while nothing changes."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np

from .._core import Array, DermisError, core
from ..devices import pin_devices, platform_devices, thimble_devices
from ..preview import pin_preview
from ..preview.rows import Row
from . import platform_twin, thimble_twin

MOST = 8
_mechanisms: dict[tuple[Any, ...], core.devices.thimble.Thimble] = {}
_loops: dict[str, list[Array]] = {}
_platforms: dict[str, tuple[tuple[Any, ...], platform_twin.State]] = {}


class ThimbleTwin(NamedTuple):
    """A thimble as it sits on its finger.

    Attributes:
        device: the mechanism. joints: where they are. loops: of the workspace, where that is shown.
    """

    device: core.devices.thimble.Thimble
    joints: thimble_twin.Joints
    loops: list[Array]


Twin = pin_preview.Pins | ThimbleTwin | platform_twin.State


def twin_of(scene: bpy.types.Scene, row: Row) -> Twin | None:
    """Return where a row's parts are; None for other devices, and where a preset or values give no place."""
    obj = scene.objects.get(row.finger)
    if obj is None:
        return None
    try:
        if row.kind in pin_devices.KINDS:
            return pin_preview.pins_of(obj, row.device)
        if row.kind in thimble_devices.KINDS:
            return _thimble(obj, row, workspace=scene.dermis.thimble_view.workspace)
        if row.kind in platform_devices.kinds():
            return _platform(obj, row)
    except DermisError:
        pass  # the bake says why
    return None


def mechanism_of(obj: bpy.types.Object, preset: str) -> tuple[core.devices.thimble.Thimble, float] | None:
    """Return a thimble as it sits on a finger, and its reference distance [m]; None while it is unknown.

    Raises:
        DermisError: a preset or settings that cannot be used.
    """
    spec = thimble_devices.spec_of(preset)
    settings = next((d for d in obj.dermis.finger.devices if d.preset == preset), None)
    if spec is None:
        return None
    key: tuple[Any, ...] = (spec.hash,)
    if settings is None or not settings.thimble_calibrated:
        device = _mechanisms.get(key) or core.devices.thimble.mechanism(spec)
    else:
        values, model = thimble_devices.parameters_of(settings), platform_devices.model_of(obj)
        if model is None:
            return None
        key = (spec.hash, model.key, tuple(values[f"thimble_felt_{i}"] for i in (1, 2, 3)))
        device = _mechanisms.get(key) or core.matching.thimble_use.calibrated_mechanism(spec, model, values)[0]
    _keep(_mechanisms, key, device)
    return device, core.devices.thimble.reference_distance(spec, device)


def workspace_of(device: core.devices.thimble.Thimble, reference: float) -> list[Array]:
    """Return the loops of a mechanism's workspace, worked out once."""
    key = core.surrogate.store.device_key(device)
    if key not in _loops:
        try:
            _keep(_loops, key, thimble_twin.loops(device, reference))
        except DermisError:
            _keep(_loops, key, [])
    return _loops[key]


def forget() -> None:
    """Forget everything that was worked out."""
    for kept in (_mechanisms, _loops, _platforms):
        kept.clear()


def _thimble(obj: bpy.types.Object, row: Row, *, workspace: bool) -> ThimbleTwin | None:
    found = mechanism_of(obj, row.device)
    if found is None or "servo_1" not in row.values:
        return None
    device, reference = found
    start = np.array([row.values.get("pitch", 0.0), row.values.get("roll", 0.0), row.values.get("distance", reference)])
    joints = thimble_twin.joints(device, thimble_twin.servo_angles(row), start)
    return ThimbleTwin(device, joints, workspace_of(device, reference) if workspace else [])


def _platform(obj: bpy.types.Object, row: Row) -> platform_twin.State | None:
    spec = platform_devices.spec_of(row.device)
    if spec is None or len(row.values) != len(spec.channels):
        return None
    touching = row.contact is None or row.contact > 0.5
    skin = platform_devices.model_of(obj) if touching else None
    key = (spec.hash, tuple(row.values.values()), touching, None if skin is None else (skin.key, skin.material))
    known = _platforms.get(row.finger)
    if known is None or known[0] != key:
        state = platform_twin.state(spec, np.array(list(row.values.values())), skin, touching)
        known = _platforms[row.finger] = (key, state)
    return known[1]


def _keep(kept: dict[Any, Any], key: Any, value: Any) -> None:
    kept.pop(key, None)  # the one used last goes to the end
    while len(kept) >= MOST:
        kept.pop(next(iter(kept)))
    kept[key] = value
