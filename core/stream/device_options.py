"""The request from a command's options: the device and its link."""

from __future__ import annotations

import argparse
import os
import sys
from datetime import date
from typing import Any

from ..devices.calibration import Calibration
from ..devices.spec import from_preset
from ..presets import Library
from .request import StreamRequest


def request_from(options: argparse.Namespace, key: str, **more: Any) -> StreamRequest:
    """Return the request that the options make for a device preset.

    Prints notices about the calibration, such as its age.

    Args:
        options: options of the command. key: key of the device preset. more: other fields of the request.

    Raises:
        DermisError: the preset or the calibration cannot be read.
    """
    preset = Library(options.presets).load("devices", key)
    made = Calibration.load(options.calibration) if options.calibration else None
    for finding in () if made is None else made.findings(from_preset(key, preset), date.today()):
        print(finding, file=sys.stderr, flush=True)
    return StreamRequest(
        url=options.url,
        protocol=options.protocol,
        device={"key": key, "preset": preset},
        calibration="" if made is None else made.dumps(),
        rate=options.rate,
        **more,
    )


def log_from(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of a request that configure the log and its tees."""
    return {
        "log": os.path.abspath(options.log) if options.log else "",  # the log's writer works in another folder
        "log_size": options.log_size,
        "log_total": options.log_total,
        "tee": " ".join(options.tee),
    }
