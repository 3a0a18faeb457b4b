"""Skins in a stored result: contact forces in single precision, and what their model is made from again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._core import DermisError, Finding, core
from ..devices import skin_models

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
            **{name: file[f"skin_{i}_{name}"] for name in SERIES},
        )
    return out


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
