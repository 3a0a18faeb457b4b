"""A tee that sends rows as a stream of the Lab Streaming Layer (LSL).

Recorders such as LabRecorder read it. It needs the package 'pylsl'.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ... import clock
from .row import LogHeader, Rows, values_of
from .settings import Tee

BUFFERED = 10  # [s] time of the rows that are buffered for a recorder that pauses
CODES = ("number", "phase", "fate")


class LslTee:
    """One outlet of LSL.

    A sample has all values of a row, then its number, phase and fate; unknown values are NaN. Its time is the row's, on
    LSL's clock. The stream is declared irregular, because each sample has a time of its own.

    Attributes:
        sent: number of rows passed to LSL. dropped, thinned: always 0.

    Raises:
        Exception: the library cannot be loaded.
    """

    def __init__(self, tee: Tee, header: LogHeader) -> None:
        import pylsl

        self._lsl, self._header = pylsl, header
        labels = [*header.columns, *CODES]
        info = pylsl.StreamInfo(
            tee.name, "Dermis", len(labels), pylsl.IRREGULAR_RATE, pylsl.cf_double64, f"dermis-{header.log}"
        )
        description = info.desc()
        for name in ("device", "started", "protocol", "program"):
            description.append_child_value(name, str(getattr(header, name)))
        description.append_child_value("rate_hz", f"{header.rate:g}")
        channels = description.append_child("channels")
        for label in labels:
            name, _, unit = label.rstrip("]").partition("[")
            channel = channels.append_child("channel")
            channel.append_child_value("label", name)
            channel.append_child_value("unit", unit or "1")
        self._outlet = pylsl.StreamOutlet(info, max_buffered=BUFFERED)
        self.sent = self.dropped = self.thinned = 0

    def take(self, rows: Rows, now: float) -> None:
        """Pass rows to LSL."""
        # LSL has a clock of its own. Its offset is measured at every call.
        offset = self._lsl.local_clock() - clock.now() + self._header.clock
        codes = np.stack([rows[name].astype(np.float64) for name in CODES], axis=1)
        table = np.concatenate([values_of(rows).astype(np.float64), codes], axis=1)
        for values, time in zip(table.tolist(), rows["time"].tolist(), strict=True):
            self._outlet.push_sample(values, time + offset)
        self.sent += len(rows)

    def close(self, summary: Mapping[str, Any]) -> None:
        """End the stream."""
        del self._outlet

    def give_up(self) -> None:
        """End the stream."""
        del self._outlet
