"""Find the side of a fingertip on which the nail is.

The axes of bones do not show it, because every tool rolls bones differently. But a finger bends only towards the palm.
The back of a hand follows from its knuckles, its wrist, and whether it is a left or a right hand. This module does not
use Blender.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .._core import Array
from .bone_names import FINGERS, LEFT, RIGHT

_PALM = 0.3  # weight of the palm against the sine of a bend; a bend of 17 degrees has the same weight
_AGAINST = -0.25  # mean sine of the bends below which the named side is not believed: 15 degrees backwards
_SURE = 0.05  # evidence below this value is a guess
# Evidence of a thumb whose tip lies 10 degrees out of the plane of the knuckles; nearer to it, a thumb shows no side.
_OUT = 0.087
# A thumb's nail is turned outwards. These are the shares of the direction of the palm's back, and of the direction from
# the fingers to the thumb.
_THUMB = (0.45, 0.9)


@dataclass(frozen=True)
class Nails:
    """Directions of the nails at rest.

    Attributes:
        directions: direction of each finger's nail, perpendicular to its last phalanx.
        side: 'L' or 'R', from the position of the bones. sure: whether a name, a person, bends or the thumb show it;
            else it is a guess.
    """

    directions: Mapping[str, Array]
    side: str
    sure: bool


def nails(
    lines: Mapping[str, Array],
    wrist: Array | None,
    side: str,
    bends: Mapping[str, Array],
    *,
    given: bool = False,
    rigid: bool = False,
    bounded: bool = False,
) -> Nails:
    """Return the directions of the nails of a hand.

    Args:
        lines: joints of each finger at rest from the knuckle to the tip, shape (n, 3).
        wrist: place of the wrist, shape (3,); None without a bone there.
        side: 'L', 'R', or '' if names have no side.
        bends: `curl` of the posed fingers, rotated back to the rest; it has the same weight as that of the rest.
        given: a person has given the side, so no bend is believed against it.
        rigid: the fingers are links of a robot. The frame of its palm lies anywhere, so the wrist does not count. The
            frames of the first joints need not lie along the finger, so only the last joint and phalanx count.
            Importers set joints to zero, whichever way that bends a finger, so the side is sure only if the thumb shows
            it too.
        bounded: `bends` are those in the middle of the joints' limits, which count alone.
    """
    curls = {finger: 0.5 * (curl(line, finger, rigid) + bends[finger]) for finger, line in lines.items()}
    if bounded:
        curls = dict(bends)
    palm = _palm(lines, None if rigid else wrist)
    if palm is None:
        found = {finger: _square(lines[finger], curls[finger] + 1e-6 * _any(lines[finger])) for finger in lines}
        return Nails(found, side, any(np.linalg.norm(c) > _SURE for c in curls.values()))
    across, along, right_back = palm
    back = -right_back if side == LEFT else right_back
    fingers = [finger for finger in lines if finger != FINGERS[0]]
    carried = {finger: _carried(back, along, lines[finger][-2:] if rigid else lines[finger]) for finger in fingers}
    vote = float(np.mean([curls[finger] @ carried[finger] for finger in fingers]))
    sure = bool(side)
    if not side:
        thumb = _thumb_vote(lines, back)
        bent, vote = vote, vote + thumb
        shown = max(abs(thumb) - _OUT, 0.0) * np.sign(thumb) if (rigid and not bounded) or abs(bent) <= _SURE else vote
        sure = bool(abs(vote) > _SURE and shown * vote > 0.0)
    if given and vote < 0.0:
        curls = {finger: 0.0 * curled for finger, curled in curls.items()}
    elif vote < (_AGAINST if side else 0.0):
        back, carried = -back, {finger: -way for finger, way in carried.items()}
    found = {finger: _square(lines[finger], _PALM * carried[finger] + curls[finger]) for finger in fingers}
    if FINGERS[0] in lines:
        line = lines[FINGERS[0]]
        rest = _square(line, _THUMB[0] * back - _THUMB[1] * across)
        found[FINGERS[0]] = _square(line, _PALM * rest + curls[FINGERS[0]])
    return Nails(found, RIGHT if back @ right_back > 0 else LEFT, sure)


def curl(line: Array, finger: str, rigid: bool = False) -> Array:
    """Return the direction opposite to a finger's bend, times the bend's sine.

    Its shape is (3,). Of a thumb and of a robot's finger (`rigid`) only the last joint counts, because the other joints
    turn it as well.
    """
    ways = np.diff(line, axis=0)
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-30)
    ways = ways[-2:] if rigid or finger == FINGERS[0] else ways[-3:]
    axis = np.cross(ways[:-1], ways[1:]).sum(axis=0)
    return -np.cross(axis, ways[-1])


def bend_of_turns(line: Array, turns: Sequence[Array | None], finger: str) -> Array:
    """Return `curl` of a finger whose joints are turned, rotated back to the rest, shape (3,).

    Args:
        turns: the matrix that turns each of its bones about its head, shape (3, 3); None for no turn.
    """
    moved, points = np.eye(3), [line[0]]
    for turn, step in zip(turns, np.diff(line, axis=0), strict=True):
        moved = moved if turn is None else moved @ turn
        points.append(points[-1] + moved @ step)
    back: Array = np.linalg.inv(moved) @ curl(np.array(points), finger)
    return back


def _palm(lines: Mapping[str, Array], wrist: Array | None) -> tuple[Array, Array, Array] | None:
    """Return three unit directions of a palm; None if they are unknown.

    They are from the index finger to the little finger, from the wrist to the fingers, and out of the back of a right
    hand.
    """
    fingers = [finger for finger in FINGERS[1:] if finger in lines]
    if len(fingers) < 2:
        return None
    knuckles = np.array([lines[finger][0] for finger in fingers])
    reach = np.mean([lines[finger][-1] for finger in fingers], axis=0)
    along = (reach if wrist is None else knuckles.mean(axis=0)) - (knuckles.mean(axis=0) if wrist is None else wrist)
    across = knuckles[-1] - knuckles[0]
    back = np.cross(across, along)
    size = float(np.linalg.norm(back))
    if size <= 1e-3 * np.linalg.norm(across) * np.linalg.norm(along):
        return None
    across = np.cross(along, back)
    return across / np.linalg.norm(across), along / np.linalg.norm(along), back / size


def _carried(back: Array, along: Array, line: Array) -> Array:
    """Carry the direction of the hand's back along a finger, without a twist."""
    way = along
    for step in np.diff(line, axis=0):
        ahead = step / max(float(np.linalg.norm(step)), 1e-30)
        middle = way + ahead
        if (size := float(middle @ middle)) > 1e-9:
            back = back - 2.0 * (middle @ back) / size * middle  # two reflections make the smallest rotation
            back = back - 2.0 * (ahead @ back) * ahead
        way = ahead
    return back


def _thumb_vote(lines: Mapping[str, Array], back: Array) -> float:
    """Return evidence for `back` from the place of a thumb's tip.

    It is positive if the tip lies on the palm's side of the knuckles, as that of a real thumb does.
    """
    if FINGERS[0] not in lines:
        return 0.0
    thumb = lines[FINGERS[0]]
    knuckle = np.mean([line[0] for finger, line in lines.items() if finger != FINGERS[0]], axis=0)
    return -0.5 * float((thumb[-1] - knuckle) @ back) / max(float(np.linalg.norm(thumb[-1] - knuckle)), 1e-30)


def _square(line: Array, way: Array) -> Array:
    """Return the unit direction perpendicular to a finger's last phalanx."""
    ahead = line[-1] - line[-2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-30)
    way = way - (way @ ahead) * ahead
    size = float(np.linalg.norm(way))
    return way / size if size > 1e-12 else _square(line, _any(line))


def _any(line: Array) -> Array:
    """Return a direction not parallel to a finger's end: Z, else Y."""
    ahead = np.abs(line[-1] - line[-2])
    return np.array([0.0, 1.0, 0.0]) if ahead[2] > 0.9 * np.linalg.norm(ahead) else np.array([0.0, 0.0, 1.0])
