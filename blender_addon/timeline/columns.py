"""Lay out the strip in the timeline in pixels: one lane for each finger.

Each column of pixels shows the largest value in it, and neighbouring columns that look the same become one box.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Array
from ..results.lanes import Kind, Lane, Mark, Series
from ..viewport.paint import BLUE, FAINT, INK, ORANGE, PANEL, Colour

RED: Colour = (0.95, 0.33, 0.27, 1.0)
YELLOW: Colour = (0.98, 0.85, 0.25, 1.0)
SEVERITIES = {"error": RED, "warning": ORANGE, "info": INK}
# [px] Heights at scale 1. LANE: a lane. GAP: between two lanes. SCRUB: the row of frame numbers. LABELLED: the least
# height of a lane with a label.
LANE, GAP, SCRUB, LABELLED = 18.0, 1.0, 26.0, 11.0
SHARE = 0.5  # largest share of an editor's height for all lanes, so that keys stay visible
LETTER = 5.8  # [px] approximate width of a letter at scale 1
STEPS = 12  # steps of height and of colour; columns of the same step are one box
TOUCH = 0.7  # share of a lane's height that shows a touch of unknown force
PALE = 0.35  # opacity of an outdated bake
KEY = 7.0  # [px] approximate half-width of a key at scale 1
MARK = 4.0  # [px] half the size of a mark at scale 1


class View(NamedTuple):
    """An editor's region.

    It has a size [px], the frames at its left and right end, and Blender's scale of the interface.
    """

    width: int
    height: int
    left: float
    right: float
    scale: float

    def x(self, frame: float) -> float:
        """Return the distance of a frame from the left end [px]."""
        return (frame - self.left) / (self.right - self.left) * self.width


@dataclass(frozen=True, eq=False)
class Layout:
    """Everything of the strip in one view, ready to be drawn.

    Attributes:
        positions: positions [px], shape (n, 2).
        colours: colours, shape (n, 4).
        triangles: indices of the corners, shape (t, 3).
        labels: texts with their places [px], if lanes are high enough to read them.
        marks: marks with the places of their middles [px].
        top: top edge of the strip [px].
    """

    positions: NDArray[np.float32]
    colours: NDArray[np.float32]
    triangles: NDArray[np.int32]
    labels: tuple[tuple[str, float, float], ...]
    marks: tuple[tuple[float, float, Mark], ...]
    top: float

    def mark_at(self, x: float, y: float, reach: float) -> Mark | None:
        """Return the mark nearest to a place; None if none is within `reach` [px]."""
        near = min(self.marks, key=lambda m: np.hypot(m[0] - x, m[1] - y), default=None)
        return near[2] if near is not None and np.hypot(near[0] - x, near[1] - y) <= reach else None


def laid_out(
    lanes: Sequence[Lane],
    live: Sequence[Lane],
    marks: Sequence[Mark],
    view: View,
    *,
    pale: bool = False,
    keys: Sequence[float] = (),
) -> Layout:
    """Lay the strip out along the bottom of a view, the first finger on top.

    Args:
        lanes: lanes of a bake.
        live: lanes of previews since the bake, drawn over `lanes`.
        pale: whether the bake is out of date.
        keys: frames that labels keep clear of. If its whole text does not fit, a label has the finger's name alone. If
            that does not fit either, it is left out.
    """
    fingers = list(dict.fromkeys([*(lane.finger for lane in lanes), *(lane.finger for lane in live)]))
    room = max(min(view.height - SCRUB * view.scale, max(SHARE * view.height, SCRUB)), 4.0)
    pitch = max(min((LANE + GAP) * view.scale, room / max(len(fingers), 1)), 2.0)
    bottoms = {f: pitch * (len(fingers) - 1 - i) + GAP * view.scale for i, f in enumerate(fingers)}
    high, boxes = max(pitch - GAP * view.scale, 1.0), _Boxes()
    for bottom in bottoms.values():
        boxes.add(0.0, bottom, float(view.width), bottom + high, (*PANEL[:3], 0.45))
    for lane in lanes:
        _lane(boxes, lane, view, bottoms[lane.finger], high, PALE if pale else 1.0)
    for lane in live:
        _lane(boxes, lane, view, bottoms[lane.finger], high, 1.0)
    placed = []
    for mark in marks:
        x, reach = view.x(mark.frame), MARK * view.scale
        if -reach <= x <= view.width + reach:
            y = bottoms.get(mark.finger, pitch * (len(fingers) - 1)) + 0.5 * high
            tone = SEVERITIES.get(mark.severity, INK)
            boxes.add(x - 0.5, 0.0, x + 0.5, pitch * len(fingers), (*tone[:3], 0.5 * tone[3]))
            boxes.diamond(x, y, reach, (*tone[:3], PALE if pale else 1.0))
            placed.append((x, y, mark))
    labels: list[tuple[str, float, float]] = []
    if high >= LABELLED * view.scale:
        said = {lane.finger: lane.says for lane in (*live, *lanes)}  # a bake's text replaces that of a preview
        for finger in fingers:
            y = bottoms[finger] + 0.5 * high - 3.5 * view.scale
            for words in dict.fromkeys((said[finger], finger)):
                width = LETTER * view.scale * len(words) + 8.0 * view.scale
                free = _clear(view, keys, width + 4.0)
                if free is not None:
                    labels.append((words, free + 4.0, y))
                    boxes.add(free, y - 3.0 * view.scale, free + 4.0 + width, y + 10.0 * view.scale, (*PANEL[:3], 0.75))
                    break
    return Layout(*boxes.arrays(), tuple(labels), tuple(placed), pitch * len(fingers))


def _clear(view: View, keys: Sequence[float], width: float) -> float | None:
    """Return the leftmost place [px] with `width` free of keys; None without."""
    edge, half = 2.0 * view.scale, KEY * view.scale
    places = sorted(view.x(frame) for frame in keys)
    taken = [(x - half, x + half) for x in places if -half <= x <= view.width + half]
    left = edge
    for low, high in (*taken, (view.width - edge, math.inf)):
        if low - left >= width:
            return left
        left = max(left, high)
    return None


def columns(series: Series, view: View) -> Array:
    """Return the largest value in each column of pixels, shape (width,).

    A sample holds until the next one; the last sample holds as long as the one before it. Columns before the first
    sample and after the end of the last one have NaN.
    """
    frames, values = series
    edges = np.linspace(view.left, view.right, view.width + 1)
    start = np.searchsorted(frames, edges[:-1], side="right") - 1
    end = np.searchsorted(frames, edges[1:], side="left")
    pairs = np.stack([np.maximum(start, 0), np.maximum(end, 1)], axis=1).ravel()
    largest = np.fmax.reduceat(np.append(values, values[-1]), np.minimum(pairs, len(values)))[::2]
    over = frames[-1] + (frames[-1] - frames[-2] if len(frames) > 1 else 1.0)
    return np.where((end > 0) & (edges[:-1] < over), largest, np.nan)


def _merged(lane: Lane, kind: Kind, view: View) -> Array:
    """Return the largest value of all series of a kind in each column.

    Columns without a value have NaN.
    """
    parts = (columns(s, view) for s in lane.series.get(kind, ()))
    return np.fmax.reduce([np.full(view.width, np.nan), *parts])


def _lane(boxes: _Boxes, lane: Lane, view: View, bottom: float, high: float, strength: float) -> None:
    if "force" in lane.series:
        level = _merged(lane, "force", view) / (lane.most("force") or 1.0)
    else:  # a bar of one height, which leaves room for the mark of limits above it
        level = TOUCH * _merged(lane, "touch", view)
    known = np.isfinite(level)
    level = np.nan_to_num(level)
    # Rounding up keeps even the lightest touch visible.
    steps = np.where(level > 0.0, np.ceil(np.clip(level, 0.0, 1.0) * STEPS), 0).astype(int)
    off = np.clip(np.nan_to_num(_merged(lane, "mismatch", view)), 0.0, 1.0)
    shade = np.round(off * STEPS).astype(int)
    for first, last in _runs(known.astype(int)):
        if known[first]:
            boxes.add(first, bottom, last, bottom + 1.0, (*FAINT[:3], 0.6 * strength))
    for first, last in _runs(steps * (STEPS + 1) + shade):
        if steps[first]:
            tone = _between(BLUE, ORANGE, shade[first] / STEPS, strength)
            boxes.add(first, bottom, last, bottom + high * steps[first] / STEPS, tone)
    at = (np.nan_to_num(_merged(lane, "limited", view)) > 0.0).astype(int)
    thick = max(0.18 * high, 1.0)
    for first, last in _runs(at):
        if at[first]:
            boxes.add(first, bottom + high - thick, last, bottom + high, (*RED[:3], strength))
    doubtful = (np.nan_to_num(_merged(lane, "doubt", view)) > 0.0).astype(int)
    for first, last in _runs(doubtful):
        if doubtful[first]:
            boxes.add(first, bottom, last, bottom + thick, (*YELLOW[:3], strength))


def _between(one: Colour, other: Colour, share: float, alpha: float) -> Colour:
    r, g, b = ((1.0 - share) * x + share * y for x, y in zip(one[:3], other[:3], strict=True))
    return (r, g, b, alpha)


def _runs(values: NDArray[np.integer]) -> list[tuple[int, int]]:
    """Return start and end (excluded) of each run of equal values."""
    edges = np.r_[0, np.flatnonzero(np.diff(values)) + 1, len(values)]
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


class _Boxes:
    """Boxes of four corners each, collected to be drawn in one call."""

    def __init__(self) -> None:
        self._corners: list[tuple[tuple[float, float], ...]] = []
        self._colours: list[Colour] = []

    def add(self, left: float, bottom: float, right: float, top: float, colour: Colour) -> None:
        """Add an upright box."""
        self._corners.append(((left, bottom), (right, bottom), (right, top), (left, top)))
        self._colours.append(colour)

    def diamond(self, x: float, y: float, reach: float, colour: Colour) -> None:
        """Add a square that stands on its tip; `reach` is half its diagonal."""
        self._corners.append(((x - reach, y), (x, y - reach), (x + reach, y), (x, y + reach)))
        self._colours.append(colour)

    def arrays(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
        """Return positions, colours and triangles."""
        n = len(self._corners)
        corners = np.array(self._corners, np.float32).reshape(-1, 2)
        colours = np.repeat(np.array(self._colours, np.float32).reshape(n, 4), 4, axis=0)
        first = 4 * np.arange(n, dtype=np.int32)[:, None]
        halves = np.array([0, 1, 2, 0, 2, 3], np.int32)  # in the order of the boxes, so that later ones cover earlier
        return corners, colours, (first + halves).reshape(-1, 3)
