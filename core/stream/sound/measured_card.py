"""The results of `stream loopback` for a sound card.

Their file is JSON of version 1.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ...errors import DermisError
from ...files import read_text, write_bytes
from ...foreign import json_of

SCHEMA = "dermis-sound-card 1"


@dataclass(frozen=True)
class MeasuredCard:
    """A sound card, measured with a cable from its output to its input.

    Attributes:
        name: name of the card.
        rate: sampling rate of the card [Hz].
        gain: gain from output to input at 1 kHz.
        latency: latency from output to input [s].
        jitter: range of the latency of single clicks [s]. corner: frequency below which the card blocks [Hz]; that of
            output and input together, so never too low. loudest: largest sample whose gain is within 0.5 %.
    """

    name: str
    rate: int
    gain: float
    latency: float
    jitter: float
    corner: float
    loudest: float

    def dumps(self) -> str:
        """Return the card as JSON; equal cards give equal text."""
        return json.dumps({"schema": SCHEMA, **asdict(self)}, indent=1, allow_nan=False) + "\n"

    def save(self, path: Path) -> None:
        """Write the file, completely or not at all."""
        write_bytes(Path(path), self.dumps().encode("utf-8"))

    @classmethod
    def load(cls, path: Path) -> MeasuredCard:
        """Read a file.

        Raises:
            DermisError: the file cannot be read, is not of this version, or has values that no card has.
        """
        where = str(path)
        found: Any = json_of(read_text(path), where)
        known = {field.name for field in fields(cls)}
        if not isinstance(found, dict) or found.get("schema") != SCHEMA or set(found) != {"schema", *known}:
            raise DermisError("no measured sound card", where=where, limit=f"{SCHEMA}: {', '.join(sorted(known))}")
        for name in sorted(known - {"name"}):
            value = found[name]
            if type(value) not in (int, float) or not math.isfinite(value) or not 0.0 <= value < 1e9:
                raise DermisError("not a number that a card has", where=f"{where}, {name}", value=str(value)[:80])
        if not isinstance(found["name"], str) or type(found["rate"]) is not int or not found["loudest"] <= 1.0:
            raise DermisError("a name, a rate or a level that no card has", where=where)
        return cls(**{name: found[name] for name in known})
