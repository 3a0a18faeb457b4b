"""The cards of devices and skins in the 3D view: which, in which order, and where, so that nothing lies over another.

Devices stand in columns at the left, pads in rows at the right with the legend above them; both in the order of the
fingers, thumb first. Where there is no room cards are folded to a line, and where not even that fits, a line says so.
Draws what `shown` has kept, and changes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import bpy

from ..hands import bone_names
from ..layouts import ui_scale
from . import device_cards, obstacles, packing, paint, shown, skin_cards
from .drawing import Handlers
from .packing import Box
from .shown import Frame
from .skin_shown import Shown

GAP = 6  # between cards [px at scale 1]
WIDE, TALL = 0.5, 0.6  # of the view: its width that devices may take, and its height that any cards may
SOURCE_COLOURS = {
    "bake": paint.GREEN,
    "live": paint.BLUE,
    "stale": paint.ORANGE,
    "earlier": paint.ORANGE,
    "device": paint.GREEN,
    "file": paint.GREEN,
}
_handlers = Handlers()


@lru_cache(maxsize=32)
def order(names: tuple[str, ...], fingers: tuple[str, ...]) -> tuple[int, ...]:
    """Return in which order cards stand: a hand's fingers from the thumb on, then others as the scene has them.

    Args:
        names: of fingers, or of what is theirs, as 'Index: thimble'. fingers: all of the scene's.
    """
    said = bone_names.labels(fingers)

    def rank(i: int) -> tuple[str, int, int, int]:
        whose = names[i] if names[i] in fingers else names[i].partition(": ")[0]
        place = fingers.index(whose) if whose in fingers else len(fingers)
        label = said.get(whose)
        if label is None:
            return ("~", len(bone_names.FINGERS), place, i)
        return (label.side, bone_names.FINGERS.index(label.finger), place, i)

    return tuple(sorted(range(len(names)), key=rank))


def _draw() -> None:
    context = bpy.context
    scene, space = context.scene, context.space_data
    if not getattr(space.overlay, "show_overlays", True):
        return
    now = shown.now(scene)
    if now is None:
        return
    import gpu

    scale = ui_scale()
    room, taken = obstacles.free(context, scale)
    fingers = tuple(obj.name for obj in scene.objects if obj.dermis.role == "FINGER")
    gpu.state.blend_set("ALPHA")
    said = ""  # already, of where values come from
    if scene.dermis.show_readout and (
        places := _devices(now, fingers, room, taken, scale, folded=scene.dermis.fold_cards)
    ):
        taken += places
        said = now.devices.note if places and now.devices is not None else ""
    if scene.dermis.skin_view.show and now.skins.states:
        _skins(context, now.skins, fingers, room, taken, scale, said)
    gpu.state.blend_set("NONE")


def _devices(
    now: Frame, fingers: tuple[str, ...], room: Box, taken: Sequence[Box], scale: float, *, folded: bool
) -> list[Box]:
    """Draw the devices' cards under a line that says where their values come from; return their places."""
    devices = now.devices
    if devices is None or not (devices.rows or (devices.source == "live" and not now.skins.states)):
        return []  # of fingers without devices the skin's legend says where it comes from
    chosen = order(tuple(row.finger for row in devices.rows), fingers)
    rows, twins = [devices.rows[i] for i in chosen], [now.twins[i] for i in chosen]
    line, width = device_cards.FOLDED * scale, device_cards.WIDTH * scale
    left = Box(room.left, room.bottom, max(WIDE * room.width, min(width, room.width)), TALL * room.height)
    heights = [line, *(line if folded else device_cards.height(row) * scale for row in rows)]
    kept, places = packing.folding(
        heights, line, lambda heights: packing.columns(heights, width, left, taken, GAP * scale)
    )
    missing = len(heights) - len(places) + 1 if len(places) < len(heights) else 0
    for i, at in enumerate(places):
        if i == 0:
            x, y = at.left + 2 * scale, at.bottom + 0.3 * line
            paint.text(devices.note, x, y, SOURCE_COLOURS[devices.source], scale, width=width)
        elif missing and i == len(places) - 1:
            _missing(missing, "device", at, scale)
        elif i < kept and not folded:
            device_cards.opened(rows[i - 1], twins[i - 1], at, scale)
        else:
            device_cards.folded(rows[i - 1], at, scale)
    return places


def _skins(
    context: bpy.types.Context,
    now: Shown,
    fingers: tuple[str, ...],
    room: Box,
    taken: Sequence[Box],
    scale: float,
    said: str,
) -> None:
    """Draw a map of each pad, smaller where there are many, and the legend above them."""
    view = context.scene.dermis.skin_view
    gap, count = GAP * scale, len(now.states)
    chosen = order(tuple(state.finger for state in now.states), fingers)
    places: list[Box] = []
    if view.maps:
        low = room._replace(height=TALL * room.height)
        for width, height in () if context.scene.dermis.fold_cards else skin_cards.sizes(view.map_size):
            places = packing.rows([width * scale] * count, height * scale, low, taken, gap)
            if len(places) == count:
                break
        if len(places) == count:
            for i, at in zip(chosen, places, strict=True):
                skin_cards.opened(now, i, view, at, scale)
        else:
            line, width = skin_cards.FOLDED * scale, skin_cards.LEGEND_WIDTH * scale
            places = packing.columns([line] * count, width, low, taken, gap, right=True)
            missing = count - len(places) + 1 if len(places) < count else 0
            for i, at in zip(chosen, places[: len(places) - 1] if missing else places, strict=False):
                skin_cards.folded(now.states[i], at, scale)
            if missing and places:
                _missing(missing, "pad", places[-1], scale)
    if view.legend:
        bottom = max((at.top + gap for at in places), default=room.bottom)
        above = Box(room.left, bottom, room.width, room.top - bottom)
        for full in (True, False):
            legend = skin_cards.Legend.of(now, full=full, said=said)
            for at in packing.rows([skin_cards.LEGEND_WIDTH * scale], legend.height * scale, above, taken, gap):
                skin_cards.legend(now, view, legend, at, scale)
                return


def _missing(count: int, what: str, at: Box, scale: float) -> None:
    words = f"and {count} more {what}{'' if count == 1 else 's'}: enlarge the view"
    paint.text(words, at.left + 2 * scale, at.bottom + 0.3 * at.height, paint.ORANGE, scale, width=at.width)


def register() -> None:
    """Draw cards from now on."""
    _handlers.add(_draw, "POST_PIXEL")


def unregister() -> None:
    """Draw them no more."""
    _handlers.clear()
