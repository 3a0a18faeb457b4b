"""Sample tables as files, for tests."""

from __future__ import annotations

from pathlib import Path

from core.files import write_npz
from core.surrogate.table import SampleTable


def write_table(path: Path, table: SampleTable) -> None:
    """Write a table as .npz (plain arrays)."""
    write_npz(path, {name: getattr(table, name) for name in ("x", "memory", "channels", "trajectory")})
