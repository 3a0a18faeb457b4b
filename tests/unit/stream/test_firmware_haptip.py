"""The tactor's two servos on the sketch: the sender's own mind, half a million baud, 1,000 commands a second."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.unit.stream.firmware_board import Chip
from tests.unit.stream.firmware_host import every_chip
from tests.unit.stream.firmware_lab import play, slow_track

pytestmark = pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")


@every_chip
def test_pulses_follow_the_track_and_every_command_arrives(chip: Chip, tmp_path: Path) -> None:
    done = play(slow_track(tmp_path / "t.dtrack", 1.0), 1.0, chip)
    assert len(done.errors) >= 70 and np.abs(done.errors).max() <= 4.0
    assert done.sent >= 1200 and done.received == done.sent
    assert not any(done.counted.values()) and not done.overruns, done.counted
