"""`python -m core collect`: a look-up table from a built device.

The sensor is in the device, in place of a finger.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.coupling import refuse_coupled
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..files import check_writable, write_bytes
from ..matching.platforms import mechanism
from ..matching.readings import readings_of
from ..matching.sweep import sweep
from ..matching.table import press_of
from ..number_rows import read_rows
from ..presets import Library
from ..skin.model import skin_from_parameters
from ..stream.collect_session import Collected, CollectSession
from ..stream.device_options import log_from, request_from
from ..stream.local_stream import say
from ..stream.sensor_input import sensor_input, simulated_sensor
from ..stream.signals import Interrupted, Signals

VIRTUAL = "virtual:"  # value of --sensor, and beginning of --url, for a simulated sensor and device
ELECTRODES = (*(f"e{i + 1}" for i in range(19)), "pressure")  # channels of the simulated sensor
REST = -1  # row number of the sensor's rest in the file of an unfinished collection
# Largest RMS change of rows that are read again, as a share of the RMS touch, see `_drift`; a larger one is reported.
DRIFTED = 0.1


def run(options: argparse.Namespace) -> int:
    """Collect a table, or continue an unfinished one; return the exit status.

    The status is 0, or 128 plus the number of the signal that ended the collection.
    """
    spec = Library(options.presets).device(options.device)
    refuse_coupled(spec)
    home = mechanism(spec).rest
    simulated = options.sensor == VIRTUAL
    if simulated and not options.url.startswith(VIRTUAL):
        raise DermisError("a virtual sensor needs a virtual device", where="--sensor", value=options.url, limit=VIRTUAL)
    names = ELECTRODES if simulated else _names(options.channels)
    most = _limits(options.stop_at, names)
    check_writable(options.out)
    skin = skin_from_parameters(dict(Library(options.presets).skin(options.skin)), level=options.level)
    press = press_of(skin, spec)
    commands, unreached = sweep(spec, press.points.positions, options.rows)
    part = _part(options.out, spec, commands, names, options.settle, options.average)
    done, earlier = _read(part, len(commands), names)
    signals = Signals()
    held: list[Any] = []
    sensor = (
        simulated_sensor(
            "the virtual sensor",
            lambda: _pose(held[0], spec) if held else None,
            lambda at: readings_of(skin).sense(press.press(at[None]).force)[0].astype(np.float64),
        )
        if simulated
        else sensor_input(options.sensor, len(names))
    )
    more = {"mode": "follow", "ramp": options.ramp, "look_ahead": 0.0, **log_from(options)}
    request = request_from(options, options.device, connect=True, **more)
    channels = tuple(c.name for c in spec.channels)
    session = CollectSession(
        request, sensor, channels, signals, settle=options.settle, average=options.average, most=most
    )
    held.append(session)
    found, whole = list(done), False
    with signals.caught():
        try:
            session.prepare("goes through its poses with")
            ready = sum(not item.again for item in done)
            say(f"{len(commands)} rows, {ready} read already; {unreached} further poses are out of the motors' reach.")
            if not most:
                say("Without --stop-at, only the device's own limits end a press that is too strong.")
            say("Do not touch the sensor: its readings at rest are read for 1 s.")
            rest = session.rest(1.0).mean(axis=0)
            if earlier is not None:
                done = [replace(item, reading=item.reading + (rest - earlier)) for item in done]
                moved = float(np.abs(rest - earlier).max())
                say(
                    f"The sensor's rest has moved by up to {moved:.4g} since the earlier run: the rows of that run are "
                    "shifted by the change of each channel."
                )
            if not options.yes:
                session.confirm("The device is about to press the sensor. Enter: arm.")

            def keep(rows: Sequence[Collected]) -> None:
                found[:] = rows
                _write_part(part, rows, rest, names)

            session.collect(commands, home, rest, done, keep)
            whole = True
        except Interrupted:
            pass
        finally:
            session.shut()
            sensor.close()
            if not whole and found:
                rows = sum(not item.again for item in found)
                say(f"{rows} rows are kept in {part}; the same command continues there.")
    if session.unsure:
        raise session.refusal("the safe state could not be confirmed")
    if not whole:
        return 128 + signals.number
    drift = _drift(found, rest)
    _write_table(options.out, spec, np.vstack([home, commands]), rest, found, names, drift)
    part.unlink(missing_ok=True)
    for finding in _findings(drift):
        print(finding, file=sys.stderr)
    print(f"{options.out}: {len(commands)} rows and rest; {_words(drift)}")
    return 0


def _pose(session: Any, spec: DeviceSpec) -> Array | None:
    """Return the positions of a virtual device's motors.

    They are in the order and the units of the device's channels, shape (channels,). The result is None if the
    device is not connected, or has not reported them.
    """
    connection = session.streamer.connection
    values = connection.link.report().get("values") if connection is not None else None
    return None if not values else np.array([values[c.name] for c in spec.channels])


def _names(text: str) -> tuple[str, ...]:
    """Return the names of a sensor's channels.

    Args:
        text: the names, separated by commas; or the number of channels, which are then called c1, c2 ...

    Raises:
        DermisError: two names are equal, or a name is empty.
    """
    if text.isdigit() and int(text) > 0:
        return tuple(f"c{i + 1}" for i in range(int(text)))
    names = tuple(name.strip() for name in text.split(","))
    if len(set(names)) != len(names) or not all(names):
        raise DermisError("neither distinct names of channels nor their number", where="--channels", value=text)
    return names


def _limits(given: Sequence[str], names: Sequence[str]) -> dict[int, float]:
    found = {}
    for text in given:
        name, equals, value = text.partition("=")
        try:
            most = float(value)
        except ValueError:
            most = float("nan")
        if not equals or name not in names or not 0.0 < most < float("inf"):
            raise DermisError(
                "not CHANNEL=CHANGE", where="--stop-at", value=text, limit=f"above 0; {', '.join(names)[:120]}"
            )
        found[list(names).index(name)] = most
    return found


def _part(out: Path, spec: DeviceSpec, commands: Array, names: Sequence[str], settle: float, average: float) -> Path:
    """Return the path of the file with the rows of an unfinished collection.

    The path depends on the device, its commands, the sensor's channels and the times of reading. A collection that
    differs in any of these therefore has another file.

    Args:
        out: path of the table that is collected.
        spec: specification of the device.
        commands: all commands of the collection, shape (rows, motors).
        names: names of the sensor's channels.
        settle: time for which a pose is held before it is read [s].
        average: time over which a pose is read [s].
    """
    parts = (spec.hash.encode(), commands.tobytes(), ",".join(names).encode(), f"{settle!r} {average!r}".encode())
    return out.with_name(f"{out.stem}.{hashlib.sha256(b'|'.join(parts)).hexdigest()[:12]}.part.csv")


def _read(part: Path, count: int, names: Sequence[str]) -> tuple[list[Collected], Array | None]:
    """Return the rows of an unfinished collection, and the sensor's rest.

    The rest is that which the interrupted run measured, shape (channels,). Without a file there are no rows, and the
    rest is None.

    Args:
        part: path of the file, see `_part`.
        count: number of commands of the collection; rows with an index outside 0 to `count` - 1 are left out.
        names: names of the sensor's channels.

    Raises:
        DermisError: the file is damaged, or has other columns.
    """
    if not part.exists():
        return [], None
    rows = read_rows(part)
    if rows.names != ("row", "again", "at", *names) or not np.isfinite(rows.values).all():
        raise DermisError("not the rows of a collection", where=str(part), remedy="Remove it, and collect again")
    made = [Collected(int(row[0]), bool(row[1]), float(row[2]), row[3:]) for row in rows.values]
    rest = next((item.reading for item in made if item.row == REST), None)
    return [item for item in made if 0 <= item.row < count], rest


def _write_part(part: Path, rows: Sequence[Collected], rest: Array, names: Sequence[str]) -> None:
    lines = [",".join(("row", "again", "at", *names))]
    kept = [Collected(REST, True, 0.0, rest), *rows]
    lines += [",".join(f"{v:.12g}" for v in (r.row, r.again, r.at, *r.reading)) for r in kept]
    if rows:
        write_bytes(part, ("\n".join(lines) + "\n").encode())


def _drift(found: Sequence[Collected], rest: Array) -> Array:
    """Return the change and the touch of each row that was read again.

    The change is the norm, over the channels, of the second reading minus the first. The touch is the norm of the first
    reading minus the rest. The shape is (repetitions, 2).
    """
    first = {item.row: item.reading for item in found if not item.again}
    again = [item for item in found if item.again]
    off = [(r.reading - first[r.row], first[r.row] - rest) for r in again]
    return np.linalg.norm(np.array(off).reshape(len(off), 2, len(rest)), axis=2)


def _findings(drift: Array) -> list[Finding]:
    if not len(drift) or np.sqrt((drift[:, 0] ** 2).mean()) <= DRIFTED * np.sqrt((drift[:, 1] ** 2).mean()):
        return []
    what = "rows that were read again differ: the sensor drifts, or it was moved in the device"
    return [Finding("warning", "sensor-drift", what, "collection", _words(drift), f"{100 * DRIFTED:g} % of the touch")]


def _words(drift: Array) -> str:
    if not len(drift):
        return "too few rows to measure drift"
    rms = np.sqrt((drift**2).mean(axis=0))
    return (
        f"{len(drift)} rows read again differ by {rms[0]:.4g}, {100 * rms[0] / max(rms[1], 1e-300):.1f} % of the touch"
    )


def _write_table(
    out: Path,
    spec: DeviceSpec,
    commands: Array,
    rest: Array,
    found: Sequence[Collected],
    names: Sequence[str],
    drift: Array,
) -> None:
    """Write the table as CSV, with a comment on the drift.

    The row of rest is the first one.

    Args:
        out: path of the file.
        spec: specification of the device.
        commands: commands of rest and of all rows, shape (1 + rows, motors).
        rest: readings at rest, shape (channels,).
        found: the rows that were read.
        names: names of the sensor's channels.
        drift: see `_drift`.
    """
    first = {item.row: item.reading for item in found if not item.again}
    readings = np.vstack([rest, *(first[row] for row in range(len(commands) - 1))])
    lines = [f"# collected with {spec.key}: {_words(drift)}"]
    lines.append(",".join((*(f"{c.name} [{c.unit}]" for c in spec.channels), *names)))
    lines += [",".join(f"{v:.9g}" for v in row) for row in np.column_stack([commands, readings])]
    write_bytes(out, ("\n".join(lines) + "\n").encode())
