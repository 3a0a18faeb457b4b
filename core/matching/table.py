"""SkinTable: look-up table of a device's commands and the readings of a sensor in the skin.

Source: [S2] III.A, with corrections: one rest row replaces all configurations without contact, and each row starts at
rest
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.solver.law_frame import USABLE
from ..devices.press import Press, Pressed
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..files import write_npz
from ..foreign import json_of
from ..npz import opened_npz
from ..skin.model import SkinModel
from ..skin.observation import skin_key
from ..surrogate.press_points import press_points
from .nearest import NEIGHBOURS, NearestPoints, neighbours
from .platforms import mechanism, mechanism_key, scale_of
from .readings import Readings, saturated, within_scale
from .sweep import sweep

FORMAT = "dermis-skin-table 1"
UNBALANCED = 0.02  # largest unbalanced force on a platform; other rows are left out [N]
# Noise floor, relative to the expected norm of the noise. With 20 channels, 1 in 10,000 readings of untouched skin
# exceeds it.
NOISE_FLOOR = 1.7
UNSETTLED = 5e-3  # largest residual of Coulomb's law; other rows are left out


@dataclass(frozen=True, eq=False)
class SkinTable:
    """Look-up table of commands and readings.

    Attributes:
        commands: commands of each row, in SI, shape (n, motors).
        readings: readings of the sensor in its unit, shape (n, channels).
        rest: index of the row without contact.
        scale: range of each motor, by which commands are divided for distances, shape (motors,).
        noise_floor: distance from the readings of rest up to which readings count as rest. Rows and queries within it
            are replaced by the rest row. 0 for a sensor without noise.
        meta: origin of the table: device, skin, and numbers of rows that were left out.

    Raises:
        DermisError: there are fewer rows than neighbours, shapes do not fit, or a scale is not above zero.
    """

    commands: Array
    readings: NDArray[Any]
    rest: int
    scale: Array
    noise_floor: float = 0.0
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.commands)
        if n < NEIGHBOURS:
            raise DermisError(
                "too few rows",
                where="look-up table",
                value=n,
                limit=f">= {NEIGHBOURS}",
                remedy="Sweep more configurations, or press deeper",
            )
        if self.commands.ndim != 2 or self.readings.ndim != 2 or len(self.readings) != n:
            raise DermisError(
                "commands and readings do not fit",
                where="look-up table",
                value=f"{self.commands.shape}, {self.readings.shape}",
            )
        if self.scale.shape != (self.commands.shape[1],) or not (self.scale > 0.0).all():
            raise DermisError("each motor needs a range above zero", where="look-up table", value=self.scale.tolist())
        if not np.isfinite(self.commands).all():
            raise DermisError("a command is not finite", where="look-up table")
        if not 0 <= self.rest < n:
            raise DermisError("the rest row does not exist", where="look-up table", value=self.rest)

    @property
    def neighbours(self) -> int:
        """Number of rows that are averaged, see `nearest.neighbours`."""
        return neighbours(self.commands.shape[1])

    @cached_property
    def by_reading(self) -> NearestPoints:
        """Search structure by readings, without rows that count as rest."""
        return NearestPoints(self.readings[self.heard])

    @cached_property
    def heard(self) -> NDArray[np.intp]:
        """Indices of the rest row and of the rows that do not count as rest, rising.

        Raises:
            DermisError: there are fewer than `NEIGHBOURS`.
        """
        told = self.from_rest(self.readings) > self.noise_floor
        told[self.rest] = True
        rows = np.flatnonzero(told)
        if len(rows) < NEIGHBOURS:
            raise DermisError(
                "too few rows differ from rest",
                where="look-up table",
                value=len(rows),
                limit=f">= {NEIGHBOURS}",
                remedy="Press deeper, use a sensor with less noise, or state the noise in the sensor's own unit",
            )
        return rows

    @cached_property
    def heard_commands(self) -> Array:
        """Commands of the rows in `by_reading`, in its order, in SI units."""
        return self.commands[self.heard]

    @cached_property
    def exact_readings(self) -> Array:
        """Readings of all rows in double precision."""
        return np.asarray(self.readings, np.float64)

    def from_rest(self, readings: NDArray[Any]) -> Array:
        """Return the distance of readings from those of rest, shape (n,)."""
        off = np.asarray(readings, np.float64) - self.exact_readings[self.rest]
        return np.sqrt(np.einsum("ij,ij->i", off, off))

    def heard_with(self, noise: float) -> SkinTable:
        """Return the same table for a sensor with a standard deviation `noise` in each channel."""
        return replace(self, noise_floor=noise_floor(noise, self.readings.shape[1]))

    @cached_property
    def by_command(self) -> NearestPoints:
        """Search structure by commands divided by the motors' ranges."""
        return NearestPoints(self.commands / self.scale)

    def save(self, path: Path) -> None:
        """Write the table, with commands in single precision; after an error an existing file is unchanged."""
        header = np.frombuffer(json.dumps({"format": FORMAT, **self.meta}, sort_keys=True).encode(), np.uint8)
        write_npz(
            Path(path),
            {
                "header": header,
                "commands": self.commands.astype(np.float32),
                "readings": self.readings,
                "rest": np.array(self.rest),
                "scale": self.scale,
            },
        )

    @classmethod
    def load(cls, path: Path) -> SkinTable:
        """Read a table.

        Raises:
            DermisError: the file cannot be read or is not a look-up table.
        """
        where = str(path)
        if Path(path).suffix.lower() == ".csv":
            raise DermisError(
                "a recorded table cannot be used for rendering yet",
                where=where,
                limit=".npz",
                remedy="Convert it: core design --table FILE.csv --save-table FILE.npz",
            )
        with opened_npz(path, where, "a look-up table") as archive:
            meta = json_of(archive.array("header").tobytes(), f"{where}, header")
            commands, readings, rest, scale = (archive.array(n) for n in ("commands", "readings", "rest", "scale"))
        if not isinstance(meta, dict) or meta.pop("format", None) != FORMAT:
            raise DermisError("not a look-up table of this version", where=where, limit=FORMAT)
        for name, array, sides, kinds in (
            ("commands", commands, 2, "f"),
            ("readings", readings, 2, "uif"),
            ("rest", rest, 0, "ui"),
            ("scale", scale, 1, "f"),
        ):
            if array.ndim != sides or array.dtype.kind not in kinds or not np.isfinite(array).all():
                raise DermisError(
                    "not the numbers of a look-up table",
                    where=f"{where}, {name}",
                    value=f"{array.dtype} {array.shape}"[:80],
                    remedy="Collect the table again",
                )
        return cls(commands.astype(np.float64), readings, int(rest), scale.astype(np.float64), 0.0, meta)


def noise_floor(noise: float, channels: int) -> float:
    """Return the distance from rest up to which readings count as rest.

    Args:
        noise: standard deviation of the noise in each channel.
        channels: number of channels.
    """
    return NOISE_FLOOR * noise * float(np.sqrt(channels))


def press_of(skin: SkinModel, spec: DeviceSpec) -> Press:
    """Return the press of a preset's platform on a skin."""
    return Press(press_points(skin), mechanism(spec), float(spec.value("friction")))


def sound(pressed: Pressed) -> NDArray[np.bool_]:
    """Return whether rows are in equilibrium and have small residuals of contact and of the tissue's law, (n,)."""
    good: NDArray[np.bool_] = (pressed.imbalance <= UNBALANCED) & (pressed.residual <= UNSETTLED)
    return good & (pressed.left <= USABLE)


def tabulate(readings: Readings, commands: Array, pressed: Pressed) -> tuple[Array, Array, dict[str, int]]:
    """Return commands and readings of the valid rows with contact, and numbers of other rows by reason.

    Readings are not rounded to whole counts: a rounded reading may differ by a count between computers, and in light
    touches neighbouring rows differ by no more. A row in which the tissue's law did not converge is kept if its
    residual is below `USABLE`.

    Args:
        readings: the virtual sensor.
        commands: commands of all rows, shape (n, motors).
        pressed: result of pressing them.
    """
    good = sound(pressed)
    keep = good & pressed.touching
    amounts = None if pressed.amounts is None else pressed.amounts[keep]
    counts = within_scale(readings.counts(pressed.force[keep], amounts))
    left = {
        "rest_rows": int((good & ~pressed.touching).sum()),
        "unbalanced_rows": int((~good).sum()),
        "saturated_rows": saturated(counts),
        "law_unsettled_rows": int((pressed.left[keep] > 0.0).sum()),
    }
    return commands[keep], counts, left


def build(spec: DeviceSpec, skin: SkinModel, readings: Readings, rows: int) -> SkinTable:
    """Compute a small table in this process; for large ones see `design.collect`."""
    press = press_of(skin, spec)
    commands, unreached = sweep(spec, press.points.positions, rows)
    kept, counts, left = tabulate(readings, commands, press.press(commands))
    asked = {"asked": len(commands) + unreached, "unreached_rows": unreached, "pressed_on": press.points.on}
    return assemble(spec, skin, readings, kept, counts, {**asked, **left})


def assemble(
    spec: DeviceSpec, skin: SkinModel, sensor: Readings, commands: Array, counts: Array, meta: Mapping[str, Any]
) -> SkinTable:
    """Return the table of the rows with contact, with a rest row before them and the origin of the table.

    Its numbers are rounded to single precision, so that a table from a file is the same.
    """
    rows = np.vstack([mechanism(spec).rest, commands]).astype(np.float32).astype(np.float64)
    readings = np.vstack([sensor.rest, counts]).astype(np.float32)
    about = {
        "device": spec.key,
        "device_hash": spec.hash,
        "mechanism": mechanism_key(spec),
        "skin": skin_key(skin),
        "material": repr(skin.material),
        "tissue": skin.tissue,
        **meta,
    }
    return SkinTable(rows, readings, 0, scale_of(spec), 0.0, about)


def belongs(table: SkinTable, spec: DeviceSpec, skin: SkinModel | None = None, where: str = "") -> tuple[Finding, ...]:
    """Check that a table belongs to a device; a table of another skin gives a finding.

    Recorded tables do not contain their device and skin.

    Args:
        table: the table.
        spec: preset of the device.
        skin: model of the finger's skin; None does not check the skin.
        where: name of the table, for errors.

    Raises:
        DermisError: the table has another number of motors, or is of a mechanism with other dimensions.
    """
    where, motors = where or "look-up table", len(mechanism(spec).rest)
    if table.commands.shape[1] != motors:
        raise DermisError(
            "the table is of another device",
            where=where,
            value=f"{table.commands.shape[1]} motors",
            limit=f"{motors} motors",
        )
    if table.meta.get("mechanism", mechanism_key(spec)) != mechanism_key(spec):
        raise DermisError(
            "the table is of another device, or of one with other dimensions",
            where=where,
            value=table.meta.get("device"),
            limit=f"device preset '{spec.key}' as it is now",
            remedy="Collect a table for this preset",
        )
    own = None if skin is None else (skin_key(skin), repr(skin.material))
    if own is None or own == (table.meta.get("skin", own[0]), table.meta.get("material", own[1])):
        return ()
    return (
        Finding(
            "warning",
            "other-skin",
            "the table was made for another skin, so commands are off",
            where,
            remedy="Collect a table for this finger's size, accuracy and stiffness",
        ),
    )
