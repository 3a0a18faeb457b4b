"""The command `stream daq`: play a track through an NI device.

The track's voltage is played once. A force sensor can be read meanwhile.
Exit status: 0; 2 if the track could not be played to its end; 128 plus a signal's number.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ... import clock
from ...arrays import Array
from ...errors import DermisError, Finding
from ...files import write_bytes
from ...track import export
from ...track.command_track import CommandTrack
from ...track.wav import Wave, stated, wave_of
from ..signals import Interrupted, Signals
from .force_sensor import ForceSensor
from .ni import HIGHEST, Daq, nidaqmx_package

SCHEMA = "dermis-forces 1"
FORCES_HZ = 1000.0  # [Hz] rate of the rows in the file; a row is the mean of the readings in its interval
TARE = 0.5  # [s] duration of the measurement without a load


def daq(options: argparse.Namespace) -> int:
    """Play a track; return the exit status.

    Raises:
        DermisError: the amplifier's gain is not stated, the track must not be played on this device, or the device is
            gone.
    """
    return run(options, nidaqmx_package(), Signals())


def run(options: argparse.Namespace, package: Any, signals: Signals) -> int:
    """Play a track; see `daq`.

    Args:
        options: options of the command.
        package: the maker's package, or a simulation of it.
        signals: signals that end the playing.
    """
    # An NI output is set in volts, so only the gain must be stated.
    settings = stated(vars(options), ("gain",), f"NI device, {options.output}")
    track = export.read(options.track)
    volts, wave = volts_of(track, settings)
    if bool(options.inputs) != bool(options.sensor) or bool(options.forces) != bool(options.sensor):
        raise DermisError("--inputs, --sensor and --forces go together", where="stream daq")
    sensor = ForceSensor.load(options.sensor) if options.sensor else None
    for finding in wave.findings:
        if finding.code != "constant-voltage":  # this warning applies to sound cards only
            print(finding, file=sys.stderr)
    peak = float(np.abs(volts).max(initial=0.0))
    full = wave.limit / float(wave.header["gain"])
    device = Daq(package, options.output, options.inputs or "", wave.rate, full, sensor.range if sensor else HIGHEST)
    try:
        if sensor is not None and device.channels != sensor.inputs:
            raise DermisError(
                "the number of inputs differs from the number of columns of the sensor's matrix",
                where=options.inputs,
                value=device.channels,
                limit=str(sensor.inputs),
            )
        with signals.caught():
            if not options.yes:
                load = " Take all load off the sensor; leave it alone for half a second after Enter." if sensor else ""
                gain = float(wave.header["gain"])
                print(
                    f"{track.spec.name} gets up to {peak * gain:.4g} V: {options.output} gives up to {peak:.4g} V, "
                    f"times the stated gain of {gain:g}.{load} Enter: play; Ctrl-C: stop.",
                    flush=True,
                )
                try:
                    if not signals.line():
                        raise DermisError(
                            "the start was not confirmed", where=options.output, remedy="Press Enter, or give --yes"
                        )
                except Interrupted:
                    return 128 + signals.number
            forces = Forces(sensor, device) if sensor is not None else None
            played = 0
            try:
                played = device.play(volts, lambda: bool(signals.number), forces.take if forces else None)
            finally:
                if forces is not None:
                    forces.save(Path(options.forces))
    finally:
        device.close()
    print(f"played {played / wave.rate:.2f} of {len(volts) / wave.rate:.2f} s")
    if forces is not None and forces.beyond:
        said, remedy = "the sensor's voltage was at the end of its range", "Use a sensor or a range for larger forces"
        print(Finding("warning", "sensor-full", said, count=forces.beyond, remedy=remedy), file=sys.stderr)
    return 128 + signals.number if signals.number else 0


def volts_of(track: CommandTrack, settings: dict[str, object]) -> tuple[Array, Wave]:
    """Return a track's voltages at the output [V], shape (n,), and its `Wave`.

    Raises:
        DermisError: the full-scale voltage before the amplifier is more than an NI device gives; see also
            `wave_of`.
    """
    wave = wave_of(track, settings)
    full = wave.limit / float(wave.header["gain"])
    if full > HIGHEST:
        raise DermisError(
            "the full-scale voltage before the amplifier is more than an NI device gives",
            where=f"track of {track.spec.name}",
            value=f"{full:.4g} V",
            limit=f"{HIGHEST:g} V",
            remedy="State the amplifier's gain (--wav-gain) and the output's range (--wav-full-scale 10)",
        )
    return np.clip(wave.volts, -wave.limit, wave.limit) / float(wave.header["gain"]), wave


class Forces:
    """Forces and torques that are measured while a track is played.

    The sensor is first measured without a load.

    Attributes:
        tare: voltages without a load [V], shape (inputs,).
        beyond: number of readings near the end of the range.
    """

    def __init__(self, sensor: ForceSensor, device: Daq) -> None:
        self._sensor, self._rate, self._started = sensor, device.rate, clock.now()
        self._times: list[Array] = []
        self._volts: list[Array] = []
        still = device.sensed(TARE)
        if not len(still):
            raise DermisError("the sensor gives no readings", where=sensor.name)
        self.tare = still.mean(axis=0)
        self.beyond = sensor.beyond(still)
        self._left, self._left_at = np.zeros((0, sensor.inputs)), 0.0

    def take(self, at: float, volts: Array) -> None:
        """Add readings.

        Args:
            at: time of the first reading [s].
            volts: the readings [V], shape (n, inputs).
        """
        self.beyond += self._sensor.beyond(volts)
        block = max(round(self._rate / FORCES_HZ), 1)
        start = self._left_at if len(self._left) else at
        whole = np.concatenate([self._left, volts])
        rows = len(whole) // block
        self._left, self._left_at = whole[rows * block :], start + rows * block / self._rate
        if rows:
            self._volts.append(whole[: rows * block].reshape(rows, block, -1).mean(axis=1))
            middles = np.arange(rows, dtype=np.float64) * block + 0.5 * (block - 1)
            self._times.append(start + middles / self._rate)

    def rows(self) -> tuple[Array, Array]:
        """Return times by the stream's clock [s], shape (n,), and the forces.

        The forces and torques have the shape (n, results), in the sensor's units.
        """
        if not self._volts:
            return np.zeros(0), np.zeros((0, len(self._sensor.channels)))
        return np.concatenate(self._times), self._sensor.forces(np.concatenate(self._volts), self.tare)

    def save(self, path: Path) -> None:
        """Write times and forces as CSV, completely or not at all.

        Times count from the `clock` of the header, as in a stream's log.
        """
        times, forces = self.rows()
        names = [f"{n}[{unit}]" for n, unit in zip(self._sensor.channels, self._sensor.units, strict=True)]
        head = {"clock": self._started, "sensor": self._sensor.name, "tare_volts": self.tare.tolist()}
        lines = [f"# {SCHEMA}", *(f"# {name}: {json.dumps(value)}" for name, value in head.items())]
        lines.append(",".join(["t_s", *names]))
        lines += [
            f"{t - self._started:.6f}," + ",".join(f"{v:.9g}" for v in row)
            for t, row in zip(times, forces, strict=True)
        ]
        write_bytes(path, ("\n".join(lines) + "\n").encode())
