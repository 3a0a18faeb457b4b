"""Simulated data collection: a resumable sweep of configurations.

The sweep is divided into parts that workers compute. Each finished part is written atomically to a file of its own, so
an interrupted collection continues with the missing parts. When all parts exist, they are joined to one table.

Source: [S2] III.A with the corrections (rows come from rest; the spread of the reversed sweep is told)
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..cache import cache_key
from ..devices.press import Press, Pressed
from ..devices.press_problem import PressPoints
from ..devices.spec import DeviceSpec, from_preset
from ..errors import DermisError
from ..files import write_npz
from ..matching.platforms import mechanism, original_key
from ..matching.readings import Readings, quantised, readings_of
from ..matching.sweep import commands_swept, reached, sweep
from ..matching.table import SkinTable, assemble, press_of, tabulate
from ..npz import opened_npz
from ..parameters.error_bands import LINEAR
from ..recent import Recent
from ..skin.material import Elastic
from ..skin.model import SkinModel, fingertip_skin
from ..skin.observation import skin_key
from ..skin.shape import FingertipShape
from ..surrogate.press_points import press_points, pressed_on
from ..work.executor import POLL_SECONDS, InlineExecutor, JobExecutor

PART = 1024  # rows of a part; it takes a few seconds
SPREAD_ROWS = 512  # rows of the reversed sweep

_spreads: Recent[tuple[str, str, str, str, int], dict[str, float]] = Recent(8)


def collect(
    spec: DeviceSpec,
    shape: FingertipShape,
    folder: Path,
    *,
    level: str = "draft",
    rows: int | None = None,
    executor: JobExecutor | None = None,
    material: Mapping[str, float] | None = None,
    points: PressPoints | None = None,
    tissue: str = LINEAR,
) -> Generator[tuple[int, int], None, SkinTable]:
    """Sweep a device's configurations on a fingertip.

    Yields (finished rows, all rows) and returns the table.

    Args:
        spec: the device.
        shape: shape of the fingertip.
        folder: folder in which parts are kept until the table is complete.
        level: resolution of the skin's mesh.
        rows: approximate number of rows; None for that of the preset.
        executor: executor of the jobs 'collect'; None for this process.
        material: parameters of the skin: young [Pa], poisson and alpha. Missing parameters have their defaults.
        points: pressed points of the same skin, if the caller has them already; None computes them.
        tissue: tissue model of the skin, 'linear' or 'neo_hookean'.

    Raises:
        DermisError: the preset has no sweep, a part cannot be written, or the table has too few rows.
    """
    skin = _skin(shape, Elastic(**(material or {})), level, tissue)
    points = press_points(skin) if points is None else points
    commands, unreached = sweep(spec, points.positions, rows)
    name = "dermis-sweep 3", original_key(spec), skin_key(skin), repr(skin.material), points.on
    key = cache_key(*name, commands.tobytes())[:16]
    folder = Path(folder) / key
    parts = [(i, folder / f"{i:06d}.npz") for i in range(0, len(commands), PART)]
    todo = [(i, path) for i, path in parts if not _whole(path)]
    done = len(commands) - sum(len(commands[i : i + PART]) for i, _ in todo)
    yield done, len(commands)
    parameters = {
        "key": spec.key,
        "preset": dict(spec.source),
        "shape": asdict(shape),
        "level": level,
        "material": dict(material or {}),
        "tissue": tissue,
    }
    arrays = {"positions": points.positions, "compliance": points.compliance}
    arrays |= {} if points.nodal is None else {"nodal": points.nodal}
    for count in _pressed(executor or InlineExecutor(), commands, todo, arrays, parameters):
        done += count
        yield done, len(commands)
    asked = {"asked": len(commands) + unreached, "unreached_rows": unreached, "pressed_on": points.on}
    return _joined(spec, skin, [path for _, path in parts], {**asked, "level": level})


def reversed_spread(spec: DeviceSpec, skin: SkinModel, rows: int = SPREAD_ROWS) -> dict[str, float]:
    """Return the effect of friction history on readings.

    Rows reached from deeper positions are compared with the same rows reached from rest. The result is kept in
    memory, because it does not depend on the touches. It is always computed on linear skin: with the nonlinear law
    the deep rows would take minutes, and rows that do not converge would be counted as an effect of friction.

    Returns:
        'rows': number of rows compared. 'rms' and 'worst': root mean square and maximum, over the rows, of the RMS
        difference of the channels [counts].

    Raises:
        DermisError: no row of the sweep touches.
    """
    skin = skin.linear
    key = original_key(spec), skin_key(skin), repr(skin.material), pressed_on(skin), rows
    return dict(_spreads.make(key, lambda: _spread(spec, skin, rows)))


def _spread(spec: DeviceSpec, skin: SkinModel, rows: int) -> dict[str, float]:
    press, sensor = press_of(skin, spec), readings_of(skin)
    commands, deeper = (commands_swept(each, press.points.positions, rows) for each in (spec, _deeper(spec)))
    within = reached(spec, commands) & reached(spec, deeper)
    commands, deeper = commands[within], deeper[within]
    direct, back = press.press(commands), press.press(commands, via=deeper)
    both = direct.touching & back.touching & (direct.imbalance < 0.02) & (back.imbalance < 0.02)
    apart = quantised(_counts(sensor, direct, both)) - quantised(_counts(sensor, back, both)).astype(float)
    each = np.sqrt((apart**2).mean(axis=1))
    if not len(each):
        raise DermisError("no row of the sweep touches", where=f"device preset '{spec.key}'")
    return {"rows": float(len(each)), "rms": float(np.sqrt((each**2).mean())), "worst": float(each.max())}


def work(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Any) -> dict[str, NDArray[Any]]:
    """Compute one part of a sweep; this is the job 'collect'."""
    spec = from_preset(str(parameters["key"]), parameters["preset"])
    shape, material = FingertipShape(**parameters["shape"]), Elastic(**parameters["material"])
    skin = _skin(shape, material, str(parameters["level"]), str(parameters.get("tissue", LINEAR)))
    law = skin.law if skin.follows_law else None
    points = PressPoints(arrays["positions"], arrays["compliance"], arrays.get("nodal"), law, skin.material.modulus)
    press = Press(points, mechanism(spec), float(spec.value("friction")))
    kept, counts, left = tabulate(readings_of(skin), arrays["commands"], press.press(arrays["commands"]))
    return {"commands": kept, "readings": counts, "left": np.array(list(left.values()), np.int64)}


def _counts(sensor: Readings, pressed: Pressed, rows: NDArray[np.bool_]) -> Array:
    """Return the counts of selected rows before rounding."""
    return sensor.counts(pressed.force[rows], None if pressed.amounts is None else pressed.amounts[rows])


@lru_cache(maxsize=1)
def _skin(shape: FingertipShape, material: Elastic, level: str, tissue: str) -> SkinModel:
    """Return a skin.

    The last skin is kept, because all parts of a collection use the same.
    """
    made = fingertip_skin(shape, material, level=level)
    return made if tissue == LINEAR else made.with_law()


def _pressed(
    executor: JobExecutor,
    commands: Array,
    todo: list[tuple[int, Path]],
    arrays: Mapping[str, NDArray[Any]],
    parameters: Mapping[str, Any],
) -> Generator[int, None, None]:
    """Submit parts as workers become free, and write their results.

    Yields the number of rows of each finished part, and 0 at intervals in which none is finished.
    """
    queue = list(reversed(todo))
    running: dict[Future[Any], tuple[Path, int]] = {}
    try:
        while queue or running:
            while queue and len(running) < executor.room():
                i, path = queue.pop()
                part = commands[i : i + PART]
                running[executor.submit("collect", {**arrays, "commands": part}, parameters)] = path, len(part)
            finished = wait(running, POLL_SECONDS, FIRST_COMPLETED).done
            for future in finished:
                path, count = running.pop(future)
                write_npz(path, future.result())
                yield count
            if not finished:
                yield 0
    finally:
        for future in running:
            future.cancel()


def _whole(path: Path) -> bool:
    try:
        part = _read_part(path)
    except DermisError:  # the part is missing or damaged, so it is computed again
        return False
    return part["left"].shape == (4,) and len(part["commands"]) == len(part["readings"])


def _read_part(path: Path) -> dict[str, NDArray[Any]]:
    with opened_npz(path) as archive:
        return archive.arrays(("commands", "readings", "left"))


def _joined(spec: DeviceSpec, skin: SkinModel, paths: list[Path], about: Mapping[str, Any]) -> SkinTable:
    commands: list[Array] = []
    counts: list[Array] = []
    left = np.zeros(4, np.int64)
    for path in paths:
        part = _read_part(path)
        commands.append(part["commands"])
        counts.append(part["readings"])
        left += part["left"]
    rest, unbalanced, saturated, unsettled = (int(v) for v in left)
    meta = {
        **about,
        "rest_rows": rest,
        "unbalanced_rows": unbalanced,
        "saturated_rows": saturated,
        "law_unsettled_rows": unsettled,
        "tetrahedra": len(skin.mesh.tetrahedra),
    }
    return assemble(spec, skin, readings_of(skin), np.vstack(commands), np.vstack(counts), meta)


def _deeper(spec: DeviceSpec) -> DeviceSpec:
    """Return the same device with a sweep that is deeper by 1/54 of its range."""
    low, high = spec.parameters["sweep_press"]
    step = (high - low) / 54.0
    return replace(spec, parameters={**spec.parameters, "sweep_press": [low + step, high + step]})
