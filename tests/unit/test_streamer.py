"""The sender's mind on a clock of the test's own: arming, limits, stops, stalls, modes. Nothing is left to luck."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.calibration import Calibration
from core.devices.spec import Channel, DeviceSpec, from_preset
from core.formats import csv
from core.matching.screen_map import ScreenMap
from core.presets import Library
from core.stream.board import Beat
from core.stream.clock import DeviceClock, TrackClock
from core.stream.gate import Gate
from core.stream.source import Play
from core.stream.streamer import Streamer
from core.stream.transport import Gone, Transport
from core.stream.url import Url
from core.stream.virtual_device import make
from core.stream.wire import Wire
from core.stream.wish import Wish
from core.track import CommandTrack

TICK = 0.001


class Lab:
    """A streamer, a virtual device at the other end of a wire without delay, and a clock that the test turns."""

    def __init__(self, protocol: str = "native", key: str = "haptip", *, load_screen: Any = None, **wish: Any) -> None:
        self.now, self.number, self.beats = 100.0, 0, True
        self.time: float | None = 0.0
        self.playing, self.stops, self.values = False, 0, ()
        self.cut = False
        self.sent: list[tuple[float, bytes]] = []
        self.preset = Library().load("devices", key)
        self.wish = Wish(connect=True, url="lab", protocol=protocol, device={"key": key, "preset": self.preset}, **wish)
        self.streamer = Streamer(self._open, load_screen)
        self.streamer.apply(copy.deepcopy(self.wish), self.now)

    def _open(self, url: Url, wire: Wire, protocol: str) -> Transport:
        lab = self
        self.device: Any = make(protocol, wire, {})

        class Wired(Transport):
            name, datagrams = "lab", self.device.datagrams
            answers: list[bytes] = []

            def send(self, message: bytes) -> bool:
                if lab.cut:
                    raise Gone("unplugged", where="lab")
                lab.sent.append((lab.now, message))
                self.answers = self.answers + lab.device.feed(message, lab.now)
                return True

            def receive(self) -> list[bytes]:
                if lab.cut:
                    raise Gone("unplugged", where="lab")
                out, self.answers = self.answers, []
                return out

        return Wired()

    def run(self, seconds: float, each: Any = None) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            if self.playing and self.time is not None:
                self.time += TICK
            if self.beats:
                self.number += 1
                self.streamer.beat(Beat(self.number, self.stops, self.playing, self.time, self.values), self.now)
            self.streamer.tick(self.now)
            self.device.tick(self.now)
            if each is not None:
                each()

    def set(self, **fields: Any) -> None:
        """Change the wish."""
        for name, value in fields.items():
            setattr(self.wish, name, value)
        self.streamer.apply(copy.deepcopy(self.wish), self.now)

    def arm(self) -> None:
        """Arm, as a press of the button does."""
        self.set(arm=self.wish.arm + 1, stops=self.stops)

    @property
    def at(self) -> np.ndarray:
        """Where the device's actuators are."""
        return np.array(list(self.device.report()["values"].values()))


@pytest.fixture
def track_file(tmp_path: Path) -> Path:
    """Five seconds of a slow sine on pulley 1, its double on pulley 2."""
    spec = Library().device("haptip")
    t = np.arange(5001) / 1000
    wave = 0.1 * np.sin(2 * np.pi * t)
    csv.write(CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, wave, 2 * wave])), tmp_path / "t.csv")
    return tmp_path / "t.csv"


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
    lab.run(3.0, lambda: errors.append(float(np.abs(
        lab.at - 0.1 * np.sin(2 * np.pi * lab.time) * np.array([1, 2])).max())))  # fmt: skip
    # The sample of this millisecond or of the one before: at most 2 pi 0.2 rad/s for one millisecond and a count.
    assert max(errors) <= 2 * np.pi * 0.2 * 1.5e-3 + step
    assert not lab.streamer.gate.limited and not lab.streamer.counters["skipped"]  # type: ignore[union-attr]


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
    lab.run(2.0, lambda: errors.append(float(np.abs(
        lab.at - 0.1 * np.sin(2 * np.pi * lab.time) * np.array([1, 2])).max())))  # fmt: skip
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
    lab.run(1.5, lambda: path.append(float(lab.streamer.gate.last[0])))  # type: ignore[union-attr]
    slew = math.radians(2300)
    assert max(path) == pytest.approx(math.radians(24))
    assert np.diff(path).max() <= slew * TICK * (1 + 1e-6)
    limited = lab.streamer.gate.limited  # type: ignore[union-attr]
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
    lab.streamer.beat(Beat(lab.number, lab.stops, False, 0.0, ()), lab.now)
    lab.set(arm=1, stops=0)
    lab.run(0.5)
    assert not lab.device.received


def test_a_stalled_blender_holds_and_then_is_safe(track_file: Path) -> None:
    lab = Lab(mode="follow", ramp=0.0, stall=0.5)
    lab.values = (0.2, -0.1)
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    assert np.allclose(lab.at, [0.2, -0.1], atol=1e-4)
    lab.beats = False
    lab.run(0.49)
    assert np.allclose(lab.at, [0.2, -0.1], atol=1e-4), "it holds"
    lab.run(0.04)
    assert lab.streamer.state == "stalled" and "sign of life" in lab.streamer.words
    assert np.abs(lab.at).max() < 1e-4
    lab.beats = True
    lab.run(0.5)
    assert np.abs(lab.at).max() < 1e-4, "a person has to arm again"


def test_a_baked_track_plays_on_by_option(track_file: Path) -> None:
    lab = Lab(track=str(track_file), ramp=0.0, play_on=True, stall=0.5)
    lab.run(0.1)
    lab.arm()
    lab.run(0.1)
    lab.playing = True
    lab.run(0.2)
    lab.beats = False
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
    assert lab.streamer.link is None and "unplugged" in lab.streamer.words
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
        assert lab.streamer.state == "streaming", (protocol, lab.streamer.words)
        lab.streamer.shut(lab.now)
        for _ in range(100):
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
    assert lab.streamer.gate.limited["pulley_2.range"]  # type: ignore[union-attr]


def test_not_a_number_is_held_and_counted() -> None:
    wire = Wire.of(Library().device("haptip"))
    gate = Gate(wire)
    gate.begin(np.zeros(2), 0.0, 0.0)
    gate.step(np.array([0.01, 0.02]), 0.001)
    assert gate.step(np.array([np.nan, np.inf]), 0.002).tolist() == [0.01, 0.02]
    assert gate.limited["pulley_1.not_finite"] == gate.limited["pulley_2.not_finite"] == 1


def test_a_round_range_is_kept() -> None:
    spec = DeviceSpec("disc", "Disc", "t", 100.0,
                      (Channel("x", "m", -2e-3, 2e-3, actuator="a"), Channel("y", "m", -2e-3, 2e-3, actuator="b")),
                      {"range_disc": ["x", "y"], "range_disc_radius": 2e-3})  # fmt: skip
    gate = Gate(Wire.of(spec))
    gate.begin(np.zeros(2), 0.0, 0.0)
    out = gate.step(np.array([2e-3, 2e-3]), 1.0)
    assert np.allclose(out, 2e-3 / math.sqrt(2)) and gate.limited["x.disc"] == 1


# -- the touch panel


@pytest.fixture
def screen() -> ScreenMap:
    """A ramp along x: slope 0.5 everywhere, so friction f0 / 2 uphill and none downhill."""
    from core.devices.friction_screen import FrictionScreen

    x = (np.arange(64) + 0.5) / 64 * 0.1 - 0.05
    heights = np.broadcast_to((0.5 * x).astype(np.float32), (1, 64, 64)).copy()
    return ScreenMap(heights, (0.1, 0.1), 1.0, FrictionScreen.of(Library().device("electrovibration")), scale=120.0,
                     lowest=float(heights.min()), highest=float(heights.max()))  # fmt: skip


def test_the_panel_is_answered_by_map_and_law(screen: ScreenMap) -> None:
    lab = Lab("native", "electrovibration", mode="panel", screen="map", ramp=0.0, load_screen=lambda path: screen)
    lab.run(0.1)
    assert lab.at[0] == 0.0, "it starts at 0 V"
    lab.arm()
    lab.run(0.1)

    def slide(x0: float, x1: float) -> None:
        for x in np.linspace(x0, x1, 50):
            lab.streamer.adapter.receive(lab.device.touched(True, float(x), 0.0, lab.now), lab.now)  # type: ignore[union-attr]
            lab.run(0.01)

    slide(-0.03, 0.03)
    wanted = (10 ** (1.05 / 1.24)) * 60 ** (1 / 1.24)  # log10 f = 1.24 log10 V - 1.05, f = 120 * 0.5
    assert lab.at[0] == pytest.approx(wanted, abs=300 / 65535)
    assert lab.at[1] == pytest.approx(60.0, abs=990 / 65535)
    slide(0.03, -0.03)
    assert lab.at[0] == 0.0, "downhill there is nothing to feel"
    slide(-0.03, 0.0)
    assert lab.at[0] > 100
    lab.streamer.adapter.receive(lab.device.touched(False, 0.0, 0.0, lab.now), lab.now)  # type: ignore[union-attr]
    lab.run(0.005)
    assert lab.at[0] == 0.0, "the finger has left"
    slide(-0.03, 0.0)
    lab.stops += 1
    lab.run(0.003)
    assert lab.at[0] == 0.0 and lab.device.safe_at is not None


# -- the position loop of a torque board


def test_the_position_loop_follows_against_inertia_and_skin(tmp_path: Path) -> None:
    spec = Library().device("haptip")
    t = np.arange(5001) / 1000
    wave = 0.2 * np.sin(2 * np.pi * 1.0 * t)
    csv.write(CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, wave, -wave])), tmp_path / "s.csv")
    lab = Lab("torque", track=str(tmp_path / "s.csv"), ramp=0.3)
    lab.run(0.2)
    lab.arm()
    lab.run(0.5)
    lab.playing = True
    lab.run(1.0)
    errors: list[float] = []
    both = np.array([0.2, -0.2])
    lab.run(2.0, lambda: errors.append(float(np.abs(lab.at - both * np.sin(2 * np.pi * lab.time)).max())))
    # What is left is the skin: the preset expects (0.79 + 1.53) / 2 N/mm at 5 mm, the device's is 0.02 N m/rad. Loop
    # and plant at s = 2 pi j: error = amplitude * (expected - skin) / (J s^2 + (skin + P) + I / s), damping aside.
    inertia, pole, s = 1e-6, 2 * np.pi * 15, 2j * np.pi
    spring = inertia * s**2 + 3 * inertia * pole * s + 0.02 + 3 * inertia * pole**2 + inertia * pole**3 / s
    assert max(errors) == pytest.approx(0.2 * abs((0.029 - 0.02) / spring), rel=0.15)
    assert np.isfinite(errors).all() and lab.streamer.adapter.counters["torque limited"] == 0  # type: ignore[union-attr]


def test_a_torque_board_that_falls_silent_gets_no_torque() -> None:
    lab = Lab("torque", mode="jog", jog={"pulley_1": 0.2}, ramp=0.0)
    lab.run(0.2)
    lab.arm()
    lab.run(0.5)
    assert lab.at[0] == pytest.approx(0.2, abs=2e-3), "the integrator holds against the spring"
    lab.device.feed = lambda data, now: []
    lab.run(0.02)
    from core.stream.torque import HEAD

    last = np.frombuffer(lab.sent[-1][1], "<f4", offset=HEAD.size)
    assert not last.any()


# -- clocks


def test_a_device_clock_through_overflow_and_skew() -> None:
    clock, skew = DeviceClock(), 80e-6
    for k in range(int(3 * 4300)):  # three overflows of 4295 s, once a second
        sent = float(k)
        raw = round((sent + 0.001) * (1 + skew) * 1e6 + 123456) % 2**32
        clock.reply(sent, sent + 0.002, raw)
    moment = 3 * 4300 - 1 + 0.5
    wanted = (moment * (1 + skew) * 1e6 + 123456) % 2**32
    error = (clock.device_us(moment) - wanted + 2**31) % 2**32 - 2**31
    assert abs(error) < 48 * 80 + 10, "48 replies of memory at 80 us a second"


def test_a_wrong_device_is_refused_in_words() -> None:
    lab = Lab()
    lab.run(0.01)
    lab.device._spec_hash = b"ABCDEFGH"
    lab.streamer.apply(Wish(), lab.now)
    opener = lab.streamer._open_link

    def wrong(url: Url, wire: Wire, protocol: str) -> Transport:
        link = opener(url, wire, protocol)
        lab.device._spec_hash = b"ABCDEFGH"
        return link

    lab.streamer._open_link = wrong
    lab.set(connect=True)
    lab.run(0.2)
    assert lab.streamer.state == "fault" and "wrong device" in lab.streamer.words


def test_play_reads_between_samples_and_rests_outside() -> None:
    spec = DeviceSpec("d", "D", "t", 10.0, (Channel("a", "m", -1.0, 5.0, rest=-1.0, actuator="m"),))
    for times in (np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.1, 0.3])):
        play = Play(Wire.of(spec), CommandTrack(spec, times, np.array([[0.0], [1.0], [3.0]])))
        assert play.value(0.05)[0] == pytest.approx(0.5)
        assert play.value(float(times[2]))[0] == 3.0 and play.value(0.1)[0] == pytest.approx(1.0)
        assert play.value(-0.01)[0] == -1.0 and play.value(0.31)[0] == -1.0
        assert play.value(0.15)[0] == pytest.approx(1.0 + 2.0 * 0.05 / (times[2] - 0.1))


def test_safe_states_of_the_presets() -> None:
    haptip, screen = (Wire.of(Library().device(k)) for k in ("haptip", "electrovibration"))
    assert haptip.safe.tolist() == [0.0, 0.0] and haptip.reach == 1
    assert screen.safe[0] == 0.0 and screen.reach == 0 and screen.rest[0] == 0.0
    broken = Library().load("devices", "haptip")
    broken["safe"]["values"]["pulley_1"] = {"value": 90, "unit": "deg"}
    with pytest.raises(ValueError, match="outside the range"):
        Wire.of(from_preset("haptip", broken))


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
    assert lab.streamer.state == "fault" and "has not answered for 0.08 s" in lab.streamer.words


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
    lab.now += 0.06  # less than the device's own watchdog, and no tick meanwhile
    lab.run(0.3)
    assert lab.streamer.armed


def full(lab: Lab, is_full: Any) -> None:
    """Let the link refuse messages while a condition holds."""
    assert lab.streamer.link is not None
    link, send = lab.streamer.link, lab.streamer.link.send
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
    assert lab.streamer.counters["dropped"] == lab.streamer.counters["skipped"] == 0


@pytest.mark.parametrize("protocol", ["maestro", "servo-animation"])
def test_a_safe_state_that_finds_no_room_is_sent_when_there_is(protocol: str) -> None:
    lab = Lab(protocol, mode="jog", jog={"pulley_1": 0.4, "pulley_2": -0.4}, ramp=0.0)
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
    assert "Switch its supply off" in lab.streamer.words


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
    from core.stream import source

    spec, t, reads = Library().device("haptip"), np.arange(2001) / 1000, []
    read = source.export.read
    monkeypatch.setattr(source.export, "read", lambda path: reads.append(path) or read(path))
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
    lab.beats = False
    lab.run(0.35)
    assert lab.streamer.state == "stalled" and np.abs(lab.at).max() < 1e-4
