"""The comparison as a job for a child process: a scene's file goes in, the table and the page come out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache
from ..presets import Library
from ..scene import scene_file
from ..steps import drain
from ..work.jobs import Report
from . import report as pages
from .device_comparison import compare_devices


def compare_job(
    _arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report
) -> dict[str, NDArray[Any]]:
    """Compare devices; see `compare_devices`.

    Args:
        parameters: 'scene' (a sampled scene's file), 'finger' (its name), and optionally 'presets' (a folder),
            'cache' (a folder) with 'cache_bytes'.

    Returns:
        'table' (JSON, see `report.as_dict`), 'csv' and 'html', as bytes.

    Raises:
        DermisError: see `compare_devices`; a file that cannot be read.
    """
    scene = scene_file.load(Path(parameters["scene"]))
    cache = Cache(Path(parameters["cache"]), int(parameters["cache_bytes"])) if "cache" in parameters else None
    steps = compare_devices(scene, Library(parameters.get("presets")), parameters["finger"], cache=cache)
    found = drain(steps, lambda step: report(step.done, step.total))
    made = {"table": json.dumps(pages.as_dict(found)), "csv": pages.csv(found), "html": pages.html(found)}
    return {name: np.frombuffer(words.encode(), np.uint8) for name, words in made.items()}
