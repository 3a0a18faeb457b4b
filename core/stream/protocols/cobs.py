"""Consistent overhead byte stuffing (COBS).

It encodes bytes without a zero, so that a zero can end a packet.

Source: Cheshire and Baker, IEEE/ACM Transactions on Networking 7(2), 1999
"""

from __future__ import annotations

from ...errors import DermisError

_CODE = [bytes([n]) for n in range(256)]


def encode(data: bytes) -> bytes:
    """Return data encoded without zeros.

    The result has one more byte, and at most another one for every 254 bytes of data. No delimiter is added.
    presets/streaming_protocol.md has the rule in words and in examples.
    """
    parts = data.split(b"\0")
    if len(max(parts, key=len)) < 254:
        return b"".join([_CODE[len(part) + 1] + part for part in parts])
    out = bytearray()
    for number, part in enumerate(parts, start=1):
        full, rest = divmod(len(part), 254)
        for k in range(full):
            out += b"\xff" + part[254 * k : 254 * k + 254]
        # A full block encodes no zero after it. If a zero follows, an empty block encodes it.
        if rest or not full or number < len(parts):
            out += _CODE[rest + 1] + part[254 * full :]
    return bytes(out)


def decode(data: bytes) -> bytes:
    """Return the data that `encode` has encoded.

    `data`: encoded bytes without the delimiter.

    Raises:
        DermisError: the bytes are empty or contain a zero, or a block reaches beyond their end.
    """
    out, at, size = [], 0, len(data)
    if not size or 0 in data:
        raise DermisError("not COBS", value=data[:16].hex(" "))
    while at < size:
        code = data[at]
        end = at + code
        if end > size:
            raise DermisError("a COBS block reaches beyond the end", value=code, limit=f"<= {size - at}")
        out.append(data[at + 1 : end])
        if code < 255 and end < size:
            out.append(b"\0")
        at = end
    return b"".join(out)
