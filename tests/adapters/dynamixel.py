"""An adapter from outside: Dynamixel servos, protocol 2.0, by one Sync Write of goal positions a sample.

Source: ROBOTIS e-Manual, protocol 2.0: packets, CRC-16, instructions 0x83 (Sync Write) and 0x03 (Write); XL330's
control table: Torque Enable 64, Goal Position 116, Present Position 132, Bus Watchdog 98 (units of 20 ms).
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

HEADER, BROADCAST = b"\xff\xff\xfd\x00", 0xFE
WRITE, SYNC_WRITE, SYNC_READ, STATUS = 0x03, 0x83, 0x82, 0x55
TORQUE, BUS_WATCHDOG, GOAL, PRESENT = 64, 98, 116, 132
TURN = 4096  # counts


def crc(data: bytes) -> int:
    """Return the CRC-16 of a packet: polynomial 0x8005, from 0, highest bit first."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x8005 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def packet(servo: int, instruction: int, parameters: bytes) -> bytes:
    """Return a packet; three header bytes within it are stuffed by a fourth."""
    body = (bytes((instruction,)) + parameters).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = HEADER + bytes((servo,)) + struct.pack("<H", len(body) + 2) + body
    return head + struct.pack("<H", crc(head))


def adapter(api: Any) -> Any:
    """Return the adapter's class."""

    class Dynamixel(api.Adapter):  # type: ignore[misc, name-defined]
        """Dynamixel. Options: `first` servo id."""

        name, title, tells_pose, baud = "dynamixel", "Dynamixel", True, 57_600
        OPTIONS = ("first",)

        def __init__(self, wire: Any, options: Any) -> None:
            super().__init__(wire, options)
            if any(unit != "rad" for unit in wire.units):
                raise api.DermisError("servos turn, so channels are angles", where=wire.spec.name, limit="rad")
            first = self.whole("first", 1, 0, 253 - wire.count)
            self.ids = range(first, first + wire.count)
            self.silence = api.Silence(api.Does.STOPS, 0.1, "board")
            self.command_bytes = len(self.command(wire.safe, 0.0, None)[0])
            self.other_bytes = 10.0 * len(self.ask_pose()[0])
            self._heard, self._asked = b"", -1.0

        def poll(self, now: float) -> list[bytes]:
            if now - self._asked < 0.1:
                return []
            self._asked = now
            return self.ask_pose()

        def ask_pose(self) -> list[bytes]:
            return [packet(BROADCAST, SYNC_READ, struct.pack("<HH", PRESENT, 4) + bytes(self.ids))]

        def arm(self) -> None:
            super().arm()
            both = (BUS_WATCHDOG, 5), (TORQUE, 1)
            self._arming = [packet(i, WRITE, struct.pack("<HB", at, n)) for at, n in both for i in self.ids]

        def command(self, values: Any, now: float, play: float | None) -> list[bytes]:
            counts = np.rint(values * TURN / (2 * np.pi)).astype(int) + TURN // 2
            body = b"".join(struct.pack("<Bi", i, c) for i, c in zip(self.ids, counts.tolist(), strict=True))
            arming, self._arming = getattr(self, "_arming", []), []
            return [*arming, packet(BROADCAST, SYNC_WRITE, struct.pack("<HH", GOAL, 4) + body)]

        def receive(self, data: bytes, now: float) -> None:
            self._heard = (self._heard + data)[-4096:]
            pose = np.full(self.wire.count, np.nan) if self.pose is None else self.pose.copy()
            while (at := self._heard.find(HEADER)) >= 0 and len(self._heard) >= at + 7:
                (size,) = struct.unpack_from("<H", self._heard, at + 5)
                if len(self._heard) < at + 7 + size:
                    break
                whole, self._heard = self._heard[at : at + 7 + size], self._heard[at + 7 + size :]
                if struct.unpack("<H", whole[-2:])[0] == crc(whole[:-2]) and whole[7] == STATUS and size == 8:
                    if whole[8] & 0x7F:
                        self.fault = f"servo {whole[4]} reports the error {whole[8] & 0x7F}"
                    (count,) = struct.unpack_from("<i", whole, 9)
                    pose[whole[4] - self.ids[0]] = (count - TURN // 2) * 2 * np.pi / TURN
            if not np.isnan(pose).any():
                self.pose = pose

    return Dynamixel
