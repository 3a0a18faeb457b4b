"""A board that runs the firmware in simulated time: bytes in, bytes and pulses out. Its two kinds are subclasses."""

from __future__ import annotations

import atexit
import functools
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from core.devices.spec import Channel, DeviceSpec
from core.stream.protocols import adapters
from core.stream.protocols.native import Native
from core.stream.protocols.wire import Wire

ROOT = Path(__file__).resolve().parents[3]
SKETCH = ROOT / "presets" / "firmware" / "dermis_servos" / "dermis_servos.ino"
SOURCES = Path(__file__).with_name("firmware")
WARNINGS = ["-Wall", "-Wextra", "-Werror"]
BAUD, ANIMATION_BAUD = 500_000, 115_200
CLOCK = 16e6  # of the cycles in which both kinds of board tell the time [Hz]


def servos(count: int = 8, slew: float | None = None, **source: Any) -> Wire:
    """Return a wire of servos from -1 to 1 rad."""
    channels = tuple(Channel(f"s{i}", "rad", -1.0, 1.0, slew, 0.0, f"m{i}") for i in range(count))
    return Wire.of(DeviceSpec("servos", "Servos", "test", 50.0, channels, source=source))


def wanted_us(values: np.ndarray) -> np.ndarray:
    """Return the pulses of such servos [us]."""
    return 1500 + 500 * values


def errors(text: str) -> list[str]:
    """Return a compiler's errors."""
    return re.findall(r"error: (.*)", text)


@functools.cache
def folder() -> Path:
    """Return a folder for what is compiled, until this process ends."""
    made = Path(tempfile.mkdtemp(prefix="dermis-firmware-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


class Board:
    """A board in simulated time, which passes only in `run`.

    Attributes:
        now: [s] since its power came. pulses: channel, start [s], width [us] of each that has ended.
        levels: pin, level, when [s], of pins that drive no servo.
        overruns, garbled: bytes that never reached the program.
    """

    room = 128  # bytes that wait for the program to take them
    watchdog = 0.25  # the chip's own [s]

    def __init__(self, command: Sequence[str], baud: float, started: float = 0.0) -> None:
        self._errors = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True
        )
        self.now, self._started = 0.0, started
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
        self._errors.close()

    def send(self, data: bytes) -> None:
        """Put bytes on the line, behind those that are still on their way."""
        for start in range(0, len(data), 16_000):
            self._command(f"S {data[start : start + 16_000].hex()}")

    def run(self, seconds: float) -> bytes:
        """Let time pass; return what the board sent meanwhile."""
        self.now += seconds
        return self._command(f"R {seconds * 1e6:.3f}")

    def hang(self) -> None:
        """Let the program's loop stand still, until `go_on`."""
        raise NotImplementedError

    def go_on(self) -> None:
        """Let the loop run again."""
        raise NotImplementedError

    def meet_again(self) -> None:
        """Let the board, which may have begun anew, be spoken to again where that needs a handshake of its own."""

    def kill_pulses(self) -> None:
        """Let the interrupt that makes the pulses do nothing from now on."""
        raise NotImplementedError

    def boards(self, count: int) -> None:
        """Let so many PCA9685 boards answer; others have lost their supply."""
        self._command(f"A {count}")

    def oscillator(self, hz: float) -> None:
        """Set the clock of the PCA9685 boards."""
        self._command(f"Q {hz}")

    def register(self, board: int, at: int) -> int:
        """Return a register of a PCA9685 board."""
        self._command(f"G {board} {at}")
        return int(self.answer)

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
            if not words:
                self._errors.seek(0)
                raise AssertionError(f"the firmware crashed:\n{self._errors.read()[-8000:]}")
            if words[0] == ".":
                return bytes(sent)
            if words[0] == "U":
                sent += bytes.fromhex(words[1])
            elif words[0] == "P":
                self.pulses.append((int(words[1]) - 2, self._time(words[2]), int(words[3]) / CLOCK * 1e6))
            elif words[0] == "L":
                self.levels.append((int(words[1]), int(words[2]), self._time(words[3])))
            elif words[0] == "O":
                self.overruns, self.garbled = int(words[1]), int(words[2])
            else:
                self.answer = words[1]

    def _time(self, cycles: str) -> float:
        return int(cycles) / CLOCK - self._started


Chip = Callable[..., Board]  # takes the sketch's defines, as '-DDERMIS_CHANNELS=2', and the line's `baud`


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
