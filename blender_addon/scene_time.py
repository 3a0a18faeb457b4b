"""The only module that converts scene frames, evaluated frames and seconds.

A scene has three times:

* The *scene frame* is the number in the timeline, with its sub-frame. Playback, renders, the frame range, markers and
  `frame_set` use it. Frames of bakes, findings and the preview are scene frames.
* The *evaluated frame* is the frame at which Blender evaluates F-curves, drivers and simulations. Keys lie on it.
* *Seconds* are counted while the animation plays, from the first frame of a bake or recording.

Measured in Blender 4.5 and 5.2, with *Time Stretching* at Old o and New n:

* `Scene.frame_current_final` is the evaluated frame: `frame_float * (o / n)`, in single precision. With 100 and 200,
  scene frame 10 evaluates frame 5. Frame 0 stays frame 0, and negative frames are stretched too.
* F-curves, the driver variable `frame` and the node *Scene Time* (frame and seconds) see the evaluated frame. A driver
  that reads `Scene.frame_current` sees the whole part of the scene frame, as sub-frames are cut off.
* The stretch changes neither `frame_end` nor the speed of playback and renders: they show each scene frame of the
  range for `fps_base / fps` seconds. With 100 and 200 the same animation takes twice as many frames. Neither
  `frame_end` nor markers move by themselves.
* Rigid bodies and cloth step at whole evaluated frames and stand still between them. They stop where a whole evaluated
  frame is left out. A baked cache has all frames, with straight lines between them. Starts and ends of caches are
  evaluated frames. Cloth also takes o / n of its time step. Simulation nodes follow fractions of a frame.
* After a change of the stretch, the next update of the dependency graph evaluates what depends on time at the new
  frame. A change of the frame rate evaluates nothing. Both arrive in `depsgraph_update_post` as an update of the scene
  with neither `is_updated_transform` nor `is_updated_geometry` set. Neither stretch nor frame rate can be animated.
* `frame_set(-7, subframe=0.25)` reads back as frame -6 and sub-frame -0.75, whose sum is right. `frame_set` cuts a
  negative sub-frame to 0, and assigning a negative `frame_float` goes to frame 0. `go_to` therefore passes the frame
  rounded down, with a positive sub-frame.
* Timeline, dope sheet and graph editor draw frame numbers, ranges and markers at scene frames and go to scene frames
  when clicked. They draw keys and the line of the current frame at evaluated frames (read in Blender's source).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import bpy
import numpy as np

from ._core import Array

if TYPE_CHECKING:
    from fractions import Fraction

T = TypeVar("T", float, Array)


@dataclass(frozen=True)
class Clock:
    """Conversion between scene frames and seconds from a first frame.

    Attributes:
        rate: scene frames a second.
        first: scene frame at 0 s.
    """

    rate: Fraction
    first: float

    def seconds(self, frames: T) -> T:
        """Return the seconds at which scene frames are shown; negative before the first frame."""
        return self.duration(frames - self.first)

    def frames(self, seconds: T) -> T:
        """Return the scene frames that are shown at seconds."""
        return self.first + self.count(seconds)

    def duration(self, count: T) -> T:
        """Return the seconds that a number of scene frames takes."""
        return count * float(self.rate.denominator) / float(self.rate.numerator)

    def count(self, seconds: T) -> T:
        """Return the number of scene frames that are shown in a number of seconds."""
        return seconds * float(self.rate.numerator) / float(self.rate.denominator)


def rate(scene: bpy.types.Scene) -> Fraction:
    """Return the frame rate, fps / fps_base, as a fraction such as 30000/1001.

    Blender stores `fps_base` in single precision. It is replaced by a fraction of small denominator that rounds to the
    stored number.
    """
    return _rate(scene.render.fps, scene.render.fps_base)


@functools.lru_cache
def _rate(fps: int, base: float) -> Fraction:
    from fractions import Fraction  # registration need not wait for it

    denominator = 1
    while True:
        fraction = Fraction(base).limit_denominator(denominator)
        if fraction > 0 and np.float32(float(fraction)) == np.float32(base):
            return Fraction(fps) / fraction
        denominator *= 10


def clock(scene: bpy.types.Scene, first: float) -> Clock:
    """Return a scene's clock; its 0 s is at the scene frame `first`."""
    return _clock(scene.render.fps, scene.render.fps_base, float(first))


@functools.lru_cache
def _clock(fps: int, base: float, first: float) -> Clock:
    return Clock(_rate(fps, base), first)


def shown(scene: bpy.types.Scene) -> float:
    """Return the scene frame that is shown, with its sub-frame."""
    return float(scene.frame_float)


def go_to(scene: bpy.types.Scene, frame: float) -> None:
    """Evaluate the scene at a scene frame, negative ones with sub-frames included."""
    whole = math.floor(frame)
    scene.frame_set(whole, subframe=frame - whole)


def evaluated(scene: bpy.types.Scene, frames: T) -> T:
    """Return the evaluated frames of scene frames.

    A key must lie on the evaluated frame to act at the scene frame.
    """
    return frames * float(scene.render.frame_map_old) / float(scene.render.frame_map_new)


def shown_at(scene: bpy.types.Scene, evaluated_frames: T) -> T:
    """Return the scene frames at which evaluated frames are shown.

    Keys, for example, lie on evaluated frames.
    """
    return evaluated_frames * float(scene.render.frame_map_new) / float(scene.render.frame_map_old)


def simulated_frames(scene: bpy.types.Scene, start: int, span: tuple[int, int]) -> Array:
    """Return the scene frames at which simulations take a step, shape (n,).

    They go from the start of the simulations, or of the range if that is earlier, to the first step at or after the end
    of the range. Each is rounded up where necessary, so that in single precision Blender still evaluates the whole
    frame, and no step is left out.

    Args:
        start: first evaluated frame of the simulations.
        span: first and last scene frame of the range.
    """
    first, last = (evaluated(scene, float(frame)) for frame in span)
    length = np.float32(scene.render.frame_map_old) / np.float32(scene.render.frame_map_new)
    frames = []
    for whole in range(min(start, math.floor(first)), math.ceil(last) + 1):
        frame = np.float32(shown_at(scene, float(whole)))
        while frame * length < whole:  # rounded down, Blender would still evaluate the whole frame before
            frame = np.nextafter(frame, np.float32(np.inf))
        frames.append(float(frame))
    return np.array(frames)


def stretch(scene: bpy.types.Scene) -> float:
    """Return how many times as long the animation takes with *Time Stretching*."""
    return shown_at(scene, 1.0)


def settings(scene: bpy.types.Scene) -> tuple[float, ...]:
    """Return the settings that decide when frames are shown and evaluated, to compare."""
    render = scene.render
    return (render.fps, render.fps_base, render.frame_map_old, render.frame_map_new)
