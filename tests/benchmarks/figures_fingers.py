"""Do to a skin what was done to measured fingers, draw it, and write the page 'measured fingers'.

`python -m tests.benchmarks.figures_fingers --out presets` writes skins/measured_fingers.md and pictures/fingers_*.png
there, and the page's numbers beside the references of the benchmarks; some minutes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from core.files import write_bytes
from core.skin.model import SkinModel, fingertip_skin

from . import one_blas_thread
from .fingers.numbers import numbers
from .fingers.page import page
from .fingers.pictures import draw
from .fingers.trials import trials

NUMBERS = Path(__file__).parent / "references" / "measured_fingers.json"


def skins(level: str) -> dict[str, SkinModel]:
    """Return a skin of each tissue that there is."""
    linear = fingertip_skin(level=level)
    return {"linear": linear, "neo-Hookean": linear.with_law()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Do all of it."""
    parser = argparse.ArgumentParser(prog="figures_fingers", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("presets"), metavar="DIR")
    parser.add_argument("--numbers", type=Path, default=NUMBERS, metavar="FILE", help="where the numbers go")
    parser.add_argument("--level", default="standard", help="accuracy of the skin")
    parser.add_argument("--squares", type=int, default=1, help="how often the plate's squares are halved")
    options = parser.parse_args(arguments)
    with one_blas_thread():
        found = {name: trials(skin, options.squares) for name, skin in skins(options.level).items()}
    said = {"level": options.level, "tissues": {name: numbers(each) for name, each in found.items()}}
    write_bytes(options.numbers, (json.dumps(said, indent=1) + "\n").encode())
    (options.out / "pictures").mkdir(parents=True, exist_ok=True)
    (options.out / "skins").mkdir(exist_ok=True)
    draw(found, options.out / "pictures")
    text = page(said)
    write_bytes(options.out / "skins" / "measured_fingers.md", text.encode())
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
