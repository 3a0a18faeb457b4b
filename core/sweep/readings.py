"""Sensor readings in the interactions of [S2].

They are computed once for all platforms of a sweep.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import cache_key
from ..design.interactions import NAMES, WOBBLE, Wobble
from ..design.trial import felt, sense
from ..errors import DermisError
from ..files import write_npz
from ..matching.readings import Counts
from ..npz import read_npz
from ..pipeline.bake import Progress
from ..skin.model import SkinModel, fingertip_skin
from ..work.engine import SAME, engine
from ..work.executor import JobExecutor
from ..work.jobs import Report
from ..work.spread import Asked, spread
from .row import Row

PARTS = ("tilt", "depth", "shift", "amplitude")  # attributes of a wobble that a row scales


def readings(
    rows: Sequence[Row], executor: JobExecutor, folder: Path
) -> Generator[Progress, None, Mapping[str, NDArray[Any]]]:
    """Compute the readings of the touches that several rows share.

    Progress is yielded. Each touch is computed once, and its readings are kept in a folder.

    Returns:
        Readings of each row's touch by the key of the row, shape (n, 20). Touches of a single row are left out, and
        touches whose job failed. Such rows compute their readings themselves, and report why they cannot.
    """
    asked = {row.key: _key(row) for row in rows}
    shared = {key for key, users in Counter(asked.values()).items() if users > 1}
    needed = {asked[row.key]: row for row in rows if asked[row.key] in shared}
    there = {}
    for key in needed:
        with suppress(DermisError):  # a missing or damaged file: its readings are computed again
            there[key] = read_readings(folder / f"{key}.npz")
    yield Progress("touches", len(there), len(needed))
    jobs = ((key, Asked("sweep-reading", {}, dict(row.given))) for key, row in needed.items() if key not in there)
    for item in spread(executor, jobs):
        if item is None or item[1].exception() is not None:
            continue
        key, made = item[0], item[1].result()
        write_npz(folder / f"{key}.npz", made)
        there[key] = made["counts"]
        yield Progress("touches", len(there), len(needed))
    for counts in there.values():
        counts.flags.writeable = False  # several jobs share the array
    return {row: there[key] for row, key in asked.items() if key in there}


def work(_arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], _report: Report) -> dict[str, Counts]:
    """Compute the readings of a row's touch; this is the job 'sweep-reading'."""
    return {"counts": sensed(parameters)}


def sensed(given: Mapping[str, Any]) -> Counts:
    """Return the readings of a row's touch, shape (n, 20).

    Args:
        given: parameters of the row's job, see `Row`. The value 'wobble' scales the default wobble.
    """
    touch, seed, share = str(given["values"]["touch"]), int(given["values"]["seed"]), float(given["values"]["wobble"])
    parts = {part: share * getattr(WOBBLE, part) for part in PARTS}
    contact = felt(_skin(str(given["level"])), touch, seed, Wobble(**parts, bandwidth=WOBBLE.bandwidth))
    return sense(contact, seed=100 * seed + NAMES.index(touch))


def _key(row: Row) -> str:
    """Return the hash of all inputs of a row's readings.

    The platform is not among these inputs.
    """
    values, made_by = row.given["values"], [engine()[name] for name in SAME]
    touch = (str(values["touch"]), repr(int(values["seed"])), repr(float(values["wobble"])), str(row.given["level"]))
    return cache_key("dermis-sweep-reading 1", *touch, *made_by)[:32]


def read_readings(path: Path) -> Counts:
    """Return the readings of an earlier run, shape (n, 20).

    Raises:
        DermisError: the file is missing or damaged.
    """
    found = read_npz(path, str(path), "readings of a sweep").get("counts")
    if found is None or found.dtype != np.uint16 or found.ndim != 2 or found.shape[1] != 20:
        raise DermisError("no readings of a touch", where=str(path), limit="'counts', 20 whole numbers a sample")
    return found


@lru_cache(maxsize=1)
def _skin(level: str) -> SkinModel:
    return fingertip_skin(level=level)
