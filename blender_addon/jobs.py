"""Running of the engine's generators: in steps in a window, at once elsewhere.

A step takes a few milliseconds. Work of child processes is such a generator, too: it follows their jobs, and closing it
ends them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any, NamedTuple

import bpy

from . import loading, on_demand, reporting
from ._core import DermisError, core
from .sampling import scene_sweep
from .streaming import session

WORK_SECONDS = 0.05
"""[s] Work between two checks of the keyboard."""
TIMER_SECONDS = 0.01
"""[s] From one timer event to the next."""
REDRAW_SECONDS = 0.25
"""[s] From one redraw of the side bars, which show a job's progress, to the next."""

Steps = Generator[Any, None, Any]

_running: list[Steps] = []


class Progress(NamedTuple):
    """Progress of the running job: title, share up to 1, and words."""

    title: str
    share: float
    words: str


_progress: Progress | None = None
_drawn = 0.0  # [s] time of the last request to redraw the side bars


def progress() -> Progress | None:
    """Return the progress of the running job; None without one."""
    return _progress


def _show(now: Progress | None) -> None:
    """Keep a job's progress, and redraw the side bars, but not at every step."""
    global _progress, _drawn
    _progress = now
    clock = time.perf_counter()
    if now is not None and clock - _drawn < REDRAW_SECONDS:
        return
    _drawn = clock
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            for region in area.regions:
                if area.type == "VIEW_3D" and region.type == "UI":
                    region.tag_redraw()


class Job:
    """Mixin for operators with long work.

    In a window the work is modal, with progress, and Esc ends it. Elsewhere it is done at once. An operator defines
    `steps` and `finished`. Between two events only the generator is kept, which looks up Blender's objects again.
    """

    job_title = "Dermis"
    after_cancel = "nothing was changed"  # words after 'was cancelled;'
    if TYPE_CHECKING:
        report: Callable[[set[str], str], None]  # Blender's, of the operator that this is mixed into
        _steps: Steps | None
        _timer: Any
    else:  # without annotations, because Blender evaluates all annotations of an operator
        _steps = _timer = None

    def steps(self, context: bpy.types.Context) -> Steps:
        """Return the work, not yet begun."""
        raise NotImplementedError

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Take the result; return the operator's return value."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Do the work at once: from a script, in background, or as 'redo'."""
        loading.settle()
        return self._finish(context, lambda: core.steps.drain(self.steps(context)))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Start work between the window's events; without a window, do it at once."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        loading.settle()
        self._steps = self.steps(context)
        _running.append(self._steps)
        manager = context.window_manager
        self._timer = manager.event_timer_add(TIMER_SECONDS, window=context.window)
        manager.progress_begin(0.0, 1.0)
        context.window.cursor_modal_set("WAIT")
        manager.modal_handler_add(self)
        _show(Progress(self.job_title, 0.0, "preparing"))
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Work for a while at each timer event; end at Esc; ignore all other events."""
        if event.type == "ESC" and event.value == "PRESS":
            if event.shift:  # Shift Esc stops a device, but this operator gets the key before the stop operator
                session.stop()
            self._end(context)
            self.report({"INFO"}, f"{self.job_title} was cancelled; {self.after_cancel}")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        if self._steps not in _running:  # the add-on was disabled meanwhile
            self._end(context)
            return {"CANCELLED"}
        end = time.perf_counter() + WORK_SECONDS
        try:
            progress = None
            while time.perf_counter() < end:
                progress = next(self._steps)
            self._tell(context, progress)
        except StopIteration as stop:
            self._end(context)
            result = stop.value
            return self._finish(context, lambda: result)
        except DermisError as error:
            self._end(context)
            return reporting.report_error(self, error, self.job_title)
        except BaseException:
            self._end(context)  # a defect: Blender prints it; the window must not stay locked
            raise
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """End the work because Blender ends the operator, as when a file is opened."""
        self._end(context)

    def _finish(self, context: bpy.types.Context, work: Callable[[], Any]) -> set[str]:
        """Take the result of some work; a refusal is reported."""
        try:
            return self.finished(context, work())
        except DermisError as error:
            return reporting.report_error(self, error, self.job_title)

    def _tell(self, context: bpy.types.Context, progress: Any) -> None:
        if progress is None or not progress.total:
            return
        share = min(progress.done / progress.total, 1.0)
        context.window_manager.progress_update(share)
        if context.workspace is not None:
            done = f"{progress.stage} {progress.done} of {progress.total} ({share:.0%})"
            _show(Progress(self.job_title, share, f"{progress.stage}, {share:.0%}"))
            context.workspace.status_text_set(f"{self.job_title}: {done}   |   Esc: cancel")

    def _end(self, context: bpy.types.Context) -> None:
        """Close the generator, which restores the scene, and give the window back."""
        steps, self._steps = self._steps, None
        if steps is not None:
            steps.close()
            if steps in _running:
                _running.remove(steps)
        timer, self._timer = self._timer, None
        if timer is None:
            return
        _show(None)
        manager = context.window_manager
        manager.event_timer_remove(timer)
        manager.progress_end()
        if context.window is not None:
            context.window.cursor_modal_restore()
        if context.workspace is not None:
            context.workspace.status_text_set(None)


def register() -> None:
    """Nothing to register: jobs are part of the operators that use them."""


def unregister() -> None:
    """Stop all running jobs, so that none goes on without the add-on."""
    while _running:
        _running.pop().close()
    _show(None)
    for sweeps in on_demand.read(scene_sweep):
        sweeps.forget()
