"""The sketch's chip layer: what compiles, what is refused in words, and the same behaviour on chips of other makes."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from core.stream.protocols.packets import Kind
from tests.unit.stream.firmware_avr import compile_sketch, emulated
from tests.unit.stream.firmware_board import SKETCH, SOURCES, WARNINGS, Chip, Sender, errors, servos, wanted_us
from tests.unit.stream.firmware_host import HostBoard, compile_for_host, every_chip, hosted

pytestmark = pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")

OTHER_CHIPS = {
    "ATmega2560": ("atmega2560", 16_000_000, "mega"),  # its interrupts have other names, which were never attached
    "ATmega32U4": ("atmega32u4", 16_000_000, "leonardo"),
    "ATmega328P at 8 MHz": ("atmega328p", 8_000_000, "standard"),  # pulses of 2 to 4 ms
}
REFUSED = {
    "DERMIS_CHANNELS=0": "DERMIS_CHANNELS: a board has one channel at least",
    "DERMIS_CHANNELS=9": "DERMIS_CHANNELS: this chip has fewer servo pins",
    "DERMIS_CHANNELS=264": "DERMIS_CHANNELS: this chip has fewer servo pins",
    "DERMIS_BAUD=460800": "DERMIS_BAUD: the chip's clock does not divide into this rate",
    "DERMIS_BAUD=4000000": "DERMIS_BAUD: the chip's clock does not divide into this rate",
    'DERMIS_ID="THIMBLE"': "DERMIS_ID has eight characters",
    "DERMIS_RELAY_PIN=13": "DERMIS_RELAY_PIN: this pin cannot be the relay's",
    "DERMIS_RELAY_PIN=9": "DERMIS_RELAY_PIN: this pin cannot be the relay's",
}


@emulated
@pytest.mark.parametrize("name", OTHER_CHIPS)
def test_a_chip_that_the_sketch_does_not_know_is_the_only_error(name: str) -> None:
    found = errors(compile_sketch(chip=OTHER_CHIPS[name]).stderr)
    assert len(found) == 1 and "ATmega328P at 16 MHz (Arduino Uno, Nano" in found[0], found


@hosted
def test_neither_is_a_computer_known_unless_it_is_named(tmp_path: Path) -> None:
    found = errors(compile_for_host(tmp_path / "sketch.so", chip="").stderr)
    assert len(found) == 1 and "dermis_servos knows ATmega328P" in found[0], found


@emulated
@pytest.mark.parametrize("define", REFUSED)
def test_limits_are_named_when_they_are_broken(define: str) -> None:
    found = errors(compile_sketch(f"-D{define}").stderr)
    assert found and REFUSED[define] in found[0], found


@emulated
def test_a_relay_has_no_say_in_servo_animation() -> None:
    found = errors(compile_sketch("-DDERMIS_SERVO_ANIMATION", "-DDERMIS_RELAY_PIN=12").stderr)
    assert found and "DERMIS_RELAY_PIN works with the native protocol only" in found[0], found


@emulated
@pytest.mark.parametrize(
    "define",
    ["DERMIS_CHANNELS=1", "DERMIS_BAUD=115200", "DERMIS_BAUD=1000000", "DERMIS_RELAY_PIN=A0", 'DERMIS_ID="THIMBLE1"'],
)
def test_what_the_readme_allows_compiles_without_a_warning(define: str) -> None:
    done = compile_sketch(f"-D{define}")
    assert not done.returncode and not done.stderr


ARM, XTENSA, RISC_V = "arm-none-eabi-g++", "xtensa-lx106-elf-g++", "riscv64-unknown-elf-g++"
ESP32 = ("esp32", "-ffreestanding", "-DARDUINO_ARCH_ESP32")
BARE = {
    "RP2040": (ARM, "rp2040", "-mcpu=cortex-m0plus", "-mthumb", "-DARDUINO_ARCH_RP2040", "-DPICO_RP2040=1"),
    "Teensy 4": (
        *(ARM, "teensy4", "-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16", "-D__IMXRT1062__"),
    ),
    # The distribution's compiler for Xtensa knows the ESP8266's core, not those of ESP32 and ESP32-S3.
    "ESP32": (XTENSA, *ESP32, "-DCONFIG_IDF_TARGET_ESP32=1"),
    "ESP32-S3": (XTENSA, *ESP32, "-DCONFIG_IDF_TARGET_ESP32S3=1"),
    "ESP32-C3": (
        *(RISC_V, *ESP32, "-march=rv32imc", "-mabi=ilp32", "-DCONFIG_IDF_TARGET_ESP32C3=1", "-DDERMIS_CHANNELS=7"),
    ),
}
WIFI = ["ESP32", "ESP32-S3", "ESP32-C3"]


def compile_bare(name: str, *defines: str) -> subprocess.CompletedProcess[str]:
    """Compile the sketch for a chip, as the Arduino tools do, against declarations of its SDK."""
    compiler, folder, *flags = BARE[name]
    flags = [flag for flag in flags if "CHANNELS" not in flag or not any("CHANNELS" in given for given in defines)]
    command = [compiler, *flags, "-O2", "-std=gnu++17", "-fno-exceptions", "-fno-rtti", *WARNINGS, *defines]
    command += [f"-I{SOURCES / folder}", "-x", "c++", "-c", str(SKETCH), "-o", os.devnull]
    return subprocess.run(command, capture_output=True, text=True, check=False)


BARE_MISSING = [compiler for compiler in (ARM, XTENSA, RISC_V) if shutil.which(compiler) is None]
bare = pytest.mark.skipif(
    bool(BARE_MISSING),
    reason=f"RP2040, TEENSY 4 AND ESP32 WERE NOT COMPILED, for want of {', '.join(BARE_MISSING)}: apt install "
    "gcc-arm-none-eabi libstdc++-arm-none-eabi-newlib gcc-xtensa-lx106 gcc-riscv64-unknown-elf",
)


@bare
@pytest.mark.parametrize(
    "defines", [(), ("-DDERMIS_CHANNELS=3", "-DDERMIS_RELAY_PIN=RELAY"), ("-DDERMIS_SERVO_ANIMATION",)]
)
@pytest.mark.parametrize("name", BARE)
def test_it_compiles_for_other_chips_without_a_warning(name: str, defines: tuple[str, ...]) -> None:
    relay = {"ESP32": "13", "ESP32-C3": "10"}.get(name, "12")
    done = compile_bare(name, *(define.replace("RELAY", relay) if "=RELAY" in define else define for define in defines))
    assert not done.returncode and not done.stderr, done.stderr


@bare
@pytest.mark.parametrize("name", BARE)
def test_wi_fi_compiles_for_the_chips_that_have_it_and_is_refused_by_the_others(name: str) -> None:
    done = compile_bare(name, "-DDERMIS_WIFI")
    if name in WIFI:
        assert not done.returncode and not done.stderr, done.stderr
    else:
        assert any("DERMIS_WIFI: the header of this chip has no Wi-Fi" in line for line in errors(done.stderr))


@bare
def test_other_chips_of_the_esp32_family_are_refused() -> None:
    done = compile_bare("ESP32", "-UCONFIG_IDF_TARGET_ESP32")
    assert "dermis_servos knows ESP32, ESP32-S3 and ESP32-C3" in errors(done.stderr)[0]


@bare
def test_only_a_chip_with_i2c_drives_pca9685_boards() -> None:
    sixteen = ("-DDERMIS_PCA9685=1", "-DDERMIS_CHANNELS=16")
    done = compile_bare("RP2040", *sixteen)
    assert not done.returncode and not done.stderr, done.stderr
    done = compile_bare("RP2040", *sixteen, "-DDERMIS_RELAY_PIN=12")
    assert "this pin is the boards' OE" in errors(done.stderr)[0]
    for name in ("Teensy 4", "ESP32"):
        assert "the header of this chip has no I2C" in errors(compile_bare(name, *sixteen).stderr)[0]


@bare
@pytest.mark.parametrize(
    ("name", "pin"), [("RP2040", 9), ("RP2040", 25), ("Teensy 4", 13), ("Teensy 4", 2), ("ESP32", 12)]
)
def test_pins_of_other_chips_that_cannot_be_the_relays(name: str, pin: int) -> None:
    found = errors(compile_bare(name, f"-DDERMIS_RELAY_PIN={pin}").stderr)
    assert found and "this pin cannot be the relay's" in found[0], found


LIMITS = {
    ("HOST_LINE_BYTES=32",): "the longest answer must fit into the line's buffer",
    ("HOST_LINE_BYTES=100",): "a ring's size is a power of two",
    ("HOST_TICKS_A_US=16",): "the pulses' timer runs over within a slot",
    ("HOST_TICKS_A_US=100", "HOST_TIMER_BITS=32"): "so many ticks a pulse do not fit into 32 bits",
    ("HOST_SERVOS=12", "DERMIS_CHANNELS=10"): "the longest pulses of so many do not fit into a round",
    ("HOST_SERVOS=70",): "a CONFIGURE of so many channels needs wider counters",
    ("HOST_QUEUE_BYTES=10",): "not one command fits",
}


@hosted
@pytest.mark.parametrize("defines", LIMITS, ids=" ".join)
def test_limits_of_a_chip_are_named(defines: tuple[str, ...], tmp_path: Path) -> None:
    channels = () if any("CHANNELS" in d for d in defines) else ("-DDERMIS_CHANNELS=4",)
    found = errors(compile_for_host(tmp_path / "sketch.so", *channels, *(f"-D{d}" for d in defines)).stderr)
    assert any(LIMITS[defines] in line for line in found), found


def test_registers_are_in_the_chips_headers_alone() -> None:
    """By their look; that no other source needs any is what its build for the host proves."""
    register = r"\b(?:[A-Z]{2,5}\d[A-Z]?|SREG|UDR0|_BV|ISR|cli|sei|PROGMEM|pgm_\w+|digital\w+|pinMode|micros|millis)\b"
    for path in sorted(SKETCH.parent.glob("*.[hi]*")):
        code = re.sub(r"/\*.*?\*/|//[^\n]*|\"[^\"\n]*\"", "", path.read_text("utf-8"), flags=re.S)
        found = set(re.findall(register, code)) | set(re.findall(r"#include <(?!stdint|string)[^>]*>", code))
        found -= set(re.findall(r"#define (\w+)\(", code))
        assert bool(found) == (path.name.startswith("chip_")), f"{path.name}: {found}"


# -- the same behaviour, whatever the chip is made of

MAKES = {
    "slow timer": ("-DHOST_TICKS_A_US=1",),
    "wide timer, as fast as 32 bits carry": ("-DHOST_TIMER_BITS=32", "-DHOST_TICKS_A_US=64"),
    "wide timer": ("-DHOST_TIMER_BITS=32", "-DHOST_TICKS_A_US=16"),
    "small line": ("-DHOST_LINE_BYTES=64",),
    "large line": ("-DHOST_LINE_BYTES=512",),
    "large queue": ("-DHOST_QUEUE_BYTES=8000",),
    "nine servos": ("-DHOST_SERVOS=9", "-DDERMIS_CHANNELS=9"),
}


@hosted
@pytest.mark.parametrize("name", MAKES)
def test_another_chip_plays_the_same_pulses(name: str) -> None:
    count = 9 if "nine" in name else 8
    tick = 1.0 if "slow" in name else 0.5
    with HostBoard(*MAKES[name]) as board:
        sender, rng = Sender(board, servos(count)), np.random.default_rng(1)
        sender.arm()
        assert sender.adapter.queue == (255 if "queue" in name else 1000 // (4 + 2 * count))
        for values in rng.uniform(-1, 1, (20, count)):
            sender.command(values)
            sender.run(0.005)
            board.pulses.clear()
            sender.run(0.03)
            widths = board.widths()
            assert max(abs(widths[i] - w) for i, w in enumerate(wanted_us(values))) <= tick / 2 + 0.25
        for k in range(sender.adapter.queue):
            sender.command(np.full(count, 0.5), board.now + 0.4 + k * 1e-4)
            sender.run(0.001, 0.001)
        assert not sender.adapter.counters["refused: queue full"] and not board.overruns
        silent = board.now
        board.pulses.clear()
        board.run(0.6)
        for channel in range(count):
            path = np.array(board.path(channel))
            assert abs(path[-1, 1] - 1500) <= 0.75, "the safe pose, by itself"
            assert path[path[:, 1] != path[0, 1]][0, 0] - silent <= 0.1


@hosted
@pytest.mark.parametrize("overflow_us", [2**32, 2**32 * 1000], ids=["microseconds", "milliseconds"])
def test_clocks_that_run_over_are_not_noticed(overflow_us: int) -> None:
    """Under way, with timed commands on both sides of it, and in the silence after it."""
    for before in (0.3, 0.6):
        with HostBoard("-DDERMIS_CHANNELS=2", start_us=overflow_us - round(before * 1e6)) as board:
            sender = Sender(board, servos(2))
            sender.arm()
            for k in range(40):
                sender.command(np.full(2, k / 40), board.now + 0.06)
                sender.run(0.01)
            counters = sender.adapter.counters
            assert sender.adapter.armed and not counters["late at the device"]
            assert not counters["lost at the device"]
            silent = board.now
            board.run(0.5)
            turned = [start for start, width in board.path(0, silent + 0.03) if width < 1700]
            assert 0.03 <= turned[0] - silent <= 0.1 and abs(board.widths()[0] - 1500) <= 1.0


@every_chip
@pytest.mark.parametrize("silence", [20, 50, 80])
def test_the_protocol_s_watchdog_keeps_its_time(chip: Chip, silence: int) -> None:
    """From the last byte of the last valid packet to the first pulse that differs, at most a round of 20 ms later."""
    with chip("-DDERMIS_CHANNELS=2") as board:
        sender = Sender(board, servos(2, safe={"reach": "at_once"}))
        sender.adapter.watchdog_ms = silence
        sender.arm()
        sender.command([0.8, 0.8])
        sender.run(0.05)
        board.send(sender.adapter._pack(Kind.SYNC, b"abcd"))
        board.run(0.001)
        heard = board.now
        board.pulses.clear()
        board.run(0.3)
        first = [min(start for start, width in board.path(c) if width < 1600) - heard for c in range(2)]
        assert all(silence * 1e-3 - 0.001 <= at <= silence * 1e-3 + 0.022 for at in first), first
