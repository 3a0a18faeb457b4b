"""Draw callbacks of Blender's editors, the strip's switch, clicks on drawn items.

Registering does not load the modules that draw. A thread loads them as soon as Blender has started. Before that,
nothing is drawn, and no frame is computed. Without a window the first call loads them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from . import changes, doubts, identity, loading, on_demand, redraw, reporting
from .comparison import compared, told
from .design import design_results
from .devices import readiness, skin_models, thimble_devices
from .film import film_objects
from .hands import armatures
from .placing import presses
from .preview import device_preview, live_lanes, moment, pin_preview, platform_preview, skin_preview, thimble_preview
from .results import exported, floors, owners, pin_reports, store, trusted
from .sampling import frames
from .streaming import (
    board_identity,
    built_devices,
    calibration_offers,
    device_calibration,
    reported_values,
    session,
    stream_log,
    streamed_track,
)
from .timeline import strip
from .viewport import (
    cards,
    device_cards,
    obstacles,
    overlay,
    pin_card,
    platform_card,
    shown,
    skin_cards,
    skin_colours,
    skin_shader,
    skin_shown,
    skin_view,
    thimble_card,
    twins,
)

MODULES = (  # modules that draw, modules that panels query, and modules that these import
    *(changes, doubts, identity, reporting, design_results, readiness, skin_models, film_objects, armatures),
    *(device_preview, live_lanes, moment, skin_preview, exported, owners, store, trusted, frames),
    *(board_identity, built_devices, calibration_offers, device_calibration, reported_values, session),
    *(stream_log, streamed_track, strip, cards, device_cards, obstacles, overlay, shown, skin_cards, skin_view, twins),
    *(compared, told, presses, floors, pin_reports, pin_card, platform_card, skin_colours, skin_shader, thimble_card),
)
VIEW = "SpaceView3D"
EDITORS = ("SpaceDopeSheetEditor", "SpaceGraphEditor")  # editors that show the strip
MENUS = ("TIME_MT_view", "DOPESHEET_MT_view", "GRAPH_MT_view")
KEYS = (  # keymap, its editor, and the operator of a click there
    ("3D View", "VIEW_3D", "dermis.fold_card"),
    ("Dopesheet", "DOPESHEET_EDITOR", "dermis.strip_jump"),
    ("Graph Editor", "GRAPH_EDITOR", "dermis.strip_jump"),
)

_handles: list[tuple[Any, Any]] = []
_keys: list[tuple[Any, Any]] = []


def there() -> bool:
    """Return whether the modules that draw are loaded; else load them in a thread."""
    return loading.addon(MODULES)


def table() -> tuple[tuple[str, str, Callable[[], None]], ...]:
    """Return the draw callbacks: editor's space, stage of a redraw, function."""
    return (
        (VIEW, "POST_VIEW", _draw_twins),
        (VIEW, "POST_VIEW", _draw_skins),
        *((editor, "POST_PIXEL", _draw_strip) for editor in EDITORS),
        (VIEW, "POST_PIXEL", _draw_cards),
    )


def _draw_twins() -> None:
    if there():
        overlay.draw()


def _draw_skins() -> None:
    if there():
        skin_view.draw()


def _draw_strip() -> None:
    if there():
        strip.draw()


def _draw_cards() -> None:
    if there():
        cards.draw()


def _draw_switch(self: Any, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.prop(context.scene.dermis, "show_strip", text="Dermis Strip")


def _work() -> None:
    if there():
        shown.work()


def register() -> None:
    """Add the draw callbacks, the strip's switch, and keys for clicks."""
    redraw.work = _work
    redraw.request()  # reads the modules that draw
    for name, when, draw in table():
        space = getattr(bpy.types, name)
        _handles.append((space, space.draw_handler_add(draw, (), "WINDOW", when)))
    for menu in MENUS:
        if hasattr(bpy.types, menu):
            getattr(bpy.types, menu).append(_draw_switch)
    ours = bpy.context.window_manager.keyconfigs.addon
    for name, editor, operator in KEYS if ours is not None else ():  # none without a window
        keymap = ours.keymaps.new(name=name, space_type=editor)
        _keys.append((keymap, keymap.keymap_items.new(operator, "LEFTMOUSE", "PRESS", head=True)))


def unregister() -> None:
    """Draw no more, forget results, and end running work."""
    while _keys:
        keymap, item = _keys.pop()
        keymap.keymap_items.remove(item)
    for menu in MENUS:
        if hasattr(bpy.types, menu):
            getattr(bpy.types, menu).remove(_draw_switch)
    while _handles:
        space, handle = _handles.pop()
        space.draw_handler_remove(handle, "WINDOW")
    redraw.work = None
    redraw.cancel()
    for preview in on_demand.read(pin_preview, platform_preview, thimble_preview, skin_preview):
        preview.reset()
    for kept in on_demand.read(
        twins,
        skin_shown,
        readiness,
        thimble_devices,
        shown,
        skin_shader,
        strip,
        live_lanes,
        cards,
        skin_models,
        loading,
    ):
        kept.forget()
