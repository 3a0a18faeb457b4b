"""The request that a command's options make: the device that they name, and its link."""

from __future__ import annotations

import argparse
import os
from typing import Any

from ..devices.calibration import Calibration
from ..presets import Library
from .request import StreamRequest


def request_from(options: argparse.Namespace, key: str, **more: Any) -> StreamRequest:
    """Return the request that the options make for a device preset; `more` are other fields of it.

    Raises:
        DermisError: the preset or the calibration cannot be read.
    """
    return StreamRequest(
        url=options.url,
        protocol=options.protocol,
        device={"key": key, "preset": Library(options.presets).load("devices", key)},
        calibration=Calibration.load(options.calibration).dumps() if options.calibration else "",
        rate=options.rate,
        **more,
    )


def log_from(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of a request that say what is logged and teed."""
    return {
        "log": os.path.abspath(options.log) if options.log else "",  # its writer works in another folder
        "log_size": options.log_size,
        "log_total": options.log_total,
        "tee": " ".join(options.tee),
    }
