"""The makers' own SDKs of smart servos (.ci/boards.txt): packets that they send, and a port that leads to ours."""

from __future__ import annotations

import importlib.util
import random
import struct
from collections.abc import Iterator
from typing import Any

from core.stream.protocols.bus import dynamixel, feetech

MISSING = "THE MAKERS' SDKS ARE NOT INSTALLED: packets were not compared (see .ci/boards.txt)"


def there() -> bool:
    """Return whether both SDKs are installed."""
    return all(importlib.util.find_spec(name) is not None for name in ("dynamixel_sdk", "scservo_sdk"))


class Port:
    """A port of an SDK: keeps what is written, and answers from a simulated line."""

    def __init__(self, device: Any = None) -> None:
        self.is_using, self.written = False, b""
        self._device, self._answers = device, b""

    def clearPort(self) -> None:  # noqa: N802
        """Forget nothing: answers come only after a question."""

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Take a packet."""
        self.written = bytes(packet)
        if self._device is not None:
            self._answers += b"".join(self._device.feed(self.written, 0.0))
        return len(packet)

    def readPort(self, size: int) -> bytes:  # noqa: N802
        """Return the next bytes of the answers."""
        out, self._answers = self._answers[:size], self._answers[size:]
        return out

    def setPacketTimeout(self, size: float) -> None:  # noqa: N802
        """Wait for nothing."""

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Return True: what is not there does not come."""
        return True


def pairs(count: int, seed: int = 1) -> Iterator[tuple[bytes, bytes]]:
    """Yield packets of the SDKs and ours, for the same random ids, registers and values, `count` of each kind."""
    import dynamixel_sdk
    import scservo_sdk

    rng = random.Random(seed)
    port = Port()
    dxl, sts, scs = dynamixel_sdk.PacketHandler(2.0), scservo_sdk.sms_sts(port), scservo_sdk.scscl(port)
    for _ in range(count):
        ids = sorted(rng.sample(range(253), rng.randint(1, 12)))
        positions = [rng.randrange(-4096, 8192) for _ in ids]
        register, size = rng.randrange(0, 200), rng.randint(1, 49)
        one = ids[0]

        group = dynamixel_sdk.GroupSyncWrite(port, dxl, dynamixel.GOAL, 4)
        rows = {servo: struct.pack("<i", at) for servo, at in zip(ids, positions, strict=True)}
        for servo, data in rows.items():
            group.addParam(servo, list(data))
        yield _sent(port, group.txPacket), dynamixel.sync_write(dynamixel.GOAL, rows)
        read = dynamixel_sdk.GroupSyncRead(port, dxl, register, size)
        for servo in ids:
            read.addParam(servo)
        yield _sent(port, read.txPacket), dynamixel.sync_read(ids, register, size, fast=False)
        yield _sent(port, read.fastSyncReadTxPacket), dynamixel.sync_read(ids, register, size, fast=True)
        yield _sent(port, lambda: dxl.readTx(port, one, register, size)), dynamixel.read(one, register, size)  # noqa: B023

        for handler, order in ((sts, "<"), (scs, ">")):
            group = scservo_sdk.GroupSyncWrite(handler, feetech.GOAL, 2)
            words = {}
            for servo, at in zip(ids, positions, strict=True):
                word = handler.scs_toscs(at, 15) & 0xFFFF
                group.addParam(servo, [handler.scs_lobyte(word), handler.scs_hibyte(word)])
                words[servo] = struct.pack(f"{order}H", -at | feetech.SIGN if at < 0 else at)
            yield _sent(port, group.txPacket), feetech.sync_write(feetech.GOAL, words)
            yield _sent(port, lambda: handler.readTx(one, register, size)), feetech.read(one, register, size)  # noqa: B023
        sync = scservo_sdk.GroupSyncRead(sts, register, size)
        for servo in ids:
            sync.addParam(servo)
        yield _sent(port, sync.txPacket), feetech.sync_read(ids, register, size)


def _sent(port: Port, send: Any) -> bytes:
    port.is_using = False
    send()
    return port.written
