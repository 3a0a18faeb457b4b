"""Rows of numbers from a text file, with a line of names or without: the one reader of .csv files from elsewhere."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .arrays import Array
from .column_names import TIMES, Column, columns_of, time_column
from .errors import DermisError
from .files import read_text

SEPARATORS = ";\t,"  # the first of them that stands in the first line; else white space
LONGEST_SPAN = 86_400.0  # [s], a day: no recording of a finger is longer, and numbers of another unit are
SLOW, LONG = 1.0, 60.0  # rows as far apart [s], for so long [s]: nobody records so, their times have another unit
LATEST = 1e11  # [s] more than since the year 1 (6.4e10), less than milliseconds since 1970 (1.7e12)
UNIT_NOT_SAID = "the unit of the times is not stated, and in seconds they are slow"


@dataclass(frozen=True)
class Line:
    """A line of a file: its number from 1, and its text, whose cells a separator parts; '' is white space."""

    number: int
    text: str
    separator: str

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells without what surrounds them."""
        parts = self.text.split(self.separator) if self.separator else self.text.split()
        return tuple(part.strip().strip('"').strip() for part in parts)

    def numbers(self) -> list[float | None]:
        """Return the cells' numbers, None where one holds none."""
        if "_" not in self.text:  # which Python reads over
            with contextlib.suppress(ValueError):
                return list(map(float, self.text.split(self.separator or None)))
        return [number(cell, self.separator) for cell in self.cells]


@dataclass(frozen=True, eq=False)
class Rows:
    """Numbers in columns.

    Attributes:
        where: name of the file.
        names: names of the columns; empty if the file has no line of names.
        values: NaN where a cell holds no number, shape (n, c). lines: the number of each row's line in the file.
        spaced: white space parts the cells.
    """

    where: str
    names: tuple[str, ...]
    values: Array
    lines: tuple[int, ...]
    spaced: bool = False

    def columns(self) -> tuple[Column, ...]:
        """Return the meaning of the names.

        Raises:
            DermisError: see `column_names.columns_of`.
        """
        return columns_of(self.names, self.where)

    def place(self, row: int, column: int | None = None) -> str:
        """Return where a number stands, for people."""
        text = f"{self.where}, line {self.lines[row]}"
        if column is None:
            return text
        return f"{text}, column {column + 1}" + (f" '{self.names[column]}'" if self.names else "")

    def times(self) -> tuple[Array, int]:
        """Return times [s], rising, shape (n,), and their column: the first where the file has no names.

        Raises:
            DermisError: no column has the name of a time, or see `seconds`.
        """
        if not self.names:
            return self.seconds(0, None), 0
        columns = self.columns()
        index = time_column(columns, self.where)
        return self.seconds(index, columns[index].unit), index

    def seconds(self, index: int, unit: float | None) -> Array:
        """Return the times of a column [s], rising, shape (n,).

        Args:
            unit: seconds of one, None where the file does not say it: then they are seconds if they can be.

        Raises:
            DermisError: nobody says the unit, and they can hardly be seconds; or see `check_times`.
        """
        given = self.values[:, index]
        if unit is None and slow(given) and (np.diff(given) > 0.0).all():
            likely = time_unit(given) or "ms"
            raise DermisError(
                UNIT_NOT_SAID,
                where=self.place(len(given) - 1, index),
                value=f"{given[0]:.12g} to {given[-1]:.12g} in {len(given)} rows",
                limit=f"less than {SLOW:g} s from row to row, or a unit in the column's name",
                remedy=f"Name the column in the line of names 'time_{likely}', or 'time_s' if they are seconds",
            )
        times = given * (unit or 1.0)
        check_times(times, self, index)
        return times


def check_times(times: Array, rows: Rows, column: int) -> None:
    """Refuse times that cannot be.

    Args:
        times: [s], shape (n,). rows, column: where they stand.

    Raises:
        DermisError: a time that is missing or no later than the one before, or more than a day in all.
    """
    bad = np.flatnonzero(~np.isfinite(times))
    if len(bad):
        raise DermisError("a time is missing or not finite", where=rows.place(int(bad[0]), column))
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if len(late):
        row = int(late[0]) + 1
        raise DermisError(
            "times do not rise",
            where=rows.place(row, column),
            value=float(rows.values[row, column]),
            limit=f"> {rows.values[row - 1, column]:.12g}, of the row before",
        )
    if len(times) and times[-1] - times[0] > LONGEST_SPAN:
        raise DermisError(
            "these times cannot be seconds: the recording would last longer than a day",
            where=rows.place(len(times) - 1, column),
            value=f"{times[-1] - times[0]:.6g} s",
            limit=f"{LONGEST_SPAN:g} s",
            remedy="Name their unit in the line of names, such as 'time [ms]', or choose the right column",
        )


def slow(times: Array) -> bool:
    """Return whether times are too far apart, or too late, to be seconds."""
    if not len(times):
        return False
    span = np.ptp(times)
    return bool((span >= LONG and span >= SLOW * (len(times) - 1)) or np.abs(times).max() > LATEST)


def time_unit(times: Array) -> str:
    """Return the unit of times, 's' where they can be seconds; '' where they have none."""
    if not slow(times):
        return "s"
    step = np.ptp(times) / (len(times) - 1)
    for unit in ("ms", "us", "ns"):
        if step * TIMES[unit] < SLOW and np.abs(times).max() * TIMES[unit] <= LATEST:
            return unit
    return ""


def read_rows(path: Path) -> Rows:
    """Read a .csv file of numbers; other cells become NaN.

    Cells are parted by semicolons, tabs, commas or white space. Where no comma parts them, a comma in a number is a
    decimal comma. A first line without a single number is one of names; so is a comment before the numbers that has as
    many words as they have columns, and names x, y and z. Other lines that begin with '#', and empty ones, are passed
    over. A line of missing values ('nan') is a line of values.

    Raises:
        DermisError: the file is no text, has no rows, or rows of different lengths.
    """
    lines, separator, comment = lines_of(path)
    names: tuple[str, ...] = ()
    if lines and not any(value is not None for value in lines[0].numbers()):
        names, lines = lines[0].cells, lines[1:]
    if not lines:
        raise DermisError("the file has no rows of numbers", where=str(path))
    count = len(names or lines[0].numbers())
    whole = numbers_of(lines, count)
    rows = [line.numbers() for line in lines] if whole is None else []
    for line, row in zip(lines, rows, strict=whole is None):
        if len(row) != count:
            raise DermisError(
                "a row and the first row have different numbers of values",
                where=f"{path}, line {line.number}",
                value=len(row),
                limit=str(count),
                remedy="Keep one line of names with the units in it, and below it rows of as many numbers",
            )
    if not names and len(comment) == count and _has_places(comment, str(path)):
        names = comment
    values = np.array(rows, np.float64) if whole is None else whole  # None becomes NaN
    return Rows(str(path), names, values, tuple(line.number for line in lines), not separator)


def lines_of(path: Path) -> tuple[list[Line], str, tuple[str, ...]]:
    """Return the lines of a file that are neither empty nor comments, what parts their cells, and the last comment's.

    Returns:
        lines, without separators at their ends; ';', a tab, ',' or '' for white space; the cells of the comment
        directly before the first line.

    Raises:
        DermisError: the file cannot be read, or is no text.
    """
    kept: list[tuple[int, str]] = []
    comment = ""
    for i, line in enumerate(read_text(path, encoding="utf-8-sig").splitlines(), 1):
        if line.startswith("#"):
            comment = line.lstrip("# ") if not kept else comment
        elif line.strip():
            kept.append((i, line))
    first = kept[0][1] if kept else ""
    separator = next((s for s in SEPARATORS if s in first), "")
    kept = _unended(kept, separator)
    return [Line(i, text, separator) for i, text in kept], separator, Line(0, comment, separator).cells


def _unended(kept: list[tuple[int, str]], separator: str) -> list[tuple[int, str]]:
    """Return lines without a separator at their ends, which parts nothing; one before a missing last value stays."""

    def width(text: str) -> int:
        return text.count(separator) + 1

    def ended(text: str) -> bool:
        return text.rstrip(" \r").endswith(separator)

    if not separator or not any(ended(text) for _, text in kept):
        return kept
    columns = width(kept[0][1]) - ended(kept[0][1])
    if any(width(text) > columns and not ended(text) for _, text in kept):
        return kept
    return [(i, text[: text.rindex(separator)] if width(text) == columns + 1 else text) for i, text in kept]


def numbers_of(lines: Sequence[Line], columns: int) -> Array | None:
    """Return the numbers of lines, shape (lines, columns), read all at once; None where one of them is to be looked at.

    That is one with a cell that holds no number, or that only `number` reads, or with another count of cells.
    """
    try:
        found = np.loadtxt([line.text for line in lines], delimiter=lines[0].separator or None, comments=None, ndmin=2)
    except ValueError:
        return None
    return found if found.shape == (len(lines), columns) else None


def number(cell: str, separator: str = ",") -> float | None:
    """Return a cell's number, None where it holds none; the comma is a decimal one where it parts no cells."""
    if "_" in cell:  # Python reads 1_0 as 10: no program writes numbers so
        return None
    try:
        return float(cell)
    except ValueError:
        if separator == "," or "," not in cell or "." in cell:
            return None
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return None


def _has_places(names: Sequence[str], where: str) -> bool:
    try:
        return {"x", "y", "z"} <= {column.meaning for column in columns_of(names, where)}
    except DermisError:
        return False
