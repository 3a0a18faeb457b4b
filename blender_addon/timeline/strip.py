"""Draw the strip at the bottom of timeline, dope sheet and graph editor.

It shows the touch of each finger, frame by frame. A bake's lanes are made once, and laid out once for each view. A
redraw only sends them to the graphics card.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import changes, compat
from .._core import core
from ..layouts import ui_scale
from ..preview import live_lanes
from ..results import store, trusted
from ..results.lanes import Lane, Mark, lanes_of, marks_of
from ..viewport import paint
from .columns import MARK, SCRUB, Layout, View, laid_out

EDITORS = ("DOPESHEET_EDITOR", "GRAPH_EDITOR")
LETTERS = 0.87  # size of letters over the usual size
NOTE = 16.0  # [px] height of the line above the lanes at scale 1
MOST = 32  # largest number of selected objects whose keys labels keep clear of
NOTES = {**store.NOTES, "fresh": "", "live": "live: frames seen since the last edit"}


class Strip(NamedTuple):
    """Contents of a scene's strip.

    `lanes` are those of the bake, `live` those of previews since, `marks` the findings with a frame, and `state` is a
    key of `NOTES`.
    """

    lanes: tuple[Lane, ...]
    live: tuple[Lane, ...]
    marks: tuple[Mark, ...]
    state: str


_baked: dict[int, tuple[Any, Any, tuple[Lane, ...], tuple[Mark, ...]]] = {}  # by the scene's uid, with its source
_layouts: core.recent.Recent[tuple[Any, ...], tuple[Layout, Any]] = core.recent.Recent(8)
_key_frames: core.recent.Recent[tuple[Any, ...], tuple[float, ...]] = core.recent.Recent(2)


def of(scene: bpy.types.Scene) -> Strip | None:
    """Return the contents of a scene's strip; None without a bake and without a touch in the preview."""
    state, result = store.state(scene), store.current(scene)
    live = () if state == "fresh" else live_lanes.of(scene)
    if result is None:
        _baked.pop(scene.session_uid, None)
        touched = any(lane.most("touch") or lane.most("force") for lane in live)
        return Strip((), live, (), "live") if touched else None
    kept, told = _baked.get(scene.session_uid), trusted.current(scene)
    if kept is None or kept[0] is not result or kept[1] is not told:
        lanes, marks = lanes_of(result), marks_of(result.bake.all_findings)
        if told is not None:
            lanes, marks = told.into(lanes), (*marks, *told.marks)
        kept = _baked[scene.session_uid] = (result, told, lanes, marks)
    return Strip(kept[2], live, kept[3], state) if kept[2] or live else None


def view_of(region: bpy.types.Region) -> View:
    """Return the view of a region."""
    left, right = (region.view2d.region_to_view(x, 0.0)[0] for x in (0.0, float(region.width)))
    return View(region.width, region.height, round(left, 6), round(right, 6), ui_scale())


def layout_of(shown: Strip, view: View) -> Layout:
    """Return the layout of the strip for a view, which is cached."""
    return _kept(shown, view)[0]


def mark_at(context: bpy.types.Context, x: float, y: float) -> Mark | None:
    """Return the mark at a place of the current region [px]; None without one."""
    shown = of(context.scene) if visible(context) else None
    if shown is None or not shown.marks:
        return None
    return layout_of(shown, view_of(context.region)).mark_at(x, y, 1.5 * MARK * ui_scale())


def visible(context: bpy.types.Context) -> bool:
    """Return whether the current editor shows a strip, if there is one."""
    space, region = context.space_data, context.region
    if space is None or space.type not in EDITORS or region is None or region.type != "WINDOW":
        return False
    return bool(context.scene.dermis.show_strip) and getattr(space, "mode", "") != "DRIVERS"  # whose x are no frames


def _kept(shown: Strip, view: View) -> tuple[Layout, Any]:
    lanes, live, marks, state = shown
    keys = _keys_shown()
    key = (tuple(map(id, lanes)), tuple(map(id, live)), state, view, keys)

    def make() -> tuple[Layout, Any]:
        made = laid_out(lanes, live, marks, view, pale=state in ("stale", "earlier"), keys=keys)
        return made, (lanes, live, [])  # references keep the lanes, whose ids are in the key; the list holds the batch

    return _layouts.make(key, make)


def _keys_shown() -> tuple[float, ...]:
    """Return the frames of the keys of selected objects, which editors show."""
    chosen = tuple(bpy.context.selected_objects or ())[:MOST]
    key = (changes.edits(), tuple(obj.session_uid for obj in chosen))

    def look() -> tuple[float, ...]:
        return tuple(sorted({frame for obj in chosen for frame in _keyed(obj)}))

    return _key_frames.make(key, look)


def _keyed(obj: bpy.types.Object) -> set[float]:
    """Return the frames of an object's keys."""
    animation, found = obj.animation_data, set[float]()
    for bag in compat.channelbags(animation.action) if animation is not None and animation.action else ():
        for curve in bag.fcurves:
            places = np.empty(2 * len(curve.keyframe_points), np.float32)
            curve.keyframe_points.foreach_get("co", places)
            found.update(places[::2].tolist())
    return found


def draw() -> None:
    """Draw the strip into the current editor."""
    context = bpy.context
    if not visible(context):
        return
    shown = of(context.scene)
    if shown is None:
        return
    import gpu
    from gpu_extras.batch import batch_for_shader

    view = view_of(context.region)
    layout, (_, _, drawn) = _kept(shown, view)
    shader = gpu.shader.from_builtin("FLAT_COLOR")
    if not drawn:
        data = {"pos": layout.positions, "color": layout.colours}
        drawn.append(batch_for_shader(shader, "TRIS", data, indices=layout.triangles))
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("NONE")
    drawn[0].draw(shader)
    if layout.labels:
        _write(layout, view, shown.state)
    gpu.state.blend_set("NONE")


def _write(layout: Layout, view: View, state: str) -> None:
    """Write the titles of the lanes, and above them a note on their source.

    There is no note on an up-to-date bake.
    """
    pale, size = state in ("stale", "earlier"), LETTERS * view.scale
    for words, x, y in layout.labels:
        paint.text(words, x, y, paint.FAINT if pale else paint.INK, size)
    if NOTES[state] and layout.top + (NOTE + SCRUB) * view.scale <= view.height:  # else over the frames' numbers
        tone = paint.ORANGE if pale else paint.BLUE
        paint.text(
            NOTES[state],
            view.width - 18.0 * view.scale,
            layout.top + 4.0 * view.scale,
            tone,
            size,
            align=1.0,
            ground=True,
        )


def forget() -> None:
    """Drop all lanes and layouts."""
    _baked.clear()
    _layouts.clear()
