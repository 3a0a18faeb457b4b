"""Compute the poses of a finger in a gesture.

The finger comes down, presses, holds, slides along the surface, and lifts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

from mathutils import Matrix, Quaternion, Vector

from .surfaces import Spot, frame_on

_STEP = 1.0e-3  # [m] length of the slide between keys, small enough to follow a curved surface
_MOST = 500  # largest number of keys of a slide


@dataclass(frozen=True)
class Gesture:
    """A finger's movement, in metres and seconds.

    Attributes:
        height: height above the surface at the begin and the end. approach: speed of coming down and lifting [m/s].
        depth: depth of the press; the bone is this far below its position at first touch.
        hold: time before it slides [s].
        slide: length of the slide along the surface. speed: speed of the slide [m/s].
        direction: direction of the slide, as an angle about the normal from the direction of the tip [rad].
    """

    height: float
    approach: float
    depth: float
    hold: float
    slide: float
    speed: float
    direction: float


def poses(
    gesture: Gesture, start: Matrix, spot: Spot, nearest: Callable[[Vector], Spot | None], unit: float
) -> tuple[list[float], list[Matrix]]:
    """Return times [s] from the beginning, and the finger's frames then.

    Frames are in scene units.

    Args:
        start: the finger's frame, which gives the direction of its tip. spot: the place of first touch.
        nearest: function that returns the nearest spot of the surface. unit: [m] length of a scene unit.
    """
    frame = frame_on(spot, start.to_3x3().col[1])
    times = [0.0, gesture.height / gesture.approach]
    frames = [raised(frame, gesture.height / unit), frame]
    if gesture.depth > 0.0:
        times.append(times[-1] + gesture.depth / gesture.approach)
        frames.append(raised(frame, -gesture.depth / unit))
    if gesture.hold > 0.0:
        times.append(times[-1] + gesture.hold)
        frames.append(frames[-1])
    count = min(ceil(gesture.slide / _STEP), _MOST)
    turn = Quaternion((0.0, 0.0, 1.0), gesture.direction)
    for _ in range(count):
        step = frame.to_3x3() @ (turn @ Vector((0.0, gesture.slide / count / unit, 0.0)))
        at = nearest(frame.translation + step)
        if at is None:
            break
        way = (at.point - frame.translation).length * unit
        frame = frame_on(at, frame.to_3x3().col[1])
        times.append(times[-1] + max(way, 1e-6) / gesture.speed)
        frames.append(raised(frame, -gesture.depth / unit))
    times.append(times[-1] + (gesture.depth + gesture.height) / gesture.approach)
    frames.append(raised(frame, gesture.height / unit))
    return times, frames


def raised(frame: Matrix, height: float) -> Matrix:
    """Return a frame moved along its own Z, towards the nail."""
    return Matrix.Translation(height * frame.to_3x3().col[2]) @ frame
