"""`stream panel`: a screen that answers a real finger, without Blender."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import DermisError
from .device_options import log_from, request_from
from .signals import Interrupted, Signals
from .touch_panel_session import TouchPanelSession
from .touch_sources import touch_input

TELL_TOUCHES = ("native", "osc")  # protocols whose device may have a touch panel of its own


def run(options: argparse.Namespace, load_screen: Callable[[Path], Any]) -> int:
    """Answer touches until a signal or the end of the touches.

    Connects and arms before, and ends at 0 V. Returns 0, or 1 if the log is not whole.

    Raises:
        DermisError: a map, device, link or source of touches that cannot be used; says which.
    """
    if options.touch == "-" and not options.yes:
        raise DermisError(
            "standard input cannot both arm the device and give touches",
            where="--touch -",
            remedy="Pass --yes, or take another source",
        )
    if options.touch == "device" and options.protocol not in TELL_TOUCHES:
        raise DermisError(
            "this protocol reports no touches",
            where="--protocol",
            value=options.protocol,
            limit=", ".join(TELL_TOUCHES),
            remedy="Choose a source with --touch",
        )
    screen = load_screen(options.map)
    more = {"mode": "panel", "screen": str(options.map), "ramp": 0.0, "play_on": True, **log_from(options)}
    request = request_from(options, options.device or "electrovibration", connect=True, **more)
    given, signals = touch_input(options.touch, options.unit, screen.size), Signals()
    session = TouchPanelSession(request, screen, given, signals)
    with signals.caught():
        try:
            session.prepare(screen.device.limit)
            if not options.yes:
                session.confirm("Enter: arm.")
            session.follow()
        except Interrupted:
            pass
        finally:
            session.shut()
            if given is not None:
                given.close()
    with contextlib.suppress(OSError):  # the terminal may have been closed
        print(session.summary())
    if session.unsure:
        raise session.refusal("0 V could not be confirmed")
    return int(not session.logged)
