"""Look-up matching: motor commands for sensor readings by the nearest rows of a table, and the reverse.

The nearest rows (`nearest.neighbours`) are averaged with weights by the inverse square of their distance, less that of
the first row that is left out, or by a local fit if there are more than three motors (`local_fit`). Commands are then a
continuous function of the readings, so that rounding, which differs between computers, chooses nothing. A query that
equals a row returns that row. Of rows with equal readings, the one is taken whose command is nearest to the previous
one. All rows in which nothing touches are replaced by one rest row.

Source: [S2] eq. 1-4 and 8-10 with the corrections; weights that fall to zero at a distance: Franke and Nielson 1980
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..cache import cache_key
from ..devices.coupling import Coupling, coupling_of
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..following import in_time
from ..interpolate import interpolate
from ..parameters.device import DEVICE
from ..recent import Recent
from ..scene.tactile_scene import DeviceUse, TactileScene, device_times
from ..skin.model import SkinModel
from ..skin.observation import skin_key
from ..track.command_track import CommandTrack
from . import thimble
from .local_fit import REDUNDANT, fitted_mean
from .platforms import original_key
from .readings import readings_of, saturated, within_scale
from .rendered import Rendered
from .table import SkinTable, belongs, build
from .thimble_use import by_stress

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact
    from .nearest import NearestPoints, Neighbours


# Share of a motor's range. Smaller excesses by a coupling, and smaller delays by a motor's speed, are not reported.
SLACK = 0.01
ROWS = DEVICE["table_rows"].default
# Distances of commands, over the motors' ranges, that differ by less count as equal. Files may hold commands in single
# precision, with a rounding error of 6e-8 of a command.
EQUALLY_NEAR = 1e-6
TABLES = 8  # number of tables that are kept in memory


def commands_of(table: SkinTable, readings: NDArray[Any], last: Array | None = None) -> Array:
    """Return the motor commands for sensor readings.

    Readings that cannot be distinguished from those of untouched skin give the command of rest.

    Args:
        table: the look-up table.
        readings: readings in the table's unit, in order of time, shape (q, channels).
        last: command before the first query, for rows with equal readings, shape (motors,); None for that of rest.

    Returns:
        Commands in SI units, shape (q, motors).

    Raises:
        DermisError: the number of channels is wrong, or a reading is not finite.

    Source: [S2] eq. 2-4
    """
    readings = np.asarray(readings, np.float64)
    if readings.shape == (1, table.readings.shape[1]):
        alone = _alone(table, readings[0])
        if alone is not None:
            return alone[None]
    rest = table.commands[table.rest]
    loud = np.arange(len(readings))
    if table.noise_floor > 0.0 and readings.shape[1:] == table.readings.shape[1:]:
        # Readings within the noise of rest need no search. NaN is not among them, so that the search raises the error.
        loud = np.flatnonzero(~(table.from_rest(readings) <= table.noise_floor))
    out = np.tile(rest, (len(readings), 1))
    if not len(loud):
        return out
    searched, values = table.by_reading, table.heard_commands
    found = searched.query(readings[loud], table.neighbours)
    out[loud] = _mean(table, searched, readings[loud], found, values[searched.first[found.index]])
    for at in np.flatnonzero(searched.repeated[found.index].any(axis=1)).tolist():  # these depend on those before them
        i = int(loud[at])
        before = out[i - 1] if i else rest if last is None else np.asarray(last, np.float64)
        rows = [_nearest_row(searched.rows(point), values, before, table.scale) for point in found.index[at].tolist()]
        out[i] = _mean(table, searched, readings[i : i + 1], found.take(slice(at, at + 1)), values[rows][None])[0]
    return out


def readings_for(table: SkinTable, commands: Array) -> Array:
    """Return the readings to expect from motor commands, shape (q, channels).

    Distances are those of commands divided by each motor's range.

    Args:
        table: the look-up table.
        commands: commands in SI units, shape (q, motors).

    Source: [S2] eq. 8-10
    """
    scaled = np.asarray(commands, np.float64) / table.scale
    searched = table.by_command
    found = searched.query(scaled, table.neighbours)
    return _mean(table, searched, scaled, found, table.exact_readings[searched.first[found.index]])


def _alone(table: SkinTable, reading: Array) -> Array | None:
    """Return the command for a single reading, shape (motors,), faster than `commands_of`.

    None for more than three motors and where `NearestPoints.query_one` has no answer.
    """
    if table.noise_floor > 0.0:
        off = reading - table.exact_readings[table.rest]
        if math.sqrt(off.dot(off)) <= table.noise_floor:
            return table.commands[table.rest].copy()
    motors, searched = table.commands.shape[1], table.by_reading
    found = searched.query_one(reading, table.neighbours) if motors < REDUNDANT else None
    if found is None:
        return None
    points, weights = found
    mean: Array = weights.dot(table.heard_commands.take(searched.first.take(points), axis=0)) / weights.sum()
    return mean


def _nearest_row(rows: Indices, values: Array, before: Array, scale: Array) -> int:
    """Return the row whose command is nearest to a command, the lowest of those that are equally near."""
    away = np.sqrt((((values[rows] - before) / scale) ** 2).sum(axis=1))
    return int(rows[np.flatnonzero(away <= away.min() + EQUALLY_NEAR)[0]])


def _mean(table: SkinTable, searched: NearestPoints, queries: Array, found: Neighbours, values: Array) -> Array:
    """Return the weighted mean of the neighbours' values, shape (q, k, m), for each query, shape (q, m)."""
    if table.commands.shape[1] >= REDUNDANT:
        return fitted_mean(searched.points[found.index], queries, found, values)
    mean: Array = np.matmul(found.weights[:, None], values)[:, 0]
    return mean


def render(
    pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec, skin: SkinContact
) -> Rendered:
    """Render one finger's platform: look up the virtual sensor's readings of every sample.

    Parameters of the use: table (path of a collected table; if empty, a small one is swept and kept with the skin),
    table_rows (size of that one), and platform_method, by which six legs can be matched by a search instead (see
    `thimble.render`). For a device with couplings, the commands of the original motors are looked up. Its own commands
    are those that come nearest to them.

    Signals: 'contact', 'sensed_error' (norm of the difference between the readings and those that the table predicts
    for the command) [counts], 'target_force' [N], and 'clipped' (1 where a motor would leave its range).

    Raises:
        DermisError: the table cannot be read or belongs to another device, or the preset is broken.

    Source: [S2] III
    """
    p = use.parameters
    if by_stress(spec, p):
        return thimble.render(pad_contact, scene, finger, use, spec, skin)
    path = DEVICE["table"].of(p, spec.key)
    table = table_of(skin.model, spec, path, int(DEVICE["table_rows"].of(p, spec.key)))
    sensor = readings_of(skin.model)
    count = len(skin.times)
    rest = table.commands[table.rest]
    commands = np.tile(rest, (count, 1))
    series = {name: np.zeros(count) for name in ("contact", "sensed_error", "target_force", "clipped")}
    findings = list(belongs(table, spec, skin.model, path))
    touched, felt_on = skin.contact, "nodes" if skin.points is None else "points"
    if len(touched) and table.meta.get("pressed_on", felt_on) != felt_on:
        findings.append(
            Finding(
                "info",
                "other-contact",
                f"contact is solved at {felt_on}, but in the table at {table.meta['pressed_on']}: on a draft skin this "
                "may change the touch by a fifth",
                f"finger '{scene.fingers[finger].name}'",
                remedy="Set the finger's Contact to the same as the table's, or collect the table again",
            )
        )
    felt = skin.force
    if len(touched):
        sensed = within_scale(sensor.counts(felt, skin.amounts))
        commands[touched] = commands_of(table, sensed)
        series["contact"][touched] = 1.0
        series["target_force"][touched] = felt[:, :, 2].sum(axis=1)
        full = saturated(sensed)
        if full:
            findings.append(
                Finding(
                    "warning",
                    "sensor-saturated",
                    "the virtual sensor is saturated",
                    "look-up matching",
                    limit="0 to 4095 counts",
                    count=full,
                    remedy="Touch less deeply",
                )
            )
    else:
        findings.append(
            Finding(
                "info",
                "no-touch",
                "the finger touches nothing, so the platform stays at rest",
                f"finger '{scene.fingers[finger].name}'",
            )
        )
    limited, driven, beyond, told = driven_within(spec, commands, skin.frames)
    series["clipped"][beyond] = 1.0
    findings += told
    coupling = coupling_of(spec)
    own_rest = rest if coupling is None else coupling.reduced(rest)
    name = scene.fingers[finger].name
    limited, late = _in_time(spec, skin.times, limited, own_rest, series["contact"] > 0.0, name, skin.frames)
    driven = limited if coupling is None else coupling.original(limited)
    findings += late
    if len(touched):
        expected = readings_for(table, driven[touched])
        series["sensed_error"][touched] = np.linalg.norm(expected - sensed, axis=1)
    times = device_times(scene, spec.rate)
    if count > 1:
        at = np.minimum(times, skin.times[-1])
        limited = interpolate(skin.times, limited, at)
        series = {name: interpolate(skin.times, s[:, None], at)[:, 0] for name, s in series.items()}
    meta = {
        "method": "lookup",
        "table_rows": str(len(table.commands)),
        "neighbours": str(table.neighbours),
        "sensor": "virtual, 19 electrodes and pressure",
    }
    skipped = {"lookups_without_contact": count - len(touched)}
    return Rendered(CommandTrack(spec, times, limited, meta), series, tuple(findings), skipped)


def _in_time(
    spec: DeviceSpec, times: Array, commands: Array, rest: Array, touched: NDArray[np.bool_], finger: str, frames: Array
) -> tuple[Array, list[Finding]]:
    """Return commands within the motors' speeds, and findings where a speed delays the look-up.

    The motors start before a touch, and return to rest after it.
    """
    slews = np.array([np.inf if c.slew is None else c.slew for c in spec.channels])
    path = in_time(times, commands, touched, slews, np.clip(rest, *_ends(spec)))
    away = np.where(touched, np.abs(path - commands).max(axis=1, initial=0.0), 0.0)
    late = away > SLACK * np.ptp(_ends(spec), axis=0).max()
    if not late.any():
        return path, []
    what = "a motor's speed holds the look-up back"
    worst = f"by up to {away.max():.3g} {spec.channels[0].unit}"
    where, frame = f"finger '{finger}', {spec.key}", float(frames[away.argmax()])
    return path, [Finding("info", "servo-limit", what, where, worst, frame=frame, count=int(late.sum()))]


def driven_within(
    spec: DeviceSpec, original: Array, frames: Array | None = None
) -> tuple[Array, Array, NDArray[np.bool_], list[Finding]]:
    """Return a device's own commands for commands of its original motors, which couplings drive.

    Args:
        spec: preset of the device.
        original: wanted commands of the original motors in SI units, shape (n, motors).
        frames: scene frames of the samples, for findings; None outside a scene.

    Returns:
        The device's own commands within its range, shape (n, channels); the commands of the original motors that result
        from them, shape (n, motors); whether a motor is held at an end of its range, shape (n,); findings.
    """
    coupling = coupling_of(spec)
    values = original if coupling is None else coupling.reduced(original)
    limited = np.clip(values, *_ends(spec))
    beyond = np.abs(limited - values).max(axis=1) > 1e-9 * np.maximum(np.abs(values).max(axis=1), 1e-9)
    findings = []
    if beyond.any():
        worst = float(np.abs(limited - values).max())
        findings.append(
            Finding(
                "warning",
                "motor-range",
                "a motor would leave its range and stays at its end",
                f"device '{spec.key}'",
                f"by up to {worst:.3g} {spec.channels[0].unit}",
                frame=None if frames is None else float(frames[beyond.argmax()]),
                count=int(beyond.sum()),
            )
        )
    if coupling is None:
        return limited, limited, beyond, findings
    driven = coupling.original(limited)
    return limited, driven, beyond, findings + _overdriven(coupling, driven, spec, frames)


def commands_now(
    table: SkinTable, spec: DeviceSpec, skin: SkinModel, force: Array, amounts: Array | None = None
) -> Array:
    """Return the device's own commands for one moment, within its range, shape (channels,).

    Args:
        table: the look-up table.
        spec: preset of the device.
        skin: model of the finger's skin.
        force: forces on the pad nodes [N], shape (1, m, 3); shape (0, m, 3) if nothing touches, which gives the
            commands of rest.
        amounts: `Stimulus.given` on skin with a nonlinear law [m], shape (3 m,); None computes it from the force.
    """
    coupling = coupling_of(spec)
    original = table.commands[table.rest]
    if len(force):
        sensed = readings_of(skin).counts(force, None if amounts is None else amounts[None])
        original = commands_of(table, within_scale(sensed))[-1]
    return np.clip(original if coupling is None else coupling.reduced(original), *_ends(spec))


def _overdriven(coupling: Coupling, driven: Array, spec: DeviceSpec, frames: Array | None) -> list[Finding]:
    """Report original motors that a coupling would drive beyond their range."""
    low, high = np.array([(c.low or 0.0, c.high or 0.0) for c in coupling.channels]).T
    beyond = np.maximum(low - driven, driven - high)
    wrong = (beyond > SLACK * (high - low)).any(axis=1)
    if not wrong.any():
        return []
    i, j = np.unravel_index(int(beyond.argmax()), beyond.shape)
    unit = coupling.channels[j].unit
    return [
        Finding(
            "warning",
            "original-range",
            "a coupling drives an original motor beyond its range",
            f"device '{spec.key}', motor {j + 1}",
            f"{driven[i, j]:.3g} {unit}",
            f"{low[j]:.3g} to {high[j]:.3g} {unit}",
            "Use more motors, or check that the mechanism allows it",
            frame=None if frames is None else float(frames[wrong.argmax()]),
            count=int(wrong.sum()),
        )
    ]


def _ends(spec: DeviceSpec) -> tuple[Array, Array]:
    low = np.array([-np.inf if c.low is None else c.low for c in spec.channels])
    return low, np.array([np.inf if c.high is None else c.high for c in spec.channels])


_TABLES: Recent[tuple[str, str, int], SkinTable] = Recent(TABLES)  # by all inputs of a sweep


def table_of(skin: SkinModel, spec: DeviceSpec, path: str = "", rows: int = ROWS) -> SkinTable:
    """Return a device's table for a skin, from a file, from memory or the skin's cache, or swept now.

    Args:
        skin: model of the finger's skin.
        spec: preset of the device.
        path: file of the table; empty for a table that is swept.
        rows: number of rows of a table that is swept.

    Raises:
        DermisError: the file cannot be read, or the table belongs to another device.
    """
    table = table_at_hand(skin, spec, path, rows)
    if table is None:
        table = build(spec, skin, readings_of(skin), rows)
        keep_table(skin, spec, rows, table)
    return table


def table_at_hand(skin: SkinModel, spec: DeviceSpec, path: str = "", rows: int = ROWS) -> SkinTable | None:
    """Return a device's table for a skin if it need not be swept, else None; see `table_of`.

    Raises:
        DermisError: the file cannot be read, or the table belongs to another device.
    """
    if path:
        return _from_file(Path(path), spec)
    name = _table_name(skin, spec, rows)
    if name not in _TABLES and skin.cache is not None:
        found = skin.cache.get(cache_key("dermis-skin-table 3", *map(str, name)))
        if found is not None:
            with contextlib.suppress(DermisError):  # a damaged table is swept again
                table = SkinTable.load(found)
                _TABLES.make(name, lambda: table)
    return _TABLES.get(name)


def keep_table(skin: SkinModel, spec: DeviceSpec, rows: int, table: SkinTable) -> None:
    """Keep a table in memory, and in the skin's cache if it has one."""
    name = _table_name(skin, spec, rows)
    _TABLES.pop(name, None)
    _TABLES.make(name, lambda: table)
    if skin.cache is not None:
        skin.cache.put(cache_key("dermis-skin-table 3", *map(str, name)), table.save)


def _table_name(skin: SkinModel, spec: DeviceSpec, rows: int) -> tuple[str, str, int]:
    return original_key(spec), skin_key(skin) + repr(skin.material), rows


def _from_file(path: Path, spec: DeviceSpec) -> SkinTable:
    """Read a table; it is read again only after the file has changed."""
    try:
        stat = path.stat()
    except (OSError, ValueError) as error:
        raise DermisError("the file does not exist", where=str(path)) from error
    stamp = str(path), stat.st_mtime_ns, stat.st_size
    table = _files.make(stamp, lambda: SkinTable.load(path))
    belongs(table, spec, where=str(path))
    return table


_files: Recent[tuple[str, int, int], SkinTable] = Recent(1)


def known(table: SkinTable) -> Mapping[str, Any]:
    """Return the origin and the size of a table, for reports."""
    return {"rows": len(table.commands), **table.meta}
