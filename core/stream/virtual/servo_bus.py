"""Simulated smart servos on one line.

They have the registers of a Dynamixel XL330, a Feetech STS3215, or a Feetech servo of the SCS family.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import numpy as np

from ..protocols.bus import dynamixel as dxl
from ..protocols.bus import feetech as fts
from ..protocols.wire import Wire

ROOM = 31.0  # [degC] reported temperature of every servo


class SimulatedServo:
    """The registers and the shaft of a servo.

    While the torque is on, the shaft is at its goal at once.

    Attributes:
        id: id of the servo.
        memory: registers.
        position: position of the shaft [counts].
        error: error byte of its answers.
        heard: time of the last instruction [s].
        held: the shaft is held fast, so it does not follow its goal.
    """

    def __init__(self, servo: int, position: int) -> None:
        self.id, self.position, self.error = servo, position, 0
        self.memory = bytearray(256)
        self.heard = 0.0
        self.held = False

    def word(self, at: int, form: str = "<H") -> int:
        """Return the number in a register; `form`: its format in `struct`."""
        return int(struct.unpack_from(form, self.memory, at)[0])

    def put(self, at: int, value: int, form: str = "<H") -> None:
        """Set the number in a register; `form`: its format in `struct`."""
        struct.pack_into(form, self.memory, at, value)


class ServoBusDevice:
    """Servos on one half-duplex line.

    Args:
        wire: description of the device. stuck: index of a servo that does not move; -1: none.
        first: id of the first servo. twin: id of a second servo, which answers as well; -1: none.
    """

    datagrams = False
    MIDDLE, COUNTS = 2048, 4096 / (2 * math.pi)  # [counts] position of 0 rad, and [counts/rad]
    GOAL, POSITION, TORQUE, FORM = 0, 0, 0, "<H"  # registers, and the format of a position in `struct`

    def __init__(self, wire: Wire, *, stuck: int = -1, first: int = 1, twin: int = -1) -> None:
        self.wire, self._buffer, self.damaged = wire, b"", 0
        counts = np.rint(self.MIDDLE + self.COUNTS * wire.rest).astype(int).tolist()
        self.servos = [self._new(first + k, count) for k, count in enumerate(counts)]
        self._driven = list(self.servos)
        if twin >= 0:
            self.servos.append(self._new(twin, self.MIDDLE + 300))
        if stuck >= 0:
            self.servos[stuck].held = True

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Process received bytes; return the answers in their order."""
        self.tick(now)
        self._buffer += data
        out: list[bytes] = []
        while (instruction := self._instruction()) is not None:
            out += self._do(*instruction, now)
            for servo in self.servos:
                self._move(servo)
        return out

    def tick(self, now: float) -> list[bytes]:
        """Advance to the time `now` [s]; servos do nothing by themselves."""
        return []

    def report(self) -> dict[str, object]:
        """Return the values of the servos, and whether every torque is off."""
        counts = np.array([servo.position for servo in self._driven])
        return {
            "values": self.wire.named((counts - self.MIDDLE) / self.COUNTS),
            "released": not any(servo.memory[self.TORQUE] for servo in self._driven),
            "damaged": self.damaged,
        }

    def _new(self, servo: int, position: int) -> SimulatedServo:
        raise NotImplementedError

    def _instruction(self) -> tuple[int, int, bytes] | None:
        """Take the next instruction from the buffer: id, instruction, parameters.

        None: there is no complete instruction.
        """
        raise NotImplementedError

    def _do(self, servo: int, instruction: int, parameters: bytes, now: float) -> list[bytes]:
        raise NotImplementedError

    def _move(self, servo: SimulatedServo) -> None:
        """Move the shaft to its goal, if the servo can."""
        if servo.memory[self.TORQUE] & 1 and not servo.held and self._obeys(servo):
            servo.position = self._signed(servo.word(self.GOAL, self.FORM))
        self._store(servo)

    def _obeys(self, servo: SimulatedServo) -> bool:
        return True

    def _signed(self, value: int) -> int:
        return value

    def _store(self, servo: SimulatedServo) -> None:
        servo.put(self.POSITION, servo.position, self.FORM)

    def _for(self, ids: bytes) -> list[SimulatedServo]:
        return [servo for wanted in ids for servo in self.servos if servo.id == wanted]

    def _set_rows(self, rows: bytes, size: int, write: Callable[[SimulatedServo, bytes], None]) -> None:
        """Write the rows of a Sync Write, each with an id and `size` register bytes."""
        for k in range(0, len(rows) - size, size + 1):
            for servo in self._for(rows[k : k + 1]):
                write(servo, rows[k + 1 : k + 1 + size])


class DynamixelDevice(ServoBusDevice):
    """Dynamixel servos, by default XL330-M288.

    A servo that its bus watchdog has stopped refuses goals until the watchdog is cleared.

    Args:
        model: model number. fast: whether the servos support Fast Sync Read. mode: Operating Mode.
    """

    GOAL, POSITION, TORQUE, FORM = dxl.GOAL, dxl.POSITION, dxl.TORQUE, "<i"

    def __init__(self, wire: Wire, *, model: int = 1200, fast: bool = True, mode: int = 3, **more: int) -> None:
        self._model, self._fast, self._mode = model, fast, mode
        super().__init__(wire, **more)

    def tick(self, now: float) -> list[bytes]:
        """Stop the servos whose bus watchdog has timed out at the time `now` [s]."""
        for servo in self.servos:
            watch = servo.memory[dxl.BUS_WATCHDOG]
            late = now - servo.heard > watch * dxl.WATCH_UNIT / 1e3
            if servo.memory[dxl.TORQUE] and 0 < watch < 128 and late:
                servo.memory[dxl.BUS_WATCHDOG] = dxl.STOPPED
        return []

    def _new(self, servo: int, position: int) -> SimulatedServo:
        made = SimulatedServo(servo, position)
        made.put(dxl.MODEL, self._model)
        made.memory[dxl.FIRMWARE], made.memory[dxl.MODE], made.memory[dxl.TEMPERATURE_LIMIT] = 52, self._mode, 70
        made.put(dxl.HIGHEST, 4095, "<i")
        made.put(dxl.GOAL, position, "<i")
        made.memory[dxl.TEMPERATURE] = int(ROOM)
        self._store(made)
        return made

    def _instruction(self) -> tuple[int, int, bytes] | None:
        while (at := self._buffer.find(dxl.HEADER)) >= 0 and len(self._buffer) >= at + 10:
            self._buffer = self._buffer[at:]
            servo, length = struct.unpack_from("<BH", self._buffer, 4)
            if len(self._buffer) < 7 + length and length <= dxl.LONGEST:
                return None
            whole = self._buffer[: 7 + length]
            if length < 3 or length > dxl.LONGEST or struct.unpack("<H", whole[-2:])[0] != dxl.crc16(whole[:-2]):
                self.damaged, self._buffer = self.damaged + 1, self._buffer[4:]
                continue
            self._buffer = self._buffer[7 + length :]
            body = whole[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            return servo, body[0], body[1:]
        return None

    def _do(self, servo: int, instruction: int, parameters: bytes, now: float) -> list[bytes]:
        for one in self.servos:
            one.heard = now
        if len(parameters) < 4:
            return []
        at, size = struct.unpack_from("<HH", parameters)
        if instruction == dxl.READ:
            return [self._status(one, at, size) for one in self._for(bytes((servo,)))]
        if instruction == dxl.SYNC_READ:
            return [self._status(one, at, size) for one in self._for(parameters[4:])]
        if instruction == dxl.FAST_SYNC_READ and self._fast:
            asked = self._for(parameters[4:])
            whole = dxl.HEADER + struct.pack("<BHB", dxl.BROADCAST, 1 + len(asked) * (size + 4), dxl.STATUS)
            for one in asked:
                whole += bytes((one.error, one.id)) + one.memory[at : at + size]
                whole += struct.pack("<H", dxl.crc16(whole))
            return [whole]
        if instruction == dxl.SYNC_WRITE:
            self._set_rows(parameters[4:], size, lambda one, data: self._set(one, at, data))
        return []

    def _status(self, servo: SimulatedServo, at: int, size: int) -> bytes:
        return dxl.packet(servo.id, dxl.STATUS, bytes((servo.error,)) + bytes(servo.memory[at : at + size]))

    def _set(self, servo: SimulatedServo, at: int, data: bytes) -> None:
        stopped = servo.memory[dxl.BUS_WATCHDOG] == dxl.STOPPED
        if at == dxl.GOAL and len(data) == 4:
            (goal,) = struct.unpack("<i", data)
            low, high = servo.word(dxl.LOWEST, "<i"), servo.word(dxl.HIGHEST, "<i")
            if stopped or (self._mode == 3 and not low <= goal <= high):
                return
        elif at == dxl.BUS_WATCHDOG and stopped and data[0]:
            return
        elif at == dxl.TORQUE and data[0] and not servo.memory[dxl.TORQUE]:
            servo.put(dxl.GOAL, servo.position, "<i")  # with the torque on, a servo's first goal is its position
        servo.memory[at : at + len(data)] = data

    def _obeys(self, servo: SimulatedServo) -> bool:
        return servo.memory[dxl.BUS_WATCHDOG] != dxl.STOPPED


class FeetechDevice(ServoBusDevice):
    """Feetech STS3215 servos, or servos of the SCS family.

    They have no watchdog. A servo whose torque is switched on moves to its last goal.

    Args:
        scs: whether the servos are of the SCS family, which has 1024 counts, the opposite byte order and no Sync Read.
    """

    GOAL, POSITION, TORQUE = fts.GOAL, fts.POSITION, fts.TORQUE

    def __init__(self, wire: Wire, *, scs: bool = False, **more: int) -> None:
        self._scs = scs
        counts, degrees, self.FORM = fts.SERIES["scs" if scs else "sts"]
        self.FORM += "H"
        self.MIDDLE, self.COUNTS = counts // 2, counts / math.radians(degrees)
        super().__init__(wire, **more)

    def _new(self, servo: int, position: int) -> SimulatedServo:
        made = SimulatedServo(servo, position)
        made.put(fts.MODEL, 777, self.FORM)
        made.put(fts.HIGHEST, 2 * self.MIDDLE - 1, self.FORM)
        made.put(fts.GOAL, self.MIDDLE, self.FORM)
        made.memory[fts.TEMPERATURE_LIMIT], made.memory[fts.TEMPERATURE] = 70, int(ROOM)
        self._store(made)
        return made

    def _instruction(self) -> tuple[int, int, bytes] | None:
        while (at := self._buffer.find(fts.HEADER)) >= 0 and len(self._buffer) >= at + 6:
            self._buffer = self._buffer[at:]
            servo, length = self._buffer[2], self._buffer[3]
            if servo > fts.BROADCAST or length < 2:
                self._buffer = self._buffer[1:]
                continue
            whole = self._buffer[: 4 + length]
            if len(whole) < 4 + length:
                return None
            if ~sum(whole[2:-1]) & 0xFF != whole[-1]:
                self.damaged, self._buffer = self.damaged + 1, self._buffer[1:]
                continue
            self._buffer = self._buffer[4 + length :]
            return servo, whole[4], whole[5:-1]
        return None

    def _do(self, servo: int, instruction: int, parameters: bytes, now: float) -> list[bytes]:
        asked = self._for(bytes((servo,)))
        if instruction == fts.PING:
            return [self._status(one, 0, 0) for one in asked]
        if len(parameters) < 2:
            return []
        at, size = parameters[0], parameters[1]
        if instruction == fts.WRITE:
            for one in asked:
                one.memory[at : at + len(parameters) - 1] = parameters[1:]
            return [self._status(one, 0, 0) for one in asked]
        if instruction == fts.READ:
            return [self._status(one, at, size) for one in asked]
        if instruction == fts.SYNC_READ and not self._scs:
            return [self._status(one, at, size) for one in self._for(parameters[2:])]
        if instruction == fts.SYNC_WRITE:

            def write(one: SimulatedServo, data: bytes) -> None:
                one.memory[at : at + size] = data

            self._set_rows(parameters[2:], size, write)
        return []

    def _status(self, servo: SimulatedServo, at: int, size: int) -> bytes:
        return fts.packet(servo.id, servo.error, bytes(servo.memory[at : at + size]))

    def _signed(self, value: int) -> int:
        return -(value & ~fts.SIGN) if value & fts.SIGN and not self._scs else value

    def _store(self, servo: SimulatedServo) -> None:
        at = servo.position
        servo.put(self.POSITION, -at | fts.SIGN if at < 0 else at, self.FORM)
