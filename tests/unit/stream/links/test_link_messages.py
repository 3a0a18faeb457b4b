"""What links say: a record that cannot be written, a port that somebody has, each name once, limits before anything."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from core.errors import DermisError
from core.presets import Library
from core.stream.client import SenderClient
from core.stream.links import serial_port
from core.stream.links.open_link import open_link
from core.stream.links.serial_port import Serial
from core.stream.links.transport import Transport, cannot_open, holder_of
from core.stream.links.url import Url
from core.stream.protocols.wire import Wire
from core.stream.request import StreamRequest
from core.stream.streamer import Streamer
from core.stream.virtual import faults
from core.stream.virtual.link import open_any_link
from core.work.child import command, environment
from tests.unit.stream.stream_box import HAPTIP, Box, posix, ready
from tests.unit.stream.stream_lab import sine_track

pytestmark = pytest.mark.shared_tests("words of messages")


def spied(path: Path | str) -> Transport:
    return open_link(Url(f"spy://loop://?file={path}"), lambda url: pytest.fail("no virtual device was asked for"))


# -- the record of a link


def test_a_record_never_overwrites_a_file(tmp_path: Path) -> None:
    mine = tmp_path / "thesis.txt"
    mine.write_text("three years of work")
    with pytest.raises(DermisError, match="would overwrite a file.*does not exist yet"):
        spied(mine)
    assert mine.read_text() == "three years of work"
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(DermisError, match="Name a file that does not exist yet"):
        spied(tmp_path / "link")
    assert not (tmp_path / "nowhere").exists()


@posix
def test_a_record_is_a_regular_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, "/dev/null", "/dev/full"):
        with pytest.raises(DermisError, match="a record is a regular file"):
            spied(path)
    for path in (tmp_path / "none" / "record", "/proc/record", "bad%00name"):
        with pytest.raises(DermisError, match="cannot be written.*Choose a folder"):
            spied(path)


def test_a_link_that_is_opened_again_goes_on_with_its_own_record(tmp_path: Path) -> None:
    path = tmp_path / "record.txt"
    for byte in (b"\x01", b"\x02"):
        link = spied(path)
        assert link.send(byte)
        link.close()
        link.close()
    assert [line[13:] for line in path.read_text().splitlines()] == ["TX 01", "TX 02"]
    path.unlink()
    path.write_text("somebody else's")
    with pytest.raises(DermisError, match="overwrite"):
        spied(path)
    assert path.read_text() == "somebody else's"


def test_a_refused_record_leaves_its_link_closed(tmp_path: Path) -> None:
    closed: list[str] = []

    class Inner(Transport):
        name = "inner"

        def close(self) -> None:
            closed.append("inner")

    with pytest.raises(DermisError, match="regular file"):
        open_link(Url(f"spy://virtual:?file={tmp_path}"), lambda url: Inner())
    assert closed == ["inner"]


SENDS = """
import sys
from core.stream.links.open_link import open_link
from core.stream.links.url import Url
link = open_link(Url("spy://loop://?file=" + sys.argv[1]), None)
for k in range(2000):
    assert link.send(bytes((k % 256,)) * 8) and link.receive()
print(link.report())
link.close()
print(link.report())
"""


@posix
@pytest.mark.parametrize("room", [0, 100, 20_000])
def test_a_disk_without_room_ends_the_record_and_not_the_stream(tmp_path: Path, room: int) -> None:
    """The system refuses what goes beyond a size, as a full disk does; Python ignores the signal of that."""
    import resource

    done = subprocess.run(
        [sys.executable, "-c", SENDS, str(tmp_path / "record.txt")],
        env=environment(),
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
        timeout=60,
    )
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert done.stderr.count("is not whole") == 1 and "the link goes on without it" in done.stderr
    during, after = done.stdout.splitlines()
    assert "is not whole" in during and "'missing': " in during and after == during
    assert (tmp_path / "record.txt").stat().st_size <= room


def test_a_record_that_only_its_end_does_not_fit_says_so_too(tmp_path: Path) -> None:
    link = spied(tmp_path / "record.txt")
    assert link.send(b"\x01") and "record" not in link.report()
    os.close(link._record._file.fileno())  # type: ignore[attr-defined]
    link.close()
    assert "is not whole" in link.report()["record"]


# -- who has a port


def held_open(path: str) -> subprocess.Popen[str]:
    """Start a process that has a port open."""
    code = f"import sys; f = open({path!r}, 'rb+', buffering=0); print('open', flush=True); sys.stdin.read()"
    one = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert one.stdout is not None and one.stdout.readline() == "open\n"
    return one


@pytest.mark.skipif(not Path("/proc/self/fdinfo").exists(), reason="Linux tells who has a file open")
def test_a_device_is_not_named_as_the_one_who_has_its_own_port(boxes: Callable[..., Box]) -> None:
    import pty

    box = boxes("pty")
    assert holder_of(box.url) == "", "the virtual device keeps its own end open"
    other = held_open(box.url)
    assert holder_of(box.url).endswith(f"(process {other.pid})") and str(box.process.pid) not in holder_of(box.url)
    other.communicate("")
    assert holder_of(box.url) == ""
    mine, theirs = pty.openpty()
    other = held_open(os.ttyname(theirs))
    assert holder_of(os.ttyname(theirs)).endswith(f"(process {other.pid})"), "another pseudo-terminal's own process"
    other.communicate("")
    os.close(mine)
    os.close(theirs)


@posix
def test_port_in_use_names_the_sender_alone(boxes: Callable[..., Box]) -> None:
    box = boxes("pty")
    with SenderClient() as one, SenderClient() as two:
        ready(one, box.url)
        two.connect(box.url, "native", "haptip", HAPTIP)
        words = two.wait("fault", 10)["message"]
    assert f"process {one.pid}" in words and f"process {box.process.pid}" not in words
    assert words.count(box.url) == 1


# -- every name once


@pytest.mark.parametrize(
    "url",
    [
        "/dev/ttyNoSuch9",
        "serial:/dev/ttyNoSuch9",
        "bogus://x",
        "spy://bogus://x",
        "socket://127.0.0.1:1",
        "socket://no-such-host.invalid:1",
        "/dev/null?baud=fast",
    ],
)
def test_the_command_line_names_a_link_once(url: str, tmp_path: Path) -> None:
    track = sine_track(tmp_path / "t.csv")
    done = subprocess.run(
        command("stream", "play", str(track), "--url", url, "--yes"),
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )
    place = url.removeprefix("spy://").removeprefix("serial:").partition("?")[0]
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert done.stderr.count(place) == 1, done.stderr


def test_a_port_that_cannot_be_opened_is_named_once(tmp_path: Path) -> None:
    plain = tmp_path / "no_port"
    plain.write_bytes(b"")
    for place in (str(plain), "/dev/null", str(tmp_path)):
        with pytest.raises(DermisError) as refused:
            Serial(place, 115200)
        assert str(refused.value).count(place) == 1, refused.value


def test_a_ports_description_says_more_than_its_name() -> None:
    more = serial_port._more
    assert more("/dev/ttyS0", "ttyS0") == more("/dev/ttyS0", "n/a") == more("COM3", "COM3") == ""
    assert more("/dev/ttyACM0", "Arduino Uno") == "Arduino Uno"
    assert more("COM3", "USB Serial Device (COM3)") == "USB Serial Device"


# -- faults


@pytest.mark.parametrize(
    ("fault", "limit"),
    [
        ("loss=2", "0 to 1"),
        ("loss=-0.1", "0 to 1"),
        ("corrupt=1.5", "0 to 1"),
        ("delay=-1", "0 to 60 s"),
        ("jitter=61", "0 to 60 s"),
        ("slow=-5", "bytes a second"),
        ("skew=2", "-0.1 to 0.1"),
        ("stuck=1.5", "whole"),
        ("seed=0.5", "whole"),
        ("finger=2", "0 to 1"),
        ("stuck=99", "0 to 1"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_before_anything_is_told(fault: str, limit: str) -> None:
    done = subprocess.run(
        command("stream", "virtual", "--fault", fault),
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 2 and done.stdout == "" and "Traceback" not in done.stderr
    assert limit in done.stderr and fault.partition("=")[0] in done.stderr, done.stderr
    with pytest.raises(DermisError, match=limit):
        open_any_link(Url(f"virtual:?{fault}"), Wire.of(Library().device("haptip")))


def test_faults_have_limits_in_words() -> None:
    for name in faults.NAMES:
        with pytest.raises(DermisError, match=" to "):
            faults.check(name, float("nan"))
    assert faults.number_of("stuck", "-1") == -1.0 and faults.number_of("loss", "1") == 1.0


def test_a_streamers_words_stay_those_of_the_link() -> None:
    from core.stream.request import StreamRequest

    streamer = Streamer(open_any_link)
    preset = Library().load("devices", "haptip")
    streamer.apply(StreamRequest(connect=True, url="bogus://x", device={"key": "haptip", "preset": preset}), 1.0)
    streamer.tick(1.0)
    assert streamer.message.count("bogus://x") == 1


# -- sockets


@posix
def test_a_refused_broadcast_is_told_as_one() -> None:
    """The system refuses both with the number that it has for a serial port without rights."""
    with pytest.raises(DermisError, match="broadcast address.*device's own address") as told:
        open_link(Url("udp://255.255.255.255:9000"), lambda url: pytest.fail("no virtual device was asked for"))
    assert "dialout" not in str(told.value) and "port" not in told.value.what


def test_a_socket_that_nobody_listens_at_is_no_serial_port() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(DermisError, match="cannot be opened: nobody listens there.*Start the device"):
        open_link(Url(f"socket://127.0.0.1:{port}"), lambda url: pytest.fail("no virtual device was asked for"))
    with pytest.raises(DermisError, match="unknown name of a computer"):
        open_link(Url("udp://no-such-host.invalid:9"), lambda url: pytest.fail("no virtual device was asked for"))


def test_a_connection_that_stands_still_is_known_and_is_reset() -> None:
    """The other side reads nothing more: what waits here is old by the time it would arrive, so it never does."""
    import socket
    import time

    from core import clock
    from core.stream.links.sockets import STILL, Tcp

    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        listener.bind(("127.0.0.1", 0))
        listener.listen(1)
        link = Tcp(Url(f"socket://127.0.0.1:{listener.getsockname()[1]}"))
        there, _ = listener.accept()
        with there:
            assert link.send(b"read") and there.recv(100) == b"read"
            time.sleep(2 * STILL)
            assert link.stands_still(clock.now()) == 0.0, "all of it was confirmed"
            while link.send(bytes(8192)):
                pass
            until = clock.now() + 5.0
            while link.stands_still(clock.now()) <= STILL and clock.now() < until:
                time.sleep(0.01)
            assert link.stands_still(clock.now()) > STILL and link.pending() > 0
            link.close()
            there.settimeout(5.0)
            with pytest.raises(ConnectionResetError):
                while there.recv(1 << 20):
                    pass


# -- advice that fits the link


class Silent(Transport):
    """A link at whose other end nobody answers."""

    name = "silent"

    def __init__(self, baud: int | None, *, datagrams: bool = False) -> None:
        self.baud, self.datagrams = baud, datagrams

    def send(self, message: bytes) -> bool:
        return True

    def receive(self) -> list[bytes]:
        return []


def nobody(protocol: str, baud: int | None, *, datagrams: bool = False) -> str:
    """Return the message of a streamer to which nobody answers."""
    device = {"key": "haptip", "preset": Library().load("devices", "haptip")}
    streamer = Streamer(lambda *_: Silent(baud, datagrams=datagrams))
    streamer.apply(StreamRequest(connect=True, url="lab", protocol=protocol, device=device, reconnect=False), 0.0)
    for now in (0.0, 1.0, 2.0, 2.9, 3.1, 3.2):
        streamer.tick(now)
    return streamer.message


def test_a_baud_rate_is_named_only_where_there_is_one() -> None:
    on_a_line = nobody("native", 500_000)
    assert "no answer came within 3 s. Check address, protocol and power" in on_a_line
    for name in ("DERMIS_WIFI", "DERMIS_SERVO_ANIMATION", "DERMIS_BAUD", "?baud=115200"):
        assert name in on_a_line
    in_datagrams = nobody("native", None, datagrams=True)
    assert "no answer came" in in_datagrams and "baud" not in in_datagrams and "DERMIS" not in in_datagrams


def test_a_port_that_is_not_there_and_a_missing_pyserial_name_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DermisError, match="no such port.*'stream ports', or 'Rescan Ports' in Blender"):
        raise cannot_open("/dev/x", FileNotFoundError(2, "No such file", "/dev/x"))
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(DermisError, match="Run 'pip install pyserial'"):
        Serial("/dev/x", 115_200)


def test_an_unknown_option_of_the_simulated_device_lists_its_faults() -> None:
    wire = Wire.of(Library().device("haptip"))
    with pytest.raises(DermisError, match="found 'lossy'.*of the protocol reach, watchdog_ms; of the.*loss, delay"):
        open_any_link(Url("virtual:?lossy=1"), wire)
    open_any_link(Url("virtual:?loss=0.1&watchdog_ms=60"), wire).close()
