"""The command `stream measure`: measure the response curve of one actuator.

It is `python -m core stream measure`. It drives the actuator to one stop after another and asks the person for its
position. No finger may be in the device.
"""

from __future__ import annotations

import argparse
import math
from datetime import date
from pathlib import Path

import numpy as np

from ...devices.calibration import Calibration
from ...devices.response import Response
from ...devices.response_readings import LEAST, of_readings
from ...errors import DermisError
from ..device_options import request_from
from ..local_stream import say
from ..signals import Interrupted, Signals
from .bench import Bench
from .person import INTRODUCTION, Person, Terminal

HANDY = {"m": ("mm", 1e3), "rad": ("degrees", math.degrees(1.0))}  # SI unit -> unit for people, and its number in it
SETTLED = 0.5  # [s] time in which an actuator comes to rest after its movement
FEWEST = LEAST + 2  # smallest number of stops: those at both ends may be left out


def run(options: argparse.Namespace) -> int:
    """Measure a curve and write a calibration with it; return the exit status.

    It is 0, 1 if the safe state is not certain, or 128 plus the number of a signal that ended the measurement.
    """
    request = request_from(options, options.device)
    path = options.out or Path(f"calibration_{options.device}_{options.channel}_{date.today().isoformat()}.json")
    if path.exists():
        raise DermisError("the calibration's file exists", where=str(path), remedy="Choose another name with --out")
    if options.points < FEWEST:
        raise DermisError("too few stops for a curve", where="--points", value=options.points, limit=f">= {FEWEST}")
    signals = Signals()

    def heed() -> None:
        if signals.number:
            raise Interrupted

    bench = Bench(request, heed)
    if options.channel not in bench.wire.names:
        raise DermisError(
            "the device has no such channel with an actuator",
            where="--channel",
            value=options.channel,
            limit=", ".join(bench.wire.names)[:200],
        )
    person = Terminal(lambda: bench.run(0.01))
    unsure, curve = "", None
    with signals.caught():  # an interruption first brings the device to its safe state
        try:
            print(INTRODUCTION)
            person.wait(f"{bench.wire.spec.name} at {options.url}: fingers out? Enter begins.")
            bench.connect()
            curve = walk(bench, person, options.channel, options.points, options.valid_days)
        except Interrupted:
            say("Stopping.")
        finally:
            if unsure := bench.end():
                say(f"{unsure}. THE DEVICE MAY NOT BE SAFE: switch its supply off")
    if curve is None:
        return 128 + signals.number
    made = request.calibrated() or Calibration.of(bench.wire.spec)
    made.with_entry(options.channel, response=curve).save(path)
    print(f"Wrote {path}: it reaches {curve.reach[0]:.6g} to {curve.reach[1]:.6g}, play {curve.play:.3g} (SI)")
    return int(bool(unsure))


def walk(bench: Bench, person: Person, name: str, count: int, valid_days: int) -> Response:
    """Drive an actuator up and down its range; return the curve of the readings.

    All other actuators stay at their safe values.

    Args:
        bench: bench with the device. person: person who reads the positions. name: channel of the actuator.
        count: number of stops in each direction. valid_days: validity of the curve [days].

    Raises:
        DermisError: the device cannot be driven, or the readings give no curve.
    """
    wire = bench.wire
    k = wire.names.index(name)
    low, high = float(wire.lower_limit[k]), float(wire.upper_limit[k])
    if not math.isfinite(high - low):
        raise DermisError("the channel has no range to be measured in", where=name, remedy="Calibrate its limits")
    unit, factor = HANDY.get(wire.units[k], (wire.units[k], 1.0))
    stops = np.linspace(low, high, count)
    bench.arm()
    driven, reached = [], []
    for stop in [*stops, *stops[-2::-1]]:
        goal = wire.safe.copy()
        goal[k] = stop
        way = abs(stop - float(bench.connection.output.limiter.last[k]))
        bench.move(goal, SETTLED + (way / float(wire.slew[k]) if math.isfinite(wire.slew[k]) else 0.0))
        at = float(bench.connection.output.limiter.last[k])  # a disc as the range may end before the stop
        reading = person.number(f"{name} is driven to {at * factor:.4g} {unit}. What does it reach, in {unit}?")
        if reading is not None:
            driven.append(at)
            reached.append(reading / factor)
    bench.stop()
    return of_readings(driven, reached, measured_on=date.today().isoformat(), valid_days=valid_days)
