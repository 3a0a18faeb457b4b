"""Rows of numbers from a text file, with a line of names or without."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .arrays import Array
from .errors import DermisError
from .files import read_text


def read_rows(path: Path) -> Array:
    """Read a .csv file of numbers, shape (n, c); what is no number becomes NaN.

    A first line without a single number is one of names. Lines that begin with '#' and empty ones are passed over. A
    line of missing values ('nan') is a line of values.

    Raises:
        DermisError: the file is no text, has no rows, or rows of different lengths.
    """
    where = str(path)
    text = read_text(path, encoding="utf-8-sig")
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if lines and all(_number(field) is None for field in lines[0][1].split(",")):
        lines = lines[1:]
    if not lines:
        raise DermisError("the file has no rows of numbers", where=where)
    rows = [[_number(field) for field in line.split(",")] for _, line in lines]
    for (line, _), row in zip(lines, rows, strict=True):
        if len(row) != len(rows[0]):
            raise DermisError(
                "a row has another number of values than the first",
                where=f"{where}, line {line}",
                value=len(row),
                limit=str(len(rows[0])),
            )
    return np.array([[np.nan if v is None else v for v in row] for row in rows], np.float64)


def _number(field: str) -> float | None:
    try:
        return float(field)
    except ValueError:
        return None
