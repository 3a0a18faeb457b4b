"""Keep results on fingers with pin arrays for the session.

They are press tests and comparisons of methods.
"""

from __future__ import annotations

from typing import Any

import bpy

from .._core import DermisError, core
from ..devices import active_presets, skin_models
from ..preferences import library
from . import store

calibrated: dict[int, Any] = {}
"""The last press test of each finger, by its session uid."""

_reports: dict[int, tuple[str, tuple[Any, ...], tuple[Any, ...]]] = {}


def compare(scene: bpy.types.Scene, obj: bpy.types.Object) -> tuple[Any, ...]:
    """Compare all methods for a finger's touch in the last bake.

    The result is kept for the session.

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
    with skin_models.one_thread():
        weighting = device.pin_nodes
        reports = engine.compare(felt, spec, weighting=weighting, bounded=device.pin_bounded, where=where)
        findings = engine.doubts(felt, spec, weighting=weighting, where=where)
    _reports[obj.session_uid] = (result.bake.content_hash, reports, findings)
    return reports


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
