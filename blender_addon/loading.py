"""Work that needs nothing of Blender runs in a thread: no view waits for it.

`value` is for slow reading of files, such as modules of the engine and tables of skins. `aside` is for a step of a
view's contents that takes longer than the view may wait, such as the first contact after a jump. Work of several
seconds belongs in another process. In background nobody waits for a view, and the work is done at once.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, TypeVar

import bpy

from . import redraw
from ._core import core

POLL = 0.02  # [s] between two checks of running work
LOOK = 0.004  # [s] for which the window waits at most for work of `aside`, before it goes on with something else
PANELS = ("devices.kinds", "pipeline.skipping", "stream.state")
LIGHT = (
    "pipeline.trail",
    "surface.gap",
    "kernels.library",
    "matching.shear_tactor",
    "matching.friction_screen",
    "matching.voice_coil",
    "matching.thimble_use",
    "images.raster",
    "effects.map_repair",
    "effects.depth_map",
    "surface.curved",
    "track.file_names",
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
    "skin.recovery",
    "skin.stress_table",
    "skin.finger_skin",
    "work.processes",
)


_turn = threading.Lock()


class _Task:
    """Work in a thread of its own; only one such thread works at a time.

    Two at a time would keep the interpreter from the window twice as long.
    """

    def __init__(self, work: Callable[[], Any]) -> None:
        self.value: Any = None
        self.error: BaseException | None = None
        self._work = work
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            with _turn:
                self.value = self._work()
        except BaseException as error:  # raised again in the thread that takes the value
            self.error = error


T = TypeVar("T")
_aside: _Task | None = None
_aside_holds = ExitStack()  # keeps BLAS at one thread while work of `aside` runs
_tasks: dict[Hashable, _Task] = {}
_told: set[Hashable] = set()  # keys of tasks that have ended and for which a redraw was requested
_there: set[Hashable] = set()  # keys of the groups of modules that have been loaded


def value(key: Hashable, work: Callable[[], Any]) -> tuple[Any] | None:
    """Return the result of some work, as the only element; None while it runs.

    Args:
        key: identifies the work in later calls. work: the work; it must touch nothing of Blender.

    Raises:
        Exception: raised by the work. The next call with the key starts the work again.
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


def aside(work: Callable[[], T]) -> Generator[None, Any, T]:
    """Do some work in a thread, and yield as long as it runs; return its result.

    If the generator is not continued, the work still runs to its end. Nobody may use its data until `at_rest` returns
    True.

    Args:
        work: the work; it must touch nothing of Blender.

    Raises:
        Exception: raised by the work.
    """
    global _aside
    if not redraw.watched():
        return work()
    while not at_rest():
        yield
    _aside_holds.enter_context(core.skin.blas.one_thread())  # until `at_rest` finds it done
    task = _aside = _Task(work)
    while not at_rest():
        yield
    if task.error is not None:
        raise task.error
    value: T = task.value
    return value


def at_rest() -> bool:
    """Wait a moment for the work of `aside`; return whether it is done."""
    global _aside
    if _aside is not None:
        _aside.thread.join(LOOK)
        if _aside.thread.is_alive():
            return False
        _aside = None
        _aside_holds.close()
    return True


def settle() -> None:
    """Wait until the work of `aside` is done.

    Operators call this before they use the data of the previews.
    """
    while not at_rest():
        pass


def engine(modules: Sequence[Any] = (), *, skins: bool, more: Callable[[], Callable[[], None]] | None = None) -> bool:
    """Return whether the modules that a preview needs are loaded; else load them.

    Args:
        modules: modules of the add-on to load with them, see `on_demand`.
        skins: load the modules that solve skins, and scipy, too.
        more: returns a function that loads further items, and that runs in the thread.
    """
    return "skins" in _there or _read("skins" if skins else "engine", LIGHT + HEAVY * skins, modules, more)


def addon(modules: Sequence[Any]) -> bool:
    """Return whether modules of the add-on are loaded, see `on_demand`.

    If they are not, a thread loads them.
    """
    return _read("add-on", PANELS, modules, None)


def addon_loaded() -> bool:
    """Return whether the modules of `addon` are loaded. Without a window, nobody waits for them."""
    return not redraw.watched() or "add-on" in _there


def _read(
    key: Hashable, names: Sequence[str], modules: Sequence[Any], more: Callable[[], Callable[[], None]] | None
) -> bool:
    if not redraw.watched() or key in _there:
        return True
    if value(("modules", key), _loader(names, modules, more)) is None:
        return False
    _there.add(key)
    return True


def forget() -> None:
    """Wait for all work in threads, and forget it and its results."""
    settle()
    for task in _tasks.values():
        task.thread.join()
    _tasks.clear()
    _told.clear()
    _there.clear()
    gc.unfreeze()
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def _loader(
    names: Sequence[str], modules: Sequence[Any], more: Callable[[], Callable[[], None]] | None
) -> Callable[[], None]:
    also = None if more is None else more()  # called here because it queries Blender, which a thread must not

    def load() -> None:
        with _uncollected():
            _load(names, modules)
            if also is not None:
                also()

    return load


@contextmanager
def _uncollected() -> Iterator[None]:
    """Keep the garbage collector away from objects that a block loads.

    A full collection visits every object of the interpreter. Loading the modules makes one due. It takes 70 to 90 ms,
    during which no thread runs, not even the window's. Later collections leave out frozen objects. These are freed as
    before when nothing refers to them. `forget` unfreezes them.
    """
    gc.collect(1)  # young objects only, so that garbage among them is not frozen
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if collects:
            gc.enable()


def _load(names: Sequence[str], modules: Sequence[Any]) -> None:
    for name in names:
        module: Any = core
        for part in name.split("."):
            module = getattr(module, part)
    if "kernels.library" in names:
        import scipy.sparse.csgraph  # noqa: F401  (by which the engine tells the parts of a surface)

        core.kernels.library.have_kernels()  # loads them
    if "skin.blas" in names:
        core.skin.blas.pools()
    for module in modules:
        vars(module)  # loads the modules that load on demand


def _on_timer() -> float | None:
    ended = {key for key, task in _tasks.items() if not task.thread.is_alive()}
    if ended - _told:
        _told.update(ended)
        redraw.request()
    return POLL if len(ended) < len(_tasks) else None
