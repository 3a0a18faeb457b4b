"""Loading: work that needs nothing of Blender runs in a thread, so that no view waits for it.

It is for what takes long because files are read: modules of the engine, tables of skins. What computes for seconds
belongs into another process. In background nobody waits for a view, and the work is done at once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import bpy

from . import redraw
from ._core import core

POLL = 0.02  # [s] between two looks at what is being loaded
LIGHT = (
    "pipeline.trail",
    "surface.gap",
    "kernels.library",
    "matching.shear_tactor",
    "matching.friction_screen",
    "matching.thimble_use",
    "images.raster",
)
HEAVY = (
    "contact.skin_stepper",
    "matching.thimble",
    "matching.thimble_job",
    "matching.pins",
    "matching.lookup",
    "matching.replay",
    "matching.platforms",
    "devices.thimble",
    "skin.blas",
    "skin.stress_table",
    "tissue.stiffening_store",
    "tissue.finger_skin",
)


class _Task:
    """Work in a thread of its own."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self.value: Any = None
        self.error: BaseException | None = None
        self._work = work
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.value = self._work()
        except BaseException as error:  # whoever asks for the value gets it
            self.error = error


_tasks: dict[Hashable, _Task] = {}
_told: set[Hashable] = set()  # tasks that ended, and that views were drawn again for
_engine: set[bool] = set()  # whether with what solves skins


def value(key: Hashable, work: Callable[[], Any]) -> tuple[Any] | None:
    """Return what some work gives, as the only element; None while it runs.

    Args:
        key: of the work, by which it is asked for again. work: it must touch nothing of Blender.

    Raises:
        Exception: what the work raised, once; it is tried anew when it is asked for again.
    """
    if not redraw.watched():
        return (work(),)
    task = _tasks.get(key)
    if task is None:
        task = _tasks[key] = _Task(work)
        if not bpy.app.timers.is_registered(_on_timer):
            bpy.app.timers.register(_on_timer, first_interval=POLL)
    if task.thread.is_alive():
        return None
    del _tasks[key]
    _told.discard(key)
    if task.error is not None:
        raise task.error
    return (task.value,)


def engine(modules: Sequence[Any] = (), *, skins: bool) -> bool:
    """Return whether the modules are there that a preview needs; load them where they are not.

    Args:
        modules: of the add-on that are read with them, see `on_demand`. skins: also what solves skins, with scipy.
    """
    if not redraw.watched() or skins in _engine or True in _engine:
        return True
    if value(("engine", skins), lambda: _load(LIGHT + HEAVY if skins else LIGHT, modules)) is None:
        return False
    _engine.add(skins)
    return True


def finish() -> None:
    """Wait for all that is being loaded, and forget it."""
    for task in _tasks.values():
        task.thread.join()
    _tasks.clear()
    _told.clear()
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def _load(names: Sequence[str], modules: Sequence[Any]) -> None:
    for name in names:
        module: Any = core
        for part in name.split("."):
            module = getattr(module, part)
    if "skin.blas" in names:
        core.skin.blas.pools()
    for module in modules:
        vars(module)  # reads what is read on demand


def _on_timer() -> float | None:
    ended = {key for key, task in _tasks.items() if not task.thread.is_alive()}
    if ended - _told:
        _told.update(ended)
        redraw.request()
    return POLL if len(ended) < len(_tasks) else None
