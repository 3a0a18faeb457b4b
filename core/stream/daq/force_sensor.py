"""The calibration of a force and torque sensor.

Its file is JSON of version 1.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from ...files import read_text, write_bytes
from ...foreign import json_of

SCHEMA = "dermis-force-sensor 1"
UNITS = ("N", "N m")
MOST = 32  # largest number of channels
FULL = 0.98  # [1] part of the inputs' range beyond which a voltage may be cut off


@dataclass(frozen=True)
class ForceSensor:
    """A sensor with a calibration matrix.

    Attributes:
        name: name of the sensor.
        channels, units: names and units of the results, such as 'Fx' in 'N'.
        range: range of the inputs to either side of zero [V].
        matrix: rows of the calibration matrix, shape (results, inputs), in units of the results per volt.
    """

    name: str
    channels: tuple[str, ...]
    units: tuple[str, ...]
    range: float
    matrix: tuple[tuple[float, ...], ...]

    @property
    def inputs(self) -> int:
        """Number of voltages of the sensor."""
        return len(self.matrix[0])

    def forces(self, volts: Array, tare: Array) -> Array:
        """Return forces and torques, shape (n, results).

        Args:
            volts: voltages [V], shape (n, inputs). tare: voltages without a load [V], shape (inputs,).
        """
        return np.asarray((volts - tare) @ np.array(self.matrix).T)

    def beyond(self, volts: Array) -> int:
        """Return the number of rows with a voltage that may be cut off."""
        return int((np.abs(volts) >= FULL * self.range).any(axis=1).sum())

    def dumps(self) -> str:
        """Return the sensor as JSON; equal sensors give equal text."""
        return json.dumps({"schema": SCHEMA, **asdict(self)}, indent=1, allow_nan=False) + "\n"

    def save(self, path: Path) -> None:
        """Write the file, completely or not at all."""
        write_bytes(Path(path), self.dumps().encode("utf-8"))

    @classmethod
    def load(cls, path: Path) -> ForceSensor:
        """Read a file.

        Raises:
            DermisError: the file cannot be read, is not of this version, or its matrix does not fit its channels.
        """
        where = str(path)
        found: Any = json_of(read_text(path), where)
        known = {field.name for field in fields(cls)}
        if not isinstance(found, dict) or found.get("schema") != SCHEMA or set(found) != {"schema", *known}:
            raise DermisError("no force sensor", where=where, limit=f"{SCHEMA}: {', '.join(sorted(known))}")
        channels, units, rows = found["channels"], found["units"], found["matrix"]
        lists = all(isinstance(v, list) and 0 < len(v) <= MOST for v in (channels, units, rows))
        if (
            not lists
            or not all(isinstance(t, str) for t in (found["name"], *channels))
            or len(set(channels)) < len(rows)
        ):
            raise DermisError("its name, channels, units and matrix do not fit together", where=where)
        if len(units) != len(channels) or len(rows) != len(channels) or any(unit not in UNITS for unit in units):
            raise DermisError(
                "one unit and one row of the matrix a channel",
                where=where,
                value=str(units)[:80],
                limit=", ".join(UNITS),
            )
        widths = {len(row) if isinstance(row, list) else 0 for row in rows}
        numbers = [found["range"], *(value for row in rows if isinstance(row, list) for value in row)]
        if len(widths) != 1 or not 0 < min(widths) <= MOST or not all(map(_is_number, numbers)) or found["range"] <= 0:
            raise DermisError(
                "the rows of the matrix differ in length, or a number is out of range",
                where=f"{where}, matrix and range",
                limit="finite numbers, range above 0",
            )
        return cls(
            found["name"],
            tuple(channels),
            tuple(units),
            float(found["range"]),
            tuple(tuple(map(float, row)) for row in rows),
        )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and abs(value) < 1e9
