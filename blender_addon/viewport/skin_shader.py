"""Skins on the graphics card: triangles, colour maps, and the shader of values."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from mathutils import Matrix, Vector

from ..preview.skin_state import SkinState
from . import skin_colours
from .skin_field import Drawn
from .skin_shown import Shown, colour_table

BANDS = 8
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


class Ready(NamedTuple):
    """One skin on the graphics card."""

    drawn: Drawn
    whole: Any
    pad: Any


_gpu: dict[str, Any] = {}
_ready: dict[str, Ready] = {}


def on_card(state: SkinState, drawn: Drawn) -> Ready:
    """Return a skin's batches, made anew if its drawing has changed."""
    ready = _ready.get(state.finger)
    if ready is not None and ready.drawn is drawn:
        return ready
    from gpu_extras.batch import batch_for_shader

    shader, surface = _shader(), drawn.surface
    arrays = {
        "position": drawn.positions.astype(np.float32),
        "normal": drawn.normals.astype(np.float32),
        "value": drawn.values.astype(np.float32),
    }
    palmar = np.ascontiguousarray(surface.triangles[surface.palmar])
    ready = _ready[state.finger] = Ready(
        drawn,
        batch_for_shader(shader, "TRIS", arrays, indices=surface.triangles),
        batch_for_shader(shader, "TRIS", arrays, indices=palmar),
    )
    return ready


def draw(
    batch: Any,
    model: Matrix,
    now: Shown,
    view: Any,
    *,
    opacity: float,
    fill: float,
    bias: float,
    light: float,
    linear: bool = False,
    contours: float = 0.3,
) -> None:
    """Draw a batch.

    Args:
        opacity: opacity of the large values. fill: share of it at the value zero.
        bias: shift towards the eye [m]. light: strength of the shading, 0 to 1.
        linear: write linear colours, not sRGB. contours: strength of the lines of equal value.
    """
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


def forget() -> None:
    """Release everything on the graphics card."""
    _gpu.clear()
    _ready.clear()
