"""`python -m core follow`, `stream follow` and `validate`.

`follow` makes a track from a recording of a sensor, and `stream follow` lets a device follow a sensor live. `validate`
compares the readings of a played track with their target.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..design import playback, task
from ..design.follow import Followed, Follower, follow, table_of
from ..design.recorded_table import rest_finding
from ..design.recordings import read_recording
from ..devices.spec import DeviceSpec
from ..errors import DermisError
from ..files import keep_apart, write_bytes
from ..matching.table import SkinTable, belongs
from ..plot import stimuli as plot_stimuli
from ..plot import track as plot_track
from ..presets import Library
from ..stream.device_options import log_from, request_from
from ..stream.local_stream import say
from ..stream.sensor_input import sensor_input
from ..stream.sensor_session import SensorSession
from ..stream.signals import Interrupted, Signals
from ..track import csv, export
from . import thimble

CLOUD = 4000  # most rows of the table that are drawn as dots
# [Hz] Default rate of live commands, unless the device's own rate is higher. A reading then waits for at most 2 ms. A
# link that is too slow for the rate is reported.
RATE = 500.0


def run(options: argparse.Namespace) -> int:
    """Write a track that follows a recording; return the exit status."""
    if options.noise is not None and not 0.0 <= options.noise < float("inf"):
        raise DermisError("noise is a standard deviation", where="--noise", value=options.noise, limit=">= 0")
    for out in (options.out, options.plot):
        keep_apart(out, options.stimuli, options.table)
    keep_apart(options.plot, options.out)
    spec = Library(options.presets).device(options.device)
    if spec.kind == "thimble" and options.method == "learned":
        _refuse(options, ("motors", "rest", "rest_rows", "plot"), "for look-ups only; a thimble uses a learned model")
        return thimble.follow(options)
    if options.table is None:
        raise DermisError(
            "a look-up needs a table of this device and this sensor",
            where="--table",
            remedy="Record one: motor commands and the sensor's channels, a row a configuration",
        )
    table = table_of(spec, options.table, options.rest_rows)
    recording = read_recording(options.stimuli, options.rest)
    found = follow(spec, table, recording, noise=options.noise, motors=options.motors)
    csv.write(found.track, options.out)
    if options.plot is not None:
        _draw(found, options.plot)
    for finding in found.findings:
        print(finding, file=sys.stderr)
    print(f"{options.out}: {found.words()}")
    return 0


def _draw(found: Followed, path: Path) -> None:
    """Draw the track; samples with a touch are shaded."""
    write = {".svg": plot_track.write_svg, ".png": plot_track.write_png}.get(path.suffix.lower())
    if write is None:
        raise DermisError("unknown kind of picture", where=str(path), value=path.suffix, limit=".png, .svg")
    touched = np.interp(found.track.times, found.times, found.touched.astype(float))
    write(found.track, path, contact=touched)


def _refuse(options: argparse.Namespace, names: tuple[str, ...], why: str) -> None:
    for name in names:
        if getattr(options, name) not in (None, ()):
            raise DermisError(f"this option is {why}", where=f"--{name.replace('_', '-')}")


def validate(options: argparse.Namespace) -> int:
    """Compare the readings of a played track with their target.

    Print the result, write it if --out is given, and return the exit status.
    """
    track = export.read(options.track)
    spec = track.spec
    table = table_of(spec, options.table, options.rest_rows)
    recording = read_recording(options.recording, options.rest, [options.sync] if options.sync else [])
    target = None if options.target is None else read_recording(options.target, options.rest)
    sync = (recording.beside[options.sync], options.sync_at) if options.sync else None
    found = playback.playback(track, table, recording, target, sync=sync)
    text = playback.as_text(found)
    print(text, end="")
    if options.out is not None:
        write_bytes(options.out / "validation.txt", text.encode())
        write_bytes(options.out / "validation.csv", playback.as_csv(found).encode())
        _draw_components(found, table, spec, options.out / "validation.png")
    return 0


def _draw_components(found: playback.Playback, table: SkinTable, spec: DeviceSpec, path: Path) -> None:
    """Draw target, estimate and measurement in three components of readings.

    The rows of the table are drawn with them, as dots. The colour of a dot shows the commands of the first three
    motors.
    """
    three = [np.pad(own, ((0, 0), (0, 3 - own.shape[1]))) for own in found.series().values()]
    cloud = (table.exact_readings - found.rest) @ found.directions
    some = np.linspace(0, len(cloud) - 1, min(len(cloud), CLOUD)).astype(int)
    low, high = table.commands.min(axis=0), table.commands.max(axis=0)
    tint = 2.0 * (table.commands[some, :3] - low[:3]) / np.maximum(high[:3] - low[:3], 1e-300) - 1.0
    worst = "; ".join(f"{each.name} {100 * each.relative:.1f} %" for each in found.differences)
    plot_stimuli.write(
        path,
        np.pad(cloud[some], ((0, 0), (0, 3 - cloud.shape[1]))),
        np.pad(tint, ((0, 0), (0, 3 - tint.shape[1]))),
        dict(zip(found.series(), three, strict=True)),
        f"{spec.name}: played back, in three components of the readings",
        f"relative RMS: {worst}",
    )


def live(options: argparse.Namespace) -> int:
    """Let a device follow a sensor live, until a signal or the last reading.

    At the end the device goes to its safe state. Return the exit status: 0, or 1 if the log is incomplete.

    Raises:
        DermisError: the table, device, link or sensor cannot be used, no readings come, or the device may not be in its
            safe state.
    """
    if options.sensor == "-" and not options.yes:
        raise DermisError(
            "standard input cannot both arm the device and give readings",
            where="--sensor -",
            remedy="Pass --yes, or take another source",
        )
    if options.noise is not None and not 0.0 <= options.noise < float("inf"):
        raise DermisError("noise is a standard deviation", where="--noise", value=options.noise, limit=">= 0")
    spec = Library(options.presets).device(options.device)
    if spec.kind == "thimble":
        raise DermisError("a thimble follows recordings, not a live sensor yet", where=f"device '{spec.key}'")
    table = task.load_table(spec, options.table, options.rest_rows)
    for finding in (*belongs(table, spec), *rest_finding(table)):
        print(finding, file=sys.stderr)
    signals = Signals()
    sensor = sensor_input(options.sensor, table.readings.shape[1])
    options.rate = options.rate or max(RATE, spec.rate)
    more = {"mode": "follow", "ramp": options.ramp, "look_ahead": 0.0, **log_from(options)}
    request = request_from(options, options.device, connect=True, **more)
    session = SensorSession(request, sensor, tuple(c.name for c in spec.channels), signals)
    with signals.caught():
        try:
            session.prepare("follows")
            follower, offset = _rested(session, spec, table, options)
            if not options.yes:
                session.confirm("Enter: arm.")
            session.follow(follower, offset)
        except Interrupted:
            pass
        finally:
            session.shut()
            sensor.close()
            with contextlib.suppress(OSError):  # a closed terminal takes no output
                print(session.summary())
    if session.unsure:
        raise session.refusal("the safe state could not be confirmed")
    return int(not session.logged)


def _rested(
    session: SensorSession, spec: DeviceSpec, table: SkinTable, options: argparse.Namespace
) -> tuple[Follower, Array | float]:
    """Return the follower of a sensor, and the offset to add to its readings.

    The offset, shape (channels,), moves the rest of the untouched sensor to that of the table. Rest and noise are
    measured during the time --rest-for. If that is 0, the offset is 0, and so is the noise unless --noise is given.
    """
    if not options.rest_for:
        return Follower(spec, table, options.noise or 0.0), 0.0
    say(f"Do not touch the sensor: its readings at rest are measured for {options.rest_for:g} s.")
    readings = session.rest(options.rest_for)
    spread = float(np.sqrt(readings.var(axis=0, ddof=1).mean())) if len(readings) > 1 else 0.0
    noise = spread if options.noise is None else options.noise
    say(f"{len(readings)} readings at rest, noise {noise:.3g} a channel.")
    return Follower(spec, table, noise), table.exact_readings[table.rest] - readings.mean(axis=0)
