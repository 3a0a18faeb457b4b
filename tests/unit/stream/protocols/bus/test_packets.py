"""Packets of smart servos against the makers' SDKs, and the simulated servos read by them."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from core.presets import Library
from core.stream.protocols.bus import dynamixel, feetech
from core.stream.protocols.wire import Wire
from core.stream.virtual.servo_bus import DynamixelDevice, FeetechDevice
from tests import servo_sdks

sdks = pytest.mark.skipif(not servo_sdks.there(), reason=servo_sdks.MISSING)
CABLE = Wire.of(Library().device("cable_platform"))
HAPTIP = Wire.of(Library().device("haptip"))


@sdks
def test_packets_are_those_of_the_makers() -> None:
    compared = 0
    for theirs, ours in servo_sdks.pairs(1500):
        assert theirs.hex(" ") == ours.hex(" ")
        compared += 1
    assert compared == 1500 * 9


def test_the_makers_own_examples() -> None:
    """ROBOTIS e-Manual, protocol 2.0: Ping, Read and Write; the check value of the CRC; a stuffed packet by hand."""
    assert dynamixel.packet(1, 1, b"").hex(" ") == "ff ff fd 00 01 03 00 01 19 4e"
    assert dynamixel.read(1, 132, 4).hex(" ") == "ff ff fd 00 01 07 00 02 84 00 04 00 1d 15"
    written = dynamixel.packet(1, dynamixel.WRITE, struct.pack("<Hi", 116, 512))
    assert written.hex(" ") == "ff ff fd 00 01 09 00 03 74 00 00 02 00 00 ca 89"
    assert dynamixel.crc16(b"123456789") == 0xFEE8  # CRC-16/UMTS
    stuffed = dynamixel.packet(1, dynamixel.STATUS, b"\0\xff\xff\xfd\x00\x01")
    assert stuffed[7:-2] == bytes.fromhex("55 00 ff ff fd fd 00 01") and stuffed[5] == 10
    assert dynamixel.answers(stuffed, 4)[0][0].data == b"\xff\xff\xfd\x00\x01"
    assert feetech.packet(1, 1, b"").hex(" ") == "ff ff 01 02 01 fb"  # Feetech's protocol manual: Ping


@sdks
@pytest.mark.parametrize("fast", [False, True])
def test_the_maker_reads_a_simulated_dynamixel(fast: bool) -> None:
    import dynamixel_sdk

    device = DynamixelDevice(CABLE)
    for servo, position in zip(device.servos, (0, 0x00FDFFFF, -7), strict=True):
        servo.position = position
        device._store(servo)
    port = servo_sdks.Port(device)
    group = dynamixel_sdk.GroupSyncRead(port, dynamixel_sdk.PacketHandler(2.0), dynamixel.BUS_WATCHDOG, 49)
    for servo in (1, 2, 3):
        group.addParam(servo)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == 0
    read = [group.getData(servo, dynamixel.POSITION, 4) for servo in (1, 2, 3)]
    assert read == [0, 0x00FDFFFF, 2**32 - 7]
    assert [group.getData(servo, dynamixel.TEMPERATURE, 1) for servo in (1, 2, 3)] == [31] * 3


@sdks
def test_the_maker_reads_and_drives_simulated_feetech_servos() -> None:
    import scservo_sdk

    device = FeetechDevice(HAPTIP)
    port = servo_sdks.Port(device)
    handler = scservo_sdk.sms_sts(port)
    assert handler.ping(2)[:2] == (777, 0) and handler.ReadPos(1)[0] == 2048
    handler.SyncWritePosEx(1, 1000, 0, 0)
    handler.groupSyncWrite.txPacket()
    assert handler.ReadPos(1)[0] == 2048, "its torque is off"
    assert handler.write1ByteTxRx(1, feetech.TORQUE, 1) == (0, 0)
    assert handler.ReadPos(1)[0] == 1000
    other = servo_sdks.Port(FeetechDevice(HAPTIP, scs=True))
    assert scservo_sdk.scscl(other).ReadPos(1)[0] == 512


@pytest.mark.parametrize("module", [dynamixel, feetech])
def test_answers_come_in_any_portions_between_rubbish_and_never_with_a_wrong_bit(module: object) -> None:
    rng = np.random.default_rng(3)

    def parse(data: bytes) -> tuple[list, bytes, int]:
        return dynamixel.answers(data, 4) if module is dynamixel else feetech.answers(data)

    def status(servo: int, data: bytes) -> bytes:
        if module is dynamixel:
            return dynamixel.packet(servo, dynamixel.STATUS, b"\0" + data)
        return feetech.packet(servo, 0, data)

    for _ in range(300):
        wanted = [(int(rng.integers(1, 200)), rng.bytes(int(rng.integers(1, 20)))) for _ in range(3)]
        stream = b"\x01\x02\x03".join(status(servo, data) for servo, data in wanted)
        found, buffer = [], b""
        while stream:
            cut = int(rng.integers(1, 9))
            answers, buffer, damaged = parse(buffer + stream[:cut])
            stream = stream[cut:]
            found += [(answer.servo, answer.data) for answer in answers]
            assert not damaged
        assert found == wanted
    whole = status(1, b"\x07\x08")
    for bit in range(8 * len(whole)):
        damaged_one = bytearray(whole)
        damaged_one[bit // 8] ^= 1 << bit % 8
        answers, _, _ = parse(bytes(damaged_one))
        assert not answers, bit
