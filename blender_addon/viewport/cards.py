"""Cards of devices and skins in the 3D view: choice, order and places.

Cards do not overlap. Devices stand in columns at the left, pads in rows at the right with the legend above them. Both
are in the order of the fingers, thumb first. Cards without room are folded to a line. If not even the lines fit, one
line says how many are missing. The module draws from the frame that `shown` has kept, and changes nothing in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import bpy

from .. import identity
from ..hands import bone_names
from ..layouts import ui_scale
from ..preview import moment
from ..preview.rows import Preview, Row
from . import device_cards, obstacles, packing, paint, shown, skin_cards
from .packing import Box
from .skin_shown import Shown
from .twin import Twin

GAP = 6  # between cards [px at scale 1]
# Shares of the view: WIDE of its width is the most for devices, TALL of its height is the most for any cards.
WIDE, TALL = 0.5, 0.6
SOURCE_COLOURS = {
    "bake": paint.GREEN,
    "live": paint.BLUE,
    "stale": paint.ORANGE,
    "earlier": paint.ORANGE,
    "device": paint.GREEN,
    "file": paint.GREEN,
}
SLIM = 200  # [px at scale 1] in a view with less free width than this, all cards are folded
_folded: set[Card] = set()  # cards that clicks have folded in this session
_places: dict[int, list[tuple[Box, Card]]] = {}  # by region: places of its devices' cards drawn last [px]


class Card(NamedTuple):
    """A device's card, by the scene's session uid, the finger and the title."""

    scene: int
    finger: str
    title: str


class Plan(NamedTuple):
    """Places of cards, in the order of the cards [px at scale 1].

    If there are fewer places than cards, the last place is for words that say how many are missing.

    Attributes:
        devices: place of the line of words, then those of the devices' cards.
        open_devices: how many of these places, the line included, are not folded.
        pads: places of the pads' cards.
        open_pads: whether the pads' cards are open, not folded.
    """

    devices: list[Box]
    open_devices: int
    pads: list[Box]
    open_pads: bool

    def shown(self, count: int) -> int:
        """Return how many of `count` devices have a place of their own.

        If not all have one, the last place is for words.
        """
        return count if len(self.devices) > count else max(len(self.devices) - 2, 0)

    @classmethod
    def of(
        cls,
        heights: Sequence[float] | None,
        pads: int,
        map_size: float,
        room: Box,
        taken: Sequence[Box],
        *,
        folded: bool,
        lines: int = 4,
    ) -> Plan:
        """Plan places for cards of devices and pads, in px at scale 1.

        Devices are folded, the last ones first, until they fit. All are folded if open pads do not fit otherwise.

        Args:
            heights: of the devices' cards; None leaves out the line of words as well.
            pads: number of pads.
            folded: fold all cards.
            lines: lines of text in a pad's card.
        """
        low = room._replace(height=TALL * room.height)
        width = min(device_cards.WIDTH, room.width)
        left = low._replace(width=max(WIDE * room.width, width))
        folded = folded or width < SLIM
        plan = cls([], 0, [], False)
        for fold in (True,) if folded else (False, True):
            lengths = [device_cards.FOLDED if fold else height for height in heights or ()]
            kept, devices = packing.folding(
                [device_cards.FOLDED, *lengths] if heights is not None else [],
                device_cards.FOLDED,
                lambda lengths: packing.columns(lengths, width, left, taken, GAP),
            )
            sizes = [] if folded else skin_cards.sizes(map_size, lines)
            plan = cls(devices, 1 if fold else kept, *_pads(pads, sizes, low, (*taken, *devices)))
            if len(plan.pads) == pads and plan.open_pads:
                break
        return plan


def _pads(count: int, sizes: Sequence[tuple[float, float]], room: Box, taken: Sequence[Box]) -> tuple[list[Box], bool]:
    """Return places for pads, and whether they are open.

    All have the first of the sizes in which all fit. If they fit in none, they are folded to lines.
    """
    for width, height in sizes:
        places = packing.rows([width] * count, height, room, taken, GAP)
        if len(places) == count:
            return sorted(places, key=lambda box: (-box.bottom, box.left)), True  # to be read from the top
    lines = [skin_cards.FOLDED] * count
    return packing.columns(lines, skin_cards.LEGEND_WIDTH, room, taken, GAP, right=True), count == 0


def draw() -> None:
    """Draw the cards and the legend into the current view."""
    context = bpy.context
    scene, space = context.scene, context.space_data
    _places.pop(context.region.as_pointer(), None)
    if not getattr(space.overlay, "show_overlays", True):
        return
    now = shown.now(scene)
    if now is None:
        return
    import gpu

    settings, scale = scene.dermis, ui_scale()
    room, taken = obstacles.free(context, scale)
    fingers = tuple(obj.name_full for obj in identity.fingers(scene))
    rows: list[tuple[Row, Twin | None]] = []
    devices, skins = now.devices, now.skins if settings.skin_view.show else now.skins._replace(states=(), drawn=())
    if settings.show_readout and devices is not None:
        rows = [
            (devices.rows[i], now.twins[i])
            for i in bone_names.order(tuple(row.finger for row in devices.rows), fingers)
        ]
    pads = bone_names.order(tuple(state.finger for state in skins.states), fingers) if settings.skin_view.maps else ()
    alone = devices is not None and devices.source == "live" and not skins.states  # else the legend has the source
    said = settings.show_readout and (rows or alone)
    names = [Card(scene.session_uid, row.finger, row.title) for row, _ in rows]
    heights = [
        device_cards.FOLDED if name in _folded else device_cards.height(row)
        for name, (row, _) in zip(names, rows, strict=True)
    ]
    size, folded = settings.skin_view.map_size, settings.fold_cards
    lines = skin_cards.lines_of(skins.states)
    plan = Plan.of(heights if said else None, len(pads), size, room, taken, folded=folded, lines=lines)
    count = plan.shown(len(names))
    places = [place.scaled(scale) for place in plan.devices[1 : count + 1]]
    _places[context.region.as_pointer()] = list(zip(places, names[:count], strict=True))
    gpu.state.blend_set("ALPHA")
    late = "" if now.frame == moment.frame_of(scene) else f"of frame {now.frame:g}"
    if devices is not None:
        _devices(devices, rows, plan, scale, late)
    _skins(skins, pads, settings.skin_view, plan, scale, late)
    if skins.states and settings.skin_view.legend:
        note = devices.note if devices is not None and plan.devices else ""
        _legend(skins, settings.skin_view, room, [*taken, *plan.devices], plan.pads, scale, note)
    gpu.state.blend_set("NONE")


def _devices(devices: Preview, rows: Sequence[tuple[Row, Twin | None]], plan: Plan, scale: float, late: str) -> None:
    """Draw the devices' cards under a line that says where their values come from.

    Args:
        late: text that names the frame of the values; empty if it is the current frame.
    """
    shown_count = plan.shown(len(rows))
    for i, at in enumerate(place.scaled(scale) for place in plan.devices):
        if i == 0:
            place = at if rows else at._replace(width=0.0)  # without cards, the line may be as long as its words
            _line(devices.note, place, SOURCE_COLOURS[devices.source], scale)
        elif i > shown_count:
            _missing(len(rows) - shown_count, "device", at, scale)
        elif i < plan.open_devices and plan.devices[i].height > device_cards.FOLDED:
            device_cards.card(*rows[i - 1], at, scale)
        else:
            device_cards.line(rows[i - 1][0], at, scale)
        if late and 0 < i <= shown_count:
            paint.veil(*at, late, scale)


def _skins(skins: Shown, order: Sequence[int], view: Any, plan: Plan, scale: float, late: str) -> None:
    """Draw a map of each pad, or a line; `late` as in `_devices`."""
    shown_count = len(order) if len(plan.pads) == len(order) else len(plan.pads) - 1
    for i, at in enumerate(place.scaled(scale) for place in plan.pads):
        if i == shown_count:
            _missing(len(order) - shown_count, "pad", at, scale)
        elif plan.open_pads:
            skin_cards.card(skins, order[i], view, at, scale)
        else:
            skin_cards.line(skins.states[order[i]], at, scale)
        if late and i < shown_count:
            paint.veil(*at, late, scale)


def _legend(
    skins: Shown, view: Any, room: Box, taken: Sequence[Box], pads: Sequence[Box], scale: float, said: str
) -> None:
    """Draw the legend above the pads, without its words if they do not fit."""
    bottom = max((at.top + GAP for at in pads), default=room.bottom)
    above = Box(room.left, bottom, room.width, room.top - bottom)
    for full in (True, False):
        legend = skin_cards.Legend.of(skins, full=full, said=said)
        for at in packing.rows([skin_cards.LEGEND_WIDTH], legend.height, above, taken, GAP):
            skin_cards.legend(skins, view, legend, at.scaled(scale), scale)
            return


def _line(words: str, at: Box, colour: paint.Colour, scale: float) -> None:
    edge = paint.EDGE * scale
    width = max(at.width - 2.0 * edge, 0.0)
    paint.text(words, at.left + edge, at.bottom + 0.3 * at.height, colour, scale, width=width, ground=True)


def _missing(count: int, what: str, at: Box, scale: float) -> None:
    _line(f"and {count} more {what}{'' if count == 1 else 's'}: enlarge the view", at, paint.ORANGE, scale)


def shown_in(context: bpy.types.Context) -> bool:
    """Return whether the current region shows cards of devices."""
    return context.region is not None and bool(_places.get(context.region.as_pointer()))


def fold_at(context: bpy.types.Context, x: float, y: float) -> bool:
    """Fold or unfold the card at a place of the current region [px].

    Returns:
        Whether there is a card.
    """
    for place, name in _places.get(context.region.as_pointer(), ()):
        if place.meets(Box(x, y, 1.0, 1.0)):
            _folded.symmetric_difference_update({name})
            context.region.tag_redraw()
            return True
    return False


def forget() -> None:
    """Forget which cards are folded, and where cards were drawn."""
    _folded.clear()
    _places.clear()
