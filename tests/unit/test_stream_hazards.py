"""What can move a device although nobody wants it to: commands already under way, sleep, touches that never end."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
import pytest

from core.presets import Library
from core.stream import osc
from core.stream.virtual_others import OscDevice
from core.stream.wire import Wire
from tests.unit.stream_lab import Lab, sine_track


@pytest.fixture
def track_file(tmp_path: Path) -> Path:
    return sine_track(tmp_path / "t.csv")


# -- commands under way when somebody stops


def test_the_virtual_osc_receiver_honours_time_tags() -> None:
    """As the specification asks; what a stop has to hold against."""
    wire = Wire.of(Library().device("haptip"))
    device = OscDevice(wire)
    message = osc.message_head("/dermis/haptip/pulley_1") + struct.pack(">f", 0.25)
    device.feed(osc.bundle(osc.ntp(time.time() + 0.5), [message]), 100.0)
    device.tick(100.4)
    assert device.latest[0] == 0.0 and len(device.waiting) == 1
    device.feed(osc.bundle(osc.IMMEDIATELY, [message[:-4] + struct.pack(">f", -0.125)]), 100.45)
    assert device.latest[0] == -0.125 and len(device.waiting) == 1, "nothing takes a bundle back"
    device.tick(100.6)
    assert device.latest[0] == 0.25 and not device.waiting


@pytest.mark.parametrize("protocol", ["osc", "native"])
def test_nothing_plays_on_after_a_stop(protocol: str, track_file: Path) -> None:
    """With the longest look-ahead: what was sent for later must not be played after the safe state."""
    lab = Lab(protocol, track=str(track_file), ramp=0.0, look_ahead=1.0)
    lab.run(0.2)
    lab.arm()
    lab.run(0.2)
    lab.playing = True
    lab.run(1.5)
    lab.stops += 1
    lab.run(0.03)
    assert np.abs(lab.at).max() < 1e-4
    moved: list[float] = []
    lab.run(1.5, lambda: moved.append(float(np.abs(lab.at).max())))
    assert max(moved) < 1e-4


def test_osc_makes_up_for_a_delay_by_what_it_sends(track_file: Path) -> None:
    lab = Lab("osc", track=str(track_file), ramp=0.0, look_ahead=0.1)
    lab.run(0.2)
    lab.arm()
    lab.run(0.2)
    lab.playing = True
    lab.run(0.5)
    errors: list[float] = []
    lab.run(1.0, lambda: errors.append(float(lab.at[0] - 0.1 * np.sin(2 * np.pi * (lab.time + 0.1)))))
    assert np.abs(errors).max() <= 2 * np.pi * 0.1 * 2e-3, "0.1 s of the track ahead, to two milliseconds"
