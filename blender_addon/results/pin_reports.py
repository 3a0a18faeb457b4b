"""Keep results on fingers with pin arrays for the session.

They are press tests and comparisons of methods.
"""

from __future__ import annotations

from collections.abc import Generator
from functools import partial
from typing import Any

import bpy

from .. import loading
from .._core import DermisError, core
from ..devices import active_presets
from ..preferences import library
from . import store

calibrated: dict[int, Any] = {}
"""The last press test of each finger, by its session uid."""

_reports: dict[int, tuple[str, tuple[Any, ...], tuple[Any, ...]]] = {}


def find(scene: bpy.types.Scene, obj: bpy.types.Object) -> Generator[Any, None, tuple[Any, ...]]:
    """Compare all methods for a finger's touch in the last bake; yields progress.

    A thread computes, method by method. The result is kept for the session.

    Raises:
        DermisError: no bake, none with this finger's skin, or nothing touched.
    """
    device, result = active_presets.device_of(obj, "pins"), store.current(scene)
    felt = result.bake.skins.get(obj.name_full) if result is not None else None
    if device is None or result is None or felt is None:
        raise DermisError(
            "this finger's skin is not baked", where=f"finger '{obj.name}'", remedy="Press Bake, then compare"
        )
    engine, spec, where = core.matching.pin_report, library().device(device.preset), f"finger '{obj.name}'"
    weighting, bounded = device.pin_nodes, bool(device.pin_bounded)
    uid, made_from, methods = obj.session_uid, result.bake.content_hash, engine.METHODS

    def compared(method: Any) -> tuple[Any, ...]:
        return tuple(engine.compare(felt, spec, methods=(method,), weighting=weighting, bounded=bounded, where=where))

    reports: list[Any] = []
    for k, method in enumerate(methods):
        yield core.pipeline.bake.Progress(f"method {method}", k, len(methods))
        reports += yield from loading.aside(partial(compared, method))
    findings = yield from loading.aside(lambda: engine.doubts(felt, spec, weighting=weighting, where=where))
    _reports[uid] = (made_from, tuple(reports), findings)
    return tuple(reports)


def shown(scene: bpy.types.Scene, obj: bpy.types.Object) -> tuple[Any, ...]:
    """Return the comparison on the present bake; empty without one."""
    known = _known(scene, obj)
    return known[1] if known else ()


def doubts(scene: bpy.types.Scene, obj: bpy.types.Object) -> tuple[Any, ...]:
    """Return the findings that warn about the comparison on the present bake."""
    known = _known(scene, obj)
    return known[2] if known else ()


def _known(scene: bpy.types.Scene, obj: bpy.types.Object) -> tuple[str, tuple[Any, ...], tuple[Any, ...]] | None:
    result, known = store.current(scene), _reports.get(obj.session_uid)
    return known if result is not None and known is not None and known[0] == result.bake.content_hash else None
