"""The way to the safe state: never a jump, as long as it takes, told in words; and nothing is closed before it left."""

from __future__ import annotations

import contextlib
import copy
import math
import socket
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.devices.spec import Channel, DeviceSpec
from core.presets import Library
from core.stream.drain import DRAIN
from core.stream.links.capacity import ramp_period
from core.stream.links.transport import Transport
from core.stream.output_limiter import OutputLimiter
from core.stream.protocols import adapters, packets
from core.stream.protocols.packets import DeviceState, Kind
from core.stream.protocols.wire import Wire
from core.stream.safe_ramp import SafeRamp
from tests.unit.stream.stream_box import posix
from tests.unit.stream.stream_lab import TICK, Lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

FAR = {f"motor_{k}": math.radians(160) for k in (1, 2, 3)}
SPEED = math.radians(600)
PERIOD = 0.01  # the cable platform takes 100 commands a second
QUANTUM = math.radians(160) / 1000
SAFE = Wire.of(Library().device("cable_platform")).safe
WAY = float(np.abs(SAFE - np.array(list(FAR.values()))).max()) / SPEED  # how long it takes [s]
DRIVEN = ["maestro", "servo-animation", "osc"]  # by the sender: these know no safe state of their own


def far_lab(protocol: str, *, after: float = 0.6, **request: Any) -> Lab:
    """Give a cable platform that stands at the end of its range."""
    lab = Lab(protocol, "cable_platform", mode="jog", jog=FAR, ramp=0.0, **request)
    lab.run(0.1)
    lab.arm()
    lab.run(after)
    assert np.allclose(lab.at, math.radians(160), atol=QUANTUM)
    return lab


def follow(lab: Lab, seconds: float, path: list[np.ndarray], words: list[str] | None = None) -> None:
    """Let time pass; note where the device was told to be at every tick, and what is said."""
    device = lab.device

    def note() -> None:
        path.append(np.array(list(device.report()["values"].values())))
        if words is not None:
            words.append(str(lab.streamer.status()["message"]))

    note()
    lab.run(seconds, note)


def shut(lab: Lab) -> None:
    lab.streamer.shut(lab.now)


def stop(lab: Lab) -> None:
    lab.stops += 1


def refuse(lab: Lab) -> None:
    lab.set(jog={"motor_1": math.nan})


def stall(lab: Lab) -> None:
    lab.heartbeats = False


def disconnect(lab: Lab) -> None:
    lab.set(connect=False)


def elsewhere(lab: Lab) -> None:
    lab.set(url="elsewhere")


@pytest.mark.parametrize("protocol", DRIVEN)
@pytest.mark.parametrize("end", [stop, disconnect, elsewhere, shut, refuse, stall])
def test_no_way_to_end_a_stream_is_a_jump(protocol: str, end: Any) -> None:
    """160 degrees at 600 degrees/s take 0.27 s, however it ends; cut at 0.06 s that was a jump of 125 degrees."""
    lab = far_lab(protocol, stall=0.05)
    path: list[np.ndarray] = []
    end(lab)
    follow(lab, 0.5, path)
    told = np.array(path)
    assert np.allclose(told[-1], SAFE, atol=QUANTUM)
    assert np.abs(np.diff(told, axis=0)).max() <= SPEED * 2 * PERIOD + QUANTUM
    took = (np.flatnonzero(np.abs(told - SAFE).max(axis=1) > QUANTUM)[-1] + 1) * TICK
    assert WAY - 2 * PERIOD <= took <= WAY + 0.05 + 4 * PERIOD


def test_the_ramp_is_told_and_nothing_is_armed_meanwhile() -> None:
    lab = far_lab("maestro")
    path: list[np.ndarray] = []
    words: list[str] = []
    lab.stops += 1
    follow(lab, 0.1, path, words)
    assert "going to the safe state, 0.2 s" in words[-1] and lab.streamer.state == "stopping"
    lab.arm()
    assert "not armed before the safe state is reached" in lab.streamer.message
    follow(lab, 0.3, path)
    assert lab.streamer.state == "ready" and not lab.streamer.armed
    assert np.abs(np.diff(np.array(path), axis=0)).max() <= SPEED * 2 * PERIOD + QUANTUM
    lab.arm()
    lab.run(0.05)
    assert lab.streamer.armed


def test_a_link_that_was_full_or_a_sender_that_slept_makes_up_for_nothing() -> None:
    for hinder in ("full", "slept"):
        lab = far_lab("maestro", url="lab?silence=keeps")
        path: list[np.ndarray] = []
        lab.stops += 1
        follow(lab, 0.05, path)
        if hinder == "slept":
            lab.now += 0.2
        else:
            link = lab.streamer.connection.link
            assert link is not None
            send = link.send
            link.send = lambda message: False  # type: ignore[method-assign]
            follow(lab, 0.2, path)
            link.send = send  # type: ignore[method-assign]
        follow(lab, 0.5, path)
        assert np.abs(np.diff(np.array(path), axis=0)).max() <= SPEED * 2 * PERIOD + QUANTUM, hinder
        assert np.allclose(path[-1], SAFE, atol=QUANTUM)


def test_the_ramp_keeps_the_pace_of_the_stream_and_says_its_end_three_times() -> None:
    """Not a command a tick: a link that carries the stream must carry its end too."""
    lab = far_lab("servo-animation")
    before, commands = len(lab.sent), lab.device.log
    del commands[:]
    lab.stops += 1
    lab.run(0.5)
    assert len(lab.sent) - before <= WAY / PERIOD + 5
    last = [position for servo, position in commands if servo == 0][-3:]
    assert len(set(last)) == 1 and len(commands) >= 3 * 3


@pytest.mark.parametrize("rate", [0.5, 1.0, 5.0, 10.0])
def test_a_stream_of_few_commands_ends_in_a_ramp_of_many(rate: float) -> None:
    """At a command a second the way was one command: 147 degrees at once on a board that knows no speed."""
    lab = far_lab("maestro", rate=rate, after=max(0.6, 4.5 / rate))
    path: list[np.ndarray] = []
    lab.stops += 1
    follow(lab, 0.6, path)
    assert np.abs(np.diff(np.array(path), axis=0)).max() <= SPEED * 2 * PERIOD + QUANTUM
    assert np.allclose(path[-1], SAFE, atol=QUANTUM)


def test_a_slow_link_gets_no_more_than_it_carries_of_a_ramp() -> None:
    made = adapters.make("maestro", Wire.of(Library().device("cable_platform")), {})
    link = Transport()
    assert ramp_period(made, link, 1.0, 100.0) == 0.01
    link.carries = 150.0  # 12 bytes a command, of which four fifths may be used: ten of them
    assert ramp_period(made, link, 1.0, 100.0) == pytest.approx(0.1)
    assert ramp_period(made, link, 200.0, 100.0) == 0.005, "what was asked for, and was found to fit"


def test_few_commands_do_not_add_up_to_a_large_step() -> None:
    """What counts of the time between two commands is that of the preset's rate, or a tenth of a second."""
    lab = Lab("maestro", "cable_platform", mode="jog", rate=1.0, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(2.5)
    path: list[np.ndarray] = []
    lab.set(jog=FAR)
    follow(lab, 3.0, path)
    assert 0.5 < np.abs(np.diff(np.array(path), axis=0)).max() <= SPEED * 0.1 + QUANTUM


def test_a_board_that_took_nothing_of_it_stands_nobody_knows_where() -> None:
    lab = far_lab("maestro", url="lab?silence=keeps")
    assert lab.streamer.status()["pose_known"] and lab.streamer.connection is not None
    lab.streamer.connection.link.send = lambda message: False  # type: ignore[method-assign]
    lab.stops += 1
    lab.run(0.9)
    assert "Switch its supply off" not in lab.streamer.message
    lab.run(0.2)
    assert "Switch its supply off" in lab.streamer.message and not lab.streamer.status()["pose_known"]
    assert lab.streamer.counters["safe states not confirmed"] == 1, "by which `stream play` judges its own end"


@pytest.mark.parametrize("stopped", [True, False])
def test_a_link_lost_on_the_way_is_said(stopped: bool) -> None:
    """Nor is one that is lost in the middle of a stream ever made safe, where the board has no watchdog."""
    lab = far_lab("maestro")
    lab.stops += stopped
    lab.run(0.05)
    lab.cut = True
    lab.run(0.05)
    assert "lost before the safe state was sure. Switch the device's supply off" in lab.streamer.message
    assert lab.streamer.counters["safe states not confirmed"] == 1


def test_channels_without_a_speed_limit_take_a_second_for_their_range() -> None:
    channels = (Channel("a", "rad", -1.0, 1.0, None, 0.0, "a"), Channel("b", "rad", -1.0, 1.0, 0.5, 0.0, "b"))
    for reach, seconds in (("ramp", 0.5), ("at_once", 0.0)):
        spec = DeviceSpec("free", "Free", "t", 100.0, channels, source={"safe": {"reach": reach}})
        limiter = OutputLimiter(Wire.of(spec))
        limiter.begin(np.array([1.0, 0.1]), 0.0, 0.0)
        ramp = SafeRamp(limiter, 0.01, 0.0)
        assert ramp.seconds == pytest.approx(seconds)
        path = [ramp.step(0.01 * (k + 1)) for k in range(60)]
        if reach == "at_once":
            assert not path[0].any() and ramp.there
            continue
        assert np.allclose(np.diff(np.array(path)[:49, 0]), -0.02), "2 rad in a second, of commands that left"
        assert np.allclose(np.array(path)[:49, 1] / np.array(path)[:49, 0], 0.1), "in a straight line"
        assert ramp.there and not path[-1].any()


def test_a_channel_without_any_limit_takes_a_second_for_its_way() -> None:
    spec = DeviceSpec("free", "Free", "t", 100.0, (Channel("a", "rad", None, None, None, 0.0, "a"),))
    limiter = OutputLimiter(Wire.of(spec))
    limiter.begin(np.array([5.0]), 0.0, 0.0)
    limiter.step(np.array([5.0]), 0.01)
    ramp = SafeRamp(limiter, 0.01, 0.01)
    assert limiter.last[0] == 5.0 and ramp.seconds == pytest.approx(1.0)
    path = [float(ramp.step(0.01 * (k + 2))[0]) for k in range(110)]
    assert np.allclose(-np.diff([5.0, *path])[:99], 0.05) and path[-1] == 0.0 and ramp.there


@pytest.mark.parametrize("protocol", ["maestro", "servo-animation"])
def test_letting_go_where_the_board_can(protocol: str) -> None:
    """First to the safe pose, at the declared speed, then no pulses; a board that cannot says so before."""
    preset = copy.deepcopy(Library().load("devices", "cable_platform"))
    unwound = {"value": 0, "unit": "deg", "source": "a test"}
    preset["safe"] = {"reach": "release", "values": dict.fromkeys(FAR, unwound)}
    lab = Lab(protocol, "cable_platform", mode="jog", jog=FAR, ramp=0.0)
    lab.set(device={"key": "cable_platform", "preset": preset})
    lab.run(0.1)
    lab.arm()
    lab.run(0.6)
    lab.stops += 1
    lab.run(0.2)
    assert not lab.device.report().get("released") and 0.1 < lab.at[0] < 1.5
    lab.run(0.2)
    assert abs(lab.at[0]) < QUANTUM
    assert lab.streamer.connection is not None
    if protocol == "maestro":
        assert lab.device.report()["released"]
    else:
        assert "no word for letting go" in lab.streamer.connection.adapter.caution


# -- where the device is, nobody knows


def test_an_unknown_pose_is_said_and_the_first_command_is_the_safe_pose() -> None:
    """The limiter starts retracted, not at rest, where the device may be in the skin already."""
    preset = copy.deepcopy(Library().load("devices", "cable_platform"))
    retracted = {"value": 20, "unit": "deg", "source": "a test"}
    preset["safe"] = {"reach": "ramp", "values": dict.fromkeys(FAR, retracted)}
    lab = Lab("maestro", "cable_platform", mode="jog", jog=FAR, ramp=1.0, url="lab?silence=keeps")
    lab.set(device={"key": "cable_platform", "preset": preset})
    lab.run(0.1)
    assert lab.streamer.status()["pose_known"] is False
    lab.arm()
    lab.run(0.012)
    assert np.allclose(lab.at, math.radians(20), atol=2 * QUANTUM)
    lab.stops += 1
    lab.run(0.3)
    assert lab.streamer.status()["pose_known"] is True, "driven there by this link"
    assert Lab("native").streamer.status()["pose_known"] is False
    told = Lab("native")
    told.run(0.1)
    assert told.streamer.status()["pose_known"] is True, "a device of this protocol says where it is"


# -- nothing is closed before it left


def closed(lab: Lab) -> list[float]:
    """Note when the link is closed."""
    link, times = lab.streamer.connection.link, []
    assert link is not None
    link.close = lambda: times.append(lab.now)  # type: ignore[method-assign]
    return times


def test_a_link_is_closed_when_the_device_has_confirmed() -> None:
    """SAFE is lost a dozen times on its way; it is said until the device answers it."""
    lab = Lab(mode="jog", jog={"pulley_1": 0.3}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    feed, lost = lab.device.feed, []

    def deaf(data: bytes, now: float) -> list[bytes]:
        kinds = [packet.kind for packet in packets.Decoder().feed(data)]
        if Kind.SAFE in kinds and len(lost) < 12:
            lost.append(now)
            return []
        return list(feed(data, now))

    lab.device.feed = deaf
    times = closed(lab)
    lab.set(connect=False)
    assert not times
    lab.run(0.2)
    assert len(lost) == 12 and lab.device.state == DeviceState.SAFE
    assert times and times[0] > lost[-1] and lab.streamer.message == ""


def test_a_torque_board_confirms_by_its_answer() -> None:
    lab = Lab("torque", mode="jog", jog={"pulley_1": 0.2}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.3)
    feed, deaf_until = lab.device.feed, lab.now + 0.05
    lab.device.feed = lambda data, now: feed(data, now) if now > deaf_until else []
    times = closed(lab)
    lab.set(connect=False)
    lab.run(0.2)
    assert times and deaf_until < times[0] < deaf_until + 0.02 and not lab.device.torque.any()


def test_a_device_that_confirms_nothing_is_given_up_in_words() -> None:
    lab = Lab(mode="jog", jog={"pulley_1": 0.3}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    lab.device.feed = lambda data, now: []
    times = closed(lab)
    began = lab.now
    lab.streamer.shut(lab.now)
    lab.run(DRAIN + 0.1)
    assert lab.streamer.finished and times[0] - began == pytest.approx(DRAIN, abs=0.01)
    assert "did not confirm its safe state within 1 s. Switch its supply off" in lab.streamer.message


def test_what_waits_leaves_before_the_link_is_closed_and_what_cannot_is_said() -> None:
    for seconds, words in ((0.3, ""), (math.inf, "12 bytes did not leave within 1 s")):
        lab = far_lab("maestro")
        link = lab.streamer.connection.link
        assert link is not None
        times = closed(lab)
        began = lab.now
        link.pending = lambda lab=lab, end=lab.now + 0.35 + seconds: 12 if lab.now < end else 0  # type: ignore[misc]
        lab.set(connect=False)
        lab.run(0.35 + 1.2)
        assert words in lab.streamer.message and bool(words) is bool(lab.streamer.message)
        assert times[0] - began >= 0.35 + min(seconds, 0.9)
        assert lab.streamer.counters["bytes thrown away at the end"] == (12 if words else 0)


@posix
def test_a_serial_port_loses_nothing_by_being_closed() -> None:
    """A pseudo terminal drops what nobody has read yet if its output is reset; the end of a cut message counts too."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED")
    import os
    import pty
    import tty

    from core.stream.links.serial_port import Serial

    there, here = pty.openpty()
    tty.setraw(here)
    try:
        port = Serial(os.ttyname(here), 115200)
        message = bytes(range(256)) * 300
        sent = 0
        while port.send(message):
            sent += len(message)
        assert sent and port._rest, "cut in its middle"
        got = b""
        os.set_blocking(there, False)
        while port.pending():
            with contextlib.suppress(BlockingIOError):
                got += os.read(there, 1000)
        port.close()
        with pytest.raises(BlockingIOError):
            while True:
                got += os.read(there, 65536)
        whole = got.count(message)
        assert got == message * whole and whole * len(message) >= sent, "every message whole, the cut one too"
    finally:
        os.close(there)
        os.close(here)


def test_a_connection_that_is_closed_has_said_everything() -> None:
    from core.stream.links.sockets import Tcp
    from core.stream.links.url import Url

    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen(1)
        link = Tcp(Url(f"socket://127.0.0.1:{listener.getsockname()[1]}"))
        other, _ = listener.accept()
        with other:
            other.sendall(b"nobody reads this")
            message, sent = bytes(1_000_000), 0
            while link.send(message):
                sent += len(message)
            assert sent and link._rest, "cut in its middle"
            got = 0
            other.setblocking(False)
            while link.pending():
                with contextlib.suppress(BlockingIOError):
                    got += len(other.recv(65536))
            link.receive()
            link.close()
            other.setblocking(True)
            while data := other.recv(65536):
                got += len(data)
        assert got % len(message) == 0 and got >= sent


def test_another_port_is_opened_when_the_one_before_is_safe() -> None:
    lab = far_lab("maestro")
    device, times = lab.device, closed(lab)
    lab.set(url="elsewhere")
    lab.run(0.2)
    assert lab.device is device and not times
    lab.run(0.2)
    assert times and lab.device is not device and lab.streamer.state == "ready"


def test_a_link_lost_while_it_is_let_go_does_not_hinder_the_next_one() -> None:
    lab = far_lab("maestro")
    lab.set(url="elsewhere")
    lab.run(0.05)
    lab.cut = True
    lab.run(TICK)
    lab.cut = False
    lab.run(0.1)
    assert lab.streamer.state == "ready" and lab.streamer.counters["links lost"] == 1


def test_limits_that_leave_the_safe_state_outside_end_in_a_ramp() -> None:
    """What a calibration under way refuses ends the stream as everything else does."""
    preset = copy.deepcopy(Library().load("devices", "cable_platform"))
    preset["safe"] = {"reach": "ramp", "values": dict.fromkeys(FAR, {"value": 20, "unit": "deg", "source": "a test"})}
    lab = Lab("maestro", "cable_platform", mode="jog", jog=FAR, ramp=0.0)
    lab.set(device={"key": "cable_platform", "preset": preset})
    lab.run(0.1)
    lab.arm()
    lab.run(0.6)
    path: list[np.ndarray] = []
    made = Calibration.of(Library().device("cable_platform")).with_entry("motor_1", low=1.0)
    lab.set(calibration=made.dumps())
    follow(lab, 0.5, path)
    assert np.abs(np.diff(np.array(path), axis=0)).max() <= SPEED * 2 * PERIOD + QUANTUM
    assert np.allclose(path[-1], math.radians(20), atol=QUANTUM) and "outside" in lab.streamer.message
