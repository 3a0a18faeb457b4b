"""`python -m core stream follow`: a device follows a live sensor by OSC, a socket, a serial line; and ends safe."""

from __future__ import annotations

import os
import re
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.presets import Library
from core.stream.message_input import MAX_LINE, _Lines
from core.stream.protocols.osc import IMMEDIATELY, NTP, bundle, padded
from core.stream.sensor_input import reading_of_line, readings_of_osc, sensor_input
from core.work.child import command, environment
from tests import exits
from tests.unit.stream.stream_box import Box, posix
from tests.unit.stream.test_touch_panel import free_port, latest, until_armed

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.shared_tests("the board is simulated; senders that end run on both lines"),
]

CHANNELS = 4
SPEC = Library().device("cable_platform")
HIGH = np.array([c.high for c in SPEC.channels])


def rows() -> tuple[Any, Any]:
    """Commands and readings of a made-up table: four channels that tell the three motors apart, rest first."""
    rng = np.random.default_rng(0)
    commands = np.vstack([np.zeros(3), rng.uniform(0.05, 0.6, (200, 3))]) * HIGH
    return commands, 1000.0 + np.rint(900.0 * (commands / HIGH) @ rng.standard_normal((3, CHANNELS)))


@pytest.fixture
def table(tmp_path: Path) -> Path:
    names = ["m1", "m2", "m3", *(f"e{i}" for i in range(CHANNELS))]
    lines = [",".join(names), *(",".join(f"{v:.9g}" for v in row) for row in np.column_stack(rows()))]
    (tmp_path / "table.csv").write_text("\n".join(lines) + "\n")
    return tmp_path / "table.csv"


def follows(table: Path, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command("stream", "follow", "--table", str(table), *more),
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def osc(values: Any) -> bytes:
    return padded(b"/dermis/sensor") + padded(b"," + b"f" * len(values)) + struct.pack(f">{len(values)}f", *values)


class Sensor:
    """Says one reading again and again, 200 times a second, until it is told another or to be quiet."""

    def __init__(self, say: Callable[[Any], object]) -> None:
        self._say, self.values, self.quiet, self._end = say, rows()[1][0], False, False
        self.every = 0.005  # [s]
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._end:
            if not self.quiet:
                try:
                    self._say(self.values)
                except OSError:
                    return
            time.sleep(self.every)

    def end(self) -> None:
        self._end = True
        self._thread.join()


@pytest.fixture
def by_osc() -> Iterator[tuple[Sensor, str]]:
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        sensor = Sensor(lambda values: one.sendto(osc(values), ("127.0.0.1", port)))
        yield sensor, f"osc://:{port}"
        sensor.end()


def driven(box: Box) -> Any:
    values = latest(box)["values"]
    return np.array([values[c.name] for c in SPEC.channels])


def reaches(one: subprocess.Popen[str], box: Box, wanted: Any, what: str) -> None:
    def lives() -> None:
        assert one.poll() is None, one.communicate()

    exits.until(lambda: np.abs(driven(box) - wanted).max() < 2e-3, lives, what)


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_sensor_by_osc_is_followed_until_a_signal_brings_the_safe_state(
    number: signal.Signals, table: Path, boxes: Callable[..., Box], by_osc: tuple[Sensor, str]
) -> None:
    sensor, source = by_osc
    commands, readings = rows()
    box = boxes("pty", "native", "cable_platform", every=0.05)
    one = follows(table, "--url", f"{box.url}?watchdog_ms=80", "--sensor", source, "--rest-for", "0.3", "--yes")
    until_armed(one, box)
    for row in (20, 77):
        sensor.values = readings[row]
        reaches(one, box, commands[row], f"row {row}")
    one.send_signal(number)
    out, said = one.communicate(timeout=20)
    assert one.returncode == 0 and "Traceback" not in said, said
    box.safe_at()
    assert box.end()["state"] == "safe"
    assert "readings at rest, noise 0 a channel" in said
    told = re.search(r"latency median ([\d.]+) ms, p95 ([\d.]+) ms", out)
    assert told is not None and float(told[1]) < 5.0, out


@posix
def test_a_sensor_that_falls_silent_ends_in_the_safe_state(
    table: Path, boxes: Callable[..., Box], by_osc: tuple[Sensor, str]
) -> None:
    sensor, source = by_osc
    commands, readings = rows()
    box = boxes("pty", "native", "cable_platform", every=0.05)
    one = follows(table, "--url", f"{box.url}?watchdog_ms=80", "--sensor", source, "--rest-for", "0", "--yes")
    until_armed(one, box)
    sensor.values = readings[33]
    reaches(one, box, commands[33], "row 33")
    sensor.quiet = True
    out, said = one.communicate(timeout=20)
    assert one.returncode == 2 and "the sensor gave no reading for 0.5 s" in said, said
    box.safe_at()
    assert box.end()["state"] == "safe"


@posix
def test_a_step_of_the_sensor_moves_no_motor_faster_than_it_may(
    table: Path, boxes: Callable[..., Box], by_osc: tuple[Sensor, str], tmp_path: Path
) -> None:
    sensor, source = by_osc
    commands, readings = rows()
    box, log = boxes("pty", "native", "cable_platform", every=0.05), tmp_path / "log.csv"
    url = f"{box.url}?watchdog_ms=80"
    one = follows(table, "--url", url, "--sensor", source, "--rest-for", "0", "--yes", "--log", str(log))
    until_armed(one, box)
    far = int(commands.max(axis=1).argmax())
    time.sleep(2.0)  # its ramp is over
    sensor.values = readings[far]
    reaches(one, box, commands[far], "the farthest row")
    one.send_signal(signal.SIGINT)
    one.communicate(timeout=20)
    lines = [line for line in log.read_text().splitlines() if line and not line.startswith("#")]
    names = lines[0].split(",")
    assert len(lines) > 300, names
    sent = [i for i, name in enumerate(names) if name.startswith("sent.")]
    live = [line.split(",") for line in lines[1:] if ",live," in line]
    made = np.array([[float(row[i]) for i in sent] for row in live])
    slew = max(c.slew for c in SPEC.channels)
    steps = np.abs(np.diff(made, axis=0)).max()
    assert 0.5 * slew / 500.0 < steps <= slew * 2.0 / 500.0 * 1.001  # a late command gets credit for two periods


@posix
def test_lines_by_socket_serial_port_and_standard_input_are_followed(table: Path, boxes: Callable[..., Box]) -> None:
    import pty
    import tty

    commands, readings = rows()

    def line(values: Any) -> bytes:
        return (",".join(f"{v:.6g}" for v in values) + "\r\n").encode()

    mine, theirs = pty.openpty()
    tty.setraw(theirs)
    server = socket.create_server(("127.0.0.1", 0))
    for source in (f"serial:{os.ttyname(theirs)}?baud=115200", f"socket://127.0.0.1:{server.getsockname()[1]}", "-"):
        box = boxes("pty", "native", "cable_platform", every=0.05)
        one = follows(table, "--url", f"{box.url}?watchdog_ms=80", "--sensor", source, "--rest-for", "0", "--yes")
        if source.startswith("socket"):
            peer, _ = server.accept()
            sensor = Sensor(lambda values, peer=peer: peer.sendall(line(values)))
        elif source == "-":
            assert one.stdin is not None
            typed = one.stdin.fileno()
            sensor = Sensor(lambda values, typed=typed: os.write(typed, line(values)))
        else:
            sensor = Sensor(lambda values: os.write(mine, line(values)))
        until_armed(one, box)
        sensor.values = readings[50]
        reaches(one, box, commands[50], source)
        sensor.end()
        if source.startswith("socket"):
            peer.close()
        elif source == "-":
            one.stdin.close()
            one.stdin = None
        else:
            one.send_signal(signal.SIGINT)
        out, said = one.communicate(timeout=20)
        assert one.returncode == (2 if source.startswith("socket") else 0), (source, said)
        box.safe_at()
        assert box.end()["state"] == "safe", source
    server.close()
    os.close(theirs)
    os.close(mine)


@posix
def test_what_cannot_be_is_refused_before_anything_is_armed(table: Path, tmp_path: Path) -> None:
    def refused(*more: str, given: Path = table) -> str:
        one = follows(given, "--url", "virtual:", *more)
        said = one.communicate("", timeout=60)[1]
        assert one.returncode == 2 and "Traceback" not in said, said
        return said

    port = free_port()
    assert "no such source of readings" in refused("--sensor", "telepathy")
    assert "standard input cannot both" in refused("--sensor", "-")
    assert "no reading came within 5 s" in refused("--sensor", f"osc://:{port}", "--yes")
    assert "cannot be read" in refused("--sensor", f"osc://:{port}", "--yes", given=tmp_path / "none.csv")
    assert "no look-up table" in refused("--sensor", f"osc://:{port}", "--device", "haptip")
    assert "follows recordings" in refused("--sensor", f"osc://:{port}", "--device", "thimble_3rrs")
    assert ">= 0" in refused("--sensor", f"osc://:{port}", "--noise", "-1")


@posix
def test_readings_too_large_to_be_any_are_no_sign_of_life(table: Path, boxes: Callable[..., Box]) -> None:
    server = socket.create_server(("127.0.0.1", 0))
    box = boxes("pty", "native", "cable_platform", every=0.05)
    source = f"socket://127.0.0.1:{server.getsockname()[1]}"
    one = follows(table, "--url", f"{box.url}?watchdog_ms=80", "--sensor", source, "--rest-for", "0", "--yes")
    peer, _ = server.accept()
    sensor = Sensor(lambda values: peer.sendall((",".join(map(repr, np.asarray(values).tolist())) + "\n").encode()))
    until_armed(one, box)
    sensor.values = np.full(CHANNELS, 1e200)
    out, said = one.communicate(timeout=20)
    sensor.end()
    peer.close()
    server.close()
    assert one.returncode == 2 and "the sensor gave no reading for 0.5 s" in said, said
    assert re.search(r"bad readings [1-9]", out), out
    box.safe_at()
    assert box.end()["state"] == "safe"


@posix
def test_a_reading_beyond_the_table_is_told_at_once_and_counted(
    table: Path, boxes: Callable[..., Box], by_osc: tuple[Sensor, str]
) -> None:
    sensor, source = by_osc
    box = boxes("pty", "native", "cable_platform", every=0.05)
    one = follows(table, "--url", f"{box.url}?watchdog_ms=80", "--sensor", source, "--rest-for", "0", "--yes")
    until_armed(one, box)
    sensor.values = np.array([1000.0, 1000.0, 1e6, 1000.0])
    time.sleep(0.5)
    one.send_signal(signal.SIGINT)
    out, said = one.communicate(timeout=20)
    assert "nothing like this reading" in said and "channel 3 reads 1e+06, beyond" in said, said
    assert re.search(r"readings beyond the table [1-9]", out), out


def test_no_reading_breaks_off_the_way_to_the_safe_state(by_osc: tuple[Sensor, str]) -> None:
    """What looks readings up fails on every one: the stream ends with that error, and in the safe state."""
    from core.stream.request import StreamRequest
    from core.stream.sensor_session import SensorSession
    from core.stream.signals import Signals

    class Fails:
        beyond, first_beyond, armed = 0, "", False

        def command(self, reading: Any) -> Any:
            if self.armed:
                raise DermisError("cannot be looked up")
            return 0.6 * HIGH

    _, source = by_osc
    device = {"key": "cable_platform", "preset": Library().load("devices", "cable_platform")}
    request = StreamRequest(connect=True, url="virtual:?watchdog_ms=80", device=device, mode="follow", rate=500.0)
    sensor, fails = sensor_input(source, CHANNELS), Fails()
    session = SensorSession(request, sensor, tuple(c.name for c in SPEC.channels), Signals())
    session.prepare("follows")
    threading.Timer(1.5, lambda: setattr(fails, "armed", True)).start()
    with pytest.raises(DermisError, match="cannot be looked up"):
        session.follow(fails)
    time.sleep(0.05)  # readings go on coming
    session.shut()
    sensor.close()
    assert session.streamer.finished and not session.unsure


def test_one_sender_is_heard_at_a_time() -> None:
    port, own, other = free_port(), np.ones(CHANNELS), np.full(CHANNELS, 2.0)
    heard = sensor_input(f"osc://:{port}", CHANNELS)
    noise = padded(b"/other") + padded(b",f") + struct.pack(">f", 1.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as a, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as b:
        b.sendto(noise, ("127.0.0.1", port))  # tells no reading, so it keeps nobody out
        for _ in range(10):
            a.sendto(osc(own), ("127.0.0.1", port))
            b.sendto(osc(other), ("127.0.0.1", port))
        exits.until(lambda: heard.count + heard.bad == 20, lambda: None, "20 datagrams")
        assert (heard.count, heard.bad) == (10, 10)
        assert all((sensed.values == own).all() for sensed in heard.since(0.0))
        time.sleep(0.6)  # a sensor's program that is started again has another port
        b.sendto(osc(other), ("127.0.0.1", port))
        exits.until(lambda: heard.count == 11, lambda: None, "the second sender")
    heard.close()


def test_the_end_of_a_line_is_no_reading() -> None:
    """A port is opened within a line, and hears '23,5' of '1023,5' first; so after a line that is too long."""
    cut = _Lines(begun=True)
    assert cut.of(b"23,5\n1023,6\r\n10") == [b"1023,6"]
    assert cut.of(b"23,7\n") == [b"1023,7"]
    whole = _Lines()
    assert whole.of(b"1,2\n") == [b"1,2"]
    assert len(whole.of(b"9" * (MAX_LINE + 1))) == 1
    assert whole.of(b"9" * (MAX_LINE + 1)) == [] and whole.of(b"9,9\n1,2\n") == [b"1,2"]


@posix
def test_a_serial_port_is_heard_from_the_next_line_on() -> None:
    import pty
    import tty

    mine, theirs = pty.openpty()
    tty.setraw(theirs)
    heard = sensor_input(f"serial:{os.ttyname(theirs)}?baud=115200", 2)
    os.write(mine, b"23,5\n1023,6\n")
    exits.until(lambda: heard.count > 0, lambda: None, "a reading")
    time.sleep(0.05)
    assert [sensed.values.tolist() for sensed in heard.since(0.0)] == [[1023.0, 6.0]]
    heard.close()
    os.close(theirs)
    os.close(mine)


def test_lines_and_datagrams_that_are_readings() -> None:
    np.testing.assert_array_equal(reading_of_line(b" 1, 2;3 4", 4), [1, 2, 3, 4])
    np.testing.assert_array_equal(reading_of_line(b"1,2,\t3 , 4,\r", 4), [1, 2, 3, 4])
    for bad in (
        b"1,,3,4",
        b"1,,2,3,4",
        b",1,2,3,4",
        b"1;;2;3;4",
        b"1_0 2 3 4",
        b" ",
        b",",
    ):  # one is missing, or no number
        with pytest.raises(ValueError):
            reading_of_line(bad, 4)
    for bad in (b"1 2 3", b"1 2 3 4 5", b"1 2 3 nan", b"1 2 3 x", b"\xff", b"1 2 3 1e200", b"1 2 3 -1e200"):
        with pytest.raises(ValueError):
            reading_of_line(bad, 4)
    one, two = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    found = list(readings_of_osc(bundle(1, [osc(one), osc(two)]), 2))
    np.testing.assert_array_equal([told.values for told in found], [one, two])
    assert [told.tag for told in readings_of_osc(bundle(7 << 32, [osc(one), osc(two)]), 2)] == [7 << 32] * 2
    assert [told.tag for told in readings_of_osc(osc(one), 2)] == [IMMEDIATELY]
    assert list(readings_of_osc(padded(b"/other") + padded(b",f") + struct.pack(">f", 1.0), 2)) == []
    for bad in (osc(np.ones(3)), osc(np.array([1.0, np.nan])), b"", b"#bundle\0"):
        with pytest.raises((DermisError, ValueError)):
            list(readings_of_osc(bad, 2))


def test_readings_keep_the_time_of_their_arrival_and_bad_ones_are_counted() -> None:
    port = free_port()
    sensor = sensor_input(f"osc://:{port}", 2)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            for values in ([1.0, 2.0], [5.0], [3.0, 4.0]):
                one.sendto(osc(values), ("127.0.0.1", port))
                time.sleep(0.02)
        end = time.monotonic() + 5
        while sensor.count < 2 and time.monotonic() < end:
            time.sleep(0.01)
        assert (sensor.count, sensor.bad) == (2, 1)
        first, last = sensor.since(0.0)
        assert last.at > first.at and sensor.since(last.at) == [last] and sensor.last is last
    finally:
        sensor.close()


def tag_of(seconds: float) -> int:
    """Return the time tag of a moment of this computer's clock."""
    return round((seconds + NTP) * 2.0**32)


def test_a_bundles_time_tag_is_when_a_reading_was_taken(capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    sensor = sensor_input(f"osc://:{port}", 2)

    def say(value: float, after: float) -> None:
        before = sensor.count + sensor.bad
        data = bundle(tag_of(began + after), [osc(np.full(2, value))])
        one.sendto(data, ("127.0.0.1", port))
        exits.until(lambda: sensor.count + sensor.bad > before, lambda: None, "a datagram")

    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            began = time.time()
            say(1.0, -0.30)
            say(3.0, -0.10)
            say(2.0, -0.20)  # datagrams overtake each other: the older reading must not move a device back
            assert (sensor.count, sensor.bad) == (2, 1)
            assert "a later reading came before it" in capsys.readouterr().err
            say(4.0, -0.05)
            say(5.0, 0.1)  # a clock that is a little ahead
            first, second, third, fourth = sensor.since(0.0)
            assert [s.values[0] for s in (first, second, third, fourth)] == [1.0, 3.0, 4.0, 5.0]
            assert 0.29 < first.at - first.taken < 1.3 and fourth.at == fourth.taken
            assert second.taken - first.taken == pytest.approx(0.2, abs=1e-3)
            assert sensor.since(first.taken + 0.15)[0] is second, "by when they were taken"
            assert sensor.since(second.at)[0] is not second
            one.sendto(osc(np.full(2, 6.0)), ("127.0.0.1", port))  # nobody says when: as it arrives
            exits.until(lambda: sensor.count == 5, lambda: None, "a datagram")
            assert sensor.last is not None and sensor.last.at == sensor.last.taken
    finally:
        sensor.close()


@pytest.mark.parametrize(("after", "words"), [(-3.0, "3 s old"), (3.0, "3 s ahead of this computer's clock")])
def test_a_time_tag_of_another_clock_is_refused_in_words(
    after: float, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    sensor = sensor_input(f"osc://:{port}", 2)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            one.sendto(bundle(tag_of(time.time() + after), [osc(np.ones(2))]), ("127.0.0.1", port))
            exits.until(lambda: sensor.bad > 0, lambda: None, "a datagram")
    finally:
        sensor.close()
    assert sensor.count == 0
    said = capsys.readouterr().err
    assert words in said and "let one server set both clocks" in said


@pytest.mark.parametrize("hertz", [1.2, 0.4])
def test_a_sensor_slower_than_the_stream_waits_for_is_refused_before_anything_is_armed(
    hertz: float, table: Path, by_osc: tuple[Sensor, str]
) -> None:
    sensor, source = by_osc
    sensor.every = 1.0 / hertz
    one = follows(table, "--url", "virtual:", "--sensor", source, "--rest-for", "0", "--yes")
    said = one.communicate(timeout=30)[1]
    assert one.returncode == 2 and "Traceback" not in said, said
    assert "too slow to be followed" in said and ">= 2 readings a second" in said and "no reading for" in said, said


@posix
def test_a_sensor_of_four_readings_a_second_is_followed(
    table: Path, boxes: Callable[..., Box], by_osc: tuple[Sensor, str]
) -> None:
    sensor, source = by_osc
    commands, readings = rows()
    sensor.every = 0.25
    box = boxes("pty", "native", "cable_platform", every=0.05)
    one = follows(table, "--url", f"{box.url}?watchdog_ms=80", "--sensor", source, "--rest-for", "0", "--yes")
    until_armed(one, box)
    sensor.values = readings[20]
    reaches(one, box, commands[20], "row 20")
    one.send_signal(signal.SIGINT)
    one.communicate(timeout=20)
    assert box.end()["state"] == "safe"
