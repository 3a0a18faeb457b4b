"""Decide whether a scene is still as it was when a result was computed.

As long as Blender reports no change, it is. After a report, or after undo, the contents of the scene are compared with
those of then, so that a change that was taken back, or of another scene, makes no result out of date. In a window the
contents are read in short pieces; until they are known, a result counts as out of date.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import bpy

from .. import changes, redraw
from .._core import core
from ..sampling import scene_content

PIECE = 0.02
"""[s] Longest reading at a time while a window waits."""
REST = 0.05
"""[s] From the end of such a piece to the next one."""


@dataclass(eq=False)
class Inputs:
    """The contents of a scene when a result was computed.

    Attributes:
        edits: a value of `changes.edits()` at which the scene had these contents.
        content: the contents; None if they are not to be compared, so that any change makes the result out of date.
        asked: value of `changes.edits()` at the last comparison. differing: session uids of data that differed then.
    """

    edits: int
    content: scene_content.Content | None
    asked: int = -1
    differing: tuple[int, ...] = ()


@dataclass
class _Reading:
    """The contents of a scene as they are read."""

    edits: int
    steps: Generator[None, None, scene_content.Content]
    content: scene_content.Content | None = None
    rested: float = 0.0  # time at which the next piece may begin


_readings: dict[int, _Reading] = {}  # by the scene's session uid


def reading(scene: bpy.types.Scene) -> Generator[Any, None, Inputs]:
    """Read the present contents of a scene; yield progress, return `Inputs`."""
    edits, steps = changes.edits(), scene_content.steps(scene)
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return Inputs(edits, done.value)
        yield core.pipeline.bake.Progress("preparing", 0, 1)


def of(scene: bpy.types.Scene) -> Inputs:
    """Return the present contents of a scene, read at once."""
    made: Inputs = core.steps.drain(reading(scene))
    return made


def hold(scene: bpy.types.Scene, was: Inputs, *, wait: bool = False) -> bool:
    """Return whether a scene is as it was.

    False, too, while its contents are being read, or while a sweep moves the scene. Blender then redraws when the
    answer is known.

    Args:
        wait: read the contents to their end at once.
    """
    now = changes.edits()
    if was.edits == now:
        return True
    if was.content is None or was.asked == now or changes.sweeping():
        return False
    if _surely_differs(was):
        was.asked = now
        return False
    content = _read(scene, now, wait)
    if content is None:
        return False
    was.asked, was.differing = now, _differing(was.content, content)
    if not was.differing:
        was.edits = now
    return not was.differing


def changed(was: Inputs) -> tuple[str, ...]:
    """Return the names of data that differed at the last comparison, in order."""
    content = was.content or {}
    return tuple(sorted({content[uid].name for uid in was.differing if uid in content}))


def forget() -> None:
    """Drop unfinished readings, as after another file was opened."""
    _readings.clear()


def _surely_differs(was: Inputs) -> bool:
    """Return whether one of the data differs that differed last, or that were reported as changed.

    During a drag, this spares reading the whole scene at every step.
    """
    content, names = was.content or {}, changes.dirty()
    likely = (*was.differing, *(uid for uid, part in content.items() if part.name in names))
    for uid in dict.fromkeys(likely):
        if uid in content and scene_content.part(uid, content[uid]) != content[uid]:
            was.differing = (uid, *(other for other in was.differing if other != uid))
            return True
    return False


def _differing(before: scene_content.Content, now: scene_content.Content) -> tuple[int, ...]:
    """Return the session uids of data that are not in both contents with the same digest."""
    both = (*before, *(uid for uid in now if uid not in before))
    return tuple(u for u in both if u not in before or u not in now or before[u].digest != now[u].digest)


def _read(scene: bpy.types.Scene, now: int, wait: bool) -> scene_content.Content | None:
    """Read the present contents on; return None while a window has to wait for more."""
    kept = _readings.get(scene.session_uid)
    if kept is None or kept.edits != now:
        kept = _readings[scene.session_uid] = _Reading(now, scene_content.steps(scene))
    if kept.content is not None:
        return kept.content
    start, watched = time.perf_counter(), redraw.watched() and not wait
    if watched and start < kept.rested:
        redraw.request()
        return None
    try:
        while not watched or time.perf_counter() - start < PIECE:
            next(kept.steps)
    except StopIteration as done:
        kept.content = done.value
        return kept.content
    except ReferenceError:  # something was removed that Blender has not reported yet
        del _readings[scene.session_uid]
        return None
    kept.rested = time.perf_counter() + REST
    redraw.request()
    return None
