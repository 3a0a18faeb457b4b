"""Feetech servos of the STS, SMS and SCS families.

Source: Feetech's memory tables of the STS and SCS servos, and their protocol manual. The tests compare the packets with
those of the maker's scservo_sdk (`ftservo-python-sdk`). The SCS family has the opposite byte order in words, and no
Sync Read.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping

from ....errors import DermisError
from ..silence import Does, Silence
from .bus_line import Taken, rows, scan
from .questions import Question
from .servo import Answer, Present, Servo
from .servo_bus import ServoBus

HEADER, BROADCAST = b"\xff\xff", 0xFE
PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83

# Memory table: the address of each entry.
MODEL, LOWEST, HIGHEST, TEMPERATURE_LIMIT, MODE = 3, 9, 11, 13, 33
TORQUE, GOAL, POSITION, VOLTAGE, TEMPERATURE, CURRENT = 40, 42, 56, 62, 63, 69
SIGN = 0x8000  # sign bit of a number
AMPERE = 6.5e-3  # [A] one count of current, from other drivers of the STS3215: the maker's SDK states no unit
ERRORS = ("voltage", "encoder", "overheating", "current", "", "overload")  # by bit of the status byte
SERIES: Mapping[str, tuple[int, float, str]] = {  # counts of the range, range [deg], byte order of a word
    "sts": (4096, 360.0, "<"),
    "scs": (1024, 300.0, ">"),
}


def packet(servo: int, instruction: int, parameters: bytes) -> bytes:
    """Return a packet with header and checksum.

    The checksum is the complement of the sum of all bytes after the header.
    """
    body = bytes((servo, len(parameters) + 2, instruction)) + parameters
    return HEADER + body + bytes((~sum(body) & 0xFF,))


def read(servo: int, register: int, size: int) -> bytes:
    """Return a question for registers of one servo."""
    return packet(servo, READ, bytes((register, size)))


def sync_read(ids: Iterable[int], register: int, size: int) -> bytes:
    """Return a question for the same registers of several servos.

    They answer one after the other.
    """
    return packet(BROADCAST, SYNC_READ, bytes((register, size, *ids)))


def sync_write(register: int, data: Mapping[int, bytes]) -> bytes:
    """Return one message that writes the same registers of several servos.

    No servo answers it.
    """
    size = len(next(iter(data.values())))
    return packet(BROADCAST, SYNC_WRITE, bytes((register, size)) + rows(data))


def answers(buffer: bytes) -> tuple[list[Answer], bytes, int]:
    """Return complete answers, unused bytes and the number of damaged answers."""
    return scan(buffer, HEADER, _take)


def _take(data: bytes) -> Taken | None:
    if len(data) < 6:
        return None
    servo, length = data[2], data[3]
    if servo >= BROADCAST or length < 2:  # a third byte 0xFF, an echo of a broadcast, or noise
        return Taken(1, [])
    whole = data[: 4 + length]
    if len(whole) < 4 + length:
        return None
    if ~sum(whole[2:-1]) & 0xFF != whole[-1]:
        return Taken(1, None)
    return Taken(len(whole), [Answer(servo, whole[4], whole[5:-1])])


class Feetech(ServoBus):
    """Feetech servos.

    Options beside those of every bus: `series`: 'sts' (STS, SMS) or 'scs'.
    These servos have no watchdog: in silence they keep their last command.
    """

    name, title = "feetech", "Feetech STS and SCS"
    OPTIONS = (*ServoBus.OPTIONS, "series")
    caution = (
        "These servos have no watchdog: they keep their last command when the computer falls silent. Keep a switch in "
        "their supply at hand."
    )
    DELIVERED = "as delivered id 1 and 1000000 baud"
    IDENTITY, PRESENT, ENABLED = (MODEL, MODE + 1 - MODEL), (TORQUE, CURRENT + 2 - TORQUE), (TORQUE, 1)
    OVERHEAD, TORQUE, GOAL = 6, TORQUE, GOAL

    def _declared_silence(self) -> Silence:
        return Silence(Does.KEEPS)

    def _scale(self) -> tuple[float, int]:
        self.series = self.options.get("series", "sts")
        if self.series not in SERIES:
            raise DermisError(
                "no such family of servos",
                where=f"protocol '{self.name}', series",
                value=self.series,
                limit=", ".join(SERIES),
            )
        counts, degrees, self._order = SERIES[self.series]
        return counts / math.radians(degrees), counts // 2

    def _read_one(self, register: int, size: int, servo: int) -> bytes:
        return read(servo, register, size)

    def _write(self, register: int, data: Mapping[int, bytes]) -> bytes:
        return sync_write(register, data)

    def _asking(self, register: int, size: int) -> list[Question]:
        if self.series == "scs":
            return [self._ask_one(register, size, servo) for servo in self.ids]
        return [Question(sync_read(self.ids, register, size), self.ids, size)]

    def _parse(self, buffer: bytes) -> tuple[list[Answer], bytes, int]:
        return answers(buffer)

    def _number(self, data: bytes, at: int) -> int:
        (value,) = struct.unpack_from(f"{self._order}H", data, at)
        return -(value & ~SIGN) if value & SIGN and self.series == "sts" else value

    def _describe(self, data: bytes) -> Servo:
        number, low, high = (self._number(data, at - MODEL) for at in (MODEL, LOWEST, HIGHEST))
        mode = data[MODE - MODEL] if self.series == "sts" else 0
        fault = ""
        if mode:
            fault = f"its Mode is {mode}. Set it to 0, position, in Feetech's FD program"
        elif not 0 <= low < high < SERIES[self.series][0]:
            fault = (
                f"its angle limits are {low} and {high}, as no servo of this family that turns to positions has. "
                "Take the other series= (sts, scs), or set the limits in Feetech's FD program"
            )
        return Servo(f"{self.series.upper()} model {number}", low, high, data[TEMPERATURE_LIMIT - MODEL], AMPERE, fault)

    def _measured(self, servo: Servo, answer: Answer) -> Present:
        data = answer.data
        position, current = (self._number(data, at - TORQUE) for at in (POSITION, CURRENT))
        stopped = ""
        if answer.error:
            names = ", ".join(name for bit, name in enumerate(ERRORS) if name and answer.error >> bit & 1)
            stopped = f"reports an error ({names or answer.error})"
        elif self.armed and not data[0]:
            stopped = "has switched its torque off"
        return Present(position, current * servo.ampere, float(data[TEMPERATURE - TORQUE]), stopped)

    def _word(self, count: int) -> bytes:
        return struct.pack(f"{self._order}H", -count | SIGN if count < 0 else count)

    def _unarmed(self, answer: Answer) -> str:
        return "" if answer.data[0] == 1 else "its torque stays off"
