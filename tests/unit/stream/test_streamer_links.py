"""A link that is full, a device that falls silent, a Blender that stands still, a calibration under way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.presets import Library
from core.stream.protocols import packets
from core.track import csv
from core.track.command_track import CommandTrack
from tests.unit.stream.stream_lab import TICK, Lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

# -- a link or a device that takes nothing


@pytest.mark.parametrize("protocol", ["native", "torque"])
def test_a_device_that_falls_silent_is_given_up_within_100_ms(protocol: str) -> None:
    """The dead man's switch of the sender: what answers has answered a moment ago, or nothing is armed any more."""
    lab = Lab(protocol, mode="jog", jog={"pulley_1": 0.1}, ramp=0.0)
    lab.run(0.2)
    lab.arm()
    lab.run(0.3)
    assert lab.streamer.armed
    lab.device.feed = lambda data, now: []
    died, ended = lab.now, []
    lab.run(0.15, lambda: ended.append(lab.now) if not lab.streamer.armed and not ended else None)
    assert ended and 0.03 < ended[0] - died <= 0.1
    assert lab.streamer.state == "fault" and "has not answered for 0.08 s" in lab.streamer.message


def test_lost_answers_alone_end_nothing() -> None:
    """Three packets in ten are lost: what stays away is asked for again within 5 ms, so a stream goes on."""
    lab = Lab(mode="jog", jog={"pulley_1": 0.1}, ramp=0.0)
    lab.run(0.2)
    lab.arm()
    lab.run(0.2)
    rng, feed = np.random.default_rng(11), lab.device.feed
    lab.device.feed = lambda data, now: feed(data, now) if rng.random() < 0.7 else []
    lab.run(5.0)
    assert lab.streamer.armed and lab.streamer.counters["faults"] == 0


def test_a_sender_that_slept_does_not_blame_the_device() -> None:
    lab = Lab(mode="jog", jog={"pulley_1": 0.1}, ramp=0.0)
    lab.run(0.2)
    lab.arm()
    lab.run(0.2)
    lab.now += 0.04  # less than the device's own watchdog, and no tick meanwhile
    lab.run(0.3)
    assert lab.streamer.armed


def full(lab: Lab, is_full: Any) -> None:
    """Let the link refuse messages while a condition holds."""
    assert lab.streamer.connection is not None
    link, send = lab.streamer.connection.link, lab.streamer.connection.link.send
    link.send = lambda message: False if is_full(message) else send(message)  # type: ignore[method-assign]


def test_samples_ahead_of_their_time_wait_for_room_and_none_is_lost(track_file: Path) -> None:
    """20 ms without room, of 100 ms of look-ahead: everything arrives, on time, and nothing counts as dropped."""
    lab = Lab(track=str(track_file), ramp=0.0, look_ahead=0.1)
    lab.run(0.3)
    lab.arm()
    lab.run(0.2)
    lab.playing = True
    lab.run(0.5)
    full(lab, lambda message: int(lab.now * 1000) % 200 < 20)
    received, sent = lab.device.received, lab.streamer.counters["sent"]
    lab.run(2.0)
    assert lab.device.received - received == lab.streamer.counters["sent"] - sent == pytest.approx(2000, abs=25)
    assert lab.device.lost == lab.device.late == 0
    assert not lab.streamer.output.limiter.limited, "no sample is stepped twice"  # type: ignore[union-attr]
    sent_at = [m for _, m in lab.sent if len(m) > 16]
    times = [packets.read_command(p.body)[0] for m in sent_at for p in packets.Decoder().feed(m) if p.kind == 5]
    assert set(np.diff(times[-1500:]) % 2**32) <= {999, 1000, 1001}, "each millisecond once, in its order"
    assert lab.streamer.counters["dropped"] == lab.streamer.counters["skipped"] == 0


@pytest.mark.parametrize("protocol", ["maestro", "servo-animation"])
def test_a_safe_state_that_finds_no_room_is_sent_when_there_is(protocol: str) -> None:
    url = "lab?silence=keeps"
    lab = Lab(protocol, mode="jog", jog={"pulley_1": 0.4, "pulley_2": -0.4}, ramp=0.0, url=url)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    assert lab.at[0] == pytest.approx(0.4, abs=2e-3)
    busy = [True]
    full(lab, lambda message: busy[0])
    lab.stops += 1
    lab.run(0.3)
    assert lab.at[0] == pytest.approx(0.4, abs=2e-3), "nothing gets through"
    busy[0] = False
    lab.run(0.01)
    assert np.abs(lab.at).max() < 1e-3 and not lab.streamer.armed


def test_a_safe_state_that_never_finds_room_says_so() -> None:
    lab = Lab("maestro", mode="jog", jog={"pulley_1": 0.4}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    full(lab, lambda message: True)
    lab.stops += 1
    lab.run(1.1)
    assert "Switch its supply off" in lab.streamer.message


@pytest.mark.parametrize("protocol", ["maestro", "servo-animation"])
def test_a_board_without_a_safe_state_of_its_own_is_left_in_it(protocol: str) -> None:
    """Another port, another device, or no connection at all: what was driven does not stay where it was."""
    for change in ({"connect": False}, {"url": "elsewhere"}):
        lab = Lab(protocol, mode="jog", jog={"pulley_1": 0.4}, ramp=0.0)
        lab.run(0.1)
        lab.arm()
        lab.run(0.3)
        assert lab.at[0] == pytest.approx(0.4, abs=2e-3)
        device, path = lab.device, [0.4]
        lab.set(**change)
        lab.run(0.05, lambda d=device, p=path: p.append(list(d.report()["values"].values())[0]))
        assert np.abs(np.diff(path)).max() <= np.radians(2300) * 2 * TICK + 1e-3, "never a jump"
        assert abs(path[-1]) < 1e-3


def test_what_a_full_link_refused_is_said_again() -> None:
    """A Maestro is told of changes only; one that was refused must not be taken for known."""
    lab = Lab("maestro", mode="jog", jog={"pulley_1": 0.0}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    busy = [True]
    full(lab, lambda message: busy[0])
    lab.set(jog={"pulley_1": 0.3})
    lab.run(0.03)
    busy[0] = False
    lab.run(0.012)
    assert lab.at[0] == pytest.approx(0.3, abs=2e-3), "before the refresh of every 0.1 s"


def test_calibration_takes_effect_under_way_and_smoothly() -> None:
    lab = Lab(mode="jog", jog={"pulley_1": 0.2}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    path: list[float] = []
    made = Calibration.of(Library().device("haptip")).with_entry("pulley_1", gain=-1.0)
    lab.set(calibration=made.dumps())
    lab.run(0.5, lambda: path.append(float(lab.at[0])))
    assert lab.streamer.armed and path[-1] == pytest.approx(-0.2, abs=2e-5)
    # The blend over 0.3 s is steepest in its middle, 1.5 times the mean speed.
    assert np.abs(np.diff(path)).max() <= 1.5 * 0.4 / 0.3 * TICK * 1.05
    lab.set(calibration="")
    lab.run(0.5)
    assert lab.at[0] == pytest.approx(0.2, abs=2e-5), "cancelled: as it was"
    tight = Calibration.of(Library().device("haptip")).with_entry("pulley_1", high=0.05)
    lab.set(calibration=tight.dumps())
    path.clear()
    lab.run(0.5, lambda: path.append(float(lab.at[0])))
    assert path[-1] == pytest.approx(0.05, abs=2e-5), "a limit that was tightened is gone to, not jumped to"
    assert np.abs(np.diff(path)).max() <= 1.5 * 0.15 / 0.3 * TICK * 1.05


def test_a_track_is_read_once_and_again_when_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reconnection or another offset must not keep the device waiting for a file that is known."""
    from core.stream import track_source

    spec, t, reads = Library().device("haptip"), np.arange(2001) / 1000, []
    read = track_source.export.read
    monkeypatch.setattr(track_source.export, "read", lambda path: reads.append(path) or read(path))
    path = tmp_path / "t.csv"
    for value in (0.1, 0.25):
        csv.write(CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, 0 * t + value, 0 * t])), path)
        lab = Lab(track=str(path), ramp=0.0)
        for offset in (0.0, 0.1, 0.2):
            lab.set(offset=offset)
            lab.run(0.05)
        lab.arm()
        lab.run(0.2)
        assert lab.at[0] == pytest.approx(value, abs=1e-4)
    assert len(reads) == 2


@pytest.mark.parametrize("mode", ["jog", "follow"])
def test_every_mode_bound_to_blender_ends_with_it(mode: str) -> None:
    lab = Lab(mode=mode, jog={"pulley_1": 0.2}, ramp=0.0, stall=0.3, play_on=True)
    lab.values = (0.2, 0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    lab.heartbeats = False
    lab.run(0.35)
    assert lab.streamer.state == "stalled" and np.abs(lab.at).max() < 1e-4
