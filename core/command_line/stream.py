"""`python -m core stream`: play a track, answer a finger, the sender of Blender, a virtual device, the ports."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import DermisError
from ..stream import panel_command
from ..stream.acceptance import command
from ..stream.protocols.adapter import NAMES

LoadScreen = Callable[[Path], Any]


def add_parser(commands: Any, load_screen: LoadScreen) -> None:
    """Add the verb `stream` to the command line."""
    one = commands.add_parser(
        "stream",
        help="play a track to a device, or run a virtual device",
        description="Live streaming. Read the safety page before a finger goes in.",
    )
    verbs = one.add_subparsers(required=True, metavar="WHAT")

    play = verbs.add_parser("play", help="play a track to a device, once")
    play.add_argument("track", type=Path, metavar="TRACK", help="a command track: CSV, JSON or binary")
    _device_options(play)
    play.add_argument("--url", required=True, help="port or URL of the device, 'virtual:' for the simulated one")
    play.add_argument("--calibration", type=Path, metavar="FILE", help="calibration of this device")
    play.add_argument(
        "--look-ahead", type=_setting("look_ahead"), default=0.1, metavar="S", help="send this far ahead (0.1 s)"
    )
    play.add_argument(
        "--ramp", type=_setting("ramp"), default=1.0, metavar="S", help="ramp from where the device is (1 s)"
    )
    play.add_argument(
        "--rate",
        type=_setting("rate"),
        default=0.0,
        metavar="HZ",
        help="commands a second; the device's own if left out",
    )
    play.add_argument("--yes", action="store_true", help="arm without asking; its warnings are printed")
    play.set_defaults(run=_play)

    panel = verbs.add_parser(
        "panel",
        help="answer a finger on a touch screen, until Ctrl-C",
        description="Answer a real finger from a screen's map, without Blender.",
    )
    _device_options(panel)
    panel_command.add_arguments(panel)
    panel.set_defaults(run=lambda options: panel_command.run(options, load_screen))

    send = verbs.add_parser("send", help="serve a shared state (not for people)")
    send.add_argument("--board", type=Path, required=True)
    send.set_defaults(run=lambda options: _send(options, load_screen))

    virtual = verbs.add_parser("virtual", help="run a virtual device until its input ends")
    _device_options(virtual)
    virtual.add_argument("--at", default="pty", choices=("pty", "tcp", "udp"), help="where it can be reached (pty)")
    virtual.add_argument("--every", type=_seconds, default=0.0, metavar="S", help="print a report this often")
    virtual.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="loss, delay, jitter, corrupt, slow, stuck, skew, seed; more than once",
    )
    virtual.set_defaults(run=_virtual)

    command.add_parser(verbs)

    ports = verbs.add_parser("ports", help="list the serial ports")
    ports.set_defaults(run=_ports)


def _setting(name: str) -> Callable[[str], float]:
    """Return a reader of a setting that has limits."""
    from ..stream.request import check_number

    def read(text: str) -> float:
        value = _number(text)
        try:
            check_number(name, value)
        except DermisError as error:
            raise argparse.ArgumentTypeError(f"{text} is not allowed: {error.limit}") from error
        return value

    return read


def _seconds(text: str) -> float:
    value = _number(text)
    if not 0.0 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: 0 to 1e6 s")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error


def _device_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", default="", metavar="KEY", help="device preset; the track's own if left out")
    parser.add_argument("--protocol", default="native", choices=sorted(NAMES), help="what the device speaks (native)")
    parser.add_argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")


def _send(options: argparse.Namespace, load_screen: LoadScreen) -> int:
    from ..stream.sender import run

    return run(options.board, load_screen)


def _ports(_options: argparse.Namespace) -> int:
    from ..stream.links.serial_port import ports

    found = ports()
    for name, description in found:
        print(f"{name}\t{description}".rstrip())
    if not found:
        print("no serial ports", file=sys.stderr)
    return 0


def _virtual(options: argparse.Namespace) -> int:
    from ..presets import Library
    from ..stream.protocols.wire import Wire
    from ..stream.virtual.faults import NAMES as FAULTS
    from ..stream.virtual.faults import number_of
    from ..stream.virtual.program import serve

    faults = {}
    for text in options.fault:
        name, _, value = text.partition("=")
        if name not in FAULTS:
            raise DermisError("not a fault", where="--fault", value=text, limit=", ".join(FAULTS))
        faults[name] = number_of(name, value)
    wire = Wire.of(Library(options.presets).device(options.device or "haptip"))
    return serve(options.protocol, wire, options.at, faults, every=options.every)


def _play(options: argparse.Namespace) -> int:
    from ..stream.play import play

    return play(options)
