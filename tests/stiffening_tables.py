"""The stiffening of the standard skins: `python -m tests.stiffening_tables [preset ...]` makes the files that ship.

Of 10 MB each, one ships: the default preset's. Others are made where a device first wants them.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from core.parameters.skin import DEFAULT_SKIN
from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.model import shape_and_material
from core.steps import drain
from core.tissue.stiffening_store import make_stiffening, shipped_name


def main(presets: list[str]) -> None:
    """Write the stiffening of each skin preset beside it."""
    for key in presets or [DEFAULT_SKIN]:
        shape, material = shape_and_material(Library().skin(key))
        assert shape is not None
        start = time.perf_counter()
        made = drain(make_stiffening(shape, material.poisson))
        path = Path(BUILT_IN) / "skins" / shipped_name(shape, material.poisson)
        made.write(path)
        seconds = time.perf_counter() - start
        print(f"{key}: {path.name}, {path.stat().st_size / 1e6:.1f} MB, {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
