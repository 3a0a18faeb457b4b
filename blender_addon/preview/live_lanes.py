"""Values of the live preview since the last edit, by frame, for the strip."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import changes
from ..results.lanes import Kind, Lane, Series

MOST = 20_000  # largest number of frames that are kept for a value
HELD = 6.0  # largest step between two frames across which a value holds; across a larger one nothing is known

_seen: dict[str, dict[Kind, dict[float, float]]] = {}
_key: tuple[int, int, int] = (0, -1, -1)  # scene, edits and lineage of the values
_lanes: tuple[Lane, ...] | None = ()


def note(scene: bpy.types.Scene, frame: Any) -> None:
    """Keep the values of a `shown.Frame` with a live preview.

    After an edit, all earlier values are forgotten.
    """
    global _key, _lanes
    key = (scene.session_uid, changes.edits(), changes.lineage())
    if key != _key:
        forget()
        _key = key
    if frame.devices is None or frame.devices.source != "live":
        return
    for row in frame.devices.rows:
        if row.contact is not None:
            _add(row.finger, "touch", frame.frame, float(row.contact > 0.5))
        if "mismatch" in row.signals:
            _add(row.finger, "mismatch", frame.frame, row.signals["mismatch"])
    for state in frame.skins.states:
        if state.source == "live" and state.work != "rendered":  # not a skin as a device renders it
            _add(state.finger, "force", frame.frame, float(state.normal_force))
    _lanes = None


def of(scene: bpy.types.Scene) -> tuple[Lane, ...]:
    """Return a lane for every finger with values; none after an edit."""
    global _lanes
    if _key != (scene.session_uid, changes.edits(), changes.lineage()):
        return ()
    if _lanes is None:
        _lanes = tuple(Lane(finger, {k: (_series(v),) for k, v in kinds.items()}) for finger, kinds in _seen.items())
    return _lanes


def forget() -> None:
    """Forget all values."""
    global _key, _lanes
    _seen.clear()
    _key, _lanes = (0, -1, -1), ()


def _add(finger: str, kind: Kind, frame: float, value: float) -> None:
    values = _seen.setdefault(finger, {}).setdefault(kind, {})
    if len(values) < MOST or frame in values:
        values[frame] = value


def _series(values: dict[float, float]) -> Series:
    seen = np.array(sorted(values))
    known = np.array([values[f] for f in seen.tolist()])
    jumps = np.flatnonzero(np.diff(seen) > HELD) + 1
    return Series(np.insert(seen, jumps, seen[jumps - 1] + 1.0), np.insert(known, jumps, np.nan))
