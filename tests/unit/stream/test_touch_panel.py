"""`python -m core stream panel`: a real finger on a screen, without Blender, from arming to 0 V."""

from __future__ import annotations

import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.stream.protocols.osc import bundle, padded
from core.stream.touch_sources import touch_input, touch_of_line, touches_of_osc
from core.work.child import command, environment
from tests import exits
from tests.unit.stream.stream_box import Box, posix
from tests.unit.stream.stream_lab import ramp

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.shared_tests("the board is simulated; senders that end run on both lines"),
]

FULL = 10 ** (1.05 / 1.24) * 60 ** (1 / 1.24)  # [V] of friction 60: log10 f = 1.24 log10 V - 1.05


@pytest.fixture
def screen(tmp_path: Path) -> Path:
    """A slope of 0.5 along x: friction 60 towards +x, none back."""
    made = ramp(direction_window=0.02)
    made.save(tmp_path / "slope.map.npz")
    return tmp_path / "slope.map.npz"


def panel(screen: Path, *more: str, typed: Any = subprocess.PIPE) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command("stream", "panel", str(screen), *more),
        env=environment(),
        stdin=typed,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def refused(screen: Path, *more: str, typed: str = "") -> str:
    one = panel(screen, *more)
    said = one.communicate(typed, timeout=60)[1]
    assert one.returncode == 2 and "Traceback" not in said, said
    return said


def touch(down: bool, x: float, y: float) -> bytes:
    return padded(b"/dermis/touch") + padded(b",iff") + struct.pack(">iff", down, x, y)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def patient(box: Box) -> str:
    """Return the address of a device that bears the longest silence: watchdogs are not what is tried here."""
    return f"{box.url}?watchdog_ms=80"


def latest(box: Box) -> dict[str, Any]:
    """Return the last of the reports that a device has given by now."""
    last = box.lines.get(timeout=10)
    while not box.lines.empty():
        last = box.lines.get()
    return last


def stroke(port: int, start: float, end: float, seconds: float, rate: float = 200.0) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        for x in np.linspace(start, end, round(seconds * rate)):
            one.sendto(touch(True, float(x), 0.0), ("127.0.0.1", port))
            time.sleep(1 / rate)


def answered(one: subprocess.Popen[str], box: Box, volts: float, draw: Callable[[], object], what: str) -> None:
    """Draw a stroke, and again until the device drives so many volts at the end of one.

    A finger that is silent for 0.2 s counts as lifted: where the machine stood still for as long it has to move again.
    """

    def goes_on() -> None:
        assert one.poll() is None, one.communicate()[1]
        draw()

    goes_on()
    exits.until(lambda: latest(box)["values"]["amplitude"] == pytest.approx(volts, rel=1e-3), goes_on, what)


def until_armed(one: subprocess.Popen[str], box: Box) -> None:
    end = time.monotonic() + 20
    while time.monotonic() < end and one.poll() is None:
        line = box.lines.get(timeout=20)
        if line.get("state") == "armed":
            return
    raise AssertionError(one.communicate()[1])


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_finger_by_osc_is_answered_until_a_signal_brings_0_v(
    number: signal.Signals, screen: Path, boxes: Callable[..., Box]
) -> None:
    box, port = boxes("pty", "native", "electrovibration", every=0.05), free_port()
    one = panel(screen, "--url", patient(box), "--touch", f"osc://:{port}", "--yes")
    until_armed(one, box)
    answered(one, box, FULL, lambda: stroke(port, -0.04, 0.04, 0.8), "uphill")
    answered(one, box, 0.0, lambda: stroke(port, 0.04, -0.04, 0.8), "downhill")
    answered(one, box, FULL, lambda: stroke(port, -0.04, 0.0, 0.6), "uphill again")
    one.send_signal(number)
    out, said = one.communicate(timeout=20)
    assert one.returncode == 0 and "Traceback" not in said, said
    box.safe_at()
    report = box.end()
    assert report["state"] == "safe" and report["values"]["amplitude"] == 0.0
    assert "up to 300 V" in said
    assert re.search(r"touches 1, reports \d+, 0 to 190\.\d V", out), out
    told = re.search(r"latency median ([\d.]+) ms, p95 ([\d.]+) ms", out)
    assert told is not None and float(told[1]) < 5.0, out


@posix
def test_a_finger_on_the_devices_own_panel_is_the_default(screen: Path) -> None:
    one = panel(screen, "--url", "virtual:?finger=1")
    assert one.stdin is not None and one.stderr is not None
    said = ""
    while "Enter: arm" not in said:
        said += (line := one.stderr.readline())
        assert line, said
    one.stdin.write("\n")
    one.stdin.flush()
    time.sleep(4.0)  # the finger takes 3.1 s for a turn
    one.send_signal(signal.SIGINT)
    out, _ = one.communicate(timeout=20)
    assert one.returncode == 0 and "the device's own panel" in said
    assert re.search(r"touches 1, reports \d\d+, 0 to 190\.\d V", out), out


@posix
def test_lines_on_standard_input_are_touches_and_bad_ones_are_counted(screen: Path, boxes: Callable[..., Box]) -> None:
    box = boxes("udp", "osc", "electrovibration", every=0.05)
    one = panel(screen, "--url", box.url, "--protocol", "osc", "--touch", "-", "--yes")
    assert one.stdin is not None

    def draw(down: bool) -> None:
        for x in np.linspace(-40, 30, 120):
            one.stdin.write(f"{x:.3f} 0\n" if down and x < 0 else f"{x:.3f}, 1.0, {down:d}\r\n")
            one.stdin.flush()
            time.sleep(0.005)

    box.lines.get(timeout=20)
    one.stdin.write("hello\n1 2 3 4\nnan 0\n0 0 2\n")
    answered(one, box, FULL, lambda: draw(True), "uphill")
    answered(one, box, 0.0, lambda: draw(False), "the same way, lifted")
    out, said = one.communicate(timeout=20)
    assert one.returncode == 0, "the end of the touches is the end"
    assert "bad touches 4" in out and "touches 1, reports" in out
    assert said.count("not a touch") == 1 and "hello" in said and "in mm" in said
    assert box.end()["values"]["amplitude"] == 0.0


@posix
def test_a_serial_touch_panel_that_is_unplugged_ends_at_0_v(screen: Path, boxes: Callable[..., Box]) -> None:
    import pty
    import tty

    box = boxes("pty", "native", "electrovibration", every=0.05)
    mine, theirs = pty.openpty()
    tty.setraw(theirs)
    one = panel(
        screen, "--url", patient(box), "--touch", f"serial:{os.ttyname(theirs)}?baud=9600", "--unit", "m", "--yes"
    )
    until_armed(one, box)

    def draw() -> None:
        for x in np.linspace(-0.04, 0.0, 100):
            os.write(mine, f"{x:.6f} 0 1\n".encode())
            time.sleep(0.005)

    answered(one, box, FULL, draw, "uphill")
    os.close(theirs)
    os.close(mine)
    out, said = one.communicate(timeout=20)
    assert one.returncode == 2 and "no more touches" in said and "Traceback" not in said
    box.safe_at()
    report = box.end()
    assert report["state"] == "safe" and report["values"]["amplitude"] == 0.0


@posix
def test_what_cannot_be_is_refused_in_words_before_anything_is_armed(screen: Path, tmp_path: Path) -> None:
    url = ("--url", "virtual:")
    assert "no such source" in refused(screen, *url, "--touch", "telepathy")
    assert "not osc://:PORT" in refused(screen, *url, "--touch", "osc://:99999")
    assert "--yes" in refused(screen, *url, "--touch", "-")
    assert "reports no touches" in refused(screen, *url, "--protocol", "maestro")
    assert "no such port" in refused(screen, *url, "--touch", "serial:/dev/ttyNoSuch9")
    assert "unknown option" in refused(screen, *url, "--touch", "serial:/dev/ttyNoSuch9?bau=1")
    assert "cannot be read" in refused(tmp_path / "none.npz", *url)
    assert "needs this channel" in refused(screen, *url, "--device", "haptip")
    assert "0 to 10000 Hz" in refused(screen, *url, "--rate", "-5")
    assert "standard input ended before anybody pressed Enter" in refused(screen, *url)
    assert refused(screen, "--url", "bogus://x", "--yes").count("bogus://x") == 1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        said = refused(screen, *url, "--touch", f"osc://:{taken.getsockname()[1]}")
    assert "cannot be listened for" in said and "Choose another port" in said


@posix
def test_without_a_display_a_mouse_is_refused_in_words(screen: Path) -> None:
    one = subprocess.run(
        command("stream", "panel", str(screen), "--url", "virtual:", "--touch", "mouse", "--yes"),
        env={**environment(), "DISPLAY": ""},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert one.returncode == 2 and "no window can be opened here" in one.stderr and "osc://" in one.stderr
    assert "Traceback" not in one.stderr


MOUSE = """
import sys, time
from core.stream.mouse_touch import MouseTouch
mouse = MouseTouch((0.2, 0.1))
assert mouse.finger(0.0) is None
canvas = mouse._root.winfo_children()[0]
canvas.event_generate("<ButtonPress-1>", x=0, y=0)
touch = mouse.finger(0.0)
assert touch.down and abs(touch.x + 0.1) < 2e-4 and abs(touch.y - 0.05) < 2e-4, touch
canvas.event_generate("<B1-Motion>", x=400, y=200)
touch = mouse.finger(0.0)
assert touch.down and abs(touch.x) < 2e-4 and abs(touch.y) < 2e-4, touch
time.sleep(0.06)
again = mouse.finger(0.0)
assert again is not touch and (again.x, again.y) == (touch.x, touch.y), "a finger that rests is told again"
canvas.event_generate("<ButtonRelease-1>", x=400, y=200)
assert not mouse.finger(0.0).down
mouse.close()
mouse.close()
assert mouse.ended and mouse.finger(0.0) is None
"""


@posix
def test_the_pressed_mouse_is_a_finger() -> None:
    import shutil

    if shutil.which("xvfb-run") is None:
        pytest.skip("no virtual display")
    done = subprocess.run(
        ["xvfb-run", "-a", sys.executable, "-c", MOUSE],
        env={**os.environ, **environment()},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="Linux has 127.0.0.2 without being told")
def test_touches_are_heard_from_this_computer_alone_unless_told() -> None:
    port = free_port()
    near = touch_input(f"osc://:{port}", "mm", (0.1, 0.1))
    assert near is not None and near.name == f"osc://127.0.0.1:{port}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.2", port))  # which a listener at every address would have
    near.close()
    wide = touch_input(f"osc://0.0.0.0:{port}", "mm", (0.1, 0.1))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other, pytest.raises(OSError):
        other.bind(("127.0.0.2", port))
    assert wide is not None
    wide.close()


def test_lines_and_datagrams_that_are_touches() -> None:
    assert touch_of_line(b"1.5 -2", 1e-3) == (True, 0.0015, -0.002)
    assert touch_of_line(b" 1,2,0 ", 1.0) == (False, 1.0, 2.0)
    for line in (b"1", b"1 2 3", b"1 2 1 1", b"inf 0", b"x y", b"\xff 1", b"1 nan 1"):
        with pytest.raises(ValueError):
            touch_of_line(line, 1.0)
    assert list(touches_of_osc(touch(True, 0.25, -0.5))) == [(True, 0.25, -0.5)]
    assert list(touches_of_osc(bundle(1, [touch(True, 0.5, 0.0), touch(False, 0.0, 0.0)]))) == [
        (True, 0.5, 0.0),
        (False, 0.0, 0.0),
    ]
    assert list(touches_of_osc(padded(b"/other") + padded(b",f") + struct.pack(">f", 1.0))) == []
    short = padded(b"/dermis/touch") + padded(b",f") + b"\0" * 4
    for data in (b"", b"#bundle\0", touch(True, float("nan"), 0.0), short):
        with pytest.raises(DermisError):
            list(touches_of_osc(data))
