"""The options by which a command names a device and its link, and the request that they make."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import DermisError
from .protocols.adapter import NAMES

if TYPE_CHECKING:
    from .request import StreamRequest


def add_device(parser: argparse.ArgumentParser, *, required: bool = False) -> None:
    """Add what names a device and its protocol."""
    text = "device preset" if required else "device preset; the track's own if left out"
    parser.add_argument("--device", required=required, default="", metavar="KEY", help=text)
    parser.add_argument("--protocol", default="native", choices=sorted(NAMES), help="what the device speaks (native)")
    parser.add_argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")


def add_link(parser: argparse.ArgumentParser) -> None:
    """Add what a link to a device needs."""
    parser.add_argument("--url", required=True, help="port or URL of the device, 'virtual:' for the simulated one")
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="calibration of this device")
    parser.add_argument(
        "--rate", type=setting("rate"), default=0.0, metavar="HZ", help="commands a second (the device's own)"
    )


def request_from(options: argparse.Namespace, key: str, **more: Any) -> StreamRequest:
    """Return the request that the options make for a device preset; `more` are other fields of it.

    Raises:
        DermisError: the preset or the calibration cannot be read.
    """
    from ..devices.calibration import Calibration
    from ..presets import Library
    from .request import StreamRequest

    return StreamRequest(
        url=options.url,
        protocol=options.protocol,
        device={"key": key, "preset": Library(options.presets).load("devices", key)},
        calibration=Calibration.load(options.calibration).dumps() if options.calibration else "",
        rate=options.rate,
        **more,
    )


def setting(name: str) -> Callable[[str], float]:
    """Return a reader of a request's setting, for argparse."""
    from .request import check_number

    def read(text: str) -> float:
        value = number(text)
        try:
            check_number(name, value)
        except DermisError as error:
            raise argparse.ArgumentTypeError(f"{text} is not allowed: {error.limit}") from error
        return value

    return read


def number(text: str) -> float:
    """Read a number, for argparse."""
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error
