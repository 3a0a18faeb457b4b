"""Cases judged by other processes or machines: verdicts come back as one JSON object."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.work.cluster import serve as reply_to

from .case import Verdict
from .families import FAMILIES
from .run import judged

TABLE = {"judge": f"{__name__}:judge"}
LINE = [sys.executable, "-c", f"from core.work.processes import serve; from {__name__} import TABLE; serve(TABLE)"]


def on_worker(request: bytes, *large: bytes) -> bytes:
    """Do a job of this table on a worker of a cluster."""
    return reply_to(request, large, TABLE)


def judge(
    _arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], _report: object
) -> dict[str, NDArray[Any]]:
    """Judge some cases of a family.

    Args:
        parameters: 'family', 'seeds', and 'changed', values in place of those that are drawn.
    """
    (family,) = (each for each in FAMILIES if each.name == parameters["family"])
    told = []
    for seed in parameters["seeds"]:
        started = time.perf_counter()
        found = judged(family, {**family.values(seed), **parameters["changed"]})
        excuses = {check: sorted(codes) for check, codes in found.excuses.items()}
        told.append(
            [seed, time.perf_counter() - started, found.measured, sorted(found.told), excuses, dict(found.facts)]
        )
    return {"verdicts": np.frombuffer(json.dumps(told).encode(), np.uint8)}


def verdicts_of(made: Mapping[str, NDArray[Any]]) -> list[tuple[int, float, Verdict]]:
    """Return what the job returned: seeds, seconds and verdicts."""
    return [
        (
            int(seed),
            float(took),
            Verdict(
                {check: (float(value), float(limit)) for check, (value, limit) in measured.items()},
                frozenset(told),
                {check: frozenset(codes) for check, codes in excuses.items()},
                facts,
            ),
        )
        for seed, took, measured, told, excuses, facts in json.loads(bytes(made["verdicts"]))
    ]
