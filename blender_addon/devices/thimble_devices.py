"""Turn the artist's settings of a thimble into the engine's `ThimbleUse`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy

from .. import loading, redraw
from .._core import DermisError, core
from ..preferences import user_folder
from ..properties import object_properties, skin_properties
from . import active_presets, skin_models

_uses: core.recent.Recent[str, Any] = core.recent.Recent(8)
_there: core.recent.Recent[str, bool] = core.recent.Recent(8)  # keys of the uses whose tables are in memory


def folder(*, create: bool = False) -> Path:
    """Return the folder of the adaptations (surrogates) of thimbles to fingers."""
    return user_folder("surrogates", create=create)


def parameters_of(device: Any) -> dict[str, Any]:
    """Return a device's values for the engine.

    A learned method without a path gets the folder of the adaptations.
    """
    values = object_properties.parameters(device)
    if method_of(device) in core.matching.thimble_use.LEARNED:
        given = values["thimble_surrogate"]
        values["thimble_surrogate"] = bpy.path.abspath(given) if given else str(folder())
    return values


def method_of(device: Any) -> str:
    """Return the method by which a device's pose is searched for.

    The result is '' if it is not searched for, see `active_presets.searched`.
    """
    spec = active_presets.searched(device)
    return "" if spec is None else str(getattr(device, core.matching.thimble_use.method_name(spec)))


def pressed(finger: bpy.types.Object, model: Any) -> Any:
    """Return the model of a finger's skin on which a thimble is matched.

    If the finger's contact is solved on nodes, this is `model.on_nodes`, which has no smooth surface; else it is
    `model`.
    """
    return model.on_nodes if finger.dermis.finger.skin.contact == "nodes" else model


def use_of(device: Any) -> dict[str, Any]:
    """Return the values of a device that describe the search of its pose."""
    values = parameters_of(device).items()
    return {name: value for name, value in values if name.startswith("thimble_") or name == "platform_method"}


def prepared(device: Any, model: Any) -> Any:
    """Return the `ThimbleUse` of a thimble on a skin.

    Raises:
        DermisError: a preset or settings that cannot be used.
    """
    spec = active_presets.searched(device)
    if spec is None:
        raise DermisError("no such thimble", where="thimble", value=device.preset)
    values = use_of(device)
    make = core.matching.thimble_use.prepare
    with skin_models.one_thread():
        return _uses.make(_key(spec, model, values), lambda: make(spec, model, values, device.preset))


def _key(spec: Any, model: Any, values: dict[str, Any]) -> str:
    on = core.surrogate.press_points.pressed_on(model)
    return json.dumps([spec.hash, model.key, model.tissue, on, repr(model.material), values], sort_keys=True)


def waits(finger: bpy.types.Object, device: Any, model: Any) -> str:
    """Return a text on why a thimble on a finger waits; '' if it is ready.

    It waits for its tables: a child process makes new ones, and a thread reads them. Without a window nothing waits.

    Args:
        model: the finger's skin, see `pressed`.

    Raises:
        DermisError: a preset or settings that cannot be used.
    """
    spec = active_presets.searched(device)
    if spec is None or not redraw.watched():
        return ""
    use = use_of(device)
    key = _key(spec, model, use)
    if key in _there:
        return ""
    thimble_job = core.matching.thimble_job
    if not _kept(thimble_job.tables_key(spec, model, use)):
        skin = skin_properties.parameters(finger.dermis.finger.skin)
        told = {
            "device": dict(spec.source),
            "device_key": spec.key,
            "level": skin["skin_level"],
            "contact": skin["contact"],
            "tissue": model.tissue,
            "use": use,
        }
        done = skin_models.make_followed(skin["skin"], told)
        if done is not None:
            return f"preparing {spec.name}: {done:.0%}"
    where = device.preset

    def read() -> Any:
        found = core.matching.thimble_use.prepare(spec, model, use, where)
        return core.matching.thimble.follower(found) and found

    found = loading.value(("thimble", key), read)
    if found is None:
        return f"reading what {spec.name} needs"
    _uses.make(key, lambda: found[0])
    _there.make(key, lambda: True)
    return ""


def _kept(mark: str) -> bool:
    return skin_models.cache().get(mark) is not None


def adapted(device: Any, model: Any) -> Path | None:
    """Return the path of the .npz file of a thimble's adaptation to a skin.

    The result is None if this file or the .onnx file beside it is missing, or if the device's pose is not searched for.

    Raises:
        DermisError: a preset or settings that cannot be used.
    """
    module, spec = core.matching.thimble_use, active_presets.searched(device)
    if spec is None:
        return None
    calibrated, friction = module.disc_device(spec, model, object_properties.parameters(device))
    given = device.thimble_surrogate
    values = {"thimble_surrogate": bpy.path.abspath(given) if given else str(folder(create=True))}
    path: Path = module.surrogate_path(values, model, calibrated, friction)
    tables = path.with_suffix(".npz")
    return tables if tables.is_file() and path.with_suffix(".onnx").is_file() else None


def forget() -> None:
    """Drop everything read, as after an adaptation was added or removed."""
    active_presets.forget()
    _uses.clear()
    _there.clear()
