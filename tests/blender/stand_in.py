"""What stands in for a window: a graphics card and a layout that take everything, and all that is drawn on them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
from mathutils import Matrix

from blender_addon import panels, views


class Anything:
    """Takes every call and gives itself; counts what is drawn, and keeps what is written, and what of it on no box."""

    def __init__(self) -> None:
        self.drawn = 0
        self.words: list[str] = []
        self.bare: list[str] = []
        self.boxes: list[Any] = []  # corners of what was filled

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self

    def __call__(self, *_: Any, **more: Any) -> Any:
        self.drawn += 1
        self.words += [more["text"]] if "text" in more else []
        return self

    def __setattr__(self, name: str, value: Any) -> None:
        if name in ("drawn", "words", "bare", "boxes"):
            self.__dict__[name] = value


class Panel:
    """Stands for an instance of a panel, which only Blender can make."""

    def __init__(self, cls: type, layout: Anything) -> None:
        self._cls, self.layout = cls, layout

    def __getattr__(self, name: str) -> Any:
        found = inspect.getattr_static(self._cls, name)
        return found.__get__(self) if inspect.isfunction(found) else getattr(self._cls, name)


def graphics_card() -> tuple[Anything, dict[str, Any]]:
    """Return a graphics card, and the modules of Blender that draw on it, by name."""

    @contextmanager
    def push_pop() -> Iterator[None]:
        yield

    made, gpu, text, batch = Anything(), ModuleType("gpu"), ModuleType("blf"), ModuleType("gpu_extras.batch")
    gpu.state = SimpleNamespace(viewport_get=lambda: (0, 0, 800, 600))
    for name in ("blend_set", "depth_test_set", "depth_mask_set", "face_culling_set"):
        setattr(gpu.state, name, lambda _value: None)
    gpu.matrix = SimpleNamespace(
        push_pop=push_pop,
        translate=lambda _by: None,
        multiply_matrix=lambda _by: None,
        get_model_view_matrix=lambda: Matrix.Identity(4),
        get_projection_matrix=lambda: Matrix.Identity(4),
    )
    gpu.shader = gpu.types = made
    at = [0.0, 0.0]

    def fill(_shader: Any, kind: str, data: dict[str, Any], **_: Any) -> Anything:
        if kind == "TRIS" and len(data.get("pos", ())) == 4:
            made.boxes.append((data["pos"].min(axis=0)[:2], data["pos"].max(axis=0)[:2]))
        return made()

    def position(_font: int, x: float, y: float, _z: float) -> None:
        at[:] = x, y

    def write(_font: int, words: str) -> None:
        made.words.append(words)
        end = (at[0] + 6.0 * len(words), at[1] + 10.0)
        if not any((low <= at).all() and (end <= high).all() for low, high in made.boxes):
            made.bare.append(words)

    batch.batch_for_shader = fill
    text.size = text.color = lambda *_: None
    text.position, text.draw = position, write
    text.dimensions = lambda _font, words: (6.0 * len(words), 10.0)
    return made, {"gpu": gpu, "blf": text, "gpu_extras.batch": batch}


def draw_callbacks() -> list[Callable[[], None]]:
    """Return the draw callbacks of all 3D views."""
    return [draw for editor, _, draw in views.table() if editor == views.VIEW]


def draw(callbacks: list[Callable[[], None]], layout: Anything) -> None:
    """Draw every view and every panel that would be shown."""
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        for callback in callbacks:
            callback()
        draw_panels(layout)


def draw_panels(layout: Anything) -> None:
    """Draw every panel that would be shown, open. As in Blender, a panel that is hidden hides those inside it."""
    hidden: set[str] = set()
    for cls in panels.CLASSES:
        if not issubclass(cls, bpy.types.Panel):
            continue
        poll = getattr(cls, "poll", lambda _context: True)
        if getattr(cls, "bl_parent_id", None) in hidden or not poll(bpy.context):
            hidden.add(cls.bl_idname)
            continue
        for name in ("draw_header", "draw"):
            if name in vars(cls) or any(name in vars(base) for base in cls.__mro__[1:-3]):
                getattr(Panel(cls, layout), name)(bpy.context)
