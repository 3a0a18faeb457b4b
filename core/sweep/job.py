"""The job 'sweep-row', which computes one row of a sweep.

The figures of the row are returned as one JSON object.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from numpy.typing import NDArray

from ..work.jobs import Report
from ..work.parcel import array_from, bytes_of
from .spec import STUDIES, Value


def work(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report) -> dict[str, NDArray[Any]]:
    """Compute a row of a study by the function `work` of the study's module."""
    study = STUDIES[STUDIES.index(parameters["study"])]
    made = import_module(f".{study}", __package__).work(arrays, parameters, report)
    return {"figures": array_from(json.dumps(made).encode())}


def figures_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Value]:
    """Return the figures that the job returned."""
    return json.loads(bytes_of(arrays["figures"]))
