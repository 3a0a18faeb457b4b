"""The sketch on an emulated ATmega328P: compiled by avr-gcc, run in simavr, its pulses measured in clock cycles.

simavr gives the processor; the serial port is firmware/usart.c, which loses bytes where the chip does.
"""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

from tests.unit.stream.firmware_board import BAUD, SKETCH, SOURCES, WARNINGS, Board, folder

ARDUINO = Path(os.environ.get("ARDUINO_AVR", "/usr/share/arduino/hardware/arduino/avr"))
MISSING = [tool for tool in ("avr-gcc", "avr-g++", "avr-nm", "gcc") if shutil.which(tool) is None]
MISSING += [str(p) for p in (ARDUINO / "cores", Path("/usr/include/simavr/sim_avr.h")) if not p.exists()]
emulated = pytest.mark.skipif(
    bool(MISSING),
    reason=f"THE FIRMWARE WAS NOT TESTED, for want of {', '.join(MISSING)}: "
    "apt install gcc gcc-avr avr-libc arduino-core-avr simavr libsimavr-dev",
)
UNO = ("atmega328p", 16_000_000, "standard")  # chip, clock [Hz], pins
_HANG = 0xCFFF  # rjmp to itself
_RETI = 0x9518
_TIMER_1 = "__vector_11"


@functools.cache
def runner() -> Path:
    """Compile the emulator."""
    path = folder() / "runner"
    sources = [str(SOURCES / name) for name in ("runner.c", "usart.c", "pca9685.c")]
    subprocess.run(["gcc", "-O2", *WARNINGS, *sources, "-o", str(path), "-lsimavr"], check=True)
    return path


def _flags(chip: str, clock: int, pins: str) -> list[str]:
    core = ARDUINO / "cores" / "arduino"
    flags = [f"-mmcu={chip}", f"-DF_CPU={clock}L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR"]
    return [*flags, "-Os", "-ffunction-sections", "-fdata-sections", f"-I{core}", f"-I{ARDUINO / 'variants' / pins}"]


_CPP = ["-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics"]


def compile_sketch(*defines: str, chip: tuple[str, int, str] = UNO) -> subprocess.CompletedProcess[str]:
    """Compile the sketch alone, as the Arduino tools do, with all warnings as errors."""
    out = ["-x", "c++", "-c", str(SKETCH), "-o", os.devnull]
    command = ["avr-g++", *_flags(*chip), *_CPP, *WARNINGS, *defines, *out]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@functools.cache
def firmware(*defines: str) -> Path:
    """Compile the sketch with the Arduino core; return its ELF file."""
    made = Path(tempfile.mkdtemp(dir=folder()))
    core, flags = ARDUINO / "cores" / "arduino", _flags(*UNO)
    jobs = [["avr-g++", *flags, *_CPP, *WARNINGS, *defines, "-x", "c++", "-c", str(SKETCH), "-o", "sketch.o"]]
    jobs += [
        ["avr-gcc", *flags, "-std=gnu11", "-c", str(core / f"{n}.c"), "-o", f"{n}.o"]
        for n in ("wiring", "wiring_digital", "hooks")
    ]
    jobs += [
        ["avr-g++", *flags, *_CPP, "-c", str(core / f"{n}.cpp"), "-o", f"{n}.o"]
        for n in ("main", "HardwareSerial", "HardwareSerial0", "Print", "abi", "new")
    ]
    for job in jobs:
        subprocess.run(job, cwd=made, check=True)
    parts = sorted(p.name for p in made.glob("*.o") if p.name != "sketch.o")
    subprocess.run(["avr-ar", "rcs", "core.a", *parts], cwd=made, check=True)  # as the Arduino tools do
    link = ["avr-g++", "-mmcu=atmega328p", "-Wl,--gc-sections", "sketch.o", "core.a", "-o", "sketch.elf"]
    subprocess.run(link, cwd=made, check=True)
    return made / "sketch.elf"


@functools.cache
def symbols(elf: Path) -> dict[str, int]:
    """Return the addresses of a firmware's symbols; those in memory begin at 0x800000."""
    done = subprocess.run(["avr-nm", str(elf)], check=True, capture_output=True, text=True)
    rows = [line.split() for line in done.stdout.splitlines()]
    return {row[2]: int(row[0], 16) for row in rows if len(row) == 3}


class AvrBoard(Board):
    """An Arduino Uno."""

    def __init__(self, *defines: str, baud: float = BAUD) -> None:
        self.elf = firmware(*defines)
        self._loop = ""
        super().__init__([str(runner()), str(self.elf)], baud)

    def hang(self) -> None:
        self._loop = self._patch("loop", f"{_HANG:04x}")

    def go_on(self) -> None:
        self._patch("loop", self._loop)

    def kill_pulses(self) -> None:
        self._patch(_TIMER_1, f"{_RETI:04x}")

    def unused(self) -> int:
        """Return how many bytes of memory neither variables nor the stack have touched so far."""
        end = symbols(self.elf)["_end"] - 0x800000
        self._command(f"M {end:x}")
        return int(self.answer) - end

    def _patch(self, symbol: str, word: str) -> str:
        """Put another instruction where a function begins; return the one that was there."""
        self._command(f"F {symbols(self.elf)[symbol]:x} {word}")
        return self.answer
