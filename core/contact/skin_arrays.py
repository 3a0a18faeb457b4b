"""Conversion of the touch on a skin to plain arrays and back, for files and other processes.

Displacement and stress are not stored, because they follow from the forces. On nonlinear skin they also need the
correction of the contact, which is stored too (`Stimulus.given`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Finding
from ..skin.model import SkinModel
from ..skin.surface_store import smooth_pad
from .skin_contact import PointRecord, SkinContact

POINTS = ("starts", "cells", "force")
SERIES = ("times", "frames", "normal_force", "tangential_force", "depth", "lift", "sticking", "slipping")
LATER = ("amounts", "slide")  # missing in results of earlier versions, or for some skins


def arrays_of(touch: SkinContact) -> dict[str, NDArray[Any]]:
    """Return the touch on a skin as arrays by name, without its model, findings and counts of skipped work."""
    arrays: dict[str, NDArray[Any]] = {
        "contact": np.asarray(touch.contact, np.int32),
        "force": np.asarray(touch.force, np.float32),
    }
    if touch.points is not None:
        arrays |= {f"point_{name}": getattr(touch.points, name) for name in POINTS}
    present = (*SERIES, *(name for name in LATER if getattr(touch, name) is not None))
    return arrays | {name: np.asarray(getattr(touch, name)) for name in present}


def touch_of(
    model: SkinModel, arrays: Mapping[str, NDArray[Any]], findings: tuple[Finding, ...], skipped: Mapping[str, int]
) -> SkinContact:
    """Return the touch on a skin from the arrays of `arrays_of`.

    Forces on points are left out if the model has no smooth pad, or one with fewer cells.

    Args:
        model: model of the same skin.
        arrays: arrays by name.
        findings: findings of the touch.
        skipped: counts of skipped work, by name.
    """
    series: dict[str, Any] = {name: arrays[name] for name in SERIES}
    return SkinContact(
        model=model,
        contact=arrays["contact"].astype(np.intp),
        held=arrays["force"],
        findings=findings,
        skipped=skipped,
        points=_points(model, arrays),
        given=arrays.get("amounts"),
        slide=arrays.get("slide"),
        **series,
    )


def _points(model: SkinModel, arrays: Mapping[str, NDArray[Any]]) -> PointRecord | None:
    if "point_cells" not in arrays:
        return None
    surface = smooth_pad(model)
    if surface is None or arrays["point_cells"].max(initial=-1) >= len(surface.chart.places):
        return None
    return PointRecord(surface, *(arrays[f"point_{name}"] for name in POINTS))
