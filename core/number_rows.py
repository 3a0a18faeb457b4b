"""Reader of rows of numbers from the .csv files of other programs.

The first line of such a file may hold the names of the columns.
"""

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

SEPARATORS = ";\t,"  # the first of these that occurs in a file's first line parts the cells; otherwise white space does
# LONGEST_SPAN [s]: times that span more than this, a day, have another unit than seconds, because no recording of a
# finger lasts longer.
LONGEST_SPAN = 86_400.0
# SLOW [s] and LONG [s]: times with a mean step of at least SLOW over a span of at least LONG have another unit than
# seconds, because nobody records a finger so slowly.
SLOW, LONG = 1.0, 60.0
# LATEST [s]: later times have another unit than seconds. Seconds since the year 1 are fewer (6.4e10), and milliseconds
# since 1970 are more (1.7e12).
LATEST = 1e11
UNIT_NOT_SAID = "the unit of the times is not stated, and in seconds they are slow"


@dataclass(frozen=True)
class Line:
    """One line of a text file, divided into cells.

    Attributes:
        number: number of the line in the file, from 1.
        text: the line without its line break.
        separator: character between the cells: ';', a tab or ','; '' for white space.
    """

    number: int
    text: str
    separator: str

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells, without the white space and double quotes around them."""
        parts = self.text.split(self.separator) if self.separator else self.text.split()
        return tuple(part.strip().strip('"').strip() for part in parts)

    def numbers(self) -> list[float | None]:
        """Return the number in each cell; None for a cell without a number."""
        if "_" not in self.text:  # `float` would read 1_0 as 10; `number` refuses it
            with contextlib.suppress(ValueError):
                return list(map(float, self.text.split(self.separator or None)))
        return [number(cell, self.separator) for cell in self.cells]


@dataclass(frozen=True, eq=False)
class Rows:
    """Numbers in columns.

    Attributes:
        where: name of the file.
        names: names of the columns; empty if the file has no names.
        values: numbers of all cells, shape (rows n, columns c); NaN for a cell without a number.
        lines: line number of each row in the file, n numbers.
        spaced: True if white space parts the cells.
    """

    where: str
    names: tuple[str, ...]
    values: Array
    lines: tuple[int, ...]
    spaced: bool = False

    def columns(self) -> tuple[Column, ...]:
        """Return the meaning of each column's name.

        Raises:
            DermisError: see `column_names.columns_of`.
        """
        return columns_of(self.names, self.where)

    def place(self, row: int, column: int | None = None) -> str:
        """Return the position of a row as text: the file and the line.

        If a column is given, its number and name follow.

        Args:
            row: index of the row.
            column: index of the column; None for the whole row.
        """
        text = f"{self.where}, line {self.lines[row]}"
        if column is None:
            return text
        return f"{text}, column {column + 1}" + (f" '{self.names[column]}'" if self.names else "")

    def times(self) -> tuple[Array, int]:
        """Return the rising times [s], shape (n,), and the index of their column.

        The column of times is found by its name. In a file without names it is the first one.

        Raises:
            DermisError: no name means a time, or see `seconds`.
        """
        if not self.names:
            return self.seconds(0, None), 0
        columns = self.columns()
        index = time_column(columns, self.where)
        return self.seconds(index, columns[index].unit), index

    def seconds(self, index: int, unit: float | None) -> Array:
        """Return the times in a column [s], rising, shape (n,).

        Args:
            index: index of the column.
            unit: unit of the times [s], such as 1e-3 for ms. None if the file states no unit; the times are then taken
                as seconds, unless they are implausible as seconds, see `slow`.

        Raises:
            DermisError: no unit is stated, and the times are implausible as seconds; or see `check_times`.
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
    """Refuse times that are missing, do not rise, or span more than a day.

    Args:
        times: the times [s], shape (n,).
        rows, column: the rows from which the times were read, and the index of their column, for the message.

    Raises:
        DermisError: a time is missing, not finite, or not later than the time before it; or the times span more than
            `LONGEST_SPAN`.
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
    """Return whether times are implausible as seconds.

    They are if they lie too far apart (`SLOW`, `LONG`) or are too late (`LATEST`).

    Args:
        times: rising times in an unknown unit, shape (n,).
    """
    if not len(times):
        return False
    span = np.ptp(times)
    return bool((span >= LONG and span >= SLOW * (len(times) - 1)) or np.abs(times).max() > LATEST)


def time_unit(times: Array) -> str:
    """Return the first plausible unit of times; '' if none is plausible.

    The units are tried in the order 's', 'ms', 'us', 'ns'.

    Args:
        times: rising times in an unknown unit, shape (n,).
    """
    if not slow(times):
        return "s"
    step = np.ptp(times) / (len(times) - 1)
    for unit in ("ms", "us", "ns"):
        if step * TIMES[unit] < SLOW and np.abs(times).max() * TIMES[unit] <= LATEST:
            return unit
    return ""


def read_rows(path: Path) -> Rows:
    """Read a .csv file of numbers; a cell without a number becomes NaN.

    Semicolons, tabs, commas or white space part the cells. If commas do not, a comma in a number is a decimal comma.

    The first line holds the names of the columns if it contains no number; 'nan' counts as a number. Otherwise the last
    comment before the numbers holds the names if it has one word per column, and its words include names of x, y and z.
    All other lines that begin with '#', and empty lines, are skipped.

    Raises:
        DermisError: the file cannot be read, is no text, has no rows, or has rows of different lengths.
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
    """Return the lines of a file, the separator of cells, and a comment.

    Returns:
        The lines that are neither empty nor comments, without needless separators at their ends.
        The separator between the cells: ';', a tab or ','; '' for white space.
        The cells of the last comment before the first line.

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
    """Remove separators at the ends of lines.

    They are kept if they stand before a missing last value. A last value is missing if another line has a value in that
    column.
    """

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
    """Return the numbers of all lines, read at once by numpy.

    The shape is (lines, columns). The result is None if numpy cannot read the lines. Numpy cannot read a cell without a
    number, a cell that only `number` can read, such as one with a decimal comma, and lines with another number of cells
    than `columns`.
    """
    try:
        found = np.loadtxt([line.text for line in lines], delimiter=lines[0].separator or None, comments=None, ndmin=2)
    except ValueError:
        return None
    return found if found.shape == (len(lines), columns) else None


def number(cell: str, separator: str = ",") -> float | None:
    """Return the number in a cell, or None if it holds none.

    A comma is a decimal comma if `separator`, the separator of cells, is another character.
    """
    if "_" in cell:  # `float` would read 1_0 as 10, but no program writes numbers with underscores
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
