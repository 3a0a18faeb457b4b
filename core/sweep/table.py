"""Files of a sweep: rows and table.

Each finished row is a file, written atomically. The table is written as CSV and Parquet.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..errors import DermisError
from ..files import atomic, read_json, write_bytes
from ..version import version
from .row import Row
from .spec import Value

Figures = Mapping[str, Value]
ERROR = "refused"  # name of the column with the reason why a row has no figures


def path_of(folder: Path, row: Row) -> Path:
    """Return the path of the file with a row's figures."""
    return folder / "rows" / f"{row.key}.json"


def kept(folder: Path, row: Row) -> Figures | None:
    """Return a row's figures from an earlier run.

    The result is None if their file is missing or damaged.
    """
    try:
        found = read_json(path_of(folder, row))
    except DermisError:
        return None
    fits = isinstance(found, dict) and all(isinstance(value, Value) for value in found.values())
    return found if fits else None


def keep(folder: Path, row: Row, figures: Figures) -> None:
    """Write a row's figures.

    Raises:
        DermisError: the folder cannot be written.
    """
    write_bytes(path_of(folder, row), json.dumps(dict(figures), ensure_ascii=False, allow_nan=False).encode())


def write(folder: Path, rows: Sequence[Row], found: Mapping[str, Figures], study: str) -> list[Path]:
    """Write the table of all rows and return the paths of its files.

    The rows keep their order. A refused row has a reason instead of figures. A row that is not computed yet has
    neither.

    Raises:
        DermisError: the folder cannot be written.
    """
    columns = _columns(rows, found)
    lines = [[_cell(row, found.get(row.key, {}), column) for column in columns] for row in rows]
    text = io.StringIO()
    about = {"study": study, "rows": len(rows), "done": sum(row.key in found for row in rows)}
    about |= {"generator": f"dermis {version()}", "note": "simulated"}
    text.write("# dermis-sweep 1\n" + "".join(f"# {key}: {value}\n" for key, value in about.items()))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(["" if cell is None else _word(cell) for cell in line] for line in lines)
    paths = [folder / "sweep.csv"]
    write_bytes(paths[0], text.getvalue().encode())
    return paths + _parquet(folder / "sweep.parquet", columns, lines)


def _columns(rows: Sequence[Row], found: Mapping[str, Figures]) -> list[str]:
    """Return the names of the table's columns.

    They are the hash, the varied parameters, the results in the order of their first rows, and the refusals.
    """
    varied = [name for row in rows for name in row.columns]
    figures = [name for row in rows for name in found.get(row.key, {})]
    return list(dict.fromkeys(["hash", *varied, *(name for name in figures if name != ERROR), ERROR]))


def _cell(row: Row, figures: Figures, column: str) -> Value | None:
    if column == "hash":
        return row.key
    return row.columns[column] if column in row.columns else figures.get(column)


def _word(value: Value) -> str:
    return repr(value) if isinstance(value, float) else str(value)  # to the last bit


def _parquet(path: Path, columns: Sequence[str], lines: Sequence[Sequence[Value | None]]) -> list[Path]:
    """Write the table as Parquet, if pyarrow is installed."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return []
    series = {}
    for i, column in enumerate(columns):
        cells = [line[i] for line in lines]
        mixed = len({type(cell) for cell in cells if cell is not None} - {int, float}) > 0
        texts = mixed and not all(isinstance(cell, bool | None) for cell in cells)
        series[column] = [None if cell is None else _word(cell) if texts else cell for cell in cells]
        if not texts and any(isinstance(cell, float) for cell in cells):
            series[column] = [None if cell is None else float(cell) for cell in cells]
    with atomic(path) as part:
        parquet.write_table(pyarrow.table(series), part)
    return [path]
