"""Damaged files for every reader: how many bring anything but a refusal in words."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path

from . import Result, benchmark

FILES = 100_000
SEED = 20_260


@benchmark("fuzz_other_exceptions", limit=0.0)
def fuzz_other_exceptions() -> Result:
    """At least 100,000 damaged files over all readers: other exceptions, more than 2 s or more than 500 MB for one."""
    from tests.fuzz import fuzz
    from tests.readers import READERS

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fuzz(READERS, -(-FILES // len(READERS)), SEED, Path(folder))
    count = sum(found.others.values())
    wrong = f"{found.tried} files: {found.others.most_common(5)}" if count or found.tried < FILES else None
    return Result("fuzz_other_exceptions", float(count), "exceptions", error=wrong)
