"""Tables of device configurations and sensor channels, and errors of fits.

The samples are simulated or recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..column_names import length_or_angle
from ..errors import DermisError
from ..npz import opened_npz
from ..number_rows import read_rows


class Fit(Protocol):
    """Learned function from inputs u to channels.

    The inputs are a configuration and a memory, see `SampleTable`.
    """

    @property
    def inputs(self) -> int:
        """Number of inputs, p."""
        ...

    @property
    def outputs(self) -> int:
        """Number of channels, c."""
        ...

    def predict(self, u: Array) -> Array:
        """Return the channels, shape (n, c), for rows of inputs, shape (n, p)."""
        ...

    def along(self, u: Array, ways: Array) -> tuple[Array, Array]:
        """Return the channels and their derivatives along given directions.

        The shapes are (c,) and (c, k).

        Args:
            u: inputs, shape (p,).
            ways: directions of the inputs, one in each column, shape (p, k).
        """
        ...


@dataclass(frozen=True, eq=False)
class SampleTable:
    """Samples for training.

    They are simulated, or recorded with a real sensor in a real device.

    Attributes:
        x: configurations: pitch, roll [rad] and distance [m], shape (n, 3); shape (n, 6) for devices with six degrees
            of freedom.
        memory: further quantities on which the channels depend, such as trial forces and the friction state of the
            previous step, shape (n, q), q >= 0; all columns have the same unit.
        channels: values to predict, such as stress components or readings of electrodes, shape (n, c).
        trajectory: number of the movement to which each row belongs, shape (n,).
    """

    x: Array
    memory: Array
    channels: Array
    trajectory: NDArray[np.int64]

    def __post_init__(self) -> None:
        n = len(self.x)
        shapes = (
            self.x.shape in ((n, 3), (n, 6))
            and self.memory.ndim == 2
            and self.channels.ndim == 2
            and len(self.memory) == len(self.channels) == len(self.trajectory) == n
        )
        if not shapes or n == 0:
            raise DermisError(
                "a table needs x (n, 3) or (n, 6), memory (n, q), channels (n, c) and trajectory (n,)",
                where="sample table",
                value=f"{self.x.shape}, {self.memory.shape}, {self.channels.shape}, {self.trajectory.shape}",
            )
        for name in ("x", "memory", "channels"):
            bad = np.flatnonzero(~np.isfinite(getattr(self, name)).all(axis=1))
            if len(bad):
                raise DermisError(f"{name} has values that are not finite", where=f"sample table, row {bad[0]}")

    @property
    def standard(self) -> tuple[Array, Array]:
        """Mean and scale of the inputs, each of shape (d + q,).

        There are d values of a configuration and q columns of the memory. A fit subtracts the mean and divides by the
        scale. All columns of the memory share one scale, their largest standard deviation, so that small columns stay
        small.
        """
        centre, scale = self.inputs.mean(axis=0), self.inputs.std(axis=0)
        scale[self.x.shape[1] :] = scale[self.x.shape[1] :].max(initial=0.0)
        scale[scale <= 1e-12 * max(float(scale.max()), 1e-300)] = 1.0
        return centre, scale

    @property
    def inputs(self) -> Array:
        """Configuration and memory side by side, shape (n, d + q)."""
        return np.concatenate([self.x, self.memory], axis=1)

    def without_memory(self) -> SampleTable:
        """Return the table without memory, for a model sigma(x). Source: [S0] 4.2."""
        return SampleTable(self.x, self.memory[:, :0], self.channels, self.trajectory)

    def rows(self, chosen: NDArray[np.bool_]) -> SampleTable:
        """Return the rows for which `chosen`, shape (n,), is true."""
        return SampleTable(self.x[chosen], self.memory[chosen], self.channels[chosen], self.trajectory[chosen])


def relative_rms(fit: Fit, table: SampleTable) -> float:
    """Return the relative RMS error of a fit.

    This is the RMS error, divided by the RMS of the channels about their mean.
    """
    miss = fit.predict(table.inputs) - table.channels
    spread = table.channels - table.channels.mean(axis=0)
    return float(np.sqrt((miss**2).sum() / (spread**2).sum()))


def movement_errors(fit: Fit, table: SampleTable) -> Array:
    """Return the relative RMS error of a fit in each movement.

    This is the RMS error of the movement, divided by the RMS of the channels about their mean in the whole table; shape
    (movements,).
    """
    miss = ((fit.predict(table.inputs) - table.channels) ** 2).sum(axis=1)
    spread = ((table.channels - table.channels.mean(axis=0)) ** 2).sum(axis=1).mean()
    owner = np.unique(table.trajectory, return_inverse=True)[1]
    return np.sqrt(np.bincount(owner, miss) / np.bincount(owner) / spread)


def read_table(path: Path) -> SampleTable:
    """Read a table from an .npz or .csv file.

    An .npz file has the arrays `x` and `channels`, and optionally `memory`, `trajectory` and `times`. Without
    `trajectory` all rows belong to one movement. In a .csv file the first three columns are `x`, and all others are
    channels. The names of the first three columns can state units; without a unit, `x` is in SI units.

    Raises:
        DermisError: the file cannot be read; an array is missing, has a wrong shape or has values that are not finite
            numbers; or `times` has not one value per row, each larger than the one before.
    """
    path, where = Path(path), str(path)
    if path.suffix.lower() == ".csv":
        rows = read_rows(path)
        units = [length_or_angle(name, where) for name in rows.names[:3]] or [1.0] * 3
        found = {"x": rows.values[:, :3] * units[: rows.values.shape[1]], "channels": rows.values[:, 3:]}
    else:
        with opened_npz(path, kind="a table") as archive:
            found = archive.arrays(n for n in ("x", "channels", "memory", "trajectory", "times") if n in archive.names)
    for name in ("x", "channels"):
        if name not in found:
            raise DermisError(f"'{name}' is missing", where=where, limit="x (n, 3) and channels (n, c)")
    arrays = {name: _numbers(value, name, where) for name, value in found.items()}
    for name in ("x", "channels", "memory"):
        if name in arrays and arrays[name].ndim != 2:
            raise DermisError(
                f"'{name}' needs two dimensions, with one row per sample",
                where=where,
                value=arrays[name].shape,
                limit="(n, 3): pitch, roll [rad], distance [m]" if name == "x" else "(n, c)",
            )
    if arrays["x"].shape[1] != 3:
        raise DermisError(
            "a table needs x (n, 3)", where=where, value=arrays["x"].shape, limit="pitch, roll [rad], distance [m]"
        )
    n = len(arrays["x"])
    owner = arrays.get("trajectory", np.zeros(n))
    if owner.shape != (n,) or not np.isfinite(owner).all():
        what = "'trajectory' needs one finite number per sample"
        raise DermisError(what, where=where, value=owner.shape, limit=f"({n},)")
    times = arrays.get("times", np.arange(n, dtype=np.float64))
    if times.shape != (n,) or not (np.diff(times) > 0.0).all():
        raise DermisError(
            "'times' needs one number per sample, each larger than the one before",
            where=where,
            value=times.shape,
            limit=f"({n},), rising",
        )
    return SampleTable(arrays["x"], arrays.get("memory", np.zeros((n, 0))), arrays["channels"], owner.astype(np.int64))


def _numbers(value: NDArray[Any], name: str, where: str) -> Array:
    try:
        if value.dtype.kind in "cSU":
            raise ValueError(f"values of type {value.dtype}")
        return np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise DermisError(f"'{name}' is not made of numbers", where=where, value=str(error)[:200]) from error
