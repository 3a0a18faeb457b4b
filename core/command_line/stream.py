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
from ..stream.device_options import add_device, add_link, number, setting

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
    add_device(play)
    add_link(play)
    play.add_argument(
        "--look-ahead", type=setting("look_ahead"), default=0.1, metavar="S", help="send this far ahead (0.1 s)"
    )
    play.add_argument(
        "--ramp", type=setting("ramp"), default=1.0, metavar="S", help="ramp from where the device is (1 s)"
    )
    play.add_argument("--yes", action="store_true", help="arm without asking; its warnings are printed")
    play.set_defaults(run=_play)

    panel = verbs.add_parser(
        "panel",
        help="answer a finger on a touch screen, until Ctrl-C",
        description="Answer a real finger from a screen's map, without Blender.",
    )
    panel_command.add_arguments(panel)
    panel.set_defaults(run=lambda options: panel_command.run(options, load_screen))

    send = verbs.add_parser("send", help="serve a shared state (not for people)")
    send.add_argument("--board", type=Path, required=True)
    send.set_defaults(run=lambda options: _send(options, load_screen))

    virtual = verbs.add_parser("virtual", help="run a virtual device until its input ends")
    add_device(virtual)
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


def _seconds(text: str) -> float:
    value = number(text)
    if not 0.0 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: 0 to 1e6 s")
    return value


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
    from ..stream.play_command import play

    return play(options)
