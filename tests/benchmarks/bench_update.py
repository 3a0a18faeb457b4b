"""How many updates of the installed extension fail while its kernels are loaded and locked, as Windows locks them.

The lock is a stand-in on Linux (tests/extension/locked_updates.py).
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from . import Result, benchmark
from .bench_register import blender

NAME = "update_locked"
UPDATES = 20


@benchmark(NAME, limit=0.0)
def update_locked() -> Result:
    """Update twenty times, in one Blender; without copies of the kernels, the peer, every update fails."""
    if not os.environ.get("DERMIS_ZIP") or not sys.platform.startswith("linux"):
        return Result(NAME, None, "failures", error="needs build_addon.py bench, and Linux for its stand-in")
    from tests.extension.locked_updates import of_version

    failed = {}
    with tempfile.TemporaryDirectory(prefix="dermis-updates-") as folder:
        old = Path(os.environ["DERMIS_ZIP"])
        zips = [str(of_version(Path(folder) / f"{n}.zip", old, f"90.0.{n}")) for n in range(UPDATES + 1)]
        for copies, some in ((True, zips), (False, zips[:3])):
            code = f"import locked_updates\nanswer = locked_updates.update({some!r}, copies={copies})"
            profile = Path(folder) / f"profile-{copies}"
            profile.mkdir()
            found = blender(code, str(profile))
            failed[copies] = len(found["failures"])
    return Result(NAME, float(failed[True]), "failures", peers={"2 updates, no copies": float(failed[False])})
