"""The skins at hand: made once, shared by all fingers of the same size, kept on disk in the extension's user folder.

Draft and standard skins are made where they are first asked for (some tenths of a second, once per size). A fine one
takes seconds: in a window a child process makes it, and whoever asked gets None until it is there.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Literal, overload

import bpy

from .._core import DermisError, core
from ..preferences import user_folder

LIMIT_BYTES = 4_000_000_000
MOST = 8
SLOW = ("fine",)
POLL = 0.1

_threads: list[Any] = []
_models: dict[str, core.skin.model.SkinModel] = {}
_making: dict[str, tuple[Any, Generator[tuple[int, int], None, Any]]] = {}
_progress: dict[str, float] = {}
_failed: dict[str, Exception] = {}


def cache() -> Any:
    """Return the size-capped folder of condensed skins."""
    return core.cache.Cache(user_folder("skins", create=True), LIMIT_BYTES)


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold the BLAS of numpy and scipy at one thread: with more they fight over the cores, for 100 times the time.

    Looking the libraries up takes milliseconds, so it is done once.
    """
    if not _threads:
        import scipy.linalg  # noqa: F401  # so that its library is there to be found

        _threads.extend(core.skin.blas.controls())
    before = [(put, read()) for read, put in _threads]
    try:
        for put, _ in before:
            put(1)
        yield
    finally:
        for put, count in before:
            put(count)


def wanted(tactile: Any, presets: Any) -> bool:
    """Tell whether a sampled scene's rendering solves skins: because they are shown, or a device is driven by them."""
    if any(f.parameters.get("skin_shown") for f in tactile.fingers):
        return True
    for key in {device.preset for f in tactile.fingers for device in f.devices}:
        try:
            if presets.device(key).follows_skin:
                return True
        except DermisError:
            continue  # rendering says why it is left out
    return False


@overload
def get(
    skin: Mapping[str, float], level: str, *, where: str = ..., wait: Literal[True]
) -> core.skin.model.SkinModel: ...
@overload
def get(
    skin: Mapping[str, float], level: str, *, where: str = ..., wait: bool = ...
) -> core.skin.model.SkinModel | None: ...
def get(
    skin: Mapping[str, float], level: str, *, where: str = "skin", wait: bool = False
) -> core.skin.model.SkinModel | None:
    """Return a skin's model, or None while it is being made.

    Args:
        skin: size and material in SI, as in a skin preset.
        wait: make it now, however long it takes.

    Raises:
        DermisError: a size that leaves no room for tissue, or a model that could not be made.
    """
    key = _key(skin, level)
    model = _models.get(key)
    if model is None:
        if key in _failed:
            raise _failed.pop(key)
        if level in SLOW and not wait and not bpy.app.background and not _finished(key):
            _begin(key, skin, level)
            return None
        model = core.skin.model.skin_from_parameters(skin, level=level, cache=cache(), where=where)
        while len(_models) >= MOST:
            _models.pop(next(iter(_models)))
    else:
        del _models[key]  # the one used last goes to the end
    _models[key] = model
    young, alpha = float(skin.get("young", model.material.young)), float(skin.get("alpha", model.material.alpha))
    if (young, alpha) != (model.material.young, model.material.alpha):
        model = model.with_material(young=young, alpha=alpha)
        _models[key] = model
    return model


def progress(skin: Mapping[str, float], level: str) -> float | None:
    """Return how far a skin that is being made has come, 0 to 1; None where it is not being made."""
    return _progress.get(_key(skin, level))


def forget() -> None:
    """Drop the models from memory, and stop making others; those on disk stay."""
    for worker, _ in _making.values():
        worker.close()
    _making.clear()
    _threads.clear()
    _progress.clear()
    _models.clear()
    _failed.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _key(skin: Mapping[str, float], level: str) -> str:
    geometry = {name: value for name, value in skin.items() if name not in ("young", "alpha")}
    return json.dumps([level, geometry], sort_keys=True)


def _finished(key: str) -> bool:
    return _progress.get(key) == 1.0 and key not in _making


def _begin(key: str, skin: Mapping[str, float], level: str) -> None:
    """Let a child process put a skin into the cache, and look after it now and then."""
    if key in _making:
        return
    worker = core.work.Worker()
    folder = str(cache().folder)
    _making[key] = (
        worker,
        worker.run("skin", {}, {"skin": dict(skin), "level": level, "folder": folder, "limit": LIMIT_BYTES}),
    )
    _progress[key] = 0.0
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=POLL)


def _tick() -> float | None:
    """Take in what the child processes say."""
    from ..preview import skin_preview

    for key, (worker, steps) in list(_making.items()):
        try:
            done, total = next(steps)
            if total:
                _progress[key] = min(done / total, 0.99)
        except StopIteration:
            _progress[key] = 1.0
            del _making[key]
            worker.close()
        except DermisError as error:
            _failed[key] = error
            _progress.pop(key, None)
            del _making[key]
            worker.close()
    skin_preview.refresh()  # whoever waits says how far it is, or begins
    return POLL if _making else None
