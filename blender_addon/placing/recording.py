"""Recorded poses from a text file: places over time, with or without how the thing was turned."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from mathutils import Matrix, Quaternion, Vector

from .._core import Array, DermisError, core

UNITS: Mapping[str, float] = {"M": 1.0, "CM": 1e-2, "MM": 1e-3}  # [m]
_COLUMNS = {3: "x, y, z", 4: "time, x, y, z", 7: "x, y, z, quaternion", 8: "time, x, y, z, quaternion"}
_Y_UP = Matrix(((1, 0, 0), (0, 0, -1), (0, 1, 0)))  # what is up there becomes up here


def read(path: Path, *, rate: float, unit: float, y_up: bool, w_last: bool) -> tuple[Array, list[Vector], list[Matrix]]:
    """Return times from 0 [s], places [m] and rotations; none of those where the file has places only.

    Args:
        path: .csv of 3, 4, 7 or 8 columns: time in seconds where there are 4 or 8, then x, y, z, then a quaternion.
        rate: rows a second, of a file without times. unit: of its places [m].
        y_up: Y is up in it, as in WebXR and Unity's exports. w_last: quaternions are x, y, z, w.

    Raises:
        DermisError: other columns, a value that is missing, or times that do not rise.
    """
    rows = core.number_rows.read_rows(path)
    count = rows.shape[1]
    if count not in _COLUMNS:
        raise DermisError(
            "these columns are no poses", where=str(path), value=count, limit=" | ".join(_COLUMNS.values())
        )
    if not np.isfinite(rows).all():
        bad = int(np.argmax(~np.isfinite(rows).all(axis=1)))
        raise DermisError("a value is missing or no number", where=f"{path}, row {bad + 1} of its numbers")
    timed = count in (4, 8)
    times = rows[:, 0] if timed else np.arange(len(rows)) / rate
    if len(times) < 2 or (np.diff(times) <= 0.0).any():
        later = int(np.argmax(np.diff(times) <= 0.0)) + 1 if len(times) > 1 else 0
        raise DermisError(
            "times do not rise",
            where=f"{path}, row {later + 1} of its numbers",
            value=float(times[later]),
            limit="two rows and more, each later than the one before",
        )
    values = rows[:, timed:]
    turn = _Y_UP if y_up else Matrix.Identity(3)
    places = [turn @ Vector(row[:3] * unit) for row in values]
    turned = []
    for row in values[:, 3:] if count > 4 else ():
        x, y, z, w = row if w_last else (*row[1:], row[0])
        quaternion = Quaternion((w, x, y, z))
        if quaternion.magnitude < 1e-6:
            raise DermisError("a quaternion of no length is no rotation", where=str(path))
        turned.append(turn @ quaternion.normalized().to_matrix())
    return times - times[0], places, turned
