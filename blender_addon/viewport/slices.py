"""Slices: long work runs in the handler for as long as a view may wait, and goes on in a timer.

Work is a generator. It yields wherever it may pause, and is sent the scene again after each pause, so it keeps no
reference to Blender's data meanwhile. A change of the scene, a jump and a step back cancel the work. The next frames of
a playback do not: otherwise a slow scene would never be shown while it plays. When the work is done, the newest frame
is next.

Frames and changes in quick succession count as passing, and are worked out coarsely. When the scene rests, its frame is
worked out once more.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from contextlib import nullcontext

import bpy

from .. import changes, redraw, scene_time
from ..devices import skin_models
from ..preview import moment, skin_preview
from ..preview.rows import goes_on
from ..streaming import session

BUDGET = 0.012  # [s] that a view waits at most, plus the step under way; it is 29 % of a frame at 24 fps
PAUSE = 0.001  # [s] between slices: Blender handles waiting events
REST = 0.25  # [s] the scene rests once no frame and no change has come for this long

Steps = Generator[None, bpy.types.Scene, None]


def budget() -> float:
    """Return how long a view waits at most [s]; without a window there is no limit."""
    return BUDGET if redraw.watched() else math.inf


def rest() -> float:
    """Return after how long the scene rests [s]; without a window no frame is passing."""
    return REST if redraw.watched() else 0.0


def plays() -> bool:
    """Return whether an animation plays or somebody scrubs, however slowly the frames come."""
    screens = [window.screen for window in bpy.context.window_manager.windows]
    return any(screen.is_animation_playing or screen.is_scrubbing for screen in screens)


def followed(scene: bpy.types.Scene) -> bool:
    """Return whether a device follows the scene.

    Nothing is then worked out coarsely, because refining it later would move the device.
    """
    return session.streams(scene) and scene.dermis_stream.mode == "follow"


class Slices:
    """The work on the shown contents of a scene, one piece at a time.

    Args:
        begin: makes the work for a scene.
    """

    def __init__(self, begin: Callable[[], Steps]) -> None:
        self._begin = begin
        self._work: Steps | None = None
        self._of: tuple[int, int] = (0, 0)  # scene and edits that the work is for
        self._frame = 0.0
        self._passing = False
        self._came = -math.inf  # when a frame or a change came last, or the work on one was done
        self._at_rest = self._on_rest
        self._timer = self._on_timer  # Blender finds a timer by its object, and each access to a method makes one

    def busy(self, scene: bpy.types.Scene) -> bool:
        """Return whether there is work left for a scene."""
        return self._work is not None and self._of[0] == scene.session_uid

    def start(self, scene: bpy.types.Scene) -> None:
        """Work on the scene as it is now, as long as a view may wait; go on in a timer."""
        frame = scene_time.shown(scene)
        step = scene_time.clock(scene, 0.0).duration(frame - self._frame)
        goes = step == 0.0 or goes_on(step)
        passing = not followed(scene) and (plays() or time.perf_counter() - self._came < rest())
        if step != 0.0 or self._of != (scene.session_uid, changes.edits()):
            self._came = time.perf_counter()
        if not (self.busy(scene) and self._of[1] == changes.edits() and goes):
            self._renew(scene, frame, passing=passing)
        self._spend(scene)

    def cancel(self) -> None:
        """Drop the work that is under way, and its timers."""
        if self._work is not None:
            self._work.close()
        self._work = None
        for timer in (self._timer, self._at_rest):
            if bpy.app.timers.is_registered(timer):
                bpy.app.timers.unregister(timer)

    def _renew(self, scene: bpy.types.Scene, frame: float, *, passing: bool) -> None:
        self.cancel()
        self._passing = passing
        self._work, self._of, self._frame = self._begin(), (scene.session_uid, changes.edits()), frame
        next(self._work)

    def _spend(self, scene: bpy.types.Scene) -> None:
        """Work until it is done or the budget is spent; without a window the budget has no limit."""
        end = time.perf_counter() + budget()
        with skin_models.one_thread() if skin_preview.any_solved(scene) else nullcontext():
            while self._work is not None:
                self._step(scene)
                if time.perf_counter() >= end:
                    break
        if self._work is not None and not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=PAUSE)
        if self._work is None and skin_preview.coarse() and not bpy.app.timers.is_registered(self._at_rest):
            bpy.app.timers.register(self._at_rest, first_interval=rest())

    def _step(self, scene: bpy.types.Scene) -> None:
        assert self._work is not None
        try:
            with moment.held(self._frame, passing=self._passing):
                self._work.send(scene)
        except Exception as error:
            self._work = None
            if not isinstance(error, StopIteration):
                raise
            self._came = time.perf_counter()
            if scene_time.shown(scene) != self._frame:  # the play has gone on meanwhile
                self._renew(scene, scene_time.shown(scene), passing=rest() > 0.0 and not followed(scene))

    def _on_timer(self) -> float | None:
        scene = self._scene()
        if scene is None:
            self.cancel()
            redraw.request()
            return None
        self._spend(scene)
        redraw.views()
        return PAUSE if self._work is not None else None

    def _on_rest(self) -> float | None:
        """Work out again, finely, the frame at which the scene rests. Newer work sets this timer again."""
        scene = self._scene()
        if scene is None or self._work is not None or not skin_preview.coarse() or followed(scene):
            return None
        left = self._came + rest() - time.perf_counter()
        if left > 0.0 or plays():
            return max(left, REST)
        self._renew(scene, scene_time.shown(scene), passing=False)
        self._spend(scene)
        redraw.views()
        return None

    def _scene(self) -> bpy.types.Scene | None:
        """Return the scene that the work is for; None where it is gone or has changed since."""
        if self._of[1] != changes.edits() or changes.sweeping():
            return None
        return next((s for s in bpy.data.scenes if s.session_uid == self._of[0]), None)
