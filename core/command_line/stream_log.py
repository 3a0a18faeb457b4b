"""`python -m core stream log`: summary or conversion of a binary log."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DermisError
from ..files import atomic
from ..stream.log.binary import LogFile, read
from ..stream.log.csv_form import CsvForm
from ..stream.log.row import Fate, Rows

_AT_ONCE = 4096  # rows that are converted at once


def run(options: argparse.Namespace) -> int:
    """Print a summary of a log, or write the log as CSV.

    Return the exit status. The status is 0, or 1 if the log is incomplete.

    Raises:
        DermisError: a file cannot be read, or the files are not those of one log.
    """
    files = _in_order(options.files)
    rows = np.concatenate([file.rows for file in files])
    first, last = files[0], files[-1]
    doubts = _doubts(files, last.lost or _gaps(rows))
    if options.out is not None:
        form = CsvForm(len(first.header.channels), len(first.header.sensed))
        with atomic(options.out) as part, part.open("wb") as out:
            out.write(form.head(replace(first.header, removed=last.header.removed)))
            for start in range(0, len(rows), _AT_ONCE):
                out.write(form.rows(rows[start : start + _AT_ONCE]))
            if last.end is not None:
                out.write(form.end({**last.end, "rows": len(rows)}))
    else:
        for line in _summary(files, rows):
            print(line)
    for doubt in doubts:
        print(doubt, file=sys.stderr)
    return int(bool(doubts))


def _in_order(paths: Sequence[Path]) -> list[LogFile]:
    files = sorted((read(path) for path in paths), key=lambda file: file.header.file)
    if len({file.header.log for file in files}) > 1:
        raise DermisError(
            "the files are of several logs",
            where=", ".join(map(str, paths)),
            limit="the files of one log: NAME.dlog, NAME.2.dlog ...",
            remedy="Convert them one by one",
        )
    numbers = [file.header.file for file in files]
    if len(set(numbers)) < len(numbers):
        raise DermisError("a file of the log is given twice", where=", ".join(map(str, paths)))
    return files


def _gaps(rows: Rows) -> int:
    """Return how many row numbers are missing between the first and last row."""
    return int(rows["number"][-1] - rows["number"][0]) + 1 - len(rows) if len(rows) else 0


def _doubts(files: Sequence[LogFile], lost: int) -> list[str]:
    """Return the reasons why a log is incomplete, each as a sentence.

    Args:
        files: the files of the log, in order.
        lost: number of missing rows.
    """
    found = []
    for file in files:
        name = f"file {file.header.file} of the log"
        if file.end is None:
            found.append(f"{name} was not finished: its writer was ended, or still writes")
        if file.unread:
            found.append(f"{name} has {file.unread:,} bytes at its end that are no whole rows")
    numbers = [file.header.file for file in files]
    missing = sorted(set(range(numbers[0], numbers[-1] + 1)) - set(numbers))
    if missing:
        found.append(f"files {', '.join(map(str, missing))} of the log are not among those given")
    if lost:
        found.append(f"{lost:,} rows are missing: they came faster than they could be written, or in files not given")
    return found


def _summary(files: Sequence[LogFile], rows: Rows) -> list[str]:
    header = files[0].header
    seconds = float(rows["time"][-1] - rows["time"][0]) if len(rows) else 0.0
    counted: dict[str, Any] = {fate.name.lower(): int((rows["fate"] == fate).sum()) for fate in Fate}
    counted["skipped"] = int(rows["skipped"].sum())
    return [
        f"{header.name} ({header.device}) by {header.protocol} at {header.url}, {header.rate:g} Hz",
        f"started {header.started}",
        f"{len(rows):,} rows in {seconds:.3f} s: " + ", ".join(f"{name} {n:,}" for name, n in counted.items()),
        "channels " + ", ".join(f"{c.name} [{c.unit}]" for c in header.channels),
        *_highest(files, rows),
    ]


def _highest(files: Sequence[LogFile], rows: Rows) -> list[str]:
    """Return a line with the largest absolute value of each measured quantity."""
    lines = []
    for k, quantity in enumerate(files[0].header.sensed):
        values = np.abs(rows["sensed"][:, k])
        if np.isfinite(values).any():
            lines.append(f"{quantity.name} up to {np.nanmax(values):.3g} {quantity.unit}")
        else:
            lines.append(f"{quantity.name}: not measured")
    return lines
