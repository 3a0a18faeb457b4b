"""The skins at hand: made once, shared by all fingers of the same size, kept on disk in the extension's user folder.

Draft and standard skins are made where they are first asked for (some tenths of a second, once per size). A fine one
takes seconds: in a window a child process makes it, and whoever asked gets None until it is there. So do the tables of
a smooth pad, and of how tissue stiffens, for lengths that no preset has: a preview goes on without them, a bake waits.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager
from typing import Any, Literal, overload

import bpy

from .._core import DermisError, core
from ..preferences import user_folder

LIMIT_BYTES = 4_000_000_000
EXACT_TISSUE = core.parameters.error_bands.NEO_HOOKEAN_EXACT
SLOW = ("fine",)
# in place of a level, and jobs: tables of the smooth pad, of its tissue, and of that tissue's exact law
PAD, STIFFENING, EXACT = "pad", "stiffening", "exact tissue"
POLL = 0.1

on_made: Callable[[], None] | None = None
"""Called whenever a skin that is being made has come further: `handlers` hooks the preview in."""

_models: core.recent.Recent[str, core.skin.model.SkinModel] = core.recent.Recent(8)
_making: dict[str, core.work.executor.JobFuture] = {}
_progress: dict[str, float] = {}
_failed: dict[str, BaseException] = {}
_stiff: core.recent.Recent[str, tuple[core.skin.model.SkinModel, core.skin.model.SkinModel]] = core.recent.Recent(8)
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
    if finger.parameters.get("skin_shown"):
        return True
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
        tissue: 'linear', 'neo_hookean', which is linear until its table is there (see `wants_stiffening`), or
            'neo_hookean_exact', which is 'neo_hookean' until then.
        wait: make it now, however long it takes.

    Raises:
        DermisError: a size that leaves no room for tissue, or a model that could not be made.
    """
    key = _key(skin, level)
    if key not in _models:
        if key in _failed:
            raise _failed.pop(key)
        if level in SLOW and not wait and not bpy.app.background and not _finished(key):
            _begin(key, skin, level)
            return None
    model = _models.make(
        key, lambda: core.skin.model.skin_from_parameters(skin, level=level, cache=cache(), where=where)
    )
    young, alpha = float(skin.get("young", model.material.young)), float(skin.get("alpha", model.material.alpha))
    if (young, alpha) != (model.material.young, model.material.alpha):
        model = model.with_material(young=young, alpha=alpha)
        _models[key] = model
    return model if tissue == "linear" else _stiffened(key, model, tissue)


def of(parameters: Mapping[str, Any], *, where: str = "skin", wait: bool = False) -> core.skin.model.SkinModel | None:
    """Return the skin of a finger's parameters, as `get` does, for what is live: the exact law is for bakes."""
    tissue = live_tissue(parameters)
    return get(parameters["skin"], str(parameters["skin_level"]), tissue, where=where, wait=wait)


def live_tissue(parameters: Mapping[str, Any]) -> str:
    """Return the tissue that previews and devices go by: a series, where a bake follows the exact law."""
    tissue = str(parameters.get("tissue", "linear"))
    return "neo_hookean" if tissue == EXACT_TISSUE else tissue


def _stiffened(key: str, model: core.skin.model.SkinModel, tissue: str) -> core.skin.model.SkinModel:
    """Return a skin of a tissue that stiffens, the same as long as the skin is: a preview goes on with it."""
    key = f"{key} {tissue}"
    kept = _stiff.get(key)
    if kept is None or kept[0] is not model or kept[1].tissue != tissue:
        kept = _stiff[key] = model, core.tissue.finger_skin.of_tissue(model, tissue)
    return kept[1]


def wants_pad(parameters: Mapping[str, Any]) -> bool:
    """Return whether a finger's contact is to be solved on points of its smooth skin, whose table is not made yet.

    Raises:
        DermisError: a size that leaves no room for tissue.
    """
    skin = parameters["skin"]
    if parameters["contact"] != "points" or "mesh" in skin or _key(skin, PAD) in _there:
        return False
    if core.skin.surface_store.surface_compliance(skin, shipped=core.skin.surface_store.SHIPPED, cache=cache()) is None:
        return True
    _there.add(_key(skin, PAD))
    return False


def wants_stiffening(parameters: Mapping[str, Any]) -> bool:
    """Return whether a finger's tissue is to stiffen, and the table of how it does is not made yet.

    Raises:
        DermisError: a size that leaves no room for tissue.
    """
    find = core.tissue.stiffening_store.find_stiffening
    return parameters.get("tissue", "linear") != "linear" and _unmade(parameters["skin"], STIFFENING, find)


def wants_exact(parameters: Mapping[str, Any]) -> bool:
    """Return whether a finger's tissue is to follow the exact law in a bake, and its table is not made yet.

    Raises:
        DermisError: a size that leaves no room for tissue.
    """
    find = core.tissue.sampled_store.find_table
    return parameters.get("tissue", "linear") == EXACT_TISSUE and _unmade(parameters["skin"], EXACT, find)


def _unmade(skin: Mapping[str, Any], table: str, find: Callable[..., object | None]) -> bool:
    """Return whether a table of a fingertip's tissue is not made yet, which is asked until it is."""
    if "mesh" in skin or _key(skin, table) in _there:
        return False
    shape, material = core.skin.model.shape_and_material(skin)
    shipped = core.skin.surface_store.SHIPPED
    if shape is not None and find(shape, material.poisson, shipped=shipped, cache=cache()) is None:
        return True
    _there.add(_key(skin, table))
    return False


def make_pad(skin: Mapping[str, float]) -> float | None:
    """Let a child process make the table of a skin's smooth pad; return how far it is, None where that failed."""
    return _made(skin, PAD)


def make_stiffening(skin: Mapping[str, float]) -> float | None:
    """Let a child process make the table of how a skin stiffens; return how far it is, None where that failed."""
    return _made(skin, STIFFENING)


def make_exact(skin: Mapping[str, float]) -> float | None:
    """Let a child process make the table of a skin's exact law; return how far it is, None where that failed."""
    return _made(skin, EXACT)


def refusal(skin: Mapping[str, float], table: str) -> str:
    """Return why a table could not be made, or ''."""
    error = _failed.get(_key(skin, table))
    return "" if error is None else str(error)


def _made(skin: Mapping[str, float], table: str) -> float | None:
    key = _key(skin, table)
    if key in _failed:
        return None
    if not _finished(key):
        _begin(key, skin, table)
    return _progress[key]


def make_tables(
    tactile: core.scene.tactile_scene.TactileScene, presets: core.presets.Library
) -> Generator[core.pipeline.bake.Progress, None, None]:
    """Make the tables of skins that a bake will need; yield progress.

    What cannot be made is left to the bake, which solves contact at the mesh's nodes, or linear tissue, and says so.
    """
    for finger in tactile.fingers:
        if _solved(finger, presets):
            yield from tables_made(finger.parameters, exact=True)


def tables_made(
    parameters: Mapping[str, Any], *, exact: bool = False
) -> Generator[core.pipeline.bake.Progress, None, None]:
    """Make the tables of a finger's skin that are wanted and not there, see `wants_pad`; yield progress.

    Args:
        exact: also that of the exact law, which only a bake follows.

    Closing the generator ends a child process that it began.
    """
    skin = parameters["skin"]
    tables = [(PAD, wants_pad, make_pad), (STIFFENING, wants_stiffening, make_stiffening)]
    for table, wants, make in [*tables, (EXACT, wants_exact, make_exact)][: 3 if exact else 2]:
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


def _begin(key: str, skin: Mapping[str, float], level: str) -> None:
    """Let a child process put something into the cache, and look after it now and then."""
    if key in _making:
        return
    executor = core.work.processes.ProcessExecutor()
    parameters = {"skin": dict(skin), "folder": str(cache().folder), "limit": LIMIT_BYTES}
    job, more = (level, {}) if level in (PAD, STIFFENING, EXACT) else ("skin", {"level": level})
    _making[key] = executor.submit(job, {}, parameters | more)
    executor.shutdown(wait=False)  # its process ends with the job
    _progress[key] = 0.0
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=POLL)


def _tick() -> float | None:
    """Take in what the child processes say."""
    for key, job in list(_making.items()):
        done, total = job.progress()
        _progress[key] = min(done / max(total, 1), 0.99)
        if job.done():
            del _making[key]
            _progress[key] = 1.0
            if (error := job.exception()) is not None:
                _failed[key] = error
                del _progress[key]
    if on_made is not None:
        on_made()  # whoever waits says how far it is, or begins
    return POLL if _making else None
