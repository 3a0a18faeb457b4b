"""Skins in a stored result: contact forces in single precision, and what their model is made from again.

Forces on points of the smooth skin are kept beside those on nodes, as cells of its tree; where its table is gone, a
result is read with those on nodes alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._core import DermisError, Finding, core
from ..devices import skin_models

POINTS = ("starts", "cells", "force")
SERIES = ("times", "frames", "normal_force", "tangential_force", "depth", "lift", "sticking", "slipping")


def pack(
    skins: Mapping[str, Any], made_of: Mapping[str, Mapping[str, Any]], arrays: dict[str, Any]
) -> list[dict[str, Any]]:
    """Add the arrays of a bake's skins to `arrays`; return their entries of the file's header.

    Displacement and stress are not kept: they follow from the forces.
    """
    entries = []
    for i, (finger, touch) in enumerate(skins.items()):
        if finger not in made_of:
            continue
        arrays[f"skin_{i}_contact"] = np.asarray(touch.contact, np.int32)
        arrays[f"skin_{i}_force"] = np.asarray(touch.force, np.float32)
        if touch.points is not None:
            for name in POINTS:
                arrays[f"skin_{i}_point_{name}"] = getattr(touch.points, name)
        for name in SERIES:
            arrays[f"skin_{i}_{name}"] = np.asarray(getattr(touch, name))
        entries.append(
            {
                "finger": finger,
                "number": i,
                **made_of[finger],
                "nodes": touch.model.pad_count,
                "findings": [f.as_dict() for f in touch.findings],
                "skipped": dict(touch.skipped),
            }
        )
    return entries


def unpack(entries: list[dict[str, Any]], file: Mapping[str, Any]) -> dict[str, Any]:
    """Return the skins of a stored result.

    Raises:
        DermisError: a skin is made otherwise by this version, so that the forces do not belong to its nodes.
    """
    out = {}
    for entry in entries:
        i, finger = int(entry["number"]), str(entry["finger"])
        model: Any = skin_models.get(entry["skin"], entry["level"], where=f"finger '{finger}', skin", wait=True)
        if model.pad_count != entry["nodes"]:
            raise DermisError(
                "the skin has other nodes in this version",
                where=f"finger '{finger}'",
                value=entry["nodes"],
                limit=str(model.pad_count),
                remedy="Bake again",
            )
        out[finger] = core.contact.skin_contact.SkinContact(
            model=model,
            contact=file[f"skin_{i}_contact"].astype(np.intp),
            force=file[f"skin_{i}_force"],
            findings=tuple(Finding(**f) for f in entry["findings"]),
            skipped=entry["skipped"],
            points=_points(model, {name: file.get(f"skin_{i}_point_{name}") for name in POINTS}),
            **{name: file[f"skin_{i}_{name}"] for name in SERIES},
        )
    return out


def _points(model: Any, arrays: Mapping[str, Any]) -> Any:
    surface = None if arrays["cells"] is None else core.skin.surface_store.smooth_pad(model)
    if surface is None or arrays["cells"].max(initial=-1) >= len(surface.chart.places):
        return None
    return core.contact.skin_contact.PointRecord(surface, **arrays)


def export(bake: Any, folder: Path) -> list[Path]:
    """Write the resultants of every skin of a bake as CSV into a folder; return the files.

    Raises:
        DermisError: the folder cannot be written.
    """
    names, written = core.track.file_names.FileNames(), []
    for finger, touch in bake.skins.items():
        path = Path(folder) / names.take(core.track.file_names.safe(finger) or "finger", ".skin.csv")
        meta = {"finger": finger, "content_hash": bake.content_hash}
        core.contact.resultants.write(touch, path, meta)
        written.append(path)
    return written
