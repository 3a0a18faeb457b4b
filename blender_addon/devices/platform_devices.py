"""Find and make the look-up table of a finger's platform.

A table holds the effect of a device on one finger's skin. Child processes sweep it once for a mechanism, a size of
finger and a number of configurations. It is kept with the skin.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path
from typing import Any

import bpy

from .._core import DermisError, core
from ..preferences import user_folder
from ..properties import skin_properties
from . import active_presets, skin_models

WORKERS = max(1, min(2, (os.cpu_count() or 2) - 1))

_swept = {"tables": 0}


def tables_made() -> int:
    """Return the number of tables made in this session.

    When it rises, a platform that waits may have its table.
    """
    return _swept["tables"]


def absolute(values: dict[str, Any]) -> dict[str, Any]:
    """Return a device's values with an absolute path of its table.

    A child process, which does not open the .blend, needs this.
    """
    table = values.get("table", "")
    return {**values, "table": bpy.path.abspath(table)} if table else values


def model_of(obj: bpy.types.Object) -> core.skin.model.SkinModel | None:
    """Return the skin on which devices are matched; None while it is made.

    Raises:
        DermisError: a size that leaves no room for tissue.
    """
    skin = skin_properties.parameters(obj.dermis.finger.skin)
    model = skin_models.of(skin, where=f"finger '{obj.name}', skin")
    return model


def table(obj: bpy.types.Object, device: Any) -> core.matching.table.SkinTable | None:
    """Return the look-up table of a finger's platform; None if it is not made.

    Raises:
        DermisError: a file that cannot be read, a table of another device, or a skin that cannot be made.
    """
    spec, model = active_presets.spec_of(device.preset, "platform"), model_of(obj)
    if spec is None or model is None:
        return None
    path = bpy.path.abspath(device.table) if device.table else ""
    with skin_models.one_thread():
        return core.matching.lookup.table_at_hand(model, spec, path, device.table_rows)


def missing(obj: bpy.types.Object, device: Any) -> bool:
    """Return whether a platform waits for its table.

    A table that cannot be read is not missing; rendering reports the reason.
    """
    if active_presets.searched(device) is not None:
        return False
    try:
        return active_presets.spec_of(device.preset, "platform") is not None and table(obj, device) is None
    except DermisError:
        return False


def make(obj: bpy.types.Object, device: Any) -> Generator[Any, None, Any]:
    """Sweep a finger's platform and keep the table; yield progress, return it.

    Closing the generator ends the child processes. Finished parts are kept, and the next sweep continues with them.

    Raises:
        DermisError: no platform, a skin that cannot be made, or a sweep that fails.
    """
    spec = active_presets.spec_of(device.preset, "platform")
    if spec is None:
        raise DermisError(
            "the finger wears no platform", where=f"finger '{obj.name}'", remedy="Add one in the Dermis tab under Wear"
        )
    yield core.pipeline.bake.Progress("skin", 0, 1)
    skin, rows = skin_properties.parameters(obj.dermis.finger.skin), int(device.table_rows)
    yield from skin_models.tables_made(skin)  # a bake makes these tables, and then needs a platform's table for them
    steps = swept(spec, skin["skin"], skin["skin_level"], rows, skin["tissue"])
    model, made = yield from steps
    core.matching.lookup.keep_table(model, spec, rows, made)
    _swept["tables"] += 1
    return made


def make_missing(scene: bpy.types.Scene) -> Generator[Any, None, None]:
    """Make the tables that a bake will need; yield progress.

    Made here, they show progress and can be stopped. If a table cannot be made, the bake leaves that device out and
    reports the reason.
    """
    for obj in sorted((o for o in scene.objects if o.dermis.role == "FINGER"), key=lambda o: o.name):
        for device in obj.dermis.finger.devices:
            if device.enabled and missing(obj, device):
                try:
                    yield from make(obj, device)
                except DermisError:
                    continue


def swept(
    spec: Any, skin: dict[str, Any], level: str, rows: int | None, tissue: str
) -> Generator[Any, None, tuple[Any, Any]]:
    """Sweep a device on a skin; yield progress, return skin model and table.

    Child processes do the work.

    Raises:
        DermisError: a skin that cannot be made, or a sweep that fails.
    """
    with skin_models.one_thread():
        model = skin_models.get(skin, level, tissue, wait=True)
    material = {k: float(v) for k, v in skin.items() if k in ("young", "poisson", "alpha")}
    lengths = {k: v for k, v in skin.items() if k not in material}
    shape = core.skin.shape.shape_from_parameters(lengths)
    with core.work.processes.ProcessExecutor(WORKERS) as executor:
        steps = core.design.collect.collect(
            spec,
            shape,
            folder(),
            level=level,
            rows=rows,
            executor=executor,
            material=material,
            points=core.surrogate.press_points.press_points(model),
            tissue=model.tissue,
        )
        while True:
            try:
                with skin_models.one_thread():
                    done, total = next(steps)
            except StopIteration as stop:
                return model, stop.value
            yield core.pipeline.bake.Progress("platform configurations", done, total)


def folder() -> Path:
    """Return where parts of unfinished tables are kept."""
    return user_folder("collection", create=True)
