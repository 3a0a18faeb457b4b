"""Smart servos on one line: Connect, Arm, silence, limits, and a bus that is not as it should be."""

from __future__ import annotations

import os
import re
import struct
import termios
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.presets import Library
from core.stream.client import SenderClient
from core.stream.links import serial_port
from core.stream.protocols import adapters
from core.stream.protocols.adapter import Adapter
from core.stream.protocols.bus import dynamixel, feetech
from core.stream.protocols.silence import Does
from core.stream.protocols.wire import Wire
from core.stream.state import State
from core.stream.virtual.device import make
from core.stream.virtual.program import Endpoint
from tests.unit.stream.stream_box import beating, posix, ready
from tests.unit.stream.stream_lab import Lab

pytestmark = pytest.mark.shared_tests("the board is simulated; senders that end run on both lines")

PRESET = Library().load("devices", "haptip")
HAPTIP = Wire.of(Library().device("haptip"))
BOTH = ["dynamixel", "feetech"]
BUSES = [("dynamixel", "", {}), ("feetech", "", {}), ("feetech", "series=scs", {"board_scs": 1.0})]


def lab_of(protocol: str, options: str = "", faults: Any = (), **more: Any) -> Lab:
    given = {"mode": "jog", "jog": {"pulley_1": 0.4}, "ramp": 0.0, "rate": 100.0, **more}
    return Lab(protocol, url=f"lab?{options}", faults=faults, **given)


def adapter_of(lab: Lab) -> Adapter:
    assert lab.streamer.connection is not None, lab.streamer.message
    return lab.streamer.connection.adapter


# -- driven


@pytest.mark.parametrize(("protocol", "options", "board"), BUSES)
def test_ten_thousand_values_reach_the_servos(protocol: str, options: str, board: dict[str, float]) -> None:
    given = dict(part.split("=") for part in options.split("&") if part)
    made, device = adapters.make(protocol, HAPTIP, given), make(protocol, HAPTIP, board)
    for servo in device.servos:  # type: ignore[attr-defined]
        servo.memory[device.TORQUE] = 1  # type: ignore[attr-defined]
    values = np.random.default_rng(4).uniform(HAPTIP.range_low, HAPTIP.range_high, (10_000, HAPTIP.count))
    for k, wanted in enumerate(values):
        for message in made.command(wanted, 0.001 * k, None):
            device.feed(message, 0.001 * k)
        told = np.array(list(device.report()["values"].values()))  # type: ignore[attr-defined]
        assert np.abs(told - made.carried(wanted)).max() < 1e-12
    step = 300 / 1024 if "scs" in options else 360 / 4096
    assert np.degrees(np.abs(made.carried(values) - values).max()) <= step / 2 + 1e-9


@pytest.mark.parametrize(("protocol", "options", "board"), BUSES)
def test_it_begins_where_the_servos_stand_and_ends_in_the_safe_pose(
    protocol: str, options: str, board: dict[str, float]
) -> None:
    lab = lab_of(protocol, options, board)
    lab.run(0.5)
    assert lab.streamer.state == State.READY, lab.streamer.message
    for servo, count in zip(lab.device.servos, (40, -60), strict=True):  # turned by hand
        servo.position = lab.device.MIDDLE + count
        lab.device._store(servo)
    before = lab.at
    lab.run(0.1)
    assert np.allclose(adapter_of(lab).pose, before)
    moved: list[np.ndarray] = []
    lab.arm()
    lab.run(0.3, lambda: moved.append(lab.at))
    assert lab.streamer.armed and np.allclose(lab.at[0], 0.4, atol=6e-3)
    path = np.array([before, *moved])
    allowed = HAPTIP.slew / 100.0 + 2 / lab.device.COUNTS
    assert (np.abs(np.diff(path, axis=0)) <= allowed).all(), "no jump to an old goal"
    status = lab.streamer.status()
    assert status["sensed"]["temperature [degC]"] == {"pulley_1": 31.0, "pulley_2": 31.0}
    assert abs(status["reported"]["pulley_1"] - 0.4) < 6e-3
    lab.streamer.stop(lab.now, "")
    lab.run(1.0)
    assert lab.streamer.state == State.READY and np.allclose(lab.at, HAPTIP.safe, atol=6e-3)
    assert not lab.device.report()["released"], "the safe pose is held"


@pytest.mark.parametrize("protocol", BOTH)
def test_a_safe_state_that_lets_go_switches_the_torque_off(protocol: str) -> None:
    lab = lab_of(protocol)
    lab.preset["safe"] = {**lab.preset["safe"], "reach": "release"}
    lab.set(device={"key": "haptip", "preset": lab.preset})
    lab.begin(0.5)
    lab.run(0.5)
    if not lab.streamer.armed:
        lab.arm()
        lab.run(0.5)
    assert lab.streamer.armed and not lab.device.report()["released"], lab.streamer.message
    lab.streamer.stop(lab.now, "")
    lab.run(1.0)
    assert lab.device.report()["released"]


@pytest.mark.parametrize("protocol", BOTH)
@pytest.mark.parametrize("deaf", [6, 10_000])
def test_letting_go_is_said_until_every_servo_confirms_it(protocol: str, deaf: int) -> None:
    lab = lab_of(protocol, reconnect=False)
    lab.preset["safe"] = {**lab.preset["safe"], "reach": "release"}
    lab.set(device={"key": "haptip", "preset": lab.preset})
    lab.run(0.5)
    lab.arm()
    lab.run(0.5)
    assert lab.streamer.armed, lab.streamer.message
    feed, left = lab.device.feed, [deaf]
    off = adapter_of(lab)._torque(False)  # type: ignore[attr-defined]

    def lossy(data: bytes, now: float) -> list[bytes]:
        if data == off and left[0]:
            left[0] -= 1
            return []
        return feed(data, now)

    lab.device.feed = lossy
    lab.streamer.stop(lab.now, "")
    lab.run(2.5)
    if deaf < 100:
        assert lab.device.report()["released"] and adapter_of(lab).settled
    else:
        assert "does not confirm its safe state" in lab.streamer.message, lab.streamer.message
        assert lab.streamer.counters["safe states not confirmed"]


@pytest.mark.parametrize("protocol", BOTH)
def test_nothing_is_said_while_an_answer_is_on_its_way(protocol: str) -> None:
    """One line carries both: answers here take 15 ms, at 1,000 commands a second."""
    lab = lab_of(protocol, rate=1000.0)
    said: list[float] = []
    held: list[tuple[float, bytes]] = []
    waiting: list[float] = []
    lab.run(0.001)
    feed = lab.device.feed

    def late(data: bytes, now: float) -> list[bytes]:
        said.append(now)
        assert not waiting or data is not None and now >= waiting[-1], "two spoke at once"
        held.extend((now + 0.015, answer) for answer in feed(data, now))
        if held:
            waiting[:] = [held[-1][0]]
        return []

    def arrive() -> None:
        while held and held[0][0] <= lab.now:
            lab._answers.append(held.pop(0)[1])

    lab.device.feed = late
    lab.run(1.0, arrive)
    lab.arm()
    lab.run(2.0, arrive)
    assert lab.streamer.armed, lab.streamer.message
    assert not adapter_of(lab).counters["answers out of turn"] and len(said) > 900


# -- silence


def test_what_they_do_in_silence_is_declared() -> None:
    made = [adapters.make(name, HAPTIP, {}) for name in BOTH]
    assert [(m.silence.does, m.silence.by) for m in made] == [(Does.STOPS, "board"), (Does.KEEPS, "sender")]
    assert all(not m.silence.watched and m.caution for m in made)
    assert adapters.make("dynamixel", HAPTIP, {"watchdog_ms": "210"}).silence.after == 0.2, "in steps of 20 ms"
    with pytest.raises(Exception, match="unknown option"):
        adapters.make("dynamixel", HAPTIP, {"silence": "retracts"})


def test_a_dynamixel_stops_when_its_sender_is_gone_and_obeys_after_the_next_arm() -> None:
    lab = lab_of("dynamixel", reconnect=True)
    lab.begin(0.5)
    goal = lab.device.servos[0].word(dynamixel.GOAL, "<i")
    lab.device.tick(lab.now + 0.09)
    assert lab.device.servos[0].memory[dynamixel.BUS_WATCHDOG] == 5
    lab.device.tick(lab.now + 0.12)  # nobody spoke
    assert lab.device.servos[0].memory[dynamixel.BUS_WATCHDOG] == dynamixel.STOPPED
    lab.device.feed(dynamixel.sync_write(dynamixel.GOAL, {1: struct.pack("<i", 2048)}), lab.now + 0.13)
    assert lab.device.servos[0].word(dynamixel.GOAL, "<i") == goal, "goals are refused"
    lab.run(0.2)
    assert "watchdog has stopped" in lab.streamer.message and not lab.streamer.armed
    lab.run(2.0)
    lab.arm()
    lab.run(0.5)
    assert lab.streamer.armed, lab.streamer.message


@pytest.mark.parametrize("protocol", BOTH)
def test_a_suspended_sender_leads_them_to_the_safe_pose(protocol: str) -> None:
    lab = lab_of(protocol)
    lab.begin(0.5)
    lab.now += 0.5
    lab.device.tick(lab.now)
    lab.run(2.0)
    assert lab.streamer.state in (State.STALLED, State.READY), lab.streamer.message
    assert np.allclose(lab.at, HAPTIP.safe, atol=6e-3)
    lab.arm()
    lab.run(0.5)
    assert lab.streamer.armed and abs(lab.at[0] - 0.4) < 6e-3, lab.streamer.message


# -- limits on what they report


@pytest.mark.parametrize("protocol", BOTH)
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("hottest_c=45", "servo 2 has 50 degC, and the limit is 45"),
        ("most_ma=300", "servo 2 takes 325 mA, and most_ma is 300"),
        ("most_lag_deg=5", "servo 2 is 1.* degrees from its command, and most_lag_deg is 5"),
        ("", "servo 2 has 71 degC, and the limit is 70"),
    ],
)
def test_a_limit_on_what_they_report_ends_the_stream(protocol: str, options: str, said: str) -> None:
    lab = lab_of(protocol, options, reconnect=False, jog={"pulley_1": 0.2, "pulley_2": 0.2})
    lab.begin(0.5)
    lab.run(0.3)
    assert lab.streamer.armed, lab.streamer.message
    servo = lab.device.servos[1]
    table: Any = dynamixel if protocol == "dynamixel" else feetech
    hot, at = table.TEMPERATURE, table.CURRENT
    if "lag" in options:
        servo.held = True
        servo.position = lab.device.MIDDLE
    else:
        servo.memory[hot] = 71 if not options else 50
        servo.put(at, 325 if protocol == "dynamixel" else 50)
    lab.run(0.15)
    assert not lab.streamer.armed and re.search(said, lab.streamer.message), lab.streamer.message
    lab.run(2.0)
    assert lab.streamer.connection is None and abs(lab.at[0] - HAPTIP.safe[0]) < 6e-3, "the others went to safety"


# -- a bus that is not as it should be


@pytest.mark.parametrize(
    ("protocol", "options", "board", "said"),
    [
        ("dynamixel", "first=2", {}, r"no answer from servo 3, while servo 2 can be heard.*ids="),
        ("feetech", "ids=1,9", {}, r"no answer from servo 9, while servo 1 can be heard"),
        ("dynamixel", "first=20", {}, r"no answer from servos 20, 21.*supply.*baud=.*57600"),
        ("feetech", "first=20", {}, r"no answer from servos 20, 21.*supply.*1000000"),
        ("dynamixel", "", {"board_twin": 2.0}, r"for servo 2: two servos have one id.*one at a time"),
        ("feetech", "", {"board_twin": 1.0}, r"for servo 1: two servos have one id"),
        ("dynamixel", "", {"board_model": 350.0}, r"servo 1: its model number is 350"),
        ("dynamixel", "", {"board_mode": 1.0}, r"Operating Mode is 1. Set it to 3"),
        ("dynamixel", "zero=4000", {}, r"takes positions from 0 to 4095, and 'pulley_1' needs \d+ to \d+.*zero="),
        ("feetech", "series=scs", {}, r"servo 1: its angle limits are 0 and 65295.*other series="),
        ("feetech", "", {"board_scs": 1.0}, r"servo 1: its angle limits are 0 and -\d+.*other series="),
        ("feetech", "zero=10", {}, r"takes positions from 0 to 4095, and 'pulley_1' needs -\d+"),
    ],
)
def test_it_is_refused_in_words_before_anything_moves(
    protocol: str, options: str, board: dict[str, float], said: str
) -> None:
    lab = lab_of(protocol, options, board, reconnect=False)
    lab.run(1.0)
    assert lab.streamer.state == State.FAULT, lab.streamer.status()
    assert re.search(said, lab.streamer.message), lab.streamer.message
    lab.arm()
    lab.run(0.5)
    table: Any = dynamixel if protocol == "dynamixel" else feetech
    written = {table.SYNC_WRITE, table.WRITE}
    place = 7 if protocol == "dynamixel" else 4
    assert lab.sent and not any(message[place] in written for _, message in lab.sent)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"ids": "1,1"}, "2 different numbers"),
        ({"ids": "1"}, "2 different numbers"),
        ({"ids": "1,253"}, "2 different numbers"),
        ({"ids": "1,x"}, "2 different numbers"),
        ({"first": "252"}, "0 to 251"),
        ({"most_ma": "-1"}, "above 0"),
        ({"hottest_c": "hot"}, "finite number"),
        ({"watchdog_ms": "20"}, "40 to 2540"),
    ],
)
def test_impossible_options(options: dict[str, str], said: str) -> None:
    with pytest.raises(Exception, match=said):
        adapters.make("dynamixel", HAPTIP, options)


def test_what_is_no_angle_is_refused() -> None:
    with pytest.raises(Exception, match="servos turn"):
        adapters.make("feetech", Wire.of(Library().device("pin_array_128")), {})


def test_old_firmware_is_read_the_slow_way_and_that_is_said() -> None:
    lab = lab_of("dynamixel", "", {"board_fast": 0.0})
    lab.begin(0.5)
    lab.run(0.3)
    lab.arm()
    lab.run(0.3)
    assert lab.streamer.armed and "update the firmware" in lab.streamer.status()["notice"], lab.streamer.message


@pytest.mark.parametrize("protocol", BOTH)
def test_a_servo_that_is_unplugged_ends_the_stream(protocol: str) -> None:
    lab = lab_of(protocol, reconnect=False)
    lab.begin(0.5)
    assert lab.streamer.armed
    del lab.device.servos[1]
    lab.run(1.0)
    assert not lab.streamer.armed and re.search("servos? .*2.*no answer any more", lab.streamer.message)


def test_a_hardware_error_ends_the_stream_and_is_named_at_the_next_connect() -> None:
    lab = lab_of("dynamixel", reconnect=False)
    lab.begin(0.5)
    servo = lab.device.servos[0]
    servo.error, servo.memory[dynamixel.ERRORS], servo.memory[dynamixel.TORQUE] = 0x80, 1 << 5, 0
    lab.run(0.2)
    assert "servo 1 reports a hardware error" in lab.streamer.message
    again = adapters.make("dynamixel", HAPTIP, {})
    assert "overload" in again._describe(bytes(servo.memory[:71])).fault  # type: ignore[attr-defined]


@pytest.mark.parametrize(("bit", "name"), [(0, "voltage"), (2, "overheating"), (5, "overload")])
def test_an_error_of_a_feetech_servo_is_named(bit: int, name: str) -> None:
    lab = lab_of("feetech", reconnect=False)
    lab.begin(0.5)
    lab.device.servos[0].error = 1 << bit
    lab.run(0.2)
    assert f"servo 1 reports an error ({name})" in lab.streamer.message


@pytest.mark.parametrize("protocol", BOTH)
def test_a_servo_whose_supply_was_interrupted_ends_the_stream(protocol: str) -> None:
    lab = lab_of(protocol, reconnect=False)
    lab.begin(0.5)
    assert lab.streamer.armed
    fresh = make(protocol, HAPTIP, {})
    lab.device.servos[0].memory[:] = fresh.servos[0].memory  # type: ignore[attr-defined]
    lab.run(0.2)
    assert not lab.streamer.armed
    assert re.search("servo 1 (was reset|has switched its torque off)", lab.streamer.message), lab.streamer.message


@pytest.mark.parametrize("protocol", BOTH)
def test_rubbish_between_the_answers_is_dropped(protocol: str) -> None:
    """As fast as the line carries it, headers of packets among it."""
    rng = np.random.default_rng(7)
    table: Any = dynamixel if protocol == "dynamixel" else feetech
    lab = lab_of(protocol, reconnect=False)
    lab.begin(0.5)
    feed = lab.device.feed

    def among(data: bytes, now: float) -> list[bytes]:
        answers = feed(data, now)
        return [rng.bytes(20), *answers, table.HEADER + rng.bytes(3)] if answers else [rng.bytes(30)]

    lab.device.feed = among
    lab.run(3.0)
    if lab.streamer.armed:
        assert np.allclose(lab.at[0], 0.4, atol=6e-3)
    else:
        assert re.search("servos? .*(damaged|no answer)", lab.streamer.message), lab.streamer.message
    lab.device.feed = feed
    lab.streamer.stop(lab.now, "")
    lab.run(2.0)
    assert np.allclose(lab.at, HAPTIP.safe, atol=6e-3)


# -- the port


def test_the_latency_timer_of_an_ftdi_chip_is_read(tmp_path: Path) -> None:
    (tmp_path / "ttyUSB7").mkdir()
    (tmp_path / "ttyUSB7" / "latency_timer").write_text("16\n")
    assert serial_port.latency_timer("/dev/ttyUSB7", tmp_path) == 0.016
    assert np.isnan(serial_port.latency_timer("/dev/ttyACM0", tmp_path))


@posix
@pytest.mark.real_time
@pytest.mark.parametrize("protocol", BOTH)
def test_over_a_pty(protocol: str, boxes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box = boxes("pty", protocol, "haptip")
    with SenderClient() as client:
        ready(client, box.url, protocol, mode="jog", jog={"pulley_1": 0.3}, ramp=0.0, rate=100.0)
        beating(client, 0.2)
        client.arm()
        beating(client, 1.0)
        status = client.status()
        assert status["armed"] and abs(status["reported"]["pulley_1"] - 0.3) < 2e-3, status
        client.stop()
        beating(client, 1.0)
    ended = box.end()
    assert not ended["damaged"] and abs(ended["values"]["pulley_1"] - HAPTIP.safe[0]) < 2e-3


@posix
@pytest.mark.real_time
@pytest.mark.parametrize("protocol", BOTH)
def test_a_line_that_loses_and_damages_leaves_them_in_the_safe_pose(protocol: str, boxes: Any) -> None:
    """A tenth of all messages, each way, does not arrive, and a twentieth is damaged."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box = boxes("pty", protocol, "haptip", "loss=0.1", "corrupt=0.05")
    with SenderClient() as client:
        client.connect(
            box.url, protocol, "haptip", PRESET, mode="jog", jog={"pulley_1": 0.3}, ramp=0.0, rate=100.0, reconnect=True
        )
        end = time.monotonic() + 4.0
        while time.monotonic() < end:
            beating(client, 0.05)
            if client.status()["state"] == "ready":
                client.arm()
        client.stop()
        beating(client, 1.0)
    ended = box.end()
    assert abs(ended["values"]["pulley_1"] - HAPTIP.safe[0]) < 2e-3, ended


class Line(Endpoint):
    """A pty whose servos hear rubbish, and are heard as rubbish, unless the port has their rate."""

    def __init__(self, protocol: str, baud: int) -> None:
        super().__init__("pty")
        self.device, self._baud, self._open = make(protocol, HAPTIP, {}), getattr(termios, f"B{baud}"), True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while self._open:
            for data in self.read(0.005, 65536) or []:
                right = termios.tcgetattr(self._fd)[4] == self._baud
                for answer in self.device.feed(data if right else os.urandom(len(data)), time.monotonic()):
                    self.write(answer)
                if not right:
                    self.write(os.urandom(3))

    def close(self) -> None:
        self._open = False
        self._thread.join()


@posix
@pytest.mark.real_time
@pytest.mark.parametrize("protocol", BOTH)
def test_a_wrong_baud_rate_is_told(protocol: str) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    line = Line(protocol, 57_600)
    try:
        with SenderClient() as client:
            client.connect(line.url, protocol, "haptip", PRESET, rate=20.0, reconnect=False)
            end = time.monotonic() + 10.0
            while "baud" not in client.status()["message"] and time.monotonic() < end:
                beating(client, 0.05)
            assert re.search(r"1000000 baud.*baud=", client.status()["message"]), client.status()
        with SenderClient() as client:
            ready(client, f"{line.url}?baud=57600", protocol, rate=20.0)
    finally:
        line.close()


def test_a_slow_chip_is_told_at_connect_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lab = lab_of("dynamixel")
    opened = lab._open

    def slow(*arguments: Any) -> Any:
        link = opened(*arguments)
        link.name, link.keeps = "/dev/ttyUSB3", 0.016
        return link

    monkeypatch.setattr(lab.streamer, "_open_link", slow)
    lab.run(0.5)
    told = lab.streamer.status()["notice"]
    assert "up to 16 ms" in told and "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB3/latency_timer" in told
