"""Places for cards in a view, computed without Blender.

Cards are stacked in strips: columns from the left, or rows from the bottom. In a strip, only the longest part that
nothing covers is used. It takes as many cards as fit, in their order, at its end. So columns stand on the view's lower
edge, and rows end at its right edge.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple


class Box(NamedTuple):
    """A rectangle, in any unit."""

    left: float
    bottom: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Its right end."""
        return self.left + self.width

    @property
    def top(self) -> float:
        """Its upper end."""
        return self.bottom + self.height

    def scaled(self, scale: float) -> Box:
        """Return the box with its size and its place multiplied by a factor."""
        return Box(*(scale * value for value in self))

    def meets(self, other: Box) -> bool:
        """Return whether two boxes have more than an edge in common."""
        across = self.left < other.right and other.left < self.right
        return across and self.bottom < other.top and other.bottom < self.top


Place = Callable[[Sequence[float]], list[Box]]


def columns(
    heights: Sequence[float], width: float, room: Box, taken: Sequence[Box], gap: float, *, right: bool = False
) -> list[Box]:
    """Place cards of one width from top to bottom, in columns.

    Columns go from the left, or from the right if `right` is set.

    Returns:
        Places of the first cards, as many as fit.
    """
    if right:
        turned = columns(heights, width, _mirrored(room), [_mirrored(box) for box in taken], gap)
        return [_mirrored(box) for box in turned]
    return [_raised(box) for box in _strips(heights, width, _laid(room), [_laid(box) for box in taken], gap)]


def rows(widths: Sequence[float], height: float, room: Box, taken: Sequence[Box], gap: float) -> list[Box]:
    """Place cards of one height from left to right, in rows from the bottom.

    Returns:
        Places of the first cards, as many as fit.
    """
    return _strips(widths, height, room, taken, gap)


def folding(opened: Sequence[float], folded: float, place: Place) -> tuple[int, list[Box]]:
    """Fold as few of the last cards as are needed to show all.

    Args:
        opened: lengths of the open cards. folded: length of a card that is folded to a line.
        place: function that places cards of given lengths, such as `columns`.

    Returns:
        The number of open cards, and the places. If there are fewer places than cards, not even folded cards all fit.
        The last place, if there is any, is then for words that say how many cards are missing.
    """
    count = len(opened)
    for kept in range(count, -1, -1):
        lengths = [*opened[:kept], *[folded] * (count - kept)]
        places = place(lengths)
        if len(places) == count:
            return kept, places
    return 0, places


def _mirrored(box: Box) -> Box:
    return box._replace(left=-box.right)


def _laid(box: Box) -> Box:
    """Lay a box on its side: downwards becomes to the right, and to the right upwards."""
    return Box(-box.top, box.left, box.height, box.width)


def _raised(box: Box) -> Box:
    """Undo `_laid`."""
    return Box(box.bottom, -box.right, box.height, box.width)


def _strips(lengths: Sequence[float], thickness: float, room: Box, taken: Sequence[Box], gap: float) -> list[Box]:
    """Stack cards along X in strips of a thickness, from the room's bottom upwards."""
    places: list[Box] = []
    bottom = room.bottom
    while len(places) < len(lengths) and bottom + thickness <= room.top:
        strip = Box(room.left, bottom, room.width, thickness)
        here = _stacked(lengths[len(places) :], _longest(strip, taken, gap), gap)
        places += here
        if here:
            bottom += thickness + gap
        else:
            bottom = min((b.top + gap for b in taken if b.top + gap > bottom), default=room.top)
    return places


def _stacked(lengths: Sequence[float], free: Box, gap: float) -> list[Box]:
    """Return places for as many cards as go into a strip, at its end."""
    used, count = 0.0, 0
    for length in lengths:
        more = used + length + (gap if count else 0.0)
        if more > free.width:
            break
        used, count = more, count + 1
    left, places = free.right - used, []
    for length in lengths[:count]:
        places.append(Box(left, free.bottom, length, free.height))
        left += length + gap
    return places


def _longest(strip: Box, taken: Sequence[Box], gap: float) -> Box:
    """Return the longest part of a strip that keeps a gap from taken boxes.

    Of parts of equal length, it is the last one.
    """
    best, left = Box(strip.right, strip.bottom, 0.0, strip.height), strip.left
    wide = [Box(b.left - gap, b.bottom - gap, b.width + 2 * gap, b.height + 2 * gap) for b in taken]
    ends = sorted((b.left, b.right) for b in wide if b.meets(strip))
    for start, end in (*ends, (strip.right, strip.right)):
        free = min(start, strip.right) - left
        if free >= best.width:
            best = Box(left, strip.bottom, free, strip.height)
        left = max(left, end)
    return best
