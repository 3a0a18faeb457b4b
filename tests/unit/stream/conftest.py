"""What tests of the stream share: virtual devices that end with their test, a track on disk, a screen to slide over."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from core.matching.screen_map import ScreenMap
from tests.unit.stream.stream_box import Box
from tests.unit.stream.stream_lab import ramp, sine_track


@pytest.fixture
def boxes() -> Iterator[Any]:
    """Make virtual devices; whatever is left of them ends afterwards."""
    made: list[Box] = []

    def make(*arguments: str, every: float = 0.0) -> Box:
        made.append(Box(*arguments, every=every))
        return made[-1]

    yield make
    for box in made:
        box.process.kill()
        box.process.wait()


@pytest.fixture
def track_file(tmp_path: Path) -> Path:
    """Five seconds of a slow sine."""
    return sine_track(tmp_path / "t.csv")


@pytest.fixture
def screen() -> ScreenMap:
    """A ramp along x: friction 60 uphill, none downhill."""
    return ramp()
