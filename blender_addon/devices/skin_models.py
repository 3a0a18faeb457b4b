"""The skins at hand: made once, shared by all fingers of the same size, kept on disk in the extension's user folder.

In a window a child process makes a skin that nobody has made before, a thread reads it from the disk, and whoever asked
gets None until it is there. A child process also makes the table of a smooth pad, for lengths that no preset has, and
where devices follow skin that stiffens the series that these are matched by: a preview goes on without them, a bake
waits.
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
PAD, STIFFENING = "pad", "stiffening"  # in place of a level, and jobs: tables of the smooth pad, and of its tissue
THIMBLE = "thimble"  # the same, of tables that a thimble is followed by on a skin
POLL = 0.1


class _Stiff(NamedTuple):
    """A skin that stiffens, made of a linear one, and whether its series was there to be looked for."""

    linear: core.skin.model.SkinModel
    made: core.skin.model.SkinModel
    looked: bool


on_made: Callable[[], None] | None = None
"""Called whenever a skin that is being made has come further: `handlers` hooks the preview in."""

on_read: Callable[[core.skin.model.SkinModel], None] | None = None
"""Called in the thread that reads a skin: `viewport/shown` hooks in what is drawn of it."""

_models: core.recent.Recent[str, core.skin.model.SkinModel] = core.recent.Recent(8)
_making: dict[str, core.work.executor.JobFuture] = {}
_progress: dict[str, float] = {}
_failed: dict[str, BaseException] = {}
_stiff: core.recent.Recent[str, _Stiff] = core.recent.Recent(8)
_there: set[str] = set()  # tables


def cache() -> core.cache.Cache:
    """Return the size-capped folder of condensed skins."""
    return core.cache.Cache(user_folder("skins", create=True), LIMIT_BYTES)


def one_thread() -> AbstractContextManager[Any]:
    """Hold the BLAS of numpy and scipy at one thread: with more they fight over the cores, for 100 times the time."""
    return core.skin.blas.one_thread()


def solved_in(tactile: core.scene.tactile_scene.TactileScene, presets: core.presets.Library) -> bool:
    """Return whether a sampled scene's rendering solves skins: they are shown, or drive a device."""
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
            continue  # rendering says why it is left out
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
        tissue: 'linear', or 'neo_hookean', whose `matched` is linear until its series is there (see `wants_series`).
        wait: make it now, however long it takes.

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
    return model if tissue == "linear" else _stiffened(key, model, tissue, _key(skin, STIFFENING) in _there)


def _read(key: str, skin: Mapping[str, float], level: str, tissue: str, where: str) -> bool:
    """Let a skin be made where it never was, and be read; return whether it is there."""
    kept, core_skin = cache(), core.skin.model
    if not _finished(key) and not core_skin.is_kept(skin, level=level, cache=kept, where=where):
        _begin(key, skin, level)
        return False

    def read() -> tuple[core.skin.model.SkinModel, bool, bool]:
        model = core_skin.skin_from_parameters(skin, level=level, cache=kept, where=where)
        assert model.unit_response.size and model.operator
        smooth = core.skin.surface_store.smooth_pad(model)
        if smooth is not None:
            chart = smooth.chart
            assert smooth.cells.extent and chart.tiles.quarters.size and chart.tiles.ways.size and chart.levels.size
            assert smooth.coarse[chart.base].size
        if on_read is not None:
            on_read(model)
        pad = smooth is not None
        return model, pad, tissue != "linear" and core.tissue.stiffening_store.find_series(model) is not None

    found = loading.value(("skin", key, tissue), read)
    if found is None:
        return False
    model, pad, series = found[0]
    _there.update(_key(skin, table) for table, there in ((PAD, pad), (STIFFENING, series)) if there)
    _models.make(key, lambda: model)
    return True


def of(parameters: Mapping[str, Any], *, where: str = "skin", wait: bool = False) -> core.skin.model.SkinModel | None:
    """Return the skin of a finger's parameters, as `get` does."""
    tissue = str(parameters.get("tissue", "linear"))
    return get(parameters["skin"], str(parameters["skin_level"]), tissue, where=where, wait=wait)


def _stiffened(key: str, model: core.skin.model.SkinModel, tissue: str, there: bool) -> core.skin.model.SkinModel:
    """Return a skin of tissue that stiffens, the same as long as the skin is, and until its series comes.

    Args:
        there: whether its series is.
    """
    kept = _stiff.get(key)
    if kept is not None and kept.linear is model and kept.looked >= there:
        return kept.made
    if kept is None or kept.linear.mesh is not model.mesh:
        made = model
    elif kept.linear is model:
        made = kept.made
    else:  # of another stiffness: what was made for its law serves on
        made = kept.made.with_material(young=model.material.young, alpha=model.material.alpha)
    _stiff[key] = _Stiff(model, core.tissue.finger_skin.of_tissue(made, tissue), there)
    return _stiff[key].made


def wants_pad(parameters: Mapping[str, Any]) -> bool:
    """Return whether a finger's contact is to be solved on points of its smooth skin, whose table is not made yet.

    Raises:
        DermisError: a size that leaves no room for tissue.
    """
    if parameters["contact"] != "points":
        return False
    return _unmade(parameters["skin"], PAD, core.skin.surface_store.find_remainder)


def wants_series(parameters: Mapping[str, Any]) -> bool:
    """Return whether the series of a finger's tissue, which devices that follow it are matched by, is not made yet.

    A mesh of one's own has none, nor has an unusual Poisson's ratio: nothing waits for them.

    Raises:
        DermisError: a size that leaves no room for tissue.
    """
    store = core.tissue.stiffening_store
    low, high = store.POISSON
    if parameters.get("tissue", "linear") == "linear" or not low <= _poisson(parameters["skin"]) <= high:
        return False
    return _unmade(parameters["skin"], STIFFENING, store.find_stiffening)


def _poisson(skin: Mapping[str, Any]) -> float:
    return float(skin.get("poisson", core.parameters.skin.TISSUE["poisson"].absent))


def _unmade(skin: Mapping[str, Any], table: str, find: Callable[..., object | None]) -> bool:
    """Return whether a table of a fingertip is not made yet, which is asked until it is."""
    if "mesh" in skin or _key(skin, table) in _there:
        return False
    shape, material = core.skin.model.shape_and_material(skin)
    shipped = core.skin.surface_store.SHIPPED
    if shape is not None and find(shape, material.poisson, shipped=shipped, cache=cache()) is None:
        return True
    _there.add(_key(skin, table))
    return False


def tables_there() -> int:
    """Return how many tables are known to be there: where it rises, a skin may be another to devices."""
    return len(_there)


def make_pad(skin: Mapping[str, float]) -> float | None:
    """Let a child process make the table of a skin's smooth pad; return how far it is, None where that failed."""
    return _made(skin, PAD)


def make_series(skin: Mapping[str, float]) -> float | None:
    """Let a child process make the series of a skin's tissue; return how far it is, None where that failed."""
    return _made(skin, STIFFENING)


def refusal(skin: Mapping[str, float], table: str) -> str:
    """Return why a table could not be made, or ''."""
    error = _failed.get(_key(skin, table))
    return "" if error is None else str(error)


def make_followed(skin: Mapping[str, float], parameters: Mapping[str, Any]) -> float | None:
    """Let a child process make the tables of a thimble on a skin; return how far it is.

    Args:
        parameters: of the job but for the skin and its cache.

    Raises:
        DermisError: they could not be made; tried anew when it is asked for again.
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

    What cannot be made is left to the bake, which solves contact at the mesh's nodes, or matches devices on linear
    skin, and says so.

    Args:
        tried_on: names of fingers that devices are tried on, whatever they wear.
    """
    for finger in tactile.fingers:
        followed = finger.name in tried_on or _followed(finger, presets)
        if followed or finger.parameters.get("skin_shown"):
            yield from tables_made(finger.parameters, followed=followed)


def tables_made(parameters: Mapping[str, Any], *, followed: bool) -> Generator[core.pipeline.bake.Progress, None, None]:
    """Make the tables of a finger's skin that are wanted and not there, see `wants_pad`; yield progress.

    Args:
        followed: also the series that devices are matched by, which nothing else asks for.

    Closing the generator ends a child process that it began.
    """
    skin = parameters["skin"]
    tables = [(PAD, wants_pad, make_pad), (STIFFENING, wants_series, make_series)]
    for table, wants, make in tables[: 2 if followed else 1]:
        try:
            if not wants(parameters):
                continue
        except DermisError:
            return
        key = _key(skin, table)
        mine = key not in _making
        try:
            while (done := make(skin)) is not None and done < 1.0:
                yield core.pipeline.bake.Progress("skin" if table == PAD else "tissue", round(100 * done), 100)
                time.sleep(POLL / 5)  # nobody else waits meanwhile, and a timer may not run
                _tick()
        finally:
            if mine and key in _making:
                _making.pop(key).cancel()
                _progress.pop(key, None)


def progress(skin: Mapping[str, float], level: str) -> float | None:
    """Return how far a skin that is being made has come, 0 to 1; None where it is not being made."""
    return _progress.get(_key(skin, level))


def forget() -> None:
    """Drop the models from memory, and stop making others; those on disk stay."""
    for job in _making.values():
        job.cancel()
    _making.clear()
    _progress.clear()
    _models.clear()
    _stiff.clear()
    _there.clear()
    _failed.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _key(skin: Mapping[str, float], level: str) -> str:
    geometry = {name: value for name, value in skin.items() if name not in ("young", "alpha")}
    return json.dumps([level, geometry], sort_keys=True)


def _finished(key: str) -> bool:
    return _progress.get(key) == 1.0 and key not in _making


def _begin(key: str, skin: Mapping[str, float], level: str, told: Mapping[str, Any] | None = None) -> None:
    """Let a child process put something into the cache, and look after it now and then."""
    if key in _making:
        return
    executor = core.work.processes.ProcessExecutor()
    parameters = {"skin": dict(skin), "folder": str(cache().folder), "limit": LIMIT_BYTES}
    job, more = (level, told or {}) if level in (PAD, STIFFENING, THIMBLE) else ("skin", {"level": level})
    _making[key] = executor.submit(job, {}, {**more, **parameters})
    executor.shutdown(wait=False)  # its process ends with the job
    _progress[key] = 0.0
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=POLL)


def _reread(key: str) -> None:
    """Forget the skins that a new table belongs to, so that a thread reads them again, and the table with them."""
    level, geometry = json.loads(key)
    if level in (PAD, STIFFENING) and redraw.watched():
        for other in [k for k in _models if json.loads(k)[1] == geometry]:
            del _models[other]


def _tick() -> float | None:
    """Take in what the child processes say."""
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
    if on_made is not None:
        on_made()  # whoever waits says how far it is, or begins
    return POLL if _making else None
