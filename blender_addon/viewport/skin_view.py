"""The heat map in the 3D view: the deformed skin over the artist's finger.

Where the skin touches an object, the object hides it from every side. So the hidden part is drawn once more, through
the objects in front. The module draws from the frame that `shown` has kept.
"""

from __future__ import annotations

import bpy
from mathutils import Matrix

from ..quantities import metres_per_unit
from . import shown, skin_shader
from .drawing import finger_matrix

BIAS = 0.3e-3  # [m] by which the skin is brought forward, so that the artist's finger does not cover it


def _visible(context: bpy.types.Context) -> bool:
    view, space = context.scene.dermis.skin_view, context.space_data
    return bool(view.show) and bool(getattr(space.overlay, "show_overlays", True))


def draw() -> None:
    """Draw into the current view."""
    context = bpy.context
    if not _visible(context):
        return
    scene = context.scene
    kept = shown.now(scene)
    if kept is None or not kept.skins.states:
        return
    now = kept.skins
    import gpu

    unit, view = 1.0 / metres_per_unit(scene), scene.dermis.skin_view
    for state, drawn in zip(now.states, now.drawn, strict=True):
        frame = finger_matrix(scene, state.finger)
        if frame is None or drawn is None:
            continue
        ready = skin_shader.on_card(state, drawn)
        model = frame @ Matrix.Scale(unit, 4)
        gpu.state.blend_set("ALPHA")
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.face_culling_set("BACK")
        skin_shader.draw(ready.whole, model, now, view, opacity=1.0, fill=view.fill, bias=BIAS, light=1.0, linear=True)
        gpu.state.face_culling_set("NONE")
        if view.xray > 0.0 and state.touching:
            gpu.state.depth_test_set("GREATER")
            skin_shader.draw(
                ready.whole, model, now, view, opacity=view.xray, fill=0.0, bias=BIAS, light=0.5, linear=True
            )
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")
