"""The firmware on an emulated board: compiled by avr-gcc, run in simavr, its pulses measured in clock cycles.

simavr gives the processor; the serial port is firmware/usart.c, which loses bytes where the chip does.
"""

from __future__ import annotations

import atexit
import functools
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pytest

from core.devices.spec import Channel, DeviceSpec
from core.stream.protocols import adapters
from core.stream.protocols.native import Native
from core.stream.protocols.wire import Wire

ROOT = Path(__file__).resolve().parents[3]
SKETCH = ROOT / "presets" / "firmware" / "dermis_servos" / "dermis_servos.ino"
EMULATOR = [Path(__file__).with_name("firmware") / name for name in ("runner.c", "usart.c")]
ARDUINO = Path(os.environ.get("ARDUINO_AVR", "/usr/share/arduino/hardware/arduino/avr"))
MISSING = [tool for tool in ("avr-gcc", "avr-g++", "avr-nm", "gcc") if shutil.which(tool) is None]
MISSING += [str(p) for p in (ARDUINO / "cores", Path("/usr/include/simavr/sim_avr.h")) if not p.exists()]
emulated = pytest.mark.skipif(
    bool(MISSING),
    reason=f"THE FIRMWARE WAS NOT TESTED, for want of {', '.join(MISSING)}: "
    "apt install gcc gcc-avr avr-libc arduino-core-avr simavr libsimavr-dev",
)

BAUD, ANIMATION_BAUD = 500_000, 115_200
CLOCK = 16e6  # [Hz]


def servos(count: int = 8, slew: float | None = None, **source: Any) -> Wire:
    """Return a wire of servos from -1 to 1 rad."""
    channels = tuple(Channel(f"s{i}", "rad", -1.0, 1.0, slew, 0.0, f"m{i}") for i in range(count))
    return Wire.of(DeviceSpec("servos", "Servos", "test", 50.0, channels, source=source))


def wanted_us(values: np.ndarray) -> np.ndarray:
    """Return the pulses of such servos [us]."""
    return 1500 + 500 * values


@functools.cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="dermis-firmware-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def runner() -> Path:
    """Compile the emulator."""
    path = _folder() / "runner"
    warnings = ["-Wall", "-Wextra", "-Werror"]
    subprocess.run(["gcc", "-O2", *warnings, *map(str, EMULATOR), "-o", str(path), "-lsimavr"], check=True)
    return path


@functools.cache
def firmware(*defines: str, sketch: Path = SKETCH) -> Path:
    """Compile the sketch with the Arduino core; return its ELF file."""
    folder = Path(tempfile.mkdtemp(dir=_folder()))
    core = ARDUINO / "cores" / "arduino"
    flags = ["-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR"]
    flags += ["-Os", "-ffunction-sections", "-fdata-sections", f"-I{core}", f"-I{ARDUINO / 'variants' / 'standard'}"]
    cpp = [*flags, "-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics"]
    own = ["-Wall", "-Wextra", "-Werror", "-x", "c++", *defines]
    jobs = [["avr-g++", *cpp, *own, "-c", str(sketch), "-o", "sketch.o"]]
    jobs += [
        ["avr-gcc", *flags, "-std=gnu11", "-c", str(core / f"{n}.c"), "-o", f"{n}.o"]
        for n in ("wiring", "wiring_digital", "hooks")
    ]
    jobs += [
        ["avr-g++", *cpp, "-c", str(core / f"{n}.cpp"), "-o", f"{n}.o"]
        for n in ("main", "HardwareSerial", "HardwareSerial0", "Print", "abi", "new")
    ]
    for job in jobs:
        subprocess.run(job, cwd=folder, check=True)
    parts = sorted(p.name for p in folder.glob("*.o") if p.name != "sketch.o")
    subprocess.run(["avr-ar", "rcs", "core.a", *parts], cwd=folder, check=True)  # as the Arduino tools do
    link = ["avr-g++", "-mmcu=atmega328p", "-Wl,--gc-sections", "sketch.o", "core.a", "-o", "sketch.elf"]
    subprocess.run(link, cwd=folder, check=True)
    return folder / "sketch.elf"


@functools.cache
def symbols(elf: Path) -> dict[str, int]:
    """Return the addresses of a firmware's symbols; those in memory begin at 0x800000."""
    done = subprocess.run(["avr-nm", str(elf)], check=True, capture_output=True, text=True)
    rows = [line.split() for line in done.stdout.splitlines()]
    return {row[2]: int(row[0], 16) for row in rows if len(row) == 3}


class Board:
    """The emulated board; time passes only in `run`.

    Attributes:
        now: [s] since its power came. pulses: channel, start [s], width [us] of each that has ended.
        levels: pin, level, when [s], for pins 10 to 13. overruns, garbled: bytes that never reached the program.
    """

    def __init__(self, elf: Path, baud: float = BAUD) -> None:
        self.elf = elf
        self.process = subprocess.Popen(
            [str(runner()), str(elf)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.now = 0.0
        self.pulses: list[tuple[int, float, float]] = []
        self.levels: list[tuple[int, int, float]] = []
        self.overruns = self.garbled = 0
        self.answer = ""
        self._command(f"B {baud}")
        self.run(0.02)

    def __enter__(self) -> Board:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.kill()
        self.process.communicate()

    def send(self, data: bytes) -> None:
        """Put bytes on the line, behind those that are still on their way."""
        for start in range(0, len(data), 16_000):
            self._command(f"S {data[start : start + 16_000].hex()}")

    def run(self, seconds: float) -> bytes:
        """Let time pass; return what the board sent meanwhile."""
        self.now += seconds
        return self._command(f"R {seconds * 1e6:.3f}")

    def patch(self, symbol: str, word: int) -> int:
        """Put another instruction where a function begins; return the one that was there."""
        self._command(f"F {symbols(self.elf)[symbol]:x} {word:04x}")
        return int(self.answer, 16)

    def unused(self) -> int:
        """Return how many bytes of memory neither variables nor the stack have touched so far."""
        end = symbols(self.elf)["_end"] - 0x800000
        self._command(f"M {end:x}")
        return int(self.answer) - end

    def widths(self) -> dict[int, float]:
        """Return the last pulse of each channel [us], and forget all."""
        last = {channel: width for channel, _, width in self.pulses}
        self.pulses.clear()
        return last

    def path(self, channel: int, since: float = 0.0) -> list[tuple[float, float]]:
        """Return start [s] and width [us] of a channel's pulses since a moment."""
        return [(start, width) for c, start, width in self.pulses if c == channel and start >= since]

    def _command(self, line: str) -> bytes:
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        sent = bytearray()
        while True:
            words = self.process.stdout.readline().split()
            assert words, "the firmware crashed"
            if words[0] == ".":
                return bytes(sent)
            if words[0] == "U":
                sent += bytes.fromhex(words[1])
            elif words[0] == "P":
                self.pulses.append((int(words[1]) - 2, int(words[2]) / CLOCK, int(words[3]) / CLOCK * 1e6))
            elif words[0] == "L":
                self.levels.append((int(words[1]), int(words[2]), int(words[3]) / CLOCK))
            elif words[0] == "O":
                self.overruns, self.garbled = int(words[1]), int(words[2])
            else:
                self.answer = words[1]


class Sender:
    """The sender's side of the native protocol, on the board's clock."""

    def __init__(self, board: Board, wire: Wire) -> None:
        self.board = board
        made = adapters.make("native", wire, {})
        assert isinstance(made, Native)
        self.adapter = made
        self.adapter.opened(board.now)

    def run(self, seconds: float, step: float = 0.005) -> None:
        """Let time pass, with signs of life."""
        for _ in range(round(seconds / step)):
            for message in self.adapter.poll(self.board.now):
                self.board.send(message)
            answers = self.board.run(step)
            if answers:
                self.adapter.receive(answers, self.board.now)

    def arm(self) -> None:
        """Shake hands and arm."""
        self.run(0.05)
        assert self.adapter.ready, self.adapter.fault
        self.adapter.arm()
        self.run(0.15)
        assert self.adapter.armed, self.adapter.counters

    def command(self, values: Sequence[float] | np.ndarray, play: float | None = None) -> None:
        """Send one command."""
        for message in self.adapter.command(np.asarray(values, float), self.board.now, play):
            self.board.send(message)
