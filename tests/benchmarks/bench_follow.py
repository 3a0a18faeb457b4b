"""From a sensor to a device and back: look-ups of public recordings, live latency, rows of tables, units, playback.

The public recordings are those of a BioTac that slides over materials (github.com/dexrob/BioTac_slide_20_50, 19
electrodes at 100 Hz beside the arm's wrench). They are not in this repository: DERMIS_BIOTAC names a folder with some
of its files `*_bio.csv` and `*_cw.csv`. No public recording has a platform's motors in it, so the table's commands are
made of the wrench: the platform leans as the measured force does, and presses as deep as it is strong. Its electrodes
are absolute differences from a baseline; those that stand at nought for long are left out, as the reader asks for.
"""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from . import Result, benchmark, one_blas_thread

PUBLIC = os.environ.get("DERMIS_BIOTAC", "")
NORMALS = os.environ.get("DERMIS_BIOTAC_NORMALS", "")
EXPECTED = (5.95, 5.12)  # [deg] by an own look-up of eight neighbours, from the first trial to the second and back
ELECTRODES = tuple(f"ele{i}" for i in range(1, 20))
MOTORS = ("motor_1", "motor_2", "motor_3")
STEPS = 60  # of the live sensor
LATEST = 0.25  # a command that has not changed by then never will [s]
UNSEEN = 20271127  # seed of the touches by which adaptive rows are judged; committed before their outcome was looked at
GRID = 3375  # rows of the grid that an adaptive table is held against
SHARES = (0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.8, 1.0)
SPARE = 0.05  # [deg] that following may be worse than an own look-up


@benchmark("follow_platform_error_deg")
def follow_platform_error() -> Result:
    """Median error of the motors' angles on recordings that are not in the table; an own look-up beside it."""
    from core.design import task
    from core.design.follow import follow
    from core.design.recordings import read_recording
    from core.presets import Library

    runs = _runs()
    if len(runs) < 3:
        return Result("follow_platform_error_deg", None, "deg", error="DERMIS_BIOTAC names no folder with 3 recordings")
    spec, wanted, found, own = Library().device("cable_platform"), [], [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        used = [i for i in range(19) if all((read[:, i] > 0).mean() > 0.95 for _, read, _ in runs)]
        names = tuple(ELECTRODES[i] for i in used)
        rows = np.vstack([np.column_stack([commands, read[:, used]]) for _, read, commands in runs[1:]])
        _write(folder / "table.csv", (*MOTORS, *names), rows)
        times, read, commands = runs[0]
        _write(folder / "run.csv", ("time_s", *names), np.column_stack([times, read[:, used]]))
        table, recording = task.load_table(spec, folder / "table.csv"), read_recording(folder / "run.csv")
        made = follow(spec, table, recording, noise=0.0)
        print(f"{len(runs)} recordings, {len(table.commands)} rows, {len(used)} electrodes: {made.words()}")
        found.append(made.commands)
        wanted.append(commands)
        for reading in recording.readings:
            squared = ((table.exact_readings - reading) ** 2).sum(axis=1)
            near = np.argsort(squared, kind="stable")[:8]
            weights = 1.0 / np.maximum(squared[near], 1e-12)
            own.append(weights @ table.commands[near] / weights.sum())
    off, peer = (_error(np.vstack(one), np.vstack(wanted)) for one in (found, [np.array(own)]))
    wrong = None if off <= peer + SPARE else f"more than {SPARE:g} degrees worse than the own look-up"
    return Result("follow_platform_error_deg", off, "deg", None, {"own look-up": peer}, wrong)


@benchmark("follow_angle_error_deg")
def follow_angle_error() -> Result:
    """Median angle between a contact's measured normal and that looked up in another person's trial, the worse way.

    The recordings are a BioTac that a tracked plane was pressed against, in two trials
    (github.com/Alexis-Georganopoulos/Robotic-Finger, source/4_Neural_Training): DERMIS_BIOTAC_NORMALS names a folder
    with X1.txt, Y1.txt, X2.txt and Y2.txt: 19 electrodes without their mean, and x, y, z of the normal, a row each.
    What is looked up is x and y; z is what is left of a unit vector.
    """
    from core.matching.lookup import commands_of
    from core.matching.table import SkinTable

    name = "follow_angle_error_deg"
    files = [Path(NORMALS) / f"{kind}{trial}.txt" for trial in (1, 2) for kind in "XY"]
    if not NORMALS or not all(file.exists() for file in files):
        return Result(name, None, "deg", error="DERMIS_BIOTAC_NORMALS names no folder with X1, Y1, X2, Y2.txt")
    felt1, normal1, felt2, normal2 = (np.loadtxt(file).T for file in files)
    found = []
    for known, normals, felt, wanted in ((felt1, normal1, felt2, normal2), (felt2, normal2, felt1, normal1)):
        rest = int(np.argmin((normals[:, :2] ** 2).sum(axis=1)))
        table = SkinTable(normals[:, :2], known, rest, np.ones(2), 0.0, {"source": NORMALS, "asked": len(known)})
        plane = commands_of(table, felt)
        upright = np.sqrt(np.maximum(1.0 - (plane**2).sum(axis=1), 0.0))
        cosine = (np.column_stack([plane, upright]) * wanted).sum(axis=1)
        found.append(float(np.median(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))))
    print(f"{len(felt1)} and {len(felt2)} samples: the first trial by the second {found[1]:.4f}, back {found[0]:.4f}")
    wrong = None if np.allclose(found, EXPECTED, atol=0.01) else f"an own look-up has {EXPECTED}"
    return Result(name, max(found), "deg", None, {"the other way": min(found)}, wrong)


@benchmark("follow_live_latency_ms")
def follow_live_latency() -> Result:
    """From a reading's datagram to the first datagram with another command, between three processes; p95 up to 5 ms."""
    from core.work.child import command, environment

    rng = np.random.default_rng(0)
    commands = np.vstack([np.zeros(3), rng.uniform(0.1, 1.5, (500, 3))])
    readings = 1000.0 + np.rint(400.0 * commands @ rng.standard_normal((3, 20)))
    names = (*MOTORS, *(f"e{i}" for i in range(20)))
    with tempfile.TemporaryDirectory() as name, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
        _write(Path(name) / "table.csv", names, np.column_stack([commands, readings]))
        device.bind(("127.0.0.1", 0))
        device.settimeout(0.002)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = int(free.getsockname()[1])
        url = f"udp://127.0.0.1:{device.getsockname()[1]}"
        words = ("--table", f"{name}/table.csv", "--sensor", f"osc://:{port}", "--rest-for", "0", "--yes")
        process = subprocess.Popen(
            command("stream", "follow", "--url", url, "--protocol", "osc", *words),
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            late = _steps(device, port, readings, rng)
        finally:
            process.send_signal(2)
            told = process.communicate(timeout=20)
    print(told[0].strip())
    if len(late) < STEPS:
        return Result("follow_live_latency_ms", None, "ms", error=f"{len(late)} of {STEPS} steps: {told[1][-200:]}")
    median, p95 = (1e3 * float(v) for v in np.percentile(late, (50, 95)))
    return Result("follow_live_latency_ms", median, "ms", p95, {}, None if p95 <= 5.0 else "p95 above 5 ms")


@benchmark("table_rows_ratio", limit=0.5)
def table_rows_ratio() -> Result:
    """Rows that an adaptive table needs for a grid's median error on edges and balls, over the grid's.

    The touches are drawn by a seed that nothing was chosen by: other radii, angles and roundings, other ways.
    """
    from core.matching.adaptive_sweep import build_adaptive
    from core.matching.lookup import commands_of
    from core.matching.readings import FULL_SCALE, quantised, readings_of
    from core.matching.table import build, press_of
    from core.presets import Library
    from core.skin.model import fingertip_skin

    spec, skin = Library().device("cable_platform"), fingertip_skin(level="draft")
    sensor, press = readings_of(skin), press_of(skin, spec)

    def left(table: Any) -> float:
        heard = table.heard_with(2.0)
        loud = sensed[heard.from_rest(sensed) > heard.noise_floor]
        played = np.clip(sensor.counts(press.press(commands_of(heard, loud)).force), 0, FULL_SCALE)
        return float(np.median(np.linalg.norm(played - loud, axis=1) / heard.from_rest(loud)))

    with one_blas_thread():
        made = [touch.forces(skin, points=True) for touch in _unseen(UNSEEN)]
        sensed = np.vstack([quantised(sensor.counts(force)) for force in made])
        wanted = left(build(spec, skin, sensor, GRID))
        for share in SHARES:
            steps = build_adaptive(spec, skin, sensor, round(share * GRID), 2.0)
            while True:
                try:
                    next(steps)
                except StopIteration as stop:
                    table = stop.value
                    break
            reached = left(table)
            rows = f"{round(share * GRID)} adaptive rows leave {100 * reached:.1f} %"
            print(f"{rows}, a grid's {GRID} {100 * wanted:.1f} %")
            if reached <= wanted:
                return Result("table_rows_ratio", share, "")
    return Result("table_rows_ratio", None, "", error="as many rows are not as good")


@benchmark("unit_invariance", limit=0.0)
def unit_invariance() -> Result:
    """Largest difference of any percentage of a verdict in five units and from five zeros; 0 to the last bit."""
    from dataclasses import replace

    from core.design.answer import design
    from core.matching.lookup import readings_for
    from core.matching.readings import readings_of
    from core.matching.table import build
    from core.presets import Library
    from core.skin.model import fingertip_skin

    spec, skin = Library().device("cable_platform"), fingertip_skin(level="draft")
    rng = np.random.default_rng(1)
    swept = build(spec, skin, readings_of(skin), 1000)
    table = replace(swept, readings=swept.exact_readings, meta={**swept.meta, "channels": [f"e{i}" for i in range(20)]})
    low, high = np.percentile(table.commands[1:], (25, 75), axis=0)
    press = np.sin(np.linspace(0.0, 9.0, 400)) ** 2
    felt = np.rint(readings_for(table, low + (high - low) * np.column_stack([press, press**2, press])))
    felt += np.rint(rng.normal(0.0, 2.0, felt.shape))
    plain, worst = design(spec, table.heard_with(2.0), {"a": felt}), 0.0
    for factor in (1e-6, 1e-3, 0.7371, 3.0, 1e6):
        zero = factor * rng.integers(-5000, 5000, 20)
        other = replace(table, readings=factor * table.readings + zero).heard_with(2.0 * factor)
        found = design(spec, other, {"a": factor * felt + zero})
        for rule in ("touch", "paper"):
            worst = max(worst, float(np.abs(found.joint.percent(rule) - plain.joint.percent(rule)).max()))  # type: ignore[arg-type]
    return Result("unit_invariance", worst, "%")


@benchmark("validate_delay_error_ms", limit=1.0)
def validate_delay_error() -> Result:
    """Worst error of the delay over 20 played recordings with noise, a gain and a pulse, at 1 kHz."""
    from core.design.playback import playback
    from core.design.recordings import Recording
    from core.matching.lookup import readings_for
    from core.matching.readings import readings_of
    from core.matching.table import build
    from core.presets import Library
    from core.skin.model import fingertip_skin
    from core.track.command_track import CommandTrack

    spec, skin = Library().device("cable_platform"), fingertip_skin(level="draft")
    table, rng = build(spec, skin, readings_of(skin), 1000), np.random.default_rng(5)
    rest, worst, gains = table.exact_readings[0], 0.0, []
    times = np.arange(600) / spec.rate
    low, high = np.percentile(table.commands[1:], (10, 60), axis=0)
    for _ in range(20):
        rates, delay, gain = rng.uniform(1.0, 3.0, 3), rng.uniform(0.0, 0.2), rng.uniform(0.7, 1.2)
        track = CommandTrack(spec, times, low + (high - low) * np.sin(np.outer(times, rates)) ** 2)
        clock = np.arange(7200) / 1000.0
        at, estimated = np.clip(clock - 0.6 - delay, 0.0, times[-1]), readings_for(table, track.values)
        felt = np.column_stack([np.interp(at, times, column) for column in estimated.T])
        felt = rest + gain * (felt - rest) + rng.normal(0.0, 2.0, felt.shape)
        pulse = 1.0 * ((clock >= 0.6) & (clock < 0.7))
        recording = Recording("played", clock, felt, tuple(f"e{i}" for i in range(20)))
        found = playback(track, table, recording, sync=(pulse, 0.0))
        assert found.delay is not None
        worst = max(worst, abs(found.delay - delay))
        gains.append(abs(found.gain / gain - 1.0))
    wrong = None if max(gains) <= 0.01 else f"a gain is {100 * max(gains):.2f} % off"
    return Result("validate_delay_error_ms", 1e3 * worst, "ms", None, {"gain error %": 100 * max(gains)}, wrong)


def _unseen(seed: int, count: int = 60) -> list[Any]:
    """Return two edges and two balls, drawn: their shape, how deep they press, and how they move meanwhile."""
    from tests import touches

    rng = np.random.default_rng(seed)
    found = []
    for shape in ("edge", "ball") * 2:
        deep = rng.uniform(0.6, 1.2)
        keys = {"depth": [(0.0, -0.3), (0.3, deep), (0.5, rng.uniform(0.5, 1.0) * deep), (0.75, deep), (1.0, -0.3)]}
        for name, most in (("x", 3.0), ("y", 2.0), *((("pitch", 15.0),) if shape == "edge" else ())):
            keys[name] = [(t, rng.uniform(-most, most)) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
        solid = (
            touches.edge(rng.uniform(0.4e-3, 1.0e-3), np.radians(rng.uniform(35.0, 60.0)))
            if shape == "edge"
            else touches.ball(rng.uniform(6e-3, 20e-3))
        )
        found.append(touches.make(shape, solid, count, **keys))
    return found


def _steps(device: socket.socket, port: int, readings: Any, rng: Any) -> list[float]:
    """Let the sensor step from one row to another; return how long the first other command took each time [s]."""
    late: list[float] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sensor:

        def say(row: int) -> float:
            text = b"/dermis/sensor".ljust(16, b"\0")
            tags = b"," + b"f" * 20
            data = text + tags + b"\0" * (4 - len(tags) % 4) + struct.pack(">20f", *readings[row])
            now = time.perf_counter()
            sensor.sendto(data, ("127.0.0.1", port))
            return now

        def heard() -> bytes | None:
            try:
                return device.recv(4096)
            except TimeoutError:
                return None

        row, began = 1, time.perf_counter()
        while time.perf_counter() - began < 12.0 and len(late) < STEPS:
            steady, since = b"", time.perf_counter()  # until the same command has come for a while
            while time.perf_counter() - since < 0.1 + rng.uniform(0.0, 0.02):
                say(row)
                if (data := heard()) is not None and data != steady:
                    steady, since = data, time.perf_counter()
                if time.perf_counter() - began > 12.0:
                    break
            if not steady:
                began = min(began, time.perf_counter())
                continue
            row = 1 + (row + int(rng.integers(1, 400))) % 490
            sent = say(row)
            while time.perf_counter() - sent < LATEST:
                data = heard()
                if data is not None and data != steady:
                    late.append(time.perf_counter() - sent)
                    break
            began = time.perf_counter()  # twelve seconds without a step are the end
    return late


def _runs() -> list[tuple[Any, Any, Any]]:
    """Return times, electrodes, and a platform's commands that lean and press as the wrench does, a recording each."""
    from core.matching.sweep import commands_at
    from core.matching.table import press_of
    from core.presets import Library
    from core.skin.model import fingertip_skin

    files = sorted(Path(PUBLIC).glob("*_bio.csv")) if PUBLIC else []
    given = [(file, file.with_name(file.name.replace("_bio", "_cw"))) for file in files]
    given = [pair for pair in given if pair[1].exists()]
    if not given:
        return []
    spec = Library().device("cable_platform")
    points = press_of(fingertip_skin(level="draft"), spec).points.positions
    read = [(_columns(bio), _columns(cw)) for bio, cw in given]
    force = [
        np.column_stack([np.interp(b["timestamp"], w["timestamp"], w[a]) for a in ("fx", "fy", "fz")]) for b, w in read
    ]
    every = np.vstack(force)
    middle, spread = every.mean(axis=0), np.abs(every - every.mean(axis=0)).max(axis=0)
    runs = []
    for (bio, _), own in zip(read, force, strict=True):
        share = 0.5 + 0.45 * (own - middle) / spread  # depth by fy, which presses; pitch and roll by the others
        commands = commands_at(spec, points, share[:, [1, 0, 2]])
        electrodes = np.column_stack([bio[name] for name in ELECTRODES])
        runs.append((bio["timestamp"] - bio["timestamp"][0], electrodes, commands))
    return runs


def _columns(path: Path) -> dict[str, Any]:
    """Return a public file's columns by name; its rows end with a separator that its line of names does not have."""
    names, *lines = path.read_text().split()
    keys = names.split(",")
    rows = np.array([[float(cell) for cell in line.split(",")[: len(keys)]] for line in lines])
    return dict(zip(keys, rows.T, strict=True))


def _write(path: Path, names: tuple[str, ...], rows: Any) -> None:
    path.write_text("\n".join([",".join(names), *(",".join(f"{v:.12g}" for v in row) for row in rows)]) + "\n")


def _error(found: Any, wanted: Any) -> float:
    return float(np.median(np.degrees(np.abs(found - wanted).max(axis=1))))
