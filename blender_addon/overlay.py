"""What the viewport shows: the device's twin on each finger, and its values in the corner.

Two draw handlers, one in the scene and one in pixels. They read `live.preview`, draw, and change nothing.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from . import live, pin_view, platform_use, platform_view, skin_live, thimble_view, twin

_handles: list[Any] = []
CARD_WIDTH, DIAL, LINE, MARGIN = 260, 92, 17, 12
INK, FAINT, PANEL = (0.92, 0.93, 0.95, 1.0), (0.92, 0.93, 0.95, 0.35), (0.07, 0.08, 0.09, 0.82)
ORANGE, BLUE = (1.0, 0.52, 0.10, 1.0), (0.36, 0.62, 1.0, 1.0)
GREEN = (0.45, 0.80, 0.55, 1.0)
SOURCE_COLOURS = {"bake": GREEN, "live": BLUE, "stale": ORANGE, "earlier": ORANGE, "device": GREEN, "file": GREEN}


def finger_matrix(scene: bpy.types.Scene, name: str) -> Matrix | None:
    """Return a finger's frame in scene units, without its scale: devices do not grow with an object."""
    obj = scene.objects.get(name)
    if obj is None or not obj.visible_get():
        return None
    location, rotation, _ = obj.matrix_world.decompose()
    return Matrix.LocRotScale(location, rotation, None)


def _draw_view() -> None:
    context = bpy.context
    scene, space = context.scene, context.space_data
    if not scene.dermis.show_twin or not getattr(space.overlay, "show_overlays", True):
        return
    shown = live.preview(scene)
    if shown is None:
        return
    import gpu

    from .sampling_roster import metres_per_unit

    unit = 1.0 / metres_per_unit(scene)
    for row in shown.rows:
        frame = finger_matrix(scene, row.finger)
        if frame is None:
            continue
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(frame @ Matrix.Scale(unit, 4))
            gpu.state.blend_set("ALPHA")
            if "tactor_x" in row.values:
                _tactor(row, scene.dermis.twin_exaggeration)
            elif "amplitude" in row.values:
                _field(row)
            gpu.state.depth_test_set("NONE")
            gpu.state.depth_mask_set(False)
            gpu.state.blend_set("NONE")


def _tactor(row: live.Row, exaggeration: float) -> None:
    import gpu

    x, y = row.values["tactor_x"] * exaggeration, row.values["tactor_y"] * exaggeration
    # The device sits between the pad and what it touches: what is hidden there shows through as a flat figure.
    for test, solid in (("GREATER", False), ("LESS_EQUAL", True)):
        gpu.state.depth_test_set(test)
        gpu.state.depth_mask_set(solid)
        _triangles(twin.housing() if solid else twin.plan())
        with gpu.matrix.push_pop():
            gpu.matrix.translate((x, y, 0.0))
            _triangles(twin.cap() if solid else twin.dot())
    gpu.state.depth_test_set("NONE")
    gpu.state.depth_mask_set(False)
    reach = row.high.get("tactor_x") or 2e-3
    _line(twin.circle(reach * exaggeration, 0.3e-3), FAINT, 1.0)
    if np.hypot(x, y) > 1e-5:
        _line(np.array([[0.0, 0.0, 0.35e-3], [x, y, 0.35e-3]], np.float32), INK, 2.5)


def _field(row: live.Row) -> None:
    import gpu

    level = _level(row, "amplitude")
    gpu.state.depth_test_set("NONE")
    gpu.state.depth_mask_set(False)
    colour = twin.heat(level)
    if level > 0.0:
        _triangles(twin.glow(6e-3 + 9e-3 * level, (*colour[:3], 0.25 + 0.6 * level)))
    _line(twin.circle(6e-3, 0.0), (*colour[:3], 0.9), 1.5)
    if level > 0.0:
        _line(twin.circle(6e-3 + 9e-3 * level, 0.0), (*colour[:3], 0.6), 1.0)


def _draw_pixels() -> None:
    context = bpy.context
    scene, space = context.scene, context.space_data
    if not scene.dermis.show_readout or not getattr(space.overlay, "show_overlays", True):
        return
    shown = live.preview(scene)
    if shown is None or not (shown.rows or shown.source == "live"):
        return
    if not shown.rows and skin_live.states(scene):
        return  # fingers without devices: the skin's legend says where it comes from
    import gpu

    scale = context.preferences.system.ui_scale
    gpu.state.blend_set("ALPHA")
    left = MARGIN * scale + _width_of(context.area, "TOOLS")
    bottom = MARGIN * scale
    height = context.region.height
    for row in reversed(shown.rows):
        needed = _card_height(row) * scale
        if bottom + needed > height - 60 * scale:
            _text(f"and {len(shown.rows)} devices in all", left, bottom, FAINT, scale)
            bottom += LINE * scale
            break
        _card(row, left, bottom, scale)
        bottom += needed + 6 * scale
    _text(shown.note, left + 2 * scale, bottom + 3 * scale, SOURCE_COLOURS[shown.source], scale)
    gpu.state.blend_set("NONE")


def _width_of(area: bpy.types.Area, kind: str) -> float:
    return float(next((r.width for r in area.regions if r.type == kind and r.width > 1), 0))


def _card_height(row: live.Row) -> float:
    if row.kind in platform_use.KINDS:
        return platform_view.height(row) + 2.0 * MARGIN
    tall = "tactor_x" in row.values or row.kind in ("pin_array", "thimble")
    return DIAL + 3.0 * MARGIN + LINE if tall else 3 * LINE + 2 * MARGIN


def _card(row: live.Row, left: float, bottom: float, scale: float) -> None:
    height = _card_height(row) * scale
    _rectangle(left, bottom, CARD_WIDTH * scale, height, PANEL)
    top = bottom + height - (MARGIN + 6) * scale
    x = left + MARGIN * scale
    _text(f"{row.finger}   {row.title}", x, top, INK, scale, width=(CARD_WIDTH - 2 * MARGIN) * scale)
    if "tactor_x" in row.values:
        _dial(row, x, bottom + MARGIN * scale, scale)
    elif row.kind == "pin_array":
        pin_view.card(row, x, bottom + MARGIN * scale, (CARD_WIDTH - 2 * MARGIN) * scale, DIAL * scale, scale)
    elif row.kind == "thimble" and "servo_1" in row.values:
        thimble_view.card(row, x, bottom + 0.7 * MARGIN * scale, (CARD_WIDTH - 2 * MARGIN) * scale, scale)
    elif row.kind in platform_use.KINDS:
        platform_view.card(row, x, bottom + 0.7 * MARGIN * scale, (CARD_WIDTH - 2 * MARGIN) * scale, scale)
    elif "amplitude" in row.values:
        _bar(row, x, top - 1.6 * LINE * scale, scale)


def _dial(row: live.Row, left: float, bottom: float, scale: float) -> None:
    """Draw the tactor's plane as the finger's owner would see it through the nail: tip up."""
    radius = 0.5 * DIAL * scale
    centre = np.array([left + radius, bottom + radius])
    reach = row.high.get("tactor_x") or 2e-3
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    _line2d(centre + radius * ring, FAINT, 1.0)
    for a, b in (((-1, 0), (1, 0)), ((0, -1), (0, 1))):
        _line2d(centre + radius * np.array([a, b]), (*FAINT[:3], 0.15), 1.0)
    if len(row.path) > 1:
        points = centre + radius * row.path / reach
        fade = np.linspace(0.0, 0.9, len(points))
        _line2d(points, np.column_stack([np.tile(ORANGE[:3], (len(points), 1)), fade]), 1.6)
    at = np.array([row.values["tactor_x"], row.values["tactor_y"]])
    _disc(centre + radius * at / reach, 5.0 * scale, ORANGE)
    x = left + DIAL * scale + 14 * scale
    y = bottom + DIAL * scale - 14 * scale
    lines = [(f"x  {at[0] * 1e3:+6.2f} mm", INK), (f"y  {at[1] * 1e3:+6.2f} mm", INK),
             (f"{100 * np.hypot(*at) / reach:.0f} % of ±{reach * 1e3:g} mm", FAINT)]  # fmt: skip
    if row.contact is not None:
        lines.append(("touching", ORANGE) if row.contact > 0.5 else ("in the air", FAINT))
    for text, colour in lines:
        _text(text, x, y, colour, scale)
        y -= LINE * scale


def _bar(row: live.Row, left: float, bottom: float, scale: float) -> None:
    level, width = _level(row, "amplitude"), (CARD_WIDTH - 2 * MARGIN) * scale
    _rectangle(left, bottom, width, 12 * scale, (*FAINT[:3], 0.12))
    if level > 0.0:
        _rectangle(left, bottom, width * level, 12 * scale, twin.heat(level))
    limit = row.high.get("amplitude")
    text = f"{row.values['amplitude']:.0f} V"
    if limit:
        text += f"  of {limit:.0f} V"
    if "carrier" in row.values:
        text += f"   at {row.values['carrier']:.0f} Hz"
    _text(text, left, bottom - 1.25 * LINE * scale, INK, scale)
    if row.contact is not None:
        touching = row.contact > 0.5
        _text("on the screen" if touching else "off the screen", left + 0.66 * width, bottom - 1.25 * LINE * scale,
              ORANGE if touching else FAINT, scale)  # fmt: skip


def _level(row: live.Row, name: str) -> float:
    return float(np.clip(row.values[name] / (row.high.get(name) or 1.0), 0.0, 1.0))


def _triangles(part: twin.Part) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRIS", {"pos": part.positions, "color": part.colours},
                     indices=np.ascontiguousarray(part.triangles)).draw(shader)  # fmt: skip


def _line(points: np.ndarray, colour: tuple[float, ...], width: float) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("POLYLINE_SMOOTH_COLOR")
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", width * bpy.context.preferences.system.ui_scale)
    gpu.state.blend_set("ALPHA")  # text drawing leaves it off
    colours = np.broadcast_to(np.asarray(colour, np.float32), (len(points), 4)).copy()
    batch_for_shader(shader, "LINE_STRIP", {"pos": points.astype(np.float32), "color": colours}).draw(shader)


def _line2d(points: np.ndarray, colour: Any, width: float) -> None:
    _line(np.column_stack([points, np.zeros(len(points))]), colour, width)


def _rectangle(left: float, bottom: float, width: float, height: float, colour: tuple[float, ...]) -> None:
    right, top = left + width, bottom + height
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    _fill(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), colour)


def _disc(centre: np.ndarray, radius: float, colour: tuple[float, ...]) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
    points = np.vstack([centre, centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    i = np.arange(24)
    _fill(points, np.stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % 24], axis=1).astype(np.int32), colour)


def _fill(points: np.ndarray, triangles: np.ndarray, colour: tuple[float, ...]) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.uniform_float("color", colour)
    gpu.state.blend_set("ALPHA")  # text drawing leaves it off
    flat = np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
    batch_for_shader(shader, "TRIS", {"pos": flat}, indices=triangles).draw(shader)


def _text(text: str, x: float, y: float, colour: tuple[float, ...], scale: float, width: float = 0.0) -> None:
    import blf

    blf.size(0, 11.5 * scale)
    blf.color(0, *colour)
    while width and len(text) > 4 and blf.dimensions(0, text)[0] > width:
        text = text.rstrip("…")[:-1] + "…"
    blf.position(0, x, y, 0.0)
    blf.draw(0, text)


def redraw() -> None:
    """Ask every 3D view to draw again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def register() -> None:
    """Add the draw handlers; without a window they are never called."""
    add = bpy.types.SpaceView3D.draw_handler_add
    _handles.append((add(_draw_view, (), "WINDOW", "POST_VIEW"), "WINDOW"))
    _handles.append((add(_draw_pixels, (), "WINDOW", "POST_PIXEL"), "WINDOW"))


def unregister() -> None:
    """Remove the draw handlers."""
    while _handles:
        handle, region = _handles.pop()
        bpy.types.SpaceView3D.draw_handler_remove(handle, region)
