"""The remainders of the standard skins: `python -m tests.remainder_tables [preset ...]` makes the files that ship.

Each is fitted to 88k tetrahedra, in two minutes and 3 GB of memory.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.model import shape_and_material
from core.skin.surface_store import FINEST, make_remainder, shipped_name
from core.steps import drain


def main(presets: list[str]) -> None:
    """Write the remainder of each skin preset beside it."""
    for key in presets or [entry.key for entry in Library().list("skins")]:
        shape, material = shape_and_material(Library().skin(key))
        assert shape is not None
        start = time.perf_counter()
        made = drain(make_remainder(shape, material.poisson, FINEST))
        path = Path(BUILT_IN) / "skins" / shipped_name(shape, material.poisson)
        made.write(path)
        seconds = time.perf_counter() - start
        print(f"{key}: {path.name}, {path.stat().st_size / 1e3:.0f} kB, {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
