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


@functools.cache
def host() -> Path:
    """Compile the program that loads a sketch."""
    path = folder() / "host"
    source = ["-std=gnu11", "-rdynamic", str(SOURCES / "host.c")]
    subprocess.run(["gcc", *_SANITIZED, *WARNINGS, *source, "-o", str(path), "-ldl"], check=True)
    return path


def compile_for_host(out: Path, *defines: str, chip: str = "chip_host.h") -> subprocess.CompletedProcess[str]:
    """Compile the sketch with all warnings as errors; `chip` is '' where none is named."""
    named = [f'-DDERMIS_CHIP="{chip}"'] if chip else []
    flags = [*_SANITIZED, *WARNINGS, "-Wshadow", "-Wconversion", "-Wpedantic", "-std=c++11", "-fPIC", "-shared"]
    command = [
        "g++",
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
def library(*defines: str) -> Path:
    """Compile the sketch as a library for `host`."""
    path = Path(tempfile.mkdtemp(dir=folder())) / "sketch.so"
    done = compile_for_host(path, *defines)
    assert not done.returncode, done.stderr
    return path


class HostBoard(Board):
    """The sketch on this computer; its clock begins at `start_us`, and `seed` draws where interrupts come."""

    def __init__(self, *defines: str, baud: float = BAUD, start_us: int = 0, seed: int = 1) -> None:
        command = [str(host()), str(library(*defines)), str(start_us), str(seed)]
        super().__init__(command, baud, start_us * 1e-6)

    def hang(self) -> None:
        self._command("H 1")

    def go_on(self) -> None:
        self._command("H 0")

    def kill_pulses(self) -> None:
        self._command("T")


every_chip = pytest.mark.parametrize(
    "chip", [pytest.param(AvrBoard, id="ATmega328P", marks=emulated), pytest.param(HostBoard, id="host", marks=hosted)]
)
