"""The CSV log format, version 2.

A file has header lines that begin with '#', one line of names, one line for each row, and footer lines with '#'.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from .row import BLOCKS, SCHEMA, Fate, LogHeader, Phase, Rows, values_of

_HEAD = ("number", "t_s", "play_s", "track_s", "skipped", "phase", "fate", "reported_t_s")
_PHASES, _FATES = [phase.name.lower() for phase in Phase], [fate.name.lower() for fate in Fate]


class CsvForm:
    """The CSV format of log files.

    Spreadsheets and `pandas.read_csv(FILE, comment="#")` read it. An unknown value is an empty cell.
    """

    def __init__(self, channels: int, sensed: int = 0) -> None:
        values = ",%.9g" * ((len(BLOCKS) + sensed) * channels)  # nine digits keep every bit of a float32
        self._line = f"%d,%.6f,%.6f,%.6f,%d,%s,%s,%.6f{values}\n"

    def head(self, header: LogHeader) -> bytes:
        """Return the header of a file."""
        plain = header.plain()
        del plain["schema"]
        lines = [f"# {SCHEMA}", *(f"# {name}: {json.dumps(value)}" for name, value in plain.items())]
        return "\n".join([*lines, ",".join([*_HEAD, *header.columns]), ""]).encode()

    def rows(self, rows: Rows) -> bytes:
        """Return the lines of rows."""
        lines = []
        values = values_of(rows) + np.float32(0)  # turns -0 into 0
        heads = zip(*(rows[name].tolist() for name in ("number", "time", "play", "track", "skipped")), strict=True)
        ends = zip(*(rows[name].tolist() for name in ("phase", "fate", "heard")), strict=True)
        for head, (phase, fate, heard), numbers in zip(heads, ends, values.tolist(), strict=True):
            lines.append(self._line % (*head, _PHASES[phase], _FATES[fate], heard, *numbers))
        return "".join(lines).replace(",nan", ",").encode()

    def end(self, summary: Mapping[str, Any]) -> bytes:
        """Return the footer of a complete file."""
        return "".join(f"# end.{name}: {json.dumps(value)}\n" for name, value in summary.items()).encode()
