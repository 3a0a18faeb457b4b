"""The study 'motors': the six interactions of [S2] on platforms.

Seeds, wobbles and dimensions of the platform can vary.

Source: [S2] V; the rule, the noise and the wobble are those fixed in `design/interactions.py`
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import cache_key
from ..design.collect import collect
from ..design.interactions import NAMES, NOISE
from ..design.synergies import RULES
from ..design.trial import Verdict, judge
from ..devices.spec import DeviceSpec, from_preset
from ..errors import DermisError
from ..matching.table import SkinTable
from ..pipeline.bake import Progress
from ..presets import Library
from ..recent import Recent
from ..skin.shape import FingertipShape
from ..steps import in_words
from ..work.executor import JobExecutor
from ..work.jobs import Report
from ..work.spread import Asked
from .readings import readings, sensed
from .row import Row, row_key
from .spec import Spec, Value
from .variant import check_keys, dimensions

DEFAULTS: Mapping[str, Value] = {"device": "cable_platform", "touch": "", "seed": 0, "wobble": 1.0}

_tables: Recent[str, SkinTable] = Recent(2)  # a sweep has few platforms, and the rows of one platform follow each other


def rows(spec: Spec, library: Library) -> list[Row]:
    """Return the rows of a sweep.

    A variant without a touch gets a row for each of the six touches.

    Raises:
        DermisError: a parameter cannot vary, a platform or touch is unknown, or a seed or wobble is not valid.
    """
    check_keys(spec, tuple(DEFAULTS), ("device",))
    made = []
    for varied in spec.variants():
        values = {**DEFAULTS, **varied}
        preset = dimensions(values, library, spec.where)
        source = dict(library.device(str(values["device"])).source) if preset is None else preset
        for touch in (values["touch"],) if values["touch"] else NAMES:
            columns = {**values, "touch": touch}
            _check(columns, spec.where)
            given = {"values": columns, "preset": source, "level": spec.level, "rows": spec.rows}
            made.append(Row(row_key("motors", "", given), columns, given))
    return made


def _check(values: Mapping[str, Value], where: str) -> None:
    seed, wobble = values["seed"], values["wobble"]
    if values["touch"] not in NAMES:
        raise DermisError("no such interaction", where=where, value=values["touch"], limit=", ".join(NAMES))
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise DermisError("not a seed", where=where, value=seed, limit=">= 0")
    if isinstance(wobble, str | bool) or not 0.0 <= wobble <= 10.0:
        raise DermisError("not a share of the wobble", where=where, value=wobble, limit="0 to 10")


def prepare(
    wanted: Sequence[Row], spec: Spec, _library: Library, executor: JobExecutor, _stack: ExitStack, folder: Path
) -> Generator[Progress, None, Callable[[Row], Asked]]:
    """Compute tables of platforms and readings of shared touches.

    Progress is yielded. Tables and readings are kept in folders, so that an interrupted sweep continues with the
    missing ones.

    Returns:
        Function that returns the job of a row.
    """
    tables: dict[str, tuple[str, dict[str, NDArray[Any]]]] = {}
    for row in wanted:
        platform = _platform(row)
        if platform not in tables:
            device = from_preset(str(row.given["values"]["device"]), row.given["preset"])
            steps = collect(
                device, FingertipShape(), folder / "tables", level=spec.level, rows=spec.rows, executor=executor
            )
            table = yield from in_words(steps, lambda step: Progress("table", *step))
            tables[platform] = _sent(table, device)

    read = yield from readings(wanted, executor, folder / "readings")

    def asked(row: Row) -> Asked:
        key, arrays = tables[_platform(row)]
        if row.key in read:
            arrays = {**arrays, "counts": read[row.key]}
        return Asked("sweep-row", arrays, {"study": "motors", "table": key, **row.given})

    return asked


def _platform(row: Row) -> str:
    return json.dumps([row.given["values"]["device"], row.given["preset"]], sort_keys=True)


def _sent(table: SkinTable, device: DeviceSpec) -> tuple[str, dict[str, NDArray[Any]]]:
    """Return a table as a key, by which workers keep it, and arrays."""
    arrays = {
        "commands": table.commands,
        "readings": table.readings,
        "scale": table.scale,
        "rest": np.array(table.rest),
    }
    for array in arrays.values():
        array.flags.writeable = False  # many jobs share the array
    parts = [np.ascontiguousarray(array).tobytes() for array in arrays.values()]
    return cache_key("dermis-sweep-table", device.key, *parts), arrays


def work(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report) -> dict[str, Value]:
    """Judge one row and return its verdict as figures.

    Raises:
        DermisError: no row of the table differs from rest by more than the noise, or the motors never move.
    """
    values = parameters["values"]
    table = _tables.make(
        str(parameters["table"]),
        lambda: SkinTable(
            arrays["commands"], arrays["readings"], int(arrays["rest"]), arrays["scale"], meta={}
        ).heard_with(NOISE),
    )
    counts = arrays["counts"] if "counts" in arrays else sensed(parameters)
    report(1, 2)
    return figures(judge(table, counts, str(values["touch"]), int(values["seed"])))


def figures(verdict: Verdict) -> dict[str, Value]:
    """Return a verdict as columns of a table."""
    made: dict[str, Value] = {"expected": verdict.expected, "error": verdict.error, "felt": verdict.touch}
    for rule, found, percent in zip(RULES, verdict.found, verdict.percent, strict=True):
        made[f"motors_{rule}"] = found
        made |= {f"lost_{rule}_{k}": value for k, value in enumerate(percent, 1)}
    return made


def verdict_of(columns: Mapping[str, Value]) -> Verdict:
    """Return the verdict in a row of the sweep's table.

    This is the inverse of `figures`.

    Raises:
        KeyError: a column is missing.
    """
    n = sum(key.startswith(f"lost_{RULES[0]}_") for key in columns)
    return Verdict(
        str(columns["touch"]),
        int(columns["seed"]),
        int(columns["expected"]),
        tuple(int(columns[f"motors_{rule}"]) for rule in RULES),
        tuple(tuple(float(columns[f"lost_{rule}_{k}"]) for k in range(1, n + 1)) for rule in RULES),
        float(columns["error"]),
        float(columns["felt"]),
    )
