"""`python -m core stream panel | send | virtual | ports | cards`.

Blender starts `send`; people start the other verbs.
"""

from __future__ import annotations

import argparse
import sys

from ..errors import DermisError
from ..matching.screen_map import ScreenMap
from ..presets import Library
from ..stream import sender, touch_panel_command
from ..stream.links import serial_port
from ..stream.protocols.adapters import adapter_of
from ..stream.protocols.wire import Wire
from ..stream.sound import card
from ..stream.virtual.faults import NAMES, number_of
from ..stream.virtual.program import serve


def panel(options: argparse.Namespace) -> int:
    """Drive a touch screen under a real finger; return the exit status."""
    return touch_panel_command.run(options, ScreenMap.load)


def send(options: argparse.Namespace) -> int:
    """Stream to a device as Blender asks in a shared file.

    Return the exit status when Blender is gone or a signal comes.
    """
    return sender.run(options.state, ScreenMap.load)


def virtual(options: argparse.Namespace) -> int:
    """Run a virtual device; return the exit status when standard input ends."""
    faults = {}
    for text in options.fault:
        name, _, value = text.partition("=")
        if name not in NAMES:
            raise DermisError("not a fault", where="--fault", value=text, limit=", ".join(NAMES))
        faults[name] = number_of(name, value)
    datagrams = adapter_of(options.protocol).datagrams
    at = options.at or ("udp" if datagrams else "pty")
    if datagrams and at != "udp":
        raise DermisError(
            "this protocol goes over datagrams", where=f"--protocol {options.protocol}", value=f"--at {at}", limit="udp"
        )
    wire = Wire.of(Library(options.presets).device(options.device or "haptip"))
    return serve(options.protocol, wire, at, faults, every=options.every)


def ports(_options: argparse.Namespace) -> int:
    """Print the serial ports; return the exit status."""
    found = serial_port.ports()
    for name, description in found:
        print(f"{name}\t{description}".rstrip())
    if not found:
        print("no serial ports", file=sys.stderr)
    return 0


def cards(_options: argparse.Namespace) -> int:
    """Print the sound cards that may drive an amplifier.

    Return the exit status.
    """
    found = card.names()
    print("\n".join(found))
    if not found:
        print(
            "no sound card qualifies: it must be exclusive to one program, and not the system's default",
            file=sys.stderr,
        )
    return 0
