"""Thimbles in the view: the twin around the finger, where it can go, and its servos as gauges in the corner."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from . import paint, skin_models, thimble_twin, thimble_use, twin
from .preferences import core_module

if TYPE_CHECKING:
    from . import live

Array = NDArray[np.float64]

HIDDEN = 0.35  # opacity of what an object or the finger hides
MOST = 8
_handles: list[Any] = []
_devices: dict[tuple[Any, ...], Any] = {}
_loops: dict[str, list[Array]] = {}


def device_of(scene: bpy.types.Scene, row: live.Row) -> tuple[Any, float] | None:
    """Return the mechanism of a row as it sits on its finger, and its reference distance; None where it is unknown."""
    obj, spec = scene.objects.get(row.finger), thimble_use.spec_of(row.device)
    if obj is None or spec is None:
        return None
    settings = next((d for d in obj.dermis.finger.devices if d.preset == row.device), None)
    thimble, errors = core_module("devices.thimble"), core_module("errors")
    try:
        if settings is None or not settings.thimble_calibrated:
            key: tuple[Any, ...] = (spec.hash,)
            if key not in _devices:
                _keep(key, thimble.mechanism(spec))
        else:
            values = thimble_use.parameters_of(settings)
            model = _model(obj)
            if model is None:
                return None
            key = (spec.hash, model.key, tuple(values[f"thimble_felt_{i}"] for i in (1, 2, 3)))
            if key not in _devices:
                _keep(key, core_module("matching.thimble_use").fitted(spec, model, values)[0])
    except errors.DermisError:
        return None  # the bake says why
    return _devices[key], float(spec.parameters.get("reference_distance", _devices[key].mount[2, 3]))


def joints_of(scene: bpy.types.Scene, row: live.Row) -> tuple[Any, thimble_twin.Joints] | None:
    """Return a row's mechanism and where its joints are; None where it has no servo angles or no such pose."""
    found = device_of(scene, row)
    if found is None or "servo_1" not in row.values:
        return None
    device, reference = found
    start = np.array([row.values.get("pitch", 0.0), row.values.get("roll", 0.0),
                      row.values.get("distance", reference)])  # fmt: skip
    try:
        return device, thimble_twin.joints(device, servo_angles(row), start)
    except core_module("errors").DermisError:
        return None


def servo_angles(row: live.Row) -> Array:
    """Return a row's servo angles from neutral [rad], shape (3,)."""
    return np.array([row.values[f"servo_{i}"] for i in (1, 2, 3)])


def shares(row: live.Row) -> Array:
    """Return how much of its range each servo uses, 0 to 1, shape (3,)."""
    angles, out = servo_angles(row), []
    for i, angle in enumerate(angles.tolist()):
        limit = row.high.get(f"servo_{i + 1}") if angle >= 0 else row.low.get(f"servo_{i + 1}")
        out.append(abs(angle / limit) if limit else 0.0)
    return np.array(out)


def workspace_of(device: Any, reference: float) -> list[Array]:
    """Return the loops of a mechanism's workspace, worked out once."""
    key = core_module("surrogate.store").device_key(device)
    if key not in _loops:
        while len(_loops) >= MOST:
            _loops.pop(next(iter(_loops)))
        try:
            _loops[key] = thimble_twin.loops(device, reference)
        except core_module("errors").DermisError:
            _loops[key] = []
    return _loops[key]


def card(row: live.Row, left: float, bottom: float, width: float, scale: float) -> None:
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
        paint.rectangle(left, y, bar * share, 8 * scale, twin.heat(share))
        paint.text(f"mismatch {100 * mismatch:.0f} %", left + bar + 6 * scale, y, paint.INK, scale)


def _keep(key: tuple[Any, ...], device: Any) -> None:
    while len(_devices) >= MOST:
        _devices.pop(next(iter(_devices)))
    _devices[key] = device


def _model(obj: bpy.types.Object) -> Any | None:
    from . import properties_skin

    values = properties_skin.parameters(obj.dermis.finger.skin)
    return skin_models.get(values["skin"], values["skin_level"])


def _draw() -> None:
    context = bpy.context
    scene, space = context.scene, context.space_data
    if not scene.dermis.show_twin or not getattr(space.overlay, "show_overlays", True):
        return
    from .live import preview

    shown = preview(scene)
    rows = [row for row in shown.rows if row.kind == "thimble"] if shown is not None else []
    if not rows:
        return
    import gpu

    from .overlay import finger_matrix
    from .sampling_roster import metres_per_unit

    unit = 1.0 / metres_per_unit(scene)
    for row in rows:
        frame, found = finger_matrix(scene, row.finger), joints_of(scene, row)
        if frame is None or found is None:
            continue
        device, at = found
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(frame @ Matrix.Scale(unit, 4))
            gpu.state.blend_set("ALPHA")
            _solid(thimble_twin.parts(device, at, shares(row)))
            if scene.dermis.thimble_view.workspace:
                _workspace(device, at, float(device_of(scene, row)[1]))  # type: ignore[index]
            gpu.state.depth_test_set("NONE")
            gpu.state.depth_mask_set(False)
            gpu.state.blend_set("NONE")


def _solid(part: twin.Part) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    for test, opacity, mask in (("GREATER", HIDDEN, False), ("LESS_EQUAL", 1.0, True)):
        gpu.state.depth_test_set(test)
        gpu.state.depth_mask_set(mask)
        colours = part.colours * np.array([1.0, 1.0, 1.0, opacity], np.float32)
        batch_for_shader(shader, "TRIS", {"pos": part.positions, "color": colours},
                         indices=np.ascontiguousarray(part.triangles)).draw(shader)  # fmt: skip


def _workspace(device: Any, at: thimble_twin.Joints, reference: float) -> None:
    import gpu

    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")
    curves = workspace_of(device, reference)
    for i, curve in enumerate(curves):
        share = i / max(len(curves) - 1, 1)
        _line(curve, (*twin.heat(share)[:3], 0.75), 1.3)
    line = thimble_twin.pointer(at.pose)
    _line(line, paint.INK, 2.0)


def _line(points: Array, colour: tuple[float, ...], width: float) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("POLYLINE_SMOOTH_COLOR")
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", width * bpy.context.preferences.system.ui_scale)
    colours = np.broadcast_to(np.asarray(colour, np.float32), (len(points), 4)).copy()
    batch_for_shader(shader, "LINE_STRIP", {"pos": points.astype(np.float32), "color": colours}).draw(shader)


def register() -> None:
    """Add the draw handler; without a window it is never called."""
    _handles.append(bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW"))


def unregister() -> None:
    """Remove it."""
    from . import thimble_live

    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    _devices.clear()
    _loops.clear()
    thimble_live.reset()
    thimble_use.forget()
