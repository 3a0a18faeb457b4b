"""Comparisons as jobs for a child process.

A scene's file is the input; tables and the page are the results.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache
from ..pipeline.bake import Progress
from ..presets import Library
from ..scene import scene_file
from ..steps import drain
from ..work.jobs import Report
from . import report as pages
from . import told_report
from .device_comparison import compare_devices
from .told_apart import tell_apart

Made = TypeVar("Made")
# [%] Progress of the whole job at the start and at the end of each stage. Other stages do not advance it: they are
# short, or begin anew for each finger.
SHARES = {"skin contact": (0, 80), "devices": (80, 90), "judging": (90, 100)}
SHARES_SEARCHED = {"skin contact": (0, 15), "devices": (15, 20), "judging": (20, 100)}  # floors are found


def compare_job(
    _arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report
) -> dict[str, NDArray[Any]]:
    """Compare devices; see `compare_devices`.

    Args:
        parameters: 'scene' (a sampled scene's file), 'finger' (its name), and optionally 'presets' (a folder),
            'cache' (a folder) with 'cache_bytes', and 'floors' (whether to find floors).

    Returns:
        'table' (JSON, see `report.as_dict`), 'csv' and 'html', as bytes.

    Raises:
        DermisError: see `compare_devices`; also if a file cannot be read.
    """
    found = _done(partial(compare_devices, floors=bool(parameters.get("floors", False))), parameters, report)
    return _encoded({"table": json.dumps(pages.as_dict(found)), "csv": pages.csv(found), "html": pages.html(found)})


def tell_job(
    _arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report
) -> dict[str, NDArray[Any]]:
    """Tell a finger's touches apart; see `tell_apart`.

    Args:
        parameters: as for `compare_job`, without 'floors'.

    Returns:
        'table' (JSON, see `told_report.as_dict`) and 'csv', as bytes.

    Raises:
        DermisError: see `tell_apart`; also if a file cannot be read.
    """
    found = _done(tell_apart, parameters, report)
    return _encoded({"table": json.dumps(told_report.as_dict(found)), "csv": told_report.csv(found)})


def _done(work: Callable[..., Generator[Progress, None, Made]], given: Mapping[str, Any], report: Report) -> Made:
    scene = scene_file.load(Path(given["scene"]))
    cache = Cache(Path(given["cache"]), int(given["cache_bytes"])) if "cache" in given else None
    steps = work(scene, Library(given.get("presets")), given["finger"], cache=cache)
    shares, told = SHARES_SEARCHED if given.get("floors") else SHARES, 0

    def tell(step: Progress) -> None:
        nonlocal told
        low, high = shares.get(step.stage, (0, 0))
        told = max(told, low + (high - low) * step.done // max(step.total, 1))
        report(told, 100)

    return drain(steps, tell)


def _encoded(made: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    return {name: np.frombuffer(words.encode(), np.uint8) for name, words in made.items()}
