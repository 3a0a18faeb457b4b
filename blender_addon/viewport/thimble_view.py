"""Thimbles in the view: the twin around the finger, where it can go, and its servos as gauges in the corner."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import DermisError, core
from ..devices import skin_models, thimble_devices
from . import drawing, paint, tactor_twin, thimble_twin
from .drawing import finger_matrix

if TYPE_CHECKING:
    from ..preview import device_preview

Array = NDArray[np.float64]

MOST = 8
_handlers = drawing.Handlers()
_devices: dict[tuple[Any, ...], Any] = {}
_loops: dict[str, list[Array]] = {}


def device_of(scene: bpy.types.Scene, row: device_preview.Row) -> tuple[Any, float] | None:
    """Return the mechanism of a row as it sits on its finger, and its reference distance; None where it is unknown."""
    obj, spec = scene.objects.get(row.finger), thimble_devices.spec_of(row.device)
    if obj is None or spec is None:
        return None
    settings = next((d for d in obj.dermis.finger.devices if d.preset == row.device), None)
    thimble = core.devices.thimble
    try:
        if settings is None or not settings.thimble_calibrated:
            key: tuple[Any, ...] = (spec.hash,)
            if key not in _devices:
                _keep(key, thimble.mechanism(spec))
        else:
            values = thimble_devices.parameters_of(settings)
            model = _model(obj)
            if model is None:
                return None
            key = (spec.hash, model.key, tuple(values[f"thimble_felt_{i}"] for i in (1, 2, 3)))
            if key not in _devices:
                _keep(key, core.matching.thimble_use.fitted(spec, model, values)[0])
    except DermisError:
        return None  # the bake says why
    return _devices[key], float(spec.parameters.get("reference_distance", _devices[key].mount[2, 3]))


def joints_of(scene: bpy.types.Scene, row: device_preview.Row) -> tuple[Any, thimble_twin.Joints] | None:
    """Return a row's mechanism and where its joints are; None where it has no servo angles or no such pose."""
    found = device_of(scene, row)
    if found is None or "servo_1" not in row.values:
        return None
    device, reference = found
    start = np.array([row.values.get("pitch", 0.0), row.values.get("roll", 0.0), row.values.get("distance", reference)])
    try:
        return device, thimble_twin.joints(device, servo_angles(row), start)
    except DermisError:
        return None


def servo_angles(row: device_preview.Row) -> Array:
    """Return a row's servo angles from neutral [rad], shape (3,)."""
    return np.array([row.values[f"servo_{i}"] for i in (1, 2, 3)])


def shares(row: device_preview.Row) -> Array:
    """Return how much of its range each servo uses, 0 to 1, shape (3,)."""
    angles, out = servo_angles(row), []
    for i, angle in enumerate(angles.tolist()):
        limit = row.high.get(f"servo_{i + 1}") if angle >= 0 else row.low.get(f"servo_{i + 1}")
        out.append(abs(angle / limit) if limit else 0.0)
    return np.array(out)


def workspace_of(device: Any, reference: float) -> list[Array]:
    """Return the loops of a mechanism's workspace, worked out once."""
    key = core.surrogate.store.device_key(device)
    if key not in _loops:
        while len(_loops) >= MOST:
            _loops.pop(next(iter(_loops)))
        try:
            _loops[key] = thimble_twin.loops(device, reference)
        except DermisError:
            _loops[key] = []
    return _loops[key]


def card(row: device_preview.Row, left: float, bottom: float, width: float, scale: float) -> None:
    """Draw the servos as gauges between their limits, the pose, and how far the rendered stress is off [px]."""
    line, used = 20 * scale, shares(row)
    top = bottom + 5.1 * line
    bar = 0.42 * width
    for i, angle in enumerate(servo_angles(row).tolist()):
        y = top - (i + 0.75) * line
        paint.rectangle(left, y, bar, 8 * scale, (*paint.FAINT[:3], 0.14))
        middle, reach = left + 0.5 * bar, 0.5 * bar * min(float(used[i]), 1.0)
        colour = paint.ORANGE if used[i] > thimble_twin.NEAR_LIMIT else paint.BLUE
        paint.rectangle(middle - (reach if angle < 0 else 0.0), y, max(reach, 1.0), 8 * scale, colour)
        paint.rectangle(middle - 0.5, y - 2 * scale, 1.0, 12 * scale, paint.FAINT)
        paint.text(f"{np.degrees(angle):+.1f}°", left + bar + 6 * scale, y, paint.INK, scale)
    x, y = left + 0.66 * width, top - 0.75 * line
    for name, text in (("pitch", "pitch"), ("roll", "roll"), ("distance", "")):
        if name in row.values:
            value = row.values[name]
            words = f"{1e3 * value:.2f} mm" if name == "distance" else f"{text} {np.degrees(value):+.1f}°"
            paint.text(words, x, y, paint.INK, scale)
        y -= line
    y = top - 3.9 * line
    mismatch = row.signals.get("mismatch")
    if row.contact is not None and row.contact < 0.5:
        paint.text("in the air: waits under the pad", left, y, paint.FAINT, scale)
    elif mismatch is not None:
        share = min(max(mismatch, 0.0), 1.0)
        paint.rectangle(left, y, bar, 8 * scale, (*paint.FAINT[:3], 0.14))
        paint.rectangle(left, y, bar * share, 8 * scale, tactor_twin.heat(share))
        paint.text(f"mismatch {100 * mismatch:.0f} %", left + bar + 6 * scale, y, paint.INK, scale)


def _keep(key: tuple[Any, ...], device: Any) -> None:
    while len(_devices) >= MOST:
        _devices.pop(next(iter(_devices)))
    _devices[key] = device


def _model(obj: bpy.types.Object) -> Any | None:
    from ..properties import skin_properties

    values = skin_properties.parameters(obj.dermis.finger.skin)
    return skin_models.get(values["skin"], values["skin_level"])


def _draw() -> None:
    scene = bpy.context.scene
    for row in drawing.rows_of(thimble_devices.KINDS):
        frame, found = finger_matrix(scene, row.finger), joints_of(scene, row)
        if frame is None or found is None:
            continue
        device, at = found
        with drawing.in_finger(frame):
            drawing.solid(thimble_twin.parts(device, at, shares(row)))
            if scene.dermis.thimble_view.workspace:
                _workspace(device, at, float(device_of(scene, row)[1]))  # type: ignore[index]


def _workspace(device: Any, at: thimble_twin.Joints, reference: float) -> None:
    import gpu

    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")
    curves = workspace_of(device, reference)
    for i, curve in enumerate(curves):
        share = i / max(len(curves) - 1, 1)
        paint.line(curve, (*tactor_twin.heat(share)[:3], 0.75), 1.3)
    line = thimble_twin.pointer(at.pose)
    paint.line(line, paint.INK, 2.0)


def register() -> None:
    """Draw thimbles from now on."""
    _handlers.add(_draw)


def unregister() -> None:
    """Draw them no more, and forget what was computed for it."""
    from ..preview import thimble_preview

    _handlers.clear()
    _devices.clear()
    _loops.clear()
    thimble_preview.reset()
    thimble_devices.forget()
