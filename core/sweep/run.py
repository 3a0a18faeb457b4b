"""Run of a sweep.

Finished rows are kept, missing rows are computed in parallel, and a table is written.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from ..errors import DermisError
from ..pipeline.bake import Progress
from ..presets import Library
from ..work.executor import JobExecutor
from ..work.spread import spread
from . import table
from .job import figures_of
from .row import Row
from .spec import Spec


@dataclass(frozen=True)
class Swept:
    """Results of a sweep.

    Attributes:
        rows: number of rows.
        done: number of rows computed by this run.
        kept: number of rows of earlier runs.
        refused: number of rows with a reason instead of figures.
        lost: descriptions of the rows that failed because of their worker, not of the row; the next run repeats them.
        paths: paths of the table's files.
    """

    rows: int
    done: int
    kept: int
    refused: int
    lost: tuple[str, ...]
    paths: tuple[Path, ...]


def run_sweep(spec: Spec, library: Library, folder: Path, executor: JobExecutor) -> Generator[Progress, None, Swept]:
    """Compute the missing rows of a sweep and write its table.

    A row is missing if `folder` has no file for it. Progress is yielded, and a `Swept` is returned. Each finished
    row is written to a file, so a later run computes only the missing rows. A refused row is kept as well, because
    it would be refused again. If the generator is closed early, the table of the finished rows is written.

    Args:
        spec: the sweep.
        library: library of the presets.
        folder: folder of this sweep. The files of rows are named by `Row.key`.
        executor: executor of the jobs.

    Raises:
        DermisError: the sweep is not valid, see `rows` of its study; or the folder cannot be written.
    """
    study = import_module(f".{spec.study}", __package__)
    rows: list[Row] = study.rows(spec, library)
    unique = {row.key: row for row in rows}
    found = {key: figures for key, row in unique.items() if (figures := table.kept(folder, row)) is not None}
    before = len(found)
    missing = [row for key, row in unique.items() if key not in found]
    lost: list[str] = []
    yield Progress("rows", before, len(unique))
    try:
        with ExitStack() as stack:
            asked = yield from study.prepare(missing, spec, library, executor, stack, folder)
            for item in spread(executor, ((row, asked(row)) for row in missing)):
                if item is None:
                    continue
                row, future = item
                error = future.exception()
                if isinstance(error, DermisError) and error.code in ("job-crashed", "other-version", "no-engine"):
                    lost.append(f"{dict(row.columns)}: {error}")  # the machines failed, not the row
                    continue
                found[row.key] = (
                    {table.ERROR: str(error)} if isinstance(error, DermisError) else figures_of(future.result())
                )
                table.keep(folder, row, found[row.key])
                yield Progress("rows", len(found), len(unique))
    finally:
        paths = table.write(folder, rows, found, spec.study)
    refused = sum(table.ERROR in figures for figures in found.values())
    return Swept(len(unique), len(found) - before, before, refused, tuple(lost), tuple(paths))
