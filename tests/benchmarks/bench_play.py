"""What a frame costs while an animation plays: everything of ours that Blender's frame handler does, in every demo.

Measured is the processor's time from Blender's evaluation of a frame to what is drawn: sampling the scene, contact with
its history, devices, stress and deformed surfaces. The evaluation itself (frame_set) is outside the clock. The play
begins 60 frames before the frames that count, which are those where everything touches. As in a window that plays,
frames are only passed: contact walks from one to the next in few steps.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple
from unittest import mock

from . import Result, benchmark, timing

PLAYED, EARLY, TIMES = 60, 10, 3  # frames before, frames before the early ones, plays
TAIL = 2.0  # a frame in twenty may take so many times the median: a playback stumbles over the slow ones


class Play(NamedTuple):
    """A scene by its name, and which of its frames count."""

    build: str
    frames: range


DEMO = Play("demo", range(70, 90))
PINS, THIMBLE = Play("pins", range(90, 110)), Play("thimble", range(40, 60))
FIVE = Play("five", range(28, 46))


@benchmark("scrub_demo_ms", limit=4.0, quick=True, tail=TAIL)
def scrub_demo() -> Result:
    """Two fingers with shear tactors lift a box, one reads a friction screen."""
    return _result("scrub_demo_ms", DEMO)


@benchmark("scrub_thimble_ms", limit=4.0, tail=TAIL)
def scrub_thimble() -> Result:
    """A thimble on a finger that presses a ball."""
    return _result("scrub_thimble_ms", THIMBLE)


@benchmark("scrub_pins_ms", limit=6.0, tail=TAIL)
def scrub_pins() -> Result:
    """A pin array on a finger that a plane slides under."""
    return _result("scrub_pins_ms", PINS)


@benchmark("scrub_5fingers_ms", limit=10.0, tail=TAIL)
def scrub_5fingers() -> Result:
    """Five draft skins with thimbles, all in contact; the standard skins are the peer."""
    peer = timing(_times(Play("five, standard", FIVE.frames))[1]).median
    return _result("scrub_5fingers_ms", FIVE, {"standard skins": peer})


@benchmark("scrub_growth", limit=1.1)
def scrub_growth() -> Result:
    """A frame after 60 frames of play over the same frame after 10, the worst demo."""
    ratios = {}
    for play in (DEMO, THIMBLE, PINS, FIVE):
        early, late = _times(play)
        ratios[play.build] = timing(late).median / timing(early).median
    return Result("scrub_growth", max(ratios.values()), "1", None, ratios)


@benchmark("idle_frame_us", limit=20.0)
def idle_frame() -> Result:
    """A scene without fingers."""
    with _blender() as handler:
        import bpy

        scene = bpy.context.scene
        times = [1e3 * t for t in _played(scene, handler, range(1, 400))]
    return Result("idle_frame_us", timing(times[100:]).median, "us", timing(times[100:]).p95)


def _result(name: str, play: Play, peers: dict[str, float] | None = None) -> Result:
    early, late = _times(play)
    peers = {f"after {EARLY} frames": timing(early).median, **(peers or {})}
    return Result(name, timing(late).median, "ms", timing(late).p95, peers)


@functools.cache
def _times(play: Play) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the times of the frames that count [ms]: after a few frames of play, and after a minute's worth."""
    with _blender() as handler:
        import bpy

        scene = _built(play.build)
        bpy.context.window.scene = scene
        found = []
        for before in (EARLY, PLAYED):
            times: list[float] = []
            for _ in range(TIMES):
                _forget()
                played = range(play.frames.start - before, play.frames.stop)
                times += list(_played(scene, handler, played))[before:]
            found.append(tuple(times))
        return found[0], found[1]


def _played(scene: Any, handler: Callable[[Any], None], frames: range) -> Iterator[float]:
    """Yield the processor's time of each frame [ms]."""
    for frame in frames:
        scene.frame_set(frame)
        started = time.process_time()
        handler(scene)
        yield 1e3 * (time.process_time() - started)


def _forget() -> None:
    """Begin a play at rest: what was seen before would only be shown again."""
    from blender_addon.preview import device_preview, skin_preview

    device_preview.reset()
    skin_preview.reset()


def _built(name: str) -> Any:
    from blender_addon.demos import demo_pins, demo_scene, demo_skin, demo_thimble

    if name == "demo":
        return demo_scene.build("haptip", "electrovibration")
    if name == "thimble":
        return demo_thimble.build("BALL")
    if name == "pins":
        return demo_pins.build()
    scene = demo_skin.build(5)
    for obj in scene.objects:
        if obj.dermis.role == "FINGER":
            obj.dermis.finger.devices.add().preset = "thimble_3rrs"
            if name.endswith("standard"):
                obj.dermis.finger.skin.level = "standard"
    return scene


@contextmanager
def _blender() -> Iterator[Callable[[Any], None]]:
    """Register the add-on in an empty file; give what its frame handler does, which Blender itself skips here."""
    import bpy

    import blender_addon

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        from blender_addon import choices
        from blender_addon.viewport import shown, slices

        choices.refresh()
        with mock.patch.object(slices, "rest", lambda: math.inf):
            yield shown.on_frame  # without a window all of it: what a view would get in slices too
    finally:
        blender_addon.unregister()
        bpy.ops.wm.read_factory_settings(use_empty=True)
