"""A gesture as poses of a finger over time: come down, press, hold, slide along the surface, lift."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

from mathutils import Matrix, Quaternion, Vector

from .surfaces import Spot, frame_on

_STEP = 1.0e-3  # [m] of the slide between keys: a curved surface is followed
_MOST = 500  # keys of a slide


@dataclass(frozen=True)
class Gesture:
    """A finger's movement, in metres and seconds.

    Attributes:
        height: above the surface, from which it comes and to which it lifts. approach: speed there [m/s].
        depth: depth of the press; the bone is this far below its position at first touch.
        hold: time before it slides [s].
        slide: way along the surface. speed: on it [m/s]. direction: angle about the normal, 0 to the tip [rad].
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
    """Return times [s] from the beginning, and the finger's frames then, in scene units.

    Args:
        start: the finger's frame, which says where its tip points. spot: where it touches first.
        nearest: returns the nearest spot of the surface. unit: metres in a scene unit.
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
    """Return a frame moved along its own nail."""
    return Matrix.Translation(height * frame.to_3x3().col[2]) @ frame
