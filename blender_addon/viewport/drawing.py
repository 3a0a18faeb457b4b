"""What the twins of all devices share where they are drawn: whose turn it is, their place, and solid parts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..preview.rows import Row
from ..quantities import metres_per_unit
from . import shown, tactor_twin

HIDDEN = 0.45  # opacity of what an object hides: where a finger touches, one always does


class Handlers:
    """Draw handlers of 3D views; without a window they are never called."""

    def __init__(self) -> None:
        self._handles: list[tuple[Any, str]] = []

    def add(self, draw: Callable[[], None], when: str = "POST_VIEW") -> None:
        """Call `draw` for every redraw of a view's main region."""
        self._handles.append((bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", when), "WINDOW"))

    def clear(self) -> None:
        """Call none of them any more."""
        while self._handles:
            bpy.types.SpaceView3D.draw_handler_remove(*self._handles.pop())


def rows_of(kinds: Collection[str]) -> list[tuple[Row, Any]]:
    """Return the devices of these kinds to draw in the current view with their twins; none where those are hidden."""
    scene, space = bpy.context.scene, bpy.context.space_data
    if not scene.dermis.show_twin or not getattr(space.overlay, "show_overlays", True):
        return []
    now = shown.now(scene)
    if now is None or now.devices is None:
        return []
    return [(row, twin) for row, twin in zip(now.devices.rows, now.twins, strict=True) if row.kind in kinds]


def finger_matrix(scene: bpy.types.Scene, name: str) -> Matrix | None:
    """Return a finger's frame in scene units, without its scale: devices do not grow with an object."""
    obj = scene.objects.get(name)
    if obj is None or not obj.visible_get():
        return None
    location, rotation, _ = obj.matrix_world.decompose()
    return Matrix.LocRotScale(location, rotation, None)


@contextmanager
def in_finger(frame: Matrix) -> Iterator[None]:
    """Draw in metres in a finger's frame, with transparency; leave the state as it was found."""
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


def solid(part: tactor_twin.Part, *, mask: bool = True) -> None:
    """Draw a part; what something hides shines through it faintly. With a mask it hides what is drawn after it."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    for test, opacity, writes in (("GREATER", HIDDEN, False), ("LESS_EQUAL", 1.0, mask)):
        gpu.state.depth_test_set(test)
        gpu.state.depth_mask_set(writes)
        colours = part.colours * np.array([1.0, 1.0, 1.0, opacity], np.float32)
        batch_for_shader(
            shader, "TRIS", {"pos": part.positions, "color": colours}, indices=np.ascontiguousarray(part.triangles)
        ).draw(shader)
