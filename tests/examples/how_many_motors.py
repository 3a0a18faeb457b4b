"""How many motors does a cable platform need? Fewer for a plate that only presses than for one that rolls."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from pathlib import Path
from typing import TypeVar

import dermis
from dermis.design import task
from dermis.design.interactions import Wobble, interaction
from dermis.skin.shape import FingertipShape

T = TypeVar("T")
STEADY = Wobble(tilt=0.0, depth=0.0, shift=0.0, amplitude=0.0)  # a machine's hand


def main() -> dict[str, dict[str, object]]:
    """Return, by touch, the number of motors and what is lost of it with one, two and three of them [%]."""
    device = dermis.Library().device("cable_platform")
    skin = dermis.fingertip("index_medium", level="draft")
    told: dict[str, dict[str, object]] = {}
    with tempfile.TemporaryDirectory() as folder:
        # what the device does to the skin, row by row: the paper has 166,375 rows, a try does with fewer
        table = finished(task.table_for(device, FingertipShape(), Path(folder), rows=1331))
        for touch in ("flat", "complex"):
            scene = interaction(touch, skin.positions, wobble=STEADY, repetitions=1)
            readings = finished(task.sense_scene(scene, skin, noise=0.0))
            answer = finished(task.answer(device, table, {touch: readings}, noise=0.0, skin=skin))
            found = answer.joint
            told[touch] = {"motors": found.motors(), "percent": found.percent().tolist()}
            print(f"{touch}: {found.motors()} of {len(device.channels)} motors")
    return told


def finished(steps: Generator[task.Step, None, T]) -> T:
    """Run work that tells its progress to its end."""
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            result: T = stop.value
            return result


if __name__ == "__main__":
    main()
