"""The same sources compiled for this computer, behind another chip layer and with sanitizers; both boards side by side.

It has no Arduino core and no emulator: firmware/chip_host.h is the chip, firmware/host.c its clock, line and pins.
"""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections import deque
from pathlib import Path
from typing import Any

import pytest

from core.stream.protocols.sealed import KEY, HostSeals, pairing_check
from tests.unit.stream.firmware_avr import AvrBoard, emulated
from tests.unit.stream.firmware_board import BAUD, SKETCH, SOURCES, WARNINGS, Board, folder

MISSING = [tool for tool in ("gcc", "g++") if shutil.which(tool) is None]
MISSING += [] if sys.platform == "linux" else ["Linux"]
hosted = pytest.mark.skipif(
    bool(MISSING),
    reason=f"THE FIRMWARE WAS NOT TESTED ON THE HOST, for want of {', '.join(MISSING)}: apt install gcc g++",
)
_SANITIZED = ["-g", "-O1", "-fno-omit-frame-pointer", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


CROSS, RISC_V = "arm-linux-gnueabihf", "riscv64-linux-gnu"  # the distribution's compilers, and qemu for what they make
QEMU = {CROSS: "qemu-arm", RISC_V: "qemu-riscv64"}
CROSS_MISSING = [
    tool
    for cross, qemu in QEMU.items()
    for tool in (f"{cross}-gcc", f"{cross}-g++", qemu)
    if shutil.which(tool) is None
]
crossed = pytest.mark.skipif(
    bool(MISSING or CROSS_MISSING),
    reason=f"THE FIRMWARE WAS NOT RUN AS ARM AND RISC-V CODE, for want of {', '.join(CROSS_MISSING)}: "
    "apt install g++-arm-linux-gnueabihf g++-riscv64-linux-gnu qemu-user",
)
CHIPS = {  # ticks, timers and buffers of other chips: chip_rp2040.h, chip_teensy4.h, chip_esp32.h
    "RP2040": ("-DHOST_TICKS_A_US=1", "-DHOST_TIMER_BITS=32", "-DHOST_LINE_BYTES=256"),
    "Teensy 4": ("-DHOST_TICKS_A_US=2", "-DHOST_TIMER_BITS=32", "-DHOST_LINE_BYTES=256"),
    "ESP32-C3": ("-DHOST_TICKS_A_US=2", "-DHOST_TIMER_BITS=32", "-DHOST_LINE_BYTES=256"),
}


@functools.cache
def host(cross: str = "") -> Path:
    """Compile the program that loads a sketch; `cross`: prefix of another processor's compiler."""
    path = folder() / f"host{cross}"
    if cross:
        sources = [str(SOURCES / name) for name in ("host.c", "pca9685.c")]
        flags = ["-std=gnu11", "-O2", "-rdynamic", *WARNINGS]
        subprocess.run([f"{cross}-gcc", *flags, *sources, "-o", str(path), "-ldl"], check=True)
        return path
    source = ["-std=gnu11", "-rdynamic", str(SOURCES / "host.c"), str(SOURCES / "pca9685.c")]
    subprocess.run(["gcc", *_SANITIZED, *WARNINGS, *source, "-o", str(path), "-ldl"], check=True)
    return path


def compile_for_host(
    out: Path, *defines: str, chip: str = "chip_host.h", cross: str = ""
) -> subprocess.CompletedProcess[str]:
    """Compile the sketch with all warnings as errors; `chip` is '' where none is named."""
    named = [f'-DDERMIS_CHIP="{chip}"'] if chip else []
    sanitized = ["-O2"] if cross else _SANITIZED
    flags = [*sanitized, *WARNINGS, "-Wshadow", "-Wconversion", "-Wpedantic", "-std=c++11", "-fPIC", "-shared"]
    command = [
        f"{cross}-g++" if cross else "g++",
        *flags,
        f"-I{SOURCES}",
        f"-I{SKETCH.parent}",
        *named,
        *defines,
        "-x",
        "c++",
        str(SKETCH),
        "-o",
        str(out),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@functools.cache
def library(*defines: str, cross: str = "") -> Path:
    """Compile the sketch as a library for `host`."""
    path = Path(tempfile.mkdtemp(dir=folder())) / "sketch.so"
    done = compile_for_host(path, *defines, cross=cross)
    assert not done.returncode, done.stderr
    return path


class HostBoard(Board):
    """The sketch on this computer; its clock begins at `start_us`, and `seed` draws where interrupts come.

    `cross`: as code of another processor, which qemu runs.
    """

    def __init__(self, *defines: str, baud: float = BAUD, start_us: int = 0, seed: int = 1, cross: str = "") -> None:
        command = [QEMU[cross], "-L", f"/usr/{cross}"] if cross else []
        command += [str(host(cross)), str(library(*defines, cross=cross)), str(start_us), str(seed)]
        super().__init__(command, baud, start_us * 1e-6)

    def hang(self) -> None:
        self._command("H 1")

    def go_on(self) -> None:
        self._command("H 0")

    def kill_pulses(self) -> None:
        self._command("T")

    def hang_i2c(self, stuck: bool) -> None:
        """Let the I2C bus stand still, or work again."""
        self._command(f"D {int(stuck)}")


def chip_of(name: str, *defines: str, **more: Any) -> Board:
    """Return the sketch with another chip's ticks, buffers and memory, as ARM or RISC-V code."""
    made = HostBoard(*CHIPS[name], *defines, cross=RISC_V if name == "ESP32-C3" else CROSS, **more)
    made.room = 256
    return made


class WifiBoard(HostBoard):
    """The sketch over Wi-Fi, on this computer: real datagrams to a socket of 127.0.0.1, in simulated time.

    It is paired over its simulated USB first. What `send` is given goes into sealed datagrams at the pace of a line, so
    that tests of a line are tests of this, too; `drop` decides which datagrams are lost, each way.
    """

    watchdog = 0.5

    def __init__(self, *defines: str, baud: float = BAUD, **more: Any) -> None:
        self.pace, self.drop = baud, lambda: False
        self.waiting: deque[tuple[float, bytes]] = deque()
        self.seals: HostSeals | None = None
        self.key, self.socket = os.urandom(KEY), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        super().__init__("-DDERMIS_WIFI", *defines, baud=115_200, **more)
        self.pair()
        self.seals = self.opened()

    def __exit__(self, *of: Any) -> None:
        self.socket.close()
        super().__exit__(*of)

    def usb(self, text: str, seconds: float = 0.05) -> str:
        """Say something over USB; return what it says."""
        Board.send(self, text.encode())
        return Board.run(self, seconds).decode()

    def pair(self, network: str = "lab", password: str = "secret") -> None:
        """Pair it, and let it begin anew."""
        said = self.usb(f"pair {self.key.hex()} {network.encode().hex()} {password.encode().hex()}\n")
        assert said == f"paired DERMISU1 {pairing_check(self.key).hex()}\n", said
        Board.run(self, 0.15)
        self._command("N")
        self.port = int(self.answer)
        assert self.port

    def ask(self, datagram: bytes, by: socket.socket | None = None) -> list[bytes]:
        """Send one datagram as it is; return what it answers within 5 ms."""
        (by or self.socket).sendto(datagram, ("127.0.0.1", self.port))
        Board.run(self, 0.005)
        return self.datagrams(by)

    def datagrams(self, by: socket.socket | None = None) -> list[bytes]:
        """Return the datagrams that have come."""
        found = []
        with contextlib.suppress(BlockingIOError):
            while True:
                found.append((by or self.socket).recv(4096))
        return found

    def opened(self) -> HostSeals:
        """Open a session."""
        seals = HostSeals(self.key)
        for _ in range(2):
            for answer in self.ask(seals.ask()):
                seals.unseal(answer)
        assert seals.opened
        return seals

    def meet_again(self) -> None:
        self.waiting.clear()
        self.seals = self.opened()

    def send(self, data: bytes) -> None:
        at = max(self.now, self.waiting[-1][0] if self.waiting else 0.0)
        for start in range(0, len(data), 250):
            part = data[start : start + 250]
            at += 10 * len(part) / self.pace
            self.waiting.append((at, part))

    def run(self, seconds: float) -> bytes:
        out, end = b"", self.now + seconds
        if self.seals is None:
            return super().run(seconds)
        while self.now < end - 1e-9:
            parts = [b""]  # nothing in it for the protocol, so that the host hears the board's clock
            while self.waiting and self.waiting[0][0] <= self.now + 2.5e-4:
                parts.append(self.waiting.popleft()[1])
            for part in parts:
                if not self.drop():
                    self.socket.sendto(self.seals.seal(part), ("127.0.0.1", self.port))
            super().run(min(end - self.now, 5e-4 if self.waiting else 0.02))
            out += b"".join(self.seals.unseal(answer) for answer in self.datagrams() if not self.drop())
        return out


def _made(*chips: Any) -> Any:
    return pytest.mark.parametrize("chip", chips)


LINES = (
    pytest.param(AvrBoard, id="ATmega328P", marks=emulated),
    pytest.param(HostBoard, id="host", marks=hosted),
    *(pytest.param(functools.partial(chip_of, name), id=name, marks=crossed) for name in CHIPS),
)
every_line = _made(*LINES)  # a serial port, or what looks like one
every_chip = _made(*LINES, pytest.param(WifiBoard, id="Wi-Fi", marks=hosted))
