"""Commands of Pololu Maestro servo controllers.

Both the compact and the Pololu protocol are supported, with and without CRC-7.

Source: Pololu Maestro Servo Controller User's Guide, sections 5.c (protocols), 5.d (CRC) and 5.e (commands)
"""

from __future__ import annotations

SET_TARGET, GET_POSITION, GET_ERRORS, POLOLU = 0x84, 0x90, 0xA1, 0xAA
CHANNELS = 24  # number of channels of the largest model
POLYNOMIAL = 0x91  # polynomial of the CRC-7, least significant bit first


def target(channel: int, quarter_us: int) -> bytes:
    """Return Set Target of the compact protocol; 0 stops the pulses."""
    return bytes((SET_TARGET, channel, quarter_us & 0x7F, quarter_us >> 7 & 0x7F))


def packet(command: bytes, device: int | None, *, crc: bool) -> bytes:
    """Return the bytes of a command to send.

    Args:
        command: command of the compact protocol. device: device number, for the Pololu protocol; None: the compact one.
        crc: whether to append a CRC.
    """
    whole = command if device is None else bytes((POLOLU, device, command[0] & 0x7F)) + command[1:]
    return whole + bytes((crc7(whole),)) if crc else whole


def crc7(data: bytes) -> int:
    """Return the CRC-7 of a command, from 0 to 127.

    It is sent as the last byte of the command.
    """
    rest = 0
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = (rest ^ POLYNOMIAL if rest & 1 else rest) >> 1
    return rest
