"""How large the zips are, each with the wheels of one Python and platform; they are built as for a release."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from . import Result, benchmark

NAME = "zip_mb"
ROOT = Path(__file__).resolve().parents[2]


@benchmark(NAME, limit=100.0)
def largest_zip() -> Result:
    """Measure the largest zip of all; those of the other platforms stand beside it."""
    with tempfile.TemporaryDirectory(prefix="dermis-zips-") as folder:
        command = [sys.executable, str(ROOT / "build_addon.py"), "build", "--out", folder]
        done = subprocess.run(command, capture_output=True, text=True)
        sizes = {path.name: path.stat().st_size / 1e6 for path in Path(folder).glob("*.zip")}
    if done.returncode or not sizes:
        return Result(NAME, None, "MB", error=(done.stderr.strip().splitlines() or ["nothing was built"])[-1])
    named = {re.sub(r"^dermis-[\d.]+-|\.zip$", "", name): size for name, size in sizes.items()}
    largest = max(named, key=lambda name: named[name])
    return Result(NAME, named.pop(largest), "MB", peers=named)
