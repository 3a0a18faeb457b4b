"""`python -m core stream panel`: a screen that answers a real finger, without Blender."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import DermisError

TELL_TOUCHES = ("native", "osc")  # protocols whose device may have a touch panel of its own


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `panel` takes beside device and protocol."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a screen's map: NAME.map.npz, as exported")
    parser.add_argument("--url", required=True, help="port or URL of the device, 'virtual:' for the simulated one")
    parser.add_argument(
        "--touch",
        default="device",
        metavar="FROM",
        help="who tells where the finger is: the "
        "device's own panel ('device', if left out), osc://:PORT or osc://HOST:PORT to listen at, "
        "serial:PORT?baud=RATE, '-' for standard input, 'mouse' in a window",
    )
    parser.add_argument(
        "--unit",
        default="mm",
        choices=("m", "mm"),
        help="of x and y in lines 'x y [down]', from the screen's centre (mm)",
    )
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="calibration of this device")
    parser.add_argument("--rate", type=float, default=0.0, metavar="HZ", help="of commands (the device's own)")
    parser.add_argument("--yes", action="store_true", help="arm without asking")


def run(options: argparse.Namespace, load_screen: Callable[[Path], Any]) -> int:
    """Connect, arm, answer touches until a signal or the end of the touches, and end at 0 V.

    Raises:
        DermisError: a map, device, link or source of touches that cannot be used; says which.
    """
    from ..devices.calibration import Calibration
    from ..presets import Library
    from .panel_session import PanelSession
    from .play import Interrupted, Signals
    from .request import StreamRequest, check_number
    from .streamer import Streamer
    from .touch_sources import touch_input
    from .virtual.link import open_link

    check_number("rate", options.rate)
    if options.touch == "-" and not options.yes:
        raise DermisError(
            "standard input cannot both arm and tell touches",
            where="--touch -",
            remedy="Pass --yes, or take another source",
        )
    if options.touch == "device" and options.protocol not in TELL_TOUCHES:
        raise DermisError(
            "this protocol tells no touches",
            where="--protocol",
            value=options.protocol,
            limit=", ".join(TELL_TOUCHES),
            remedy="Choose a source with --touch",
        )
    screen = load_screen(options.map)
    key = options.device or "electrovibration"
    request = StreamRequest(
        connect=True,
        url=options.url,
        protocol=options.protocol,
        mode="panel",
        screen=str(options.map),
        device={"key": key, "preset": Library(options.presets).load("devices", key)},
        rate=options.rate,
        ramp=0.0,
        calibration=Calibration.load(options.calibration).dumps() if options.calibration else "",
        play_on=True,
    )
    given = touch_input(options.touch, options.unit, screen.size)
    session = PanelSession(Streamer(open_link, lambda path: screen), given)
    signals = Signals()
    with signals.caught():
        try:
            session.connect(request)
            session.warn(screen.device.limit)
            if not options.yes:
                _ask(options.url, signals.line)
            session.follow(lambda: signals.number > 0)
        except Interrupted:
            pass
        finally:
            session.shut()
            if given is not None:
                given.close()
    with contextlib.suppress(OSError):  # a terminal that hung up reads no more
        print(session.summary())
    if session.unsure:
        raise DermisError(session.streamer.message.rstrip(".") or "0 V could not be made sure of", where=options.url)
    return 0


def _ask(url: str, line: Callable[[], str]) -> None:
    """Wait for a person to press Enter.

    Raises:
        DermisError: standard input ended before.
    """
    print("Enter: arm.", file=sys.stderr)
    if not line():
        raise DermisError(
            "not armed: standard input ended before anybody pressed Enter",
            where=url,
            remedy="Run it in a terminal, or pass --yes",
        )
