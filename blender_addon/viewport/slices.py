"""Slices: what may take longer than a view waits is done in the handler for as long as that, and then in a timer.

Work is a generator that is sent the scene and yields wherever it may rest, so that nothing of Blender's is kept
meanwhile. The next change cancels it; the next frames of a play do not, or a slow scene would never be shown while it
plays: they wait until it is done, and the newest of them comes next.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from contextlib import nullcontext

import bpy

from .. import changes, redraw
from ..devices import skin_models
from ..preview import moment, skin_preview
from ..preview.rows import goes_on

BUDGET = 0.012  # [s] that a view waits at most, but for one step of the work; half of a frame is left for Blender
PAUSE = 0.001  # [s] between slices: Blender handles what came in

Steps = Generator[None, bpy.types.Scene, None]


def budget() -> float:
    """Return how long a view waits [s]; without a window nobody does."""
    return math.inf if bpy.app.background else BUDGET


class Slices:
    """The work on what is shown of a scene, one piece at a time.

    Args:
        begin: makes the work for a scene.
    """

    def __init__(self, begin: Callable[[], Steps]) -> None:
        self._begin = begin
        self._work: Steps | None = None
        self._of: tuple[int, int] = (0, 0)  # scene and edits that the work is for
        self._frame = 0.0
        self._timer = self._on_timer  # Blender knows a timer by its very object, and a method is another one each time

    def busy(self, scene: bpy.types.Scene) -> bool:
        """Return whether there is work left for a scene."""
        return self._work is not None and self._of[0] == scene.session_uid

    def start(self, scene: bpy.types.Scene) -> None:
        """Work on the scene as it is now, as long as a view may wait; go on in a timer."""
        frame = float(scene.frame_current_final)
        step = (frame - self._frame) * scene.render.fps_base / scene.render.fps
        goes = step == 0.0 or goes_on(step)
        if not (self.busy(scene) and self._of[1] == changes.edits() and goes):
            self._renew(scene, frame)
        self._spend(scene)

    def cancel(self) -> None:
        """Leave the work where it is."""
        if self._work is not None:
            self._work.close()
        self._work = None
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)

    def _renew(self, scene: bpy.types.Scene, frame: float) -> None:
        self.cancel()
        self._work, self._of, self._frame = self._begin(), (scene.session_uid, changes.edits()), frame
        next(self._work)

    def _spend(self, scene: bpy.types.Scene) -> None:
        """Work until it is done or the budget is spent; without a window nobody waits."""
        end = time.perf_counter() + budget()
        with skin_models.one_thread() if skin_preview.any_solved(scene) else nullcontext():
            while self._work is not None:
                self._step(scene)
                if time.perf_counter() >= end:
                    break
        if self._work is not None and not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=PAUSE)

    def _step(self, scene: bpy.types.Scene) -> None:
        assert self._work is not None
        try:
            with moment.held(self._frame):
                self._work.send(scene)
        except Exception as error:
            self._work = None
            if not isinstance(error, StopIteration):
                raise
            if float(scene.frame_current_final) != self._frame:  # the play has gone on meanwhile
                self._renew(scene, float(scene.frame_current_final))

    def _on_timer(self) -> float | None:
        scene = next((s for s in bpy.data.scenes if s.session_uid == self._of[0]), None)
        if scene is None or self._of[1] != changes.edits() or changes.sweeping():
            self.cancel()
            redraw.request()
            return None
        self._spend(scene)
        redraw.views()
        return PAUSE if self._work is not None else None
