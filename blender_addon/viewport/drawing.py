"""Drawing of twins: their choice, their place, their triangles and lines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np
from mathutils import Matrix

from .. import identity
from ..preview.rows import Row
from ..quantities import metres_per_unit
from . import paint, shown
from .parts import Part
from .twin import Twin


def twins(context: bpy.types.Context) -> list[tuple[Row, Twin]]:
    """Return the devices to draw in the current view; none if they are hidden."""
    scene, space = context.scene, context.space_data
    if not scene.dermis.show_twin or not getattr(space.overlay, "show_overlays", True):
        return []
    now = shown.now(scene)
    if now is None or now.devices is None:
        return []
    return [(row, twin) for row, twin in zip(now.devices.rows, now.twins, strict=True) if twin is not None]


def finger_matrix(scene: bpy.types.Scene, name: str) -> Matrix | None:
    """Return a finger's frame in scene units, without the object's scale.

    Devices do not grow with an object. None if the finger is not visible.
    """
    obj = identity.named(scene, name)
    if obj is None or not obj.visible_get():
        return None
    location, rotation, _ = obj.matrix_world.decompose()
    return Matrix.LocRotScale(location, rotation, None)


@contextmanager
def in_finger(frame: Matrix) -> Iterator[None]:
    """Draw in metres in a finger's frame, with transparency.

    Afterwards, tests of depth and blending are off.
    """
    import gpu

    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(frame @ Matrix.Scale(1.0 / metres_per_unit(bpy.context.scene), 4))
        gpu.state.blend_set("ALPHA")
        try:
            yield
        finally:
            gpu.state.depth_test_set("NONE")
            gpu.state.depth_mask_set(False)
            gpu.state.blend_set("NONE")


def draw_twin(twin: Twin) -> None:
    """Draw the hidden parts, the visible parts, and lines over both."""
    import gpu

    for part, test, covers in ((twin.hidden, "GREATER", False), (twin.solid, "LESS_EQUAL", twin.covers)):
        gpu.state.depth_test_set(test)
        gpu.state.depth_mask_set(covers)
        _triangles(part)
    gpu.state.depth_test_set("NONE")
    gpu.state.depth_mask_set(False)
    for line in twin.lines:
        paint.line(*line)


def _triangles(part: Part) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(
        shader, "TRIS", {"pos": part.positions, "color": part.colours}, indices=np.ascontiguousarray(part.triangles)
    ).draw(shader)
