"""A sweep from its rows to its table: finished rows stay, the others run side by side, and failures are explained."""

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
        lost: names of the rows whose worker died; the next run repeats them.
        paths: paths of the table's files.
    """

    rows: int
    done: int
    kept: int
    refused: int
    lost: tuple[str, ...]
    paths: tuple[Path, ...]


def run_sweep(spec: Spec, library: Library, folder: Path, executor: JobExecutor) -> Generator[Progress, None, Swept]:
    """Do the rows of a sweep that are not in a folder yet, and write its table there; yield progress.

    Each row is a file as soon as it is done: a run that was ended goes on where it stood. A refused row is kept as
    finished ones are, since it would be refused again. Leaving early writes the table of finished rows.

    Args:
        folder: folder of this sweep. Rows of another variant, scene, preset or version of Dermis have other names.

    Raises:
        DermisError: a sweep that cannot be, see `rows` of its study; a folder that cannot be written.
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
                    lost.append(f"{dict(row.columns)}: {error}")  # of the machines, not of the row
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
