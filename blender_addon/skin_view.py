"""The heat map in the 3D view: the deformed skin over the artist's finger, a map of each pad, and the legend.

Where the skin touches, an object hides it from every side, so what is hidden is drawn once more, through whatever is
in front. The draw handlers read `skin_live.states`, work out the values that are shown and nothing else, and keep them
until the frame, the quantity or the skin changes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import handlers, paint, skin_colours, skin_field, skin_live, skin_models
from .skin_field import QUANTITIES, SIGNED, Drawn
from .skin_live import SkinState

BIAS = 0.3e-3  # [m] by which the skin is brought forward, so that the artist's finger does not cover it
LEGEND_WIDTH, BAR, LINE, MARGIN, NARROW = 270, 11, 16, 11, 132
BANDS = 8
SOURCES = {"bake": paint.GREEN, "live": paint.BLUE, "stale": paint.ORANGE, "earlier": paint.ORANGE}
_VERTEX = """
void main()
{
  vec3 to_eye = eye.w > 0.5 ? normalize(eye.xyz - position) : eye.xyz;
  level = value;
  shade = dot(normal, to_eye);
  gl_Position = ModelViewProjectionMatrix * vec4(position + to_eye * style.y, 1.0);
}
"""
_FRAGMENT = """
void main()
{
  float t = clamp((level - span.x) / (span.y - span.x), 0.0, 1.0);
  vec3 colour = texture(colours, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  float strength = span.x < 0.0 ? abs(2.0 * t - 1.0) : t;
  float band = t * BANDS;
  float off = abs(fract(band - 0.5) - 0.5) / max(fwidth(band), 1e-6);
  float line = (1.0 - smoothstep(0.4, 1.3, off)) * step(0.5, band) * step(band, BANDS - 0.5);
  line *= smoothstep(0.03, 0.08, strength);
  colour = mix(colour, colour.g > 0.5 ? vec3(0.0) : vec3(1.0), line * span.z);
  colour *= mix(1.0, 0.5 + 0.5 * abs(shade), style.z);
  float alpha = mix(span.w, 1.0, smoothstep(0.0, 0.3, strength)) * style.x;
  if (style.w > 0.5) {
    colour = mix(colour / 12.92, pow((colour + 0.055) / 1.055, vec3(2.4)), step(0.04045, colour));
  }
  fragment = vec4(colour, alpha);
}
"""


class _Ready(NamedTuple):
    """One skin on the graphics card."""

    state: SkinState
    key: tuple[Any, ...]
    drawn: Drawn
    whole: Any
    pad: Any


class Shown(NamedTuple):
    """Everything the view shows of skins at the current frame."""

    states: tuple[SkinState, ...]
    drawn: tuple[Drawn | None, ...]
    low: float
    high: float


_handles: list[Any] = []
_gpu: dict[str, Any] = {}
_ready: dict[str, _Ready] = {}
_drawn: dict[str, tuple[SkinState, tuple[Any, ...], Drawn]] = {}
_largest: dict[tuple[Any, ...], float] = {}
_stresses = {"computed": 0, "skipped": 0}


def shown(scene: bpy.types.Scene) -> Shown:
    """Return the skins of the current frame with their values, and the range of the colours."""
    view = scene.dermis.skin_view
    states = skin_live.states(scene)
    drawn = tuple(_values(s, view.quantity, view.exaggeration) if s.model is not None else None for s in states)
    for gone in set(_drawn) - {s.finger for s in states}:
        del _drawn[gone]
    low, high = _range(scene, [d for d in drawn if d is not None])
    return Shown(states, drawn, low, high)


def counters() -> dict[str, int]:
    """Return for how many skins and frames the values to show were computed, and for how many that was not needed."""
    return dict(_stresses)


def forget_range() -> None:
    """Let the automatic range begin anew."""
    _largest.clear()


def _values(state: SkinState, quantity: str, exaggeration: float) -> Drawn:
    known = _drawn.get(state.finger)
    key = (quantity, round(float(exaggeration), 4))
    if known is not None and known[1] == key:
        before = known[0]
        if before is state or (
            before.model is state.model and before.lift == state.lift and np.array_equal(before.force, state.force)
        ):
            return known[2]
    _stresses["computed" if state.touching else "skipped"] += 1
    with skin_models.one_thread():
        made = skin_field.draw_of(state, quantity, key[1])
    _drawn[state.finger] = (state, key, made)
    return made


def _range(scene: bpy.types.Scene, drawn: list[Drawn]) -> tuple[float, float]:
    view = scene.dermis.skin_view
    if view.range_mode == "fixed":
        top = view.maximum * QUANTITIES[view.quantity].factor
    else:
        now = max((max(d.high, -d.low) for d in drawn), default=0.0)
        if view.range_mode == "auto":
            key = (scene.session_uid, view.quantity, handlers.generation())
            now = _largest[key] = max(now, _largest.get(key, 0.0))
        factor = QUANTITIES[view.quantity].factor
        top = skin_field.nice(now / factor) * factor
    return (-top if view.quantity in SIGNED else 0.0), top


def colour_table(view: Any) -> str:
    """Return the name of the colour map that is in use."""
    return "signed" if view.quantity in SIGNED else str(view.colours)


def _visible(context: bpy.types.Context) -> bool:
    view, space = context.scene.dermis.skin_view, context.space_data
    return bool(view.show) and bool(getattr(space.overlay, "show_overlays", True))


def _draw_view() -> None:
    context = bpy.context
    if not _visible(context):
        return
    scene = context.scene
    now = shown(scene)
    if not now.states:
        return
    import gpu

    from .overlay import finger_matrix
    from .sampling_roster import metres_per_unit

    unit, view = 1.0 / metres_per_unit(scene), scene.dermis.skin_view
    for state, drawn in zip(now.states, now.drawn, strict=True):
        frame = finger_matrix(scene, state.finger)
        if frame is None or drawn is None:
            continue
        ready = _on_card(state, drawn)
        model = frame @ Matrix.Scale(unit, 4)
        gpu.state.blend_set("ALPHA")
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.face_culling_set("BACK")
        _draw(ready.whole, model, now, view, opacity=1.0, fill=view.fill, bias=BIAS, light=1.0, linear=True)
        gpu.state.face_culling_set("NONE")
        if view.xray > 0.0 and state.touching:
            gpu.state.depth_test_set("GREATER")
            _draw(ready.whole, model, now, view, opacity=view.xray, fill=0.0, bias=BIAS, light=0.5, linear=True)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")


def _on_card(state: SkinState, drawn: Drawn) -> _Ready:
    """Return a skin's batches, made anew where its values are others."""
    known = _ready.get(state.finger)
    if known is not None and known.drawn is drawn:
        return known
    from gpu_extras.batch import batch_for_shader

    shader, surface = _shader(), drawn.surface
    arrays = {
        "position": drawn.positions.astype(np.float32), "normal": drawn.normals.astype(np.float32),
        "value": drawn.values.astype(np.float32),
    }  # fmt: skip
    palmar = np.ascontiguousarray(surface.triangles[surface.palmar])
    made = _Ready(
        state, (), drawn, batch_for_shader(shader, "TRIS", arrays, indices=surface.triangles),
        batch_for_shader(shader, "TRIS", arrays, indices=palmar),
    )  # fmt: skip
    _ready[state.finger] = made
    return made


def _draw(
    batch: Any, model: Matrix, now: Shown, view: Any, *, opacity: float, fill: float, bias: float, light: float,
    linear: bool = False, contours: float = 0.3,
) -> None:
    import gpu

    shader = _shader()
    look, lens = gpu.matrix.get_model_view_matrix(), gpu.matrix.get_projection_matrix()
    back = (look @ model).inverted()
    if lens[3][3] == 0.0:
        eye = Vector((*back.translation, 1.0))
    else:
        eye = Vector((*(back.to_3x3() @ Vector((0.0, 0.0, 1.0))).normalized(), 0.0))
    shader.bind()
    shader.uniform_float("ModelViewProjectionMatrix", lens @ look @ model)
    shader.uniform_float("eye", eye)
    shader.uniform_float("span", (now.low, now.high, contours if view.contours else 0.0, fill))
    shader.uniform_float("style", (opacity, bias, light, 1.0 if linear else 0.0))
    shader.uniform_sampler("colours", _texture(colour_table(view)))
    batch.draw(shader)


def _shader() -> Any:
    """Return the shader that turns values into colours, pixel by pixel."""
    if "shader" not in _gpu:
        import gpu

        info = gpu.types.GPUShaderCreateInfo()
        info.push_constant("MAT4", "ModelViewProjectionMatrix")
        for name in ("eye", "span", "style"):
            info.push_constant("VEC4", name)
        info.sampler(0, "FLOAT_2D", "colours")
        for slot, (kind, name) in enumerate((("VEC3", "position"), ("VEC3", "normal"), ("FLOAT", "value"))):
            info.vertex_in(slot, kind, name)
        between = gpu.types.GPUStageInterfaceInfo("dermis_skin")
        between.smooth("FLOAT", "level")
        between.smooth("FLOAT", "shade")
        info.vertex_out(between)
        info.fragment_out(0, "VEC4", "fragment")
        info.define("BANDS", f"{BANDS}.0")
        info.vertex_source(_VERTEX)
        info.fragment_source(_FRAGMENT)
        _gpu["shader"] = gpu.shader.create_from_info(info)
    return _gpu["shader"]


def _texture(name: str) -> Any:
    if name not in _gpu:
        import gpu

        colours = skin_colours.table(name)
        flat = np.column_stack([colours, np.ones(len(colours), np.float32)]).ravel()
        data = gpu.types.Buffer("FLOAT", len(flat), flat.tolist())
        _gpu[name] = gpu.types.GPUTexture((len(colours), 1), format="RGBA32F", data=data)
    return _gpu[name]


def _draw_pixels() -> None:
    context = bpy.context
    if not _visible(context):
        return
    scene = context.scene
    view = scene.dermis.skin_view
    if not (view.legend or view.maps):
        return
    now = shown(scene)
    if not now.states:
        return
    import gpu

    scale = context.preferences.system.ui_scale
    gpu.state.blend_set("ALPHA")
    right = context.region.width - MARGIN * scale - paint.width_of(context.area, "UI")
    bottom = MARGIN * scale
    if view.maps:
        bottom = _columns(context, now, right, bottom, scale)
    if view.legend:
        _legend(now, view, right, bottom, scale)
    gpu.state.blend_set("NONE")


def _columns(context: bpy.types.Context, now: Shown, right: float, bottom: float, scale: float) -> float:
    """Draw a card for each finger, in the order of the view, smaller where there are many; return where to go on."""
    view = context.scene.dermis.skin_view
    gap, count = 6 * scale, len(now.states)
    room = right - paint.width_of(context.area, "TOOLS") - 2 * MARGIN * scale
    fitting = max(min(count, int((room + gap) // (NARROW * scale + gap))), 1)
    width = min(max(NARROW, 0.76 * view.map_size) * scale, (room + gap) / fitting - gap)
    size = min(view.map_size * scale, width / 0.76)
    height = size + (5.2 * LINE + MARGIN) * scale
    left = right - fitting * width - (fitting - 1) * gap
    for i in _from_the_left(context, now.states)[:fitting]:
        state, drawn = now.states[i], now.drawn[i]
        paint.rectangle(left, bottom, width, height, paint.PANEL)
        if drawn is not None:
            middle = np.array([left + 0.5 * width, bottom + 5.0 * LINE * scale + 0.5 * size])
            _pad_map(state, drawn, now, view, middle, size, scale)
        _figures(state, left + 9 * scale, bottom + 4.2 * LINE * scale, width - 18 * scale, scale)
        left += width + gap
    if count > fitting:
        paint.text(f"and {count - fitting} more", right - width, bottom + height + 4 * scale, paint.FAINT, scale)
        height += LINE * scale
    return bottom + height + gap


def _from_the_left(context: bpy.types.Context, states: tuple[SkinState, ...]) -> list[int]:
    """Return the numbers of the fingers as they stand in the view, so that cards and fingers are easily matched."""
    look = context.region_data.perspective_matrix

    def place(i: int) -> tuple[float, int]:
        obj = context.scene.objects.get(states[i].finger)
        if obj is None:
            return (0.0, i)
        at = look @ Vector((*obj.matrix_world.translation, 1.0))
        return (round(at.x / at.w, 1) if at.w > 0.0 else 0.0, i)

    return sorted(range(len(states)), key=place)


def _pad_map(
    state: SkinState, drawn: Drawn, now: Shown, view: Any, at: np.ndarray, size: float, scale: float
) -> None:
    """Draw a pad as seen through the nail, tip up: the finger's X to the right, its Y upwards."""
    longest = max(float(np.ptp(d.surface.rest[:, 1])) for d in now.drawn if d is not None)
    zoom = size / (1.05 * longest)  # one scale for all
    rest = drawn.surface.rest
    middle = 0.5 * (rest.min(axis=0) + rest.max(axis=0))
    shift = Matrix.Translation((at[0] - zoom * middle[0], at[1] - zoom * middle[1], 0.0))
    flat = Matrix.Diagonal((zoom, zoom, 0.0, 1.0))
    flat[2][2] = 1e-6 * zoom  # flat, and can still be inverted
    pad = _on_card(state, drawn).pad
    _draw(pad, shift @ flat, now, view, opacity=1.0, fill=1.0, bias=0.0, light=0.35, contours=0.12)
    if not state.touching:
        return
    push = np.maximum(-np.einsum("ij,ij->i", state.force, state.model.normals), 0.0)
    centre = push @ state.model.positions[:, :2] / max(float(push.sum()), 1e-30)
    start = at + zoom * (centre - middle[:2])
    paint.disc(start, 2.6 * scale, paint.INK)
    across = state.force.sum(axis=0)[:2]
    share = float(np.hypot(*across)) / max(state.normal_force, 1e-12)
    if share > 0.02:
        end = start + 0.34 * size * min(share, 1.0) * across / np.hypot(*across)
        paint.arrow(start, end, paint.INK, 2.0, scale)


def _figures(state: SkinState, x: float, y: float, width: float, scale: float) -> None:
    colour = SOURCES.get(state.source, paint.FAINT)
    paint.text(state.finger, x, y, paint.INK, scale, width=width - 12 * scale)
    if state.model is None:
        rows = [(state.note, paint.ORANGE)]
    elif not state.touching:
        rows = [("in the air", paint.FAINT)]
    else:
        rows = [
            (f"N {force(state.normal_force)}   T {force(state.tangential_force)}", paint.INK),
            (f"{1e3 * state.depth:.2f} mm deep", paint.INK if state.depth <= 2e-3 else paint.ORANGE),
            (state.note, paint.ORANGE) if state.work == "rendered"
            else (f"{state.sticking} stick, {state.slipping} slip", paint.FAINT) if state.converged
            else ("did not converge", paint.ORANGE),
        ]  # fmt: skip
    for text, ink in rows:
        y -= LINE * scale
        paint.text(text, x, y, ink, scale, width=width + 4 * scale)
    paint.disc(np.array([x + width - 4 * scale, y + (len(rows) * LINE + 4) * scale]), 3.2 * scale, colour)


def _legend(now: Shown, view: Any, right: float, bottom: float, scale: float) -> None:
    """Draw the colours with their range and unit, where the forces come from, and how far off the model is."""
    quantity = QUANTITIES[view.quantity]
    deepest = max((s.depth for s in now.states), default=0.0)
    said = paint.wrapped(skin_field.error_text(deepest), 42)
    width, height = LEGEND_WIDTH * scale, ((2.9 + len(said)) * LINE + BAR + 2 * MARGIN) * scale
    left, x = right - width, right - width + MARGIN * scale
    inner = width - 2 * MARGIN * scale
    paint.rectangle(left, bottom, width, height, paint.PANEL)
    y = bottom + height - (MARGIN + 8) * scale
    how = {"auto": "largest so far", "frame": "this frame", "fixed": "fixed"}[view.range_mode]
    paint.text(f"{quantity.title}  [{quantity.unit}]", x, y, paint.INK, scale)
    paint.text(how, right - (MARGIN + 82) * scale, y, paint.FAINT, scale)
    y -= (BAR + 7) * scale
    paint.strip(x, y, inner, BAR * scale, skin_colours.table(colour_table(view)))
    y -= LINE * scale
    for share in (0.0, 0.5, 1.0):
        value = (now.low + share * (now.high - now.low)) / quantity.factor
        paint.text(f"{value:.4g}", x + share * inner, y, paint.INK, scale, align=share)
    y -= 1.15 * LINE * scale
    for line in said:
        paint.text(line, x, y, paint.ORANGE if deepest > 2e-3 else paint.FAINT, scale, width=inner)
        y -= LINE * scale
    note = next((s for s in now.states if s.note), None)
    if note is not None:
        paint.text(note.note, x, bottom + (MARGIN - 3) * scale, SOURCES.get(note.source, paint.ORANGE), scale,
                   width=inner)  # fmt: skip


def force(value: float) -> str:
    """Return a force for people."""
    return f"{value:.2f} N" if value >= 0.1 else f"{1e3 * value:.0f} mN"


def register() -> None:
    """Add the draw handlers; without a window they are never called."""
    add = bpy.types.SpaceView3D.draw_handler_add
    _handles.append((add(_draw_view, (), "WINDOW", "POST_VIEW"), "WINDOW"))
    _handles.append((add(_draw_pixels, (), "WINDOW", "POST_PIXEL"), "WINDOW"))


def unregister() -> None:
    """Remove the draw handlers and what is on the graphics card."""
    while _handles:
        handle, region = _handles.pop()
        bpy.types.SpaceView3D.draw_handler_remove(handle, region)
    for kept in (_gpu, _ready, _drawn, _largest):
        kept.clear()
