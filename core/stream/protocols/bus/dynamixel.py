"""Dynamixel servos of the X and MX families, protocol 2.0.

Source: ROBOTIS e-Manual, 'DYNAMIXEL Protocol 2.0' (packets, CRC-16, stuffing) and the control tables of the X series.
The tests compare the packets with those of the maker's dynamixel_sdk.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping

from ..silence import Does, Silence
from .bus_line import Taken, rows, scan
from .questions import Question
from .servo import Answer, Present, Servo
from .servo_bus import ServoBus

HEADER, BROADCAST = b"\xff\xff\xfd\x00", 0xFE
READ, WRITE, STATUS, SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x02, 0x03, 0x55, 0x82, 0x83, 0x8A
LONGEST = 1024  # [bytes] longest packet of the maker's SDK

# Control table: the address of each entry.
MODEL, FIRMWARE, MODE, TEMPERATURE_LIMIT, HIGHEST, LOWEST = 0, 6, 11, 31, 48, 52
TORQUE, ERRORS, BUS_WATCHDOG, GOAL, CURRENT, POSITION, VOLTAGE, TEMPERATURE = 64, 70, 98, 116, 126, 132, 144, 146
TURN, MIDDLE = 4096, 2048  # [counts] a whole turn, and the middle position
WATCH_UNIT = 20  # [ms] unit of the bus watchdog
STOPPED = 0xFF  # value of the bus watchdog once it has stopped the servo
POSITION_MODES = (3, 4, 5)  # position, extended position, current-based position

# [A] one count of current: 'Present Current(126)' and 'Goal Current(102)' of each model's page in the e-Manual. NaN:
# the model measures the load alone, or its page was not consulted.
_1, _134, _269 = 1.0e-3, 1.34e-3, 2.69e-3
MODELS: Mapping[int, tuple[str, float]] = {
    30: ("MX-28", math.nan),
    311: ("MX-64", math.nan),
    321: ("MX-106", math.nan),
    1000: ("XH430-W350", _269),
    1010: ("XH430-W210", _269),
    1020: ("XM430-W350", _269),
    1030: ("XM430-W210", _269),
    1040: ("XH430-V350", _134),
    1050: ("XH430-V210", _134),
    1060: ("XL430-W250", math.nan),
    1070: ("XC430-W150", math.nan),
    1080: ("XC430-W240", math.nan),
    1090: ("2XL430-W250", math.nan),
    1100: ("XH540-W270", _269),
    1110: ("XH540-W150", _269),
    1120: ("XM540-W270", _269),
    1130: ("XM540-W150", _269),
    1160: ("2XC430-W250", math.nan),
    1190: ("XL330-M077", _1),
    1200: ("XL330-M288", _1),
    1210: ("XC330-T181", _1),
    1220: ("XC330-T288", _1),
    1230: ("XC330-M181", _1),
    1240: ("XC330-M288", _1),
}
HARDWARE = ("input voltage", "", "overheating", "motor encoder", "electrical shock", "overload")  # by bit of ERRORS


def _table() -> tuple[int, ...]:
    out = []
    for value in range(256):
        rest = value << 8
        for _ in range(8):
            rest = (rest << 1 ^ 0x8005 if rest & 0x8000 else rest << 1) & 0xFFFF
        out.append(rest)
    return tuple(out)


_CRC = _table()


def crc16(data: bytes) -> int:
    """Return the CRC-16 of a packet.

    Its polynomial is 0x8005, its initial value 0, and the highest bit comes first.
    """
    rest = 0
    for byte in data:
        rest = rest << 8 & 0xFFFF ^ _CRC[rest >> 8 ^ byte]
    return rest


def packet(servo: int, instruction: int, parameters: bytes) -> bytes:
    """Return a packet with header, byte stuffing and CRC.

    If the first three bytes of a header occur within the packet, a stuffed byte follows them, so that they cannot be
    taken for a header.
    """
    body = (bytes((instruction,)) + parameters).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    whole = HEADER + struct.pack("<BH", servo, len(body) + 2) + body
    return whole + struct.pack("<H", crc16(whole))


def read(servo: int, register: int, size: int) -> bytes:
    """Return a question for registers of one servo."""
    return packet(servo, READ, struct.pack("<HH", register, size))


def sync_read(ids: Iterable[int], register: int, size: int, *, fast: bool) -> bytes:
    """Return a question for the same registers of several servos.

    `fast`: all of them answer in one packet.
    """
    return packet(BROADCAST, FAST_SYNC_READ if fast else SYNC_READ, struct.pack("<HH", register, size) + bytes(ids))


def sync_write(register: int, data: Mapping[int, bytes]) -> bytes:
    """Return one message that writes the same registers of several servos.

    No servo answers it.
    """
    size = len(next(iter(data.values())))
    return packet(BROADCAST, SYNC_WRITE, struct.pack("<HH", register, size) + rows(data))


def answers(buffer: bytes, size: int) -> tuple[list[Answer], bytes, int]:
    """Return complete answers, unused bytes and the number of damaged answers.

    Args:
        buffer: received bytes. size: number of registers of each servo in the answer to a fast question.
    """

    def take(data: bytes) -> Taken | None:
        if len(data) < 11:
            return None
        servo, length, instruction = struct.unpack_from("<BHB", data, 4)
        if instruction != STATUS or not 4 <= length <= LONGEST:  # another program's question, an echo, or noise
            return Taken(4, [])
        whole = data[: 7 + length]
        if len(whole) < 7 + length:
            return None
        if struct.unpack("<H", whole[-2:])[0] != crc16(whole[:-2]):
            return Taken(4, None)
        body = whole[8:]
        if servo != BROADCAST:
            plain = body[:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            return Taken(len(whole), [Answer(servo, plain[0], plain[1:])])
        starts = range(0, len(body) - size - 3, size + 4)  # error, id, registers, CRC up to there
        return Taken(len(whole), [Answer(body[k + 1], body[k], body[k + 2 : k + 2 + size]) for k in starts])

    return scan(buffer, HEADER, take)


class Dynamixel(ServoBus):
    """Dynamixel servos.

    Options beside those of every bus: `watchdog_ms`: time after which a servo stops in silence [ms].
    In silence the bus watchdog stops a servo at its present position, which it holds with torque. The watchdog is
    switched on by Arm.
    """

    name, title = "dynamixel", "Dynamixel"
    OPTIONS = (*ServoBus.OPTIONS, "watchdog_ms")
    caution = (
        "In silence these servos stop where they are and hold on with their torque: a finger that is pressed stays "
        "pressed. Keep a switch in their supply at hand."
    )
    faster = "Set 'Baud Rate' of every servo to 1 Mbps in Dynamixel Wizard, and connect without ?baud="
    DELIVERED = "as delivered id 1 and 57600 baud"
    IDENTITY, PRESENT, ENABLED = (MODEL, ERRORS + 1), (BUS_WATCHDOG, TEMPERATURE + 1 - BUS_WATCHDOG), (TORQUE, 7)
    OVERHEAD, TORQUE, GOAL = 11, TORQUE, GOAL
    fast = True

    def _declared_silence(self) -> Silence:
        self._watch = self.whole("watchdog_ms", 100, 40, 127 * WATCH_UNIT) // WATCH_UNIT
        return Silence(Does.STOPS, self._watch * WATCH_UNIT / 1e3, "board")

    def _scale(self) -> tuple[float, int]:
        return TURN / (2 * math.pi), MIDDLE

    def _read_one(self, register: int, size: int, servo: int) -> bytes:
        return read(servo, register, size)

    def _write(self, register: int, data: Mapping[int, bytes]) -> bytes:
        return sync_write(register, data)

    def _asking(self, register: int, size: int) -> list[Question]:
        return [Question(sync_read(self.ids, register, size, fast=self.fast), self.ids, size)]

    def _without_fast(self) -> bool:
        had, self.fast = self.fast, False
        self.notice += ". Fast Sync Read is not answered, so Sync Read is used: update the firmware of the servos"
        return had

    def _parse(self, buffer: bytes) -> tuple[list[Answer], bytes, int]:
        return answers(buffer, self.questions.open.size if self.questions.open is not None else self.PRESENT[1])

    def _describe(self, data: bytes) -> Servo:
        number, mode, hottest = struct.unpack_from("<H", data, MODEL)[0], data[MODE], data[TEMPERATURE_LIMIT]
        high, low = struct.unpack_from("<ii", data, HIGHEST)
        if number not in MODELS:
            return Servo("", 0, 0, 0, fault=f"its model number is {number}, which is none of the X and MX families")
        model, ampere = MODELS[number]
        fault = ""
        if mode not in POSITION_MODES:
            fault = f"its Operating Mode is {mode}. Set it to 3, position control, in Dynamixel Wizard"
        elif data[ERRORS]:
            names = ", ".join(n for bit, n in enumerate(HARDWARE) if n and data[ERRORS] >> bit & 1)
            fault = f"it reports a hardware error ({names}). Remove the cause, then switch its supply off and on"
        if mode != 3:
            low, high = -(256 * TURN), 256 * TURN  # the servo's position limits apply in mode 3 alone
        return Servo(model, low, high, hottest, ampere, fault)

    def _measured(self, servo: Servo, answer: Answer) -> Present:
        data, at = answer.data, BUS_WATCHDOG
        (current,), (position,) = (
            struct.unpack_from(form, data, k - at) for form, k in (("<h", CURRENT), ("<i", POSITION))
        )
        stopped = ""
        if answer.error & 0x80:
            stopped = "reports a hardware error, so its motor is off. Connect again to read which"
        elif data[0] == STOPPED and self.armed:
            stopped = f"has heard nothing for {self._watch * WATCH_UNIT} ms, so its bus watchdog has stopped it"
        elif data[0] != self._watch and self.armed:
            stopped = "was reset, so its torque and its bus watchdog are off. Check its supply"
        return Present(position, current * servo.ampere, float(data[TEMPERATURE - at]), stopped)

    def _word(self, count: int) -> bytes:
        return struct.pack("<i", count)

    def _revived(self) -> list[bytes]:
        """Return messages that clear the watchdog's error and start it again.

        Until the error is cleared, a servo refuses goals.
        """
        return [self._all(BUS_WATCHDOG, 0), self._all(BUS_WATCHDOG, self._watch)]

    def _unarmed(self, answer: Answer) -> str:
        if answer.error & 0x80 or answer.data[ERRORS - TORQUE]:
            return "it reports a hardware error"
        return "" if answer.data[0] == 1 else "its torque stays off"
