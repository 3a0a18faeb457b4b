"""The same sources compiled for this computer, behind another chip layer and with sanitizers; both boards side by side.

It has no Arduino core and no emulator: firmware/chip_host.h is the chip, firmware/host.c its clock, line and pins.
"""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from tests.unit.stream.firmware_avr import AvrBoard, emulated
from tests.unit.stream.firmware_board import BAUD, SKETCH, SOURCES, WARNINGS, Board, folder

MISSING = [tool for tool in ("gcc", "g++") if shutil.which(tool) is None]
MISSING += [] if sys.platform == "linux" else ["Linux"]
hosted = pytest.mark.skipif(
    bool(MISSING),
    reason=f"THE FIRMWARE WAS NOT TESTED ON THE HOST, for want of {', '.join(MISSING)}: apt install gcc g++",
)
_SANITIZED = ["-g", "-O1", "-fno-omit-frame-pointer", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


CROSS = "arm-linux-gnueabihf"  # the distribution's compiler for ARM, and qemu to run what it makes
CROSS_MISSING = [tool for tool in (f"{CROSS}-gcc", f"{CROSS}-g++", "qemu-arm") if shutil.which(tool) is None]
crossed = pytest.mark.skipif(
    bool(MISSING or CROSS_MISSING),
    reason=f"THE FIRMWARE WAS NOT RUN AS ARM CODE, for want of {', '.join(CROSS_MISSING)}: "
    "apt install g++-arm-linux-gnueabihf qemu-user",
)
CHIPS = {  # ticks, timers and buffers of other chips: chip_rp2040.h, chip_teensy4.h
    "RP2040": ("-DHOST_TICKS_A_US=1", "-DHOST_TIMER_BITS=32", "-DHOST_LINE_BYTES=256"),
    "Teensy 4": ("-DHOST_TICKS_A_US=2", "-DHOST_TIMER_BITS=32", "-DHOST_LINE_BYTES=256"),
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
        command = ["qemu-arm", "-L", f"/usr/{cross}"] if cross else []
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
    """Return the sketch with another chip's ticks, buffers and memory, as ARM code."""
    made = HostBoard(*CHIPS[name], *defines, cross=CROSS, **more)
    made.room = 256
    return made


every_chip = pytest.mark.parametrize(
    "chip",
    [
        pytest.param(AvrBoard, id="ATmega328P", marks=emulated),
        pytest.param(HostBoard, id="host", marks=hosted),
        *(pytest.param(functools.partial(chip_of, name), id=name, marks=crossed) for name in CHIPS),
    ],
)
