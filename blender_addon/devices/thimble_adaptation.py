"""Adapt a thimble to a finger.

A child process learns. It writes two files to the folder in which the methods search for them.
"""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import bpy

from .._core import DermisError, core
from ..properties import skin_properties
from . import active_presets, skin_models, thimble_devices

_told: core.recent.Recent[tuple[Path, float], dict[str, Any]] = core.recent.Recent(8)


def adapt(obj: bpy.types.Object, **less: int) -> Generator[Any, None, dict[str, Any]]:
    """Adapt to a finger; yield progress, return test errors and sample count.

    Closing the generator ends the child process and removes its files. An older adaptation stays.

    Args:
        less: fewer 'trajectories' or 'iterations', for tests.

    Raises:
        DermisError: no thimble, a preset or skin that cannot be used, or an error of the child process.
    """
    device = active_presets.searched_of(obj)
    spec = active_presets.searched(device) if device is not None else None
    if device is None or spec is None:
        raise DermisError(
            "the finger wears no thimble", where=f"finger '{obj.name}'", remedy="Add one in the Dermis tab under Wear"
        )
    skin = skin_properties.parameters(obj.dermis.finger.skin)
    use = thimble_devices.use_of(device)
    folder = thimble_devices.folder(create=True)
    parameters = {
        "device": dict(spec.source),
        "device_key": spec.key,
        "skin": dict(skin["skin"]),
        "level": skin["skin_level"],
        "contact": skin["contact"],
        "skins": str(skin_models.cache().folder),
        "limit": skin_models.LIMIT_BYTES,
        "use": use,
        "folder": str(folder),
        **less,
    }
    where = f"finger '{obj.name}', skin"
    # A bake makes these tables, and then needs an adaptation that was learned on points of the skin.
    yield from skin_models.tables_made(skin)
    yield core.pipeline.bake.Progress("starting", 0, 1)
    with skin_models.one_thread():
        model = thimble_devices.pressed(obj, skin_models.of(skin, where=where, wait=True))
        parameters["tissue"] = model.tissue
        mechanism = core.matching.thimble_use.disc_device(spec, model, use)
        target = core.surrogate.store.place_of(folder, model, *mechanism)
    older, done = target.is_file(), False
    moves = core.matching.adapt.shares_of(model.tissue)["dataset"][1]  # from here on the network trains
    try:
        with core.work.processes.ProcessExecutor() as executor:
            job = executor.submit("adapt", {}, parameters)
            for now, total in job.follow():
                yield core.pipeline.bake.Progress("moving the disc" if now < moves else "learning", now, max(total, 1))
            made, done = dict(job.result()), True
            return made
    finally:
        if not done:
            _remove(folder, target.stem, whole=not older)


def status(device: Any, model: Any) -> dict[str, Any] | None:
    """Return the figures of the adaptation to a skin; None without one.

    An example is 'network_error'.

    Raises:
        DermisError: a preset or settings that cannot be used.
    """
    path = thimble_devices.adapted(device, model)
    if path is None:
        return None
    return _told.make((path, path.stat().st_mtime), lambda: _meta(path))


def _meta(path: Path) -> dict[str, Any]:
    try:
        with core.npz.opened_npz(path) as archive:
            meta = core.foreign.json_of(archive.array("meta").tobytes(), str(path))
    except DermisError:  # the bake reports the error
        return {}
    return meta if isinstance(meta, dict) else {}


def _remove(folder: Path, stem: str, *, whole: bool) -> None:
    """Remove half-written files of an adaptation, and if `whole` all files."""
    for path in folder.iterdir():
        mine = path.name.startswith(f".{stem}.") or (whole and path.name.startswith(f"{stem}."))
        if mine:
            path.unlink(missing_ok=True)
