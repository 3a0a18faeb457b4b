"""The firmware, compiled by avr-gcc and run in simavr: bytes in, pulse widths out, measured in clock cycles."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.spec import Channel, DeviceSpec
from core.stream import adapter
from core.stream.native import Native
from core.stream.wire import Wire

ROOT = Path(__file__).resolve().parents[2]
SKETCH = ROOT / "presets" / "firmware" / "dermis_servos" / "dermis_servos.ino"
RUNNER = Path(__file__).with_name("firmware") / "runner.c"
ARDUINO = Path(os.environ.get("ARDUINO_AVR", "/usr/share/arduino/hardware/arduino/avr"))
MISSING = [tool for tool in ("avr-gcc", "avr-g++", "gcc") if shutil.which(tool) is None]
MISSING += [str(p) for p in (ARDUINO / "cores", Path("/usr/include/simavr/sim_avr.h")) if not p.exists()]
pytestmark = pytest.mark.skipif(
    bool(MISSING), reason=f"THE FIRMWARE WAS NOT TESTED, for want of {', '.join(MISSING)}: "
    "apt install gcc gcc-avr avr-libc arduino-core-avr simavr libsimavr-dev",
)  # fmt: skip

CHANNELS = 8
US = 16.0  # clock cycles a microsecond
SERVOS = Wire.of(DeviceSpec(
    "servos", "Servos", "test", 50.0,
    tuple(Channel(f"s{i}", "rad", -1.0, 1.0, None, 0.0, f"m{i}") for i in range(CHANNELS)),
))  # fmt: skip
RESOLUTION = 5.0  # a hobby servo's dead band is about 5 us of pulse; the board's own step is 0.5 us


def build(folder: Path, *defines: str) -> Path:
    core = ARDUINO / "cores" / "arduino"
    flags = ["-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR"]
    flags += ["-Os", "-ffunction-sections", "-fdata-sections", f"-I{core}", f"-I{ARDUINO / 'variants' / 'standard'}"]
    cpp = [*flags, "-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics"]
    own = ["-Wall", "-Wextra", "-Werror", "-x", "c++", *defines]
    jobs = [["avr-g++", *cpp, *own, "-c", str(SKETCH), "-o", "sketch.o"]]
    jobs += [["avr-gcc", *flags, "-std=gnu11", "-c", str(core / f"{n}.c"), "-o", f"{n}.o"]
             for n in ("wiring", "wiring_digital", "hooks")]  # fmt: skip
    jobs += [["avr-g++", *cpp, "-c", str(core / f"{n}.cpp"), "-o", f"{n}.o"]
             for n in ("main", "HardwareSerial", "HardwareSerial0", "Print", "abi", "new")]  # fmt: skip
    for job in jobs:
        subprocess.run(job, cwd=folder, check=True)
    objects = sorted(p.name for p in folder.glob("*.o"))
    link = ["avr-g++", "-mmcu=atmega328p", "-Wl,--gc-sections", *objects, "-o", "sketch.elf"]
    subprocess.run(link, cwd=folder, check=True)
    return folder / "sketch.elf"


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runner") / "runner"
    subprocess.run(["gcc", "-O2", str(RUNNER), "-o", str(path), "-lsimavr"], check=True)
    return path


@pytest.fixture(scope="module")
def native_elf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("native"))


@pytest.fixture(scope="module")
def animation_elf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("animation"), "-DDERMIS_SERVO_ANIMATION")


class Board:
    """The emulated board; time passes only in `run`."""

    def __init__(self, runner: Path, elf: Path) -> None:
        self.process = subprocess.Popen([str(runner), str(elf)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.DEVNULL, text=True)  # fmt: skip
        self.now = 0.0
        self.pulses: list[tuple[int, float, float]] = []  # channel, start [s], width [us]
        self.run(0.02)

    def send(self, data: bytes) -> None:
        self._command(f"S {data.hex()}")

    def run(self, seconds: float) -> bytes:
        self.now += seconds
        return self._command(f"R {seconds * 1e6:.3f}")

    def widths(self) -> dict[int, float]:
        """Return the last pulse of each channel [us], and forget all."""
        last = {channel: width for channel, _, width in self.pulses}
        self.pulses.clear()
        return last

    def _command(self, line: str) -> bytes:
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        sent = bytearray()
        while True:
            words = self.process.stdout.readline().split()
            assert words, "the firmware crashed"
            if words == ["."]:
                return bytes(sent)
            if words[0] == "U":
                sent += bytes.fromhex(words[1])
            elif words[0] == "P":
                self.pulses.append((int(words[1]) - 2, int(words[2]) / US * 1e-6, int(words[3]) / US))


@pytest.fixture
def native(runner: Path, native_elf: Path) -> Iterator[Any]:
    board = Board(runner, native_elf)
    yield board
    board.process.kill()
    board.process.wait()


@pytest.fixture
def animation(runner: Path, animation_elf: Path) -> Iterator[Any]:
    board = Board(runner, animation_elf)
    yield board
    board.process.kill()
    board.process.wait()


class Sender:
    """The sender's side of the native protocol, on the board's clock."""

    def __init__(self, board: Board, wire: Wire = SERVOS) -> None:
        self.board = board
        self.adapter = adapter.make("native", wire, {})
        assert isinstance(self.adapter, Native)
        self.adapter.opened(board.now)

    def run(self, seconds: float, step: float = 0.005) -> None:
        for _ in range(round(seconds / step)):
            for message in self.adapter.poll(self.board.now):
                self.board.send(message)
            answers = self.board.run(step)
            if answers:
                self.adapter.receive(answers, self.board.now)

    def arm(self) -> None:
        self.run(0.05)
        assert self.adapter.ready, self.adapter.fault
        self.adapter.arm()
        self.run(0.15)
        assert self.adapter.armed, self.adapter.counters

    def command(self, values: np.ndarray, play: float | None = None) -> None:
        for message in self.adapter.command(values, self.board.now, play):
            self.board.send(message)


def wanted_us(values: np.ndarray) -> np.ndarray:
    return 1500 + 500 * values


def test_no_pulse_before_arming(native: Board) -> None:
    sender = Sender(native)
    sender.run(0.3)
    assert sender.adapter.ready and not native.pulses
    sender.command(np.full(8, 0.5))
    sender.run(0.1)
    assert not native.pulses and sender.adapter.counters["refused: not armed"] == 1
    sender.arm()
    widths = native.widths()
    assert sorted(widths) == list(range(8)) and all(abs(w - 1500) <= 1.0 for w in widths.values())


COUNTS = pytest.mark.parametrize(
    "frames", [pytest.param(60, id="480"), pytest.param(1250, id="10000", marks=pytest.mark.long)]
)


@COUNTS
def test_random_values_reach_the_servos(native: Board, frames: int) -> None:
    sender = Sender(native)
    sender.arm()
    worst, rng = 0.0, np.random.default_rng(1)
    for values in rng.uniform(-1, 1, (frames, 8)):
        sender.command(values)
        sender.run(0.005)
        native.pulses.clear()
        sender.run(0.025, 0.0125)
        widths = native.widths()
        assert sorted(widths) == list(range(8))
        worst = max(worst, max(abs(widths[i] - w) for i, w in enumerate(wanted_us(values))))
    assert worst <= 1.0 <= RESOLUTION, f"{worst} us"
    sender.run(0.1)
    counters = sender.adapter.counters
    assert not counters["lost at the device"] and not counters["damaged at the device"]


@COUNTS
def test_random_values_reach_the_servo_animation_board(animation: Board, frames: int) -> None:
    sender, rng, worst, moved = adapter.make("servo-animation", SERVOS, {}), np.random.default_rng(2), 0.0, 0
    for k, values in enumerate(rng.uniform(-1, 1, (frames, 8))):
        for message in sender.command(values, k * 0.03, None):
            animation.send(message)
        animation.run(0.006)
        animation.pulses.clear()
        animation.run(0.022)
        widths = animation.widths()
        assert sorted(widths) == list(range(8))
        worst = max(worst, max(abs(widths[i] - w) for i, w in enumerate(wanted_us(values))))
    moved = sender.counters["positions moved off the byte 0x3C"]
    assert worst <= 2.5 <= RESOLUTION, worst
    assert moved > 10 or frames < 1000, "four of the thousand positions hold the byte"


def test_silence_ends_in_the_safe_state_within_100_ms(native: Board) -> None:
    """A wire whose safe state is to let go: the pulses end."""
    release = DeviceSpec("r", "R", "t", 50.0, SERVOS.spec.channels, source={"safe": {"reach": "release"}})
    sender = Sender(native, Wire.of(release))
    sender.arm()
    sender.command(np.full(8, 0.5))
    sender.run(0.1)
    native.pulses.clear()
    silent = native.now
    native.run(0.5)
    last = max(start for _, start, _ in native.pulses)
    assert last - silent <= 0.1
    sender.adapter.receive(native.run(0.001), native.now)
    native.pulses.clear()
    sender.run(0.1)
    assert not native.pulses, "and it stays quiet until it is armed again"
    assert "by itself" in sender.adapter.fault


def test_ramp_to_the_safe_pose_at_the_allowed_speed(native: Board) -> None:
    channels = tuple(Channel(f"s{i}", "rad", -1.0, 1.0, 2.0, 0.0, f"m{i}") for i in range(8))
    preset = {"safe": {"reach": "ramp", "values": {"s0": {"value": -0.5, "unit": "rad"}}}}
    sender = Sender(native, Wire.of(DeviceSpec("r", "R", "t", 50.0, channels, source=preset)))
    sender.arm()
    assert abs(native.widths()[0] - 1250) <= 1.0, "before the first command the board stands where it is safe"
    sender.command(np.full(8, 0.5))
    sender.run(0.6)
    assert abs(native.widths()[0] - 1750) <= 1.0
    for message in sender.adapter.safe():
        native.send(message)
    start = native.now
    sender.run(0.8)
    path = [(t - start, w) for channel, t, w in native.pulses if channel == 0]
    assert abs(path[-1][1] - 1250) <= 1.0 and abs(native.pulses[-1][2] - 1500) <= 1.0
    # 2 rad/s of 2 rad in 65535 counts: 65 counts a millisecond once rounded down, 0.9918 us of pulse
    steepest = max((a[1] - b[1]) / (b[0] - a[0]) for a, b in zip(path, path[1:], strict=False))
    assert steepest <= 992 * 22 / 20, steepest  # from one pulse to the next millis() may count 22 of 20 ms
    moved = [t for t, w in path if 1260 < w < 1740]
    assert moved[-1] - moved[0] >= (480 - 2 * 20) / 992, "less the pulses at both ends"


def test_timed_commands_wait_for_their_time(native: Board) -> None:
    sender = Sender(native)
    sender.arm()
    sender.run(0.5)
    play = native.now + 0.06
    sender.command(np.full(8, 0.8), play)
    native.pulses.clear()
    sender.run(0.2)
    turned = [start for channel, start, width in native.pulses if width > 1700]
    assert min(turned) >= play - 0.002 and min(turned) <= play + 0.0225, "from the channel's next pulse on"
    sender.command(np.full(8, -0.8), native.now - 0.01)
    sender.run(0.1)
    assert sender.adapter.counters["late at the device"] == 1 and abs(native.widths()[3] - 1100) <= 1.0


def test_damage_is_refused_and_does_not_spread(native: Board) -> None:
    sender, rng = Sender(native), np.random.default_rng(3)
    sender.arm()
    for k in range(200):
        frame = bytearray(sender.adapter.command(np.full(8, 0.9), native.now, None)[0])
        frame[1 + int(rng.integers(len(frame) - 2))] ^= 1 << int(rng.integers(8))
        native.send(bytes(frame))
        sender.command(np.full(8, -0.5 if k % 2 else 0.5))
        sender.run(0.025, 0.0125)
        assert all(width < 1751 for _, _, width in native.pulses), "a damaged packet was believed"
    native.pulses.clear()
    sender.run(0.03)
    assert all(abs(w - 1250) <= 1.0 for w in native.widths().values())
    assert sender.adapter.counters["damaged at the device"] >= 200


def test_another_sender_is_refused_while_one_is_armed(native: Board) -> None:
    one = Sender(native)
    one.arm()
    two = adapter.make("native", SERVOS, {})
    two.opened(native.now)
    two._session = (one.adapter._session % 255) + 1  # type: ignore[attr-defined]
    for message in two.poll(native.now):
        native.send(message)
    answers = native.run(0.01)
    two.receive(answers, native.now)
    assert not two.ready and "in use by another sender" in two.fault


def test_a_board_with_another_number_of_channels_is_named(native: Board) -> None:
    few = DeviceSpec("few", "Few", "t", 50.0, SERVOS.spec.channels[:3])
    sender = Sender(native, Wire.of(few))
    sender.run(0.1)
    assert "it has 8 channels" in sender.adapter.fault


@pytest.mark.parametrize("count", [1, 2, 6])
def test_as_many_channels_as_the_device_has(count: int, runner: Path, tmp_path: Path) -> None:
    """Fewer than eight: a pulse each 20 ms all the same, and the handshake accepts a preset with as many."""
    wire = Wire.of(DeviceSpec("few", "Few", "t", 50.0, SERVOS.spec.channels[:count]))
    board = Board(runner, build(tmp_path, f"-DDERMIS_CHANNELS={count}"))
    try:
        sender = Sender(board, wire)
        sender.arm()
        wanted = np.linspace(-0.9, 0.9, count)
        sender.command(wanted)
        sender.run(0.05)
        board.pulses.clear()
        sender.run(0.2)
        assert {c for c, _, _ in board.pulses} == set(range(count))
        for channel in range(count):
            mine = [(start, width) for c, start, width in board.pulses if c == channel]
            assert all(abs(width - wanted_us(wanted)[channel]) <= 1.0 for _, width in mine)
            steps = np.diff([start for start, _ in mine])
            assert np.abs(steps - 0.02).max() <= 20e-6, "40000 ticks less the remainder of a division by the channels"
    finally:
        board.process.kill()
        board.process.wait()
