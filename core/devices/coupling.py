"""Coupling: motors that each replace several motors of a platform.

A new motor drives the axes of several original motors, by pulleys or levers.

The original commands are m = offset + matrix c for commands c of the new motors.

Source: [S2] IV.B and VI (pulley radii are multiples of the components)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .spec import Channel, DeviceSpec


@dataclass(frozen=True, eq=False)
class Coupling:
    """Linear map from commands of k new motors to those of n original motors.

    Attributes:
        matrix: change of the original commands for a unit command of each new motor, shape (n, k).
        offset: original commands for zero commands, shape (n,).
        channels: channels of the original motors, with their ranges.
    """

    matrix: Array
    offset: Array
    channels: tuple[Channel, ...]

    def original(self, commands: Array) -> Array:
        """Return the original commands, shape (..., n).

        Args:
            commands: commands of the new motors, shape (..., k).
        """
        return self.offset + commands @ self.matrix.T

    def reduced(self, commands: Array) -> Array:
        """Return the nearest commands of the new motors, shape (..., k).

        Distances are those of original commands divided by the motors' ranges.

        Args:
            commands: original commands, shape (..., n).
        """
        scale = 1.0 / np.array([(c.high or 0.0) - (c.low or 0.0) for c in self.channels])
        inverse = np.linalg.pinv(self.matrix * scale[:, None]) * scale
        return (commands - self.offset) @ inverse.T


def coupling_of(spec: DeviceSpec) -> Coupling | None:
    """Return the coupling of a preset by `design`; None for other presets.

    Raises:
        DermisError: the matrix does not fit the motors, or has fewer independent columns than there are new motors.
    """
    p, where = spec.parameters, f"device preset '{spec.key}'"
    if "coupling" not in p:
        return None
    matrix = np.asarray(p["coupling"], np.float64)
    offset, low, high = (
        np.asarray(p.get(name, []), np.float64) for name in ("coupling_offset", "coupling_low", "coupling_high")
    )
    n, k = len(offset), len(spec.channels)
    if matrix.shape != (n, k) or low.shape != (n,) or high.shape != (n,) or not (high > low).all():
        raise DermisError(
            "the coupling does not fit the motors",
            where=where,
            value=f"{matrix.shape}, {n} offsets",
            limit=f"({n}, {k}), a range for each original motor",
        )
    if np.linalg.matrix_rank(matrix) < k:
        raise DermisError("two motors of the coupling are equal", where=where)
    unit = spec.channels[0].unit if "coupling_unit" not in p else str(p["coupling_unit"])
    channels = tuple(Channel(f"original_{i + 1}", unit, low=float(low[i]), high=float(high[i])) for i in range(n))
    return Coupling(matrix, offset, channels)


def refuse_coupled(spec: DeviceSpec) -> None:
    """Refuse a device whose motors are coupled already.

    Couplings are searched for the original device.

    Raises:
        DermisError: the device has a coupling.
    """
    if "coupling" in spec.parameters:
        raise DermisError(
            "its motors are coupled already", where=f"device preset '{spec.key}'", remedy="Choose the original device"
        )
