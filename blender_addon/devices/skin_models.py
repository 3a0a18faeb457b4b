"""Make, read and cache the models of skins.

A skin is made once, shared by all fingers of the same size, and kept on disk in the extension's user folder. With a
window, a child process makes a new skin and a thread reads it from disk; until then callers get None. A child process
also makes the table of a smooth pad for lengths that no preset has. A preview goes on without that table, a bake waits
for it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Collection, Generator, Mapping
from contextlib import AbstractContextManager
from typing import Any, Literal, NamedTuple, overload

import bpy

from .. import loading, redraw
from .._core import DermisError, core
from ..preferences import user_folder

LIMIT_BYTES = 4_000_000_000
PAD = "pad"  # stands for a level in a key, and names a job: the table of the smooth pad
THIMBLE = "thimble"  # names a job: the tables with which a thimble follows a skin
POLL = 0.1  # [s] interval at which child processes are polled
Key = tuple[str, frozenset[tuple[str, Any]]]  # a level, or a table's name, and the parameters that shape the skin


class _Lawful(NamedTuple):
    """A skin whose tissue follows the law, and the linear skin it is made of."""

    linear: core.skin.model.SkinModel
    made: core.skin.model.SkinModel


on_read: Callable[[core.skin.model.SkinModel], None] | None = None
"""Function that the thread which reads a skin calls with it; `viewport/shown` sets it to prepare the drawing."""

_models: core.recent.Recent[Key, core.skin.model.SkinModel] = core.recent.Recent(8)
_making: dict[Key, core.work.executor.JobFuture] = {}
_progress: dict[Key, float] = {}
_failed: dict[Key, BaseException] = {}
_lawful: core.recent.Recent[Key, _Lawful] = core.recent.Recent(8)
_there: set[Key] = set()  # keys of the tables that are known to exist


def cache() -> core.cache.Cache:
    """Return the size-capped folder of condensed skins."""
    return core.cache.Cache(user_folder("skins", create=True), LIMIT_BYTES)


def one_thread() -> AbstractContextManager[Any]:
    """Limit the BLAS of numpy and scipy to one thread.

    With more threads they compete for the cores, and take up to 100 times as long.
    """
    return core.skin.blas.one_thread()


def solved_in(tactile: core.scene.tactile_scene.TactileScene, presets: core.presets.Library) -> bool:
    """Return whether rendering a sampled scene solves skins.

    It does if a skin is shown, or if a device follows one.
    """
    return any(_solved(finger, presets) for finger in tactile.fingers)


def _solved(finger: core.scene.tactile_scene.Finger, presets: core.presets.Library) -> bool:
    return bool(finger.parameters.get("skin_shown")) or _followed(finger, presets)


def _followed(finger: core.scene.tactile_scene.Finger, presets: core.presets.Library) -> bool:
    """Return whether a device that a finger wears follows its skin."""
    for key in {device.preset for device in finger.devices}:
        try:
            if presets.device(key).follows_skin:
                return True
        except DermisError:
            continue  # rendering reports why the device is left out
    return False


@overload
def get(
    skin: Mapping[str, float], level: str, tissue: str = ..., *, where: str = ..., wait: Literal[True]
) -> core.skin.model.SkinModel: ...
@overload
def get(
    skin: Mapping[str, float], level: str, tissue: str = ..., *, where: str = ..., wait: bool = ...
) -> core.skin.model.SkinModel | None: ...
def get(
    skin: Mapping[str, float], level: str, tissue: str = "linear", *, where: str = "skin", wait: bool = False
) -> core.skin.model.SkinModel | None:
    """Return a skin's model, or None while it is being made.

    Args:
        skin: size and material in SI, as in a skin preset.
        tissue: 'linear' or 'neo_hookean'.
        wait: make the model in this call, however long that takes.

    Raises:
        DermisError: a size that leaves no room for tissue, or a model that could not be made.
    """
    key = _key(skin, level)
    if key not in _models:
        if key in _failed:
            raise _failed.pop(key)
        if not wait and redraw.watched() and not _read(key, skin, level, tissue, where):
            return None
    model = _models.make(
        key, lambda: core.skin.model.skin_from_parameters(skin, level=level, cache=cache(), where=where)
    )
    young, alpha = float(skin.get("young", model.material.young)), float(skin.get("alpha", model.material.alpha))
    if (young, alpha) != (model.material.young, model.material.alpha):
        model = model.with_material(young=young, alpha=alpha)
        _models[key] = model
    return model if tissue == "linear" else _by_law(key, model)


def _read(key: Key, skin: Mapping[str, float], level: str, tissue: str, where: str) -> bool:
    """Start to make or to read a skin; return whether it is in memory."""
    kept, core_skin = cache(), core.skin.model
    if not _finished(key) and not core_skin.is_kept(skin, level=level, cache=kept, where=where):
        _begin(key, skin, level)
        return False

    def read() -> tuple[core.skin.model.SkinModel, bool]:
        model = core_skin.skin_from_parameters(skin, level=level, cache=kept, where=where)
        assert model.unit_response.size and model.operator
        smooth = core.skin.surface_store.smooth_pad(model)
        if smooth is not None:
            chart = smooth.chart
            assert smooth.cells.extent and chart.tiles.ways.size and chart.levels.size
            assert smooth.coarse[chart.base].size
        if on_read is not None:
            on_read(model)
        return model, smooth is not None

    found = loading.value(("skin", key, tissue), read)
    if found is None:
        return False
    model, pad = found[0]
    if pad:
        _there.add(_key(skin, PAD))
    _models.make(key, lambda: model)
    return True


def of(parameters: Mapping[str, Any], *, where: str = "skin", wait: bool = False) -> core.skin.model.SkinModel | None:
    """Return the skin of a finger's parameters, as `get` does."""
    tissue = str(parameters.get("tissue", "linear"))
    return get(parameters["skin"], str(parameters["skin_level"]), tissue, where=where, wait=wait)


def _by_law(key: Key, model: core.skin.model.SkinModel) -> core.skin.model.SkinModel:
    """Return a skin whose tissue follows the law, cached for its linear skin."""
    kept = _lawful.get(key)
    if kept is not None and kept.linear is model:
        return kept.made
    if kept is None or kept.linear.mesh is not model.mesh:
        made = model.with_law()
    else:  # only the stiffness differs: the parts made for the law are used again
        made = kept.made.with_material(young=model.material.young, alpha=model.material.alpha)
    _lawful[key] = _Lawful(model, made)
    return made


def wants_pad(parameters: Mapping[str, Any]) -> bool:
    """Return whether a finger needs a smooth pad's table that is not made yet.

    It needs the table if its contact is solved on points of the smooth skin.

    Raises:
        DermisError: a size that leaves no room for tissue.
    """
    if parameters["contact"] != "points":
        return False
    return _unmade(parameters["skin"], PAD, core.skin.surface_store.find_remainder)


def _unmade(skin: Mapping[str, Any], table: str, find: Callable[..., object | None]) -> bool:
    """Return whether a table of a fingertip is not made yet.

    Every call searches the disk until the table is found.
    """
    if "mesh" in skin or _key(skin, table) in _there:
        return False
    shape, material = core.skin.model.shape_and_material(skin)
    shipped = core.skin.surface_store.SHIPPED
    if shape is not None and find(shape, material.poisson, shipped=shipped, cache=cache()) is None:
        return True
    _there.add(_key(skin, table))
    return False


def tables_there() -> int:
    """Return the number of tables known to exist.

    When it rises, devices may be matched on another form of a skin.
    """
    return len(_there)


def make_pad(skin: Mapping[str, float]) -> float | None:
    """Let a child process make the table of a skin's smooth pad.

    Returns the progress from 0 to 1; None if the table could not be made.
    """
    return _made(skin, PAD)


def make_followed(skin: Mapping[str, float], parameters: Mapping[str, Any]) -> float | None:
    """Let a child process make the tables of a thimble on a skin.

    Returns the progress from 0 to 1; None when the tables are made.

    Args:
        parameters: parameters of the job other than the skin and its cache.

    Raises:
        DermisError: the tables could not be made; the next call tries again.
    """
    key = _key(skin, json.dumps([THIMBLE, parameters], sort_keys=True))
    if key in _failed:
        raise _failed.pop(key)
    if _finished(key):
        return None
    _begin(key, skin, THIMBLE, parameters)
    return _progress[key]


def _made(skin: Mapping[str, float], table: str) -> float | None:
    key = _key(skin, table)
    if key in _failed:
        return None
    if not _finished(key):
        _begin(key, skin, table)
    return _progress[key]


def make_tables(
    tactile: core.scene.tactile_scene.TactileScene, presets: core.presets.Library, tried_on: Collection[str] = ()
) -> Generator[core.pipeline.bake.Progress, None, None]:
    """Make the tables of skins that a bake will need; yield progress.

    Without a table that could not be made, the bake solves contact at the mesh's nodes and reports it.

    Args:
        tried_on: names of fingers on which devices are tried; their tables are made whatever the fingers wear.
    """
    for finger in tactile.fingers:
        if finger.name in tried_on or _solved(finger, presets):
            yield from tables_made(finger.parameters)


def tables_made(parameters: Mapping[str, Any]) -> Generator[core.pipeline.bake.Progress, None, None]:
    """Make the table of a finger's skin if `wants_pad`; yield progress.

    Closing the generator ends a child process that it started.
    """
    skin = parameters["skin"]
    try:
        if not wants_pad(parameters):
            return
    except DermisError:
        return
    key = _key(skin, PAD)
    mine = key not in _making
    try:
        while (done := make_pad(skin)) is not None and done < 1.0:
            yield core.pipeline.bake.Progress("skin", round(100 * done), 100)
            time.sleep(POLL / 5)  # the timer may not run meanwhile, so `_tick` is called here
            _tick()
    finally:
        if mine and key in _making:
            _making.pop(key).cancel()
            _progress.pop(key, None)


def progress(skin: Mapping[str, float], level: str) -> float | None:
    """Return the progress of making a skin, 0 to 1; None if it is not begun."""
    return _progress.get(_key(skin, level))


def forget() -> None:
    """Drop all models from memory, and cancel those being made.

    Models on disk stay.
    """
    for job in _making.values():
        job.cancel()
    _making.clear()
    _progress.clear()
    _models.clear()
    _lawful.clear()
    _there.clear()
    _failed.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _key(skin: Mapping[str, float], level: str) -> Key:
    return level, frozenset(item for item in skin.items() if item[0] not in ("young", "alpha"))


def _finished(key: Key) -> bool:
    return _progress.get(key) == 1.0 and key not in _making


def _begin(key: Key, skin: Mapping[str, float], level: str, told: Mapping[str, Any] | None = None) -> None:
    """Start a child process that puts a skin or table into the cache.

    A timer polls its progress.
    """
    if key in _making:
        return
    executor = core.work.processes.ProcessExecutor()
    parameters = {"skin": dict(skin), "folder": str(cache().folder), "limit": LIMIT_BYTES}
    job, more = (level, told or {}) if level in (PAD, THIMBLE) else ("skin", {"level": level})
    _making[key] = executor.submit(job, {}, {**more, **parameters})
    executor.shutdown(wait=False)  # its process ends with the job
    _progress[key] = 0.0
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=POLL)


def _reread(key: Key) -> None:
    """Drop the skins of a new table, so that a thread reads them with it."""
    level, geometry = key
    if level == PAD and redraw.watched():
        for other in [k for k in _models if k[1] == geometry]:
            del _models[other]


def _tick() -> float | None:
    """Read the progress and the results of the child processes."""
    for key, job in list(_making.items()):
        done, total = job.progress()
        _progress[key] = min(done / max(total, 1), 0.99)
        if job.done():
            del _making[key]
            _progress[key] = 1.0
            _reread(key)
            if (error := job.exception()) is not None:
                _failed[key] = error
                del _progress[key]
    redraw.request()  # views that wait show the progress, or begin
    return POLL if _making else None
