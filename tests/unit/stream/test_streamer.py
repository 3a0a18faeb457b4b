"""The sender's mind on a clock of the test's own: arming, limits, stops, stalls, modes. Nothing is left to luck."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.devices.spec import Channel, DeviceSpec
from core.presets import Library
from core.stream.output_limiter import OutputLimiter
from core.stream.protocols.wire import Wire
from core.stream.shared_state import Heartbeat
from core.stream.track_clock import TrackClock
from core.track import csv
from core.track.command_track import CommandTrack
from tests.unit.stream.stream_lab import TICK, Lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")


def test_nothing_moves_before_a_person_arms(track_file: Path) -> None:
    lab = Lab(track=str(track_file))
    lab.run(0.2)
    assert lab.streamer.state == "ready"
    lab.playing = True
    lab.run(1.0)
    assert not lab.device.received and np.abs(lab.at).max() < 1e-5, "half a count is 6.4e-6"
    lab.arm()
    lab.run(0.1)
    assert lab.streamer.state == "streaming" and lab.device.received


def test_it_plays_the_track_in_step_with_blender(track_file: Path) -> None:
    lab = Lab(track=str(track_file), ramp=0.2)
    lab.run(0.1)
    lab.arm()
    lab.run(0.5)
    assert lab.streamer.state == "armed"
    lab.playing = True
    lab.run(0.1)
    errors: list[float] = []
    step = 24.0 / 65535 * 2 * math.pi / 180
    lab.run(
        3.0, lambda: errors.append(float(np.abs(lab.at - 0.1 * np.sin(2 * np.pi * lab.time) * np.array([1, 2])).max()))
    )
    # The sample of this millisecond or of the one before: at most 2 pi 0.2 rad/s for one millisecond and a count.
    assert max(errors) <= 2 * np.pi * 0.2 * 1.5e-3 + step
    assert not lab.streamer.output.limiter.limited and not lab.streamer.counters["skipped"]  # type: ignore[union-attr]


@pytest.mark.parametrize("look_ahead", [0.1, 0.05])
def test_look_ahead_arrives_early_and_plays_on_time(track_file: Path, look_ahead: float) -> None:
    lab = Lab(track=str(track_file), ramp=0.0, look_ahead=look_ahead)
    lab.run(0.3)
    lab.arm()
    lab.run(0.3)
    lab.playing = True
    lab.run(0.5)
    errors: list[float] = []
    lab.device.early_least = np.inf
    lab.run(
        2.0, lambda: errors.append(float(np.abs(lab.at - 0.1 * np.sin(2 * np.pi * lab.time) * np.array([1, 2])).max()))
    )
    assert max(errors) <= 2 * np.pi * 0.2 * 2e-3
    assert lab.device.late == 0 and lab.device.lost == 0
    assert look_ahead - 0.003 < lab.device.early_least <= look_ahead
    assert lab.device.play_error < 0.0015


def test_start_offset(track_file: Path) -> None:
    lab = Lab(track=str(track_file), offset=0.25, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    assert abs(lab.at[0] - 0.1) < 1e-4, "at scene time 0 the device shows 0.25 s of the track, the crest"


def test_the_sender_limits_what_a_track_gets_wrong(tmp_path: Path) -> None:
    """A track that jumps out of the range: the device ends at the limit, at its own speed, and both are counted."""
    spec = Library().device("haptip")
    t = np.arange(2001) / 1000
    wild = np.where(t > 1, 1.0, 0.0)  # rad; the range ends at 24 degrees
    csv.write(CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, wild, 0 * t])), tmp_path / "w.csv")
    lab = Lab(track=str(tmp_path / "w.csv"), ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.1)
    lab.playing = True
    path: list[float] = []
    lab.run(1.5, lambda: path.append(float(lab.streamer.output.limiter.last[0])))  # type: ignore[union-attr]
    slew = math.radians(2300)
    assert max(path) == pytest.approx(math.radians(24))
    assert np.diff(path).max() <= slew * TICK * (1 + 1e-6)
    limited = lab.streamer.output.limiter.limited  # type: ignore[union-attr]
    assert limited["pulley_1.slew"] == math.floor(math.radians(24) / (slew * TICK)), "10.4 ms to the limit: 10 samples"
    assert limited["pulley_1.range"] > 300 and "pulley_2.range" not in limited


def test_ramp_starts_where_the_device_is(tmp_path: Path) -> None:
    spec = Library().device("haptip")
    t = np.arange(2001) / 1000
    csv.write(CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, 0 * t + 0.3, 0 * t])), tmp_path / "r.csv")
    lab = Lab(track=str(tmp_path / "r.csv"), ramp=1.0)
    lab.run(0.1)
    lab.device.counts = lab.device.wire.counts(np.array([-0.2, 0.1])).astype(float)
    lab.arm()
    seen: list[np.ndarray] = []
    lab.run(1.2, lambda: seen.append(lab.at))
    path = np.array(seen)[:, 0]
    # The smooth blend from -0.2 to 0.3 is steepest in its middle: 1.5 times the mean speed.
    assert np.abs(np.diff(path)).max() <= 1.5 * 0.5 * TICK * 1.05
    assert path[0] == pytest.approx(-0.2, abs=1e-3) and path[-1] == pytest.approx(0.3, abs=1e-4)
    assert (np.diff(path) >= -1e-5).all()


def test_stop_is_at_once_and_stays(track_file: Path) -> None:
    lab = Lab(track=str(track_file), ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.playing = True
    lab.run(0.22)
    assert abs(lab.at[0]) > 0.05
    lab.stops += 1
    before = lab.now
    lab.run(0.02)
    assert lab.device.safe_at is not None and lab.device.safe_at - before <= 0.02
    assert not lab.streamer.armed and np.abs(lab.at).max() < 1e-4
    received = lab.device.received
    lab.run(1.0)
    assert lab.device.received == received, "nothing moves until somebody arms again"
    lab.arm()
    lab.run(0.1)
    assert lab.device.received > received


def test_an_arming_from_before_a_stop_does_not_count(track_file: Path) -> None:
    lab = Lab(track=str(track_file))
    lab.run(0.1)
    lab.stops += 1  # the stop arrives in the same tick as an arming that a person pressed before it
    lab.number += 1
    lab.streamer.heartbeat(Heartbeat(lab.number, lab.stops, False, 0.0, ()), lab.now)
    lab.set(arm_id=1, stops=0)
    lab.run(0.5)
    assert not lab.device.received


def test_a_stalled_blender_holds_and_then_is_safe(track_file: Path) -> None:
    lab = Lab(mode="follow", ramp=0.0, stall=0.5)
    lab.values = (0.2, -0.1)
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    assert np.allclose(lab.at, [0.2, -0.1], atol=1e-4)
    lab.heartbeats = False
    lab.run(0.49)
    assert np.allclose(lab.at, [0.2, -0.1], atol=1e-4), "it holds"
    lab.run(0.04)
    assert lab.streamer.state == "stalled" and "sign of life" in lab.streamer.message
    assert np.abs(lab.at).max() < 1e-4
    lab.heartbeats = True
    lab.run(0.5)
    assert np.abs(lab.at).max() < 1e-4, "a person has to arm again"


def test_a_baked_track_plays_on_by_option(track_file: Path) -> None:
    lab = Lab(track=str(track_file), ramp=0.0, play_on=True, stall=0.5)
    lab.run(0.1)
    lab.arm()
    lab.run(0.1)
    lab.playing = True
    lab.run(0.2)
    lab.heartbeats = False
    lab.run(2.05)
    assert lab.streamer.state == "streaming"
    assert lab.at[0] == pytest.approx(0.1 * math.sin(2 * math.pi * 2.25), abs=3e-3)


def test_play_waits_for_a_blender_that_is_late(track_file: Path) -> None:
    clock = TrackClock()
    for k in range(48):
        clock.report(k / 24, True, k / 24)
    assert clock.at(47 / 24 + 0.05, 47 / 24 + 0.05) == pytest.approx(47 / 24 + 0.05, abs=1e-6)
    assert clock.at(60.0, 60.0) == pytest.approx(47 / 24 + 0.1, abs=1e-6), "at most 0.1 s beyond the last frame"
    clock.report(10.0, True, 47 / 24 + 1)
    assert clock.at(47 / 24 + 1, 47 / 24 + 1) == 10.0, "a jump is followed"


def test_the_watchdog_of_the_device_is_the_last_resort(track_file: Path) -> None:
    lab = Lab(track=str(track_file), ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.playing = True
    lab.run(0.22)
    died = lab.now
    for _ in range(100):  # the sender is dead: nothing ticks it
        lab.now += TICK
        lab.device.tick(lab.now)
    assert lab.device.watchdogs == 1 and lab.device.safe_at - died <= 0.1


def test_unplugging_and_reconnecting_never_arms(track_file: Path) -> None:
    lab = Lab(track=str(track_file), ramp=0.0, reconnect=True)
    lab.run(0.1)
    lab.arm()
    lab.playing = True
    lab.run(0.2)
    lab.cut = True
    lab.run(0.1)
    assert lab.streamer.connection is None and "unplugged" in lab.streamer.message
    lab.cut = False
    lab.run(1.2)
    assert lab.streamer.state == "ready" and not lab.device.received
    lab.arm()
    lab.run(0.2)
    assert lab.device.received


def test_ending_goes_through_the_safe_state(track_file: Path) -> None:
    for protocol in ("native", "maestro", "servo-animation", "torque"):
        lab = Lab(protocol, track=str(track_file), ramp=0.0)
        lab.run(0.2)
        lab.arm()
        lab.playing = True
        lab.run(0.3)
        assert lab.streamer.state == "streaming", (protocol, lab.streamer.message)
        lab.streamer.shut(lab.now)
        for _ in range(300):  # the safe state is said three times over a tenth of a second
            lab.now += TICK
            if not lab.streamer.finished:
                lab.streamer.tick(lab.now)
            lab.device.tick(lab.now)
        assert lab.streamer.finished
        if protocol == "torque":
            assert lab.device.report()["released"]
        else:
            assert np.abs(lab.at).max() < 1e-3, protocol


def test_safe_way_of_a_board_without_one_keeps_the_speed_limit() -> None:
    lab = Lab("maestro", mode="jog", jog={"pulley_1": 0.4}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    assert lab.at[0] == pytest.approx(0.4, abs=1e-3)
    path: list[float] = []
    lab.stops += 1
    lab.run(0.03, lambda: path.append(float(lab.at[0])))
    assert path[-1] == pytest.approx(0.0, abs=1e-3)
    assert np.abs(np.diff(path)).max() <= math.radians(2300) * TICK + 1e-3


def test_a_pose_that_the_device_knows_is_reported_as_commanded_and_left_as_driven() -> None:
    made = Calibration.of(Library().device("haptip")).with_entry("pulley_1", zero=0.1, gain=-2.0)
    lab = Lab(mode="jog", jog={"pulley_1": 0.05}, calibration=made.dumps())
    lab.begin(0.01)
    drive = lab.streamer.drive
    assert drive is not None and np.allclose(drive.connection.adapter.pose, lab.at, atol=1e-3), "where a blend begins"
    driven = lab.streamer.status()["reported"]["pulley_1"] * -2.0 + 0.1
    assert driven == pytest.approx(drive.connection.adapter.pose[0], abs=1e-12)


def test_jog_moves_one_actuator_through_the_calibration() -> None:
    made = Calibration.of(Library().device("haptip")).with_entry("pulley_2", zero=0.05, gain=-1.0, high=0.2)
    lab = Lab(mode="jog", jog={"pulley_2": 0.1}, ramp=0.0, calibration=made.dumps())
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    assert np.allclose(lab.at, [0.0, -0.05], atol=2e-5)
    lab.set(jog={"pulley_2": -0.4})
    lab.run(0.2)
    assert np.allclose(lab.at, [0.0, 0.2], atol=2e-5), "the calibration's own limit holds"
    assert lab.streamer.output.limiter.limited["pulley_2.range"]  # type: ignore[union-attr]


def test_not_a_number_is_held_and_counted() -> None:
    wire = Wire.of(Library().device("haptip"))
    limiter = OutputLimiter(wire)
    limiter.begin(np.zeros(2), 0.0, 0.0)
    limiter.step(np.array([0.01, 0.02]), 0.001)
    assert limiter.step(np.array([np.nan, np.inf]), 0.002).tolist() == [0.01, 0.02]
    assert limiter.limited["pulley_1.not_finite"] == limiter.limited["pulley_2.not_finite"] == 1


def test_a_round_range_is_kept() -> None:
    spec = DeviceSpec(
        "disc",
        "Disc",
        "t",
        100.0,
        (Channel("x", "m", -2e-3, 2e-3, actuator="a"), Channel("y", "m", -2e-3, 2e-3, actuator="b")),
        {"range_disc": ["x", "y"], "range_disc_radius": 2e-3},
    )
    limiter = OutputLimiter(Wire.of(spec))
    limiter.begin(np.zeros(2), 0.0, 0.0)
    out = limiter.step(np.array([2e-3, 2e-3]), 1.0)
    assert np.allclose(out, 2e-3 / math.sqrt(2)) and limiter.limited["x.disc"] == 1
