"""How a thimble is used: from the artist's settings to the engine's `ThimbleUse`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy

from .._core import DermisError, core
from ..preferences import user_folder
from ..properties import object_properties
from . import active_presets, skin_models

_uses: core.recent.Recent[str, Any] = core.recent.Recent(8)


def folder(*, create: bool = False) -> Path:
    """Return the folder of the adaptations to fingers."""
    return user_folder("surrogates", create=create)


def parameters_of(device: Any) -> dict[str, Any]:
    """Return a device's values for the engine; learned methods look for their files where adaptations are kept."""
    values = object_properties.parameters(device)
    if method_of(device) in core.matching.thimble_use.LEARNED:
        given = values["thimble_surrogate"]
        values["thimble_surrogate"] = bpy.path.abspath(given) if given else str(folder())
    return values


def method_of(device: Any) -> str:
    """Return how a device's pose is searched for; '' where it is not."""
    spec = active_presets.searched(device)
    return "" if spec is None else str(getattr(device, core.matching.thimble_use.method_name(spec)))


def pressed(finger: bpy.types.Object, model: Any) -> Any:
    """Return a finger's skin as a thimble is matched on it: where its touches are solved, the disc follows them."""
    matched = model.matched
    return matched.on_nodes if finger.dermis.finger.skin.contact == "nodes" else matched


def use_of(device: Any) -> dict[str, Any]:
    """Return those of a device's values that say how its pose is searched for."""
    values = parameters_of(device).items()
    return {name: value for name, value in values if name.startswith("thimble_") or name == "platform_method"}


def prepared(device: Any, model: Any) -> Any:
    """Return how a thimble is used on a skin.

    Raises:
        DermisError: a preset or settings that cannot be used.
    """
    spec = active_presets.searched(device)
    if spec is None:
        raise DermisError("no such thimble", where="thimble", value=device.preset)
    values = use_of(device)
    on = core.surrogate.press_points.pressed_on(model)
    key = json.dumps([spec.hash, model.key, model.tissue, on, repr(model.material), values], sort_keys=True)
    with skin_models.one_thread():
        return _uses.make(key, lambda: core.matching.thimble_use.prepare(spec, model, values, device.preset))


def adapted(device: Any, model: Any) -> Path | None:
    """Return the files of the adaptation to a skin, or None where there is none.

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
    """Read everything anew: a surrogate came or went."""
    active_presets.forget()
    _uses.clear()
