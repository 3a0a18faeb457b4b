"""Readings of the sensor in the interactions of [S2], computed once for all platforms of a sweep."""

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

PARTS = ("tilt", "depth", "shift", "amplitude")  # of a wobble, as a share of their defaults


def readings(
    rows: Sequence[Row], executor: JobExecutor, folder: Path
) -> Generator[Progress, None, Mapping[str, NDArray[Any]]]:
    """Let the touches that several rows share be read, each once and kept in a folder; yield progress.

    Returns:
        By the keys of rows, the readings of their touch, shape (n, 20). One that failed is not there: its rows read it
        themselves, and say why they cannot.
    """
    asked = {row.key: _key(row) for row in rows}
    shared = {key for key, users in Counter(asked.values()).items() if users > 1}
    needed = {asked[row.key]: row for row in rows if asked[row.key] in shared}
    there = {}
    for key in needed:
        with suppress(DermisError):  # not there, or damaged: it is read again
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
        counts.flags.writeable = False  # shared by several jobs
    return {row: there[key] for row, key in asked.items() if key in there}


def work(_arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], _report: Report) -> dict[str, Counts]:
    """Read the touch of a row: the job 'sweep-reading'."""
    return {"counts": sensed(parameters)}


def sensed(given: Mapping[str, Any]) -> Counts:
    """Return the readings of a row's touch, shape (n, 20), its wobble being a share of the default.

    Args:
        given: the row's parameters, see `Row`.
    """
    touch, seed, share = str(given["values"]["touch"]), int(given["values"]["seed"]), float(given["values"]["wobble"])
    parts = {part: share * getattr(WOBBLE, part) for part in PARTS}
    contact = felt(_skin(str(given["level"])), touch, seed, Wobble(**parts, bandwidth=WOBBLE.bandwidth))
    return sense(contact, seed=100 * seed + NAMES.index(touch))


def _key(row: Row) -> str:
    """Return the hash of all that is read in a row's touch, whatever platform it is judged by."""
    values, made_by = row.given["values"], [engine()[name] for name in SAME]
    touch = (str(values["touch"]), repr(int(values["seed"])), repr(float(values["wobble"])), str(row.given["level"]))
    return cache_key("dermis-sweep-reading 1", *touch, *made_by)[:32]


def read_readings(path: Path) -> Counts:
    """Return the readings of an earlier run, shape (n, 20).

    Raises:
        DermisError: it is not there, or damaged.
    """
    found = read_npz(path, str(path), "readings of a sweep").get("counts")
    if found is None or found.dtype != np.uint16 or found.ndim != 2 or found.shape[1] != 20:
        raise DermisError("no readings of a touch", where=str(path), limit="'counts', 20 whole numbers a sample")
    return found


@lru_cache(maxsize=1)
def _skin(level: str) -> SkinModel:
    return fingertip_skin(level=level)
