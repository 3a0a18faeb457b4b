"""TiffHeader: the tags of a TIFF's first page, and where they lie in the file; classic and BigTIFF."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..errors import DermisError

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
WIDTH, ROWS, BITS, COMPRESSION, PHOTOMETRIC, FILL_ORDER = 256, 257, 258, 259, 262, 266
SAMPLES, STRIP_ROWS, STRIP_BYTES, PREDICTOR = 277, 278, 279, 317
TILE_WIDTH, TILE_ROWS, TILE_BYTES, SAMPLE_FORMAT, NO_DATA = 322, 323, 325, 339, 42113
_MOST_TAGS = 4096
_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}  # of whole numbers
_FORMATS = {1: "u", 2: "i", 3: "f", 4: "u"}  # 4 is 'undefined', which readers take for whole numbers


@dataclass(frozen=True)
class _Entry:
    type: int
    count: int
    at: int  # where the entry begins
    value_at: int  # where its value lies


@dataclass(frozen=True, eq=False)
class TiffHeader:
    """The first page's tags.

    Attributes:
        order: '<' or '>'. big: BigTIFF.
    """

    data: bytes
    where: str
    order: Literal["<", ">"]
    big: bool
    entries: Mapping[int, _Entry]

    @classmethod
    def of(cls, data: bytes, where: str) -> TiffHeader:
        """Read the first page's directory.

        Raises:
            DermisError: it is cut short.
        """
        order: Literal["<", ">"] = "<" if data[:2] == b"II" else ">"
        big = data[:4] in MAGIC[2:]
        head, entry, inline = ("Q", "HHQ", 8) if big else ("H", "HHI", 4)
        try:
            (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
            (count,) = struct.unpack_from(order + head, data, at)
            if count > _MOST_TAGS:
                raise struct.error
            at += struct.calcsize(order + head)
            size = struct.calcsize(order + entry)
            entries = {}
            for _ in range(count):
                tag, kind, number = struct.unpack_from(order + entry, data, at)
                width = {1: 1, 2: 1, 3: 2, 4: 4, 16: 8}.get(kind, inline + 1)
                value_at = at + size
                if width * number > inline:
                    (value_at,) = struct.unpack_from(order + ("Q" if big else "I"), data, value_at)
                entries[tag] = _Entry(kind, number, at, value_at)
                at += size + inline
        except struct.error as error:
            raise DermisError(
                "the image is damaged or cut short", where=where, value="its tags", remedy="Save the image again"
            ) from error
        return cls(data, where, order, big, entries)

    def numbers(self, tag: int, default: int = 0) -> tuple[int, ...]:
        """Return a tag's whole numbers; `default` alone where the page has none.

        Raises:
            DermisError: the tag holds something else, or lies beyond the file.
        """
        entry = self.entries.get(tag)
        if entry is None:
            return (default,)
        kind = _TYPES.get(entry.type)
        if kind is None or not entry.count or entry.count > len(self.data):
            raise self._damaged(tag)
        try:
            return struct.unpack_from(f"{self.order}{entry.count}{kind}", self.data, entry.value_at)
        except struct.error as error:
            raise self._damaged(tag) from error

    def number(self, tag: int, default: int = 0) -> int:
        """Return a tag's first whole number."""
        return self.numbers(tag, default)[0]

    def no_data(self) -> float | None:
        """Return the number that the file declares to stand for 'no data' (tag 42113, written by GDAL), or None.

        Raises:
            DermisError: the tag holds no number.
        """
        entry = self.entries.get(NO_DATA)
        if entry is None:
            return None
        text = self.data[entry.value_at : entry.value_at + entry.count].split(b"\0")[0].decode("latin-1").strip()
        try:
            return float(text)
        except ValueError as error:
            raise DermisError(
                "the file declares no data by something that is no number",
                where=f"{self.where}, tag {NO_DATA}",
                value=text[:40],
                remedy="Write the tag again, as a number",
            ) from error

    def sample_type(self) -> np.dtype:
        """Return the type of a sample, in the file's byte order; samples of fewer than 8 bits are whole numbers of 8.

        Raises:
            DermisError: samples that no computer's type holds, or of several types.
        """
        count = self.number(SAMPLES, 1)
        bits, formats = set(self.numbers(BITS, 1)), set(self.numbers(SAMPLE_FORMAT, 1))
        kind = _FORMATS.get(max(formats))
        held = {"u": (1, 2, 4, 8, 16, 32, 64), "i": (8, 16, 32, 64), "f": (16, 32, 64)}
        if len(bits) > 1 or len(formats) > 1 or kind is None or max(bits) not in held[kind]:
            words = {1: "whole numbers", 2: "signed whole numbers", 3: "floating point", 5: "complex", 6: "complex"}
            value = " and ".join(f"{b} bit" for b in sorted(bits))
            value += ", " + " and ".join(words.get(f, f"format {f}") for f in sorted(formats))
            raise unreadable(f"{value}, {count} a pixel", self.where)
        return np.dtype(f"{self.order}{kind}{max(max(bits) // 8, 1)}")

    def as_bytes(self, item: int, columns: int) -> bytes:
        """Return the file as an image of single bytes, `item` for each sample, so that unpacking changes none of them.

        Args:
            columns: that the image shall have, in samples.
        """
        new = bytearray(self.data)
        changed = {WIDTH: columns * item, BITS: 8, SAMPLE_FORMAT: 1, PREDICTOR: 1, PHOTOMETRIC: 1}
        if TILE_WIDTH in self.entries:
            changed[TILE_WIDTH] = self.number(TILE_WIDTH) * item
        for tag, value in changed.items():
            entry = self.entries.get(tag)
            if entry is not None:
                layout = "HHQQ" if self.big else "HHII"
                struct.pack_into(self.order + layout, new, entry.at, tag, 16 if self.big else 4, 1, value)
        return bytes(new)

    def _damaged(self, tag: int) -> DermisError:
        return DermisError(
            "the image is damaged or cut short", where=self.where, value=f"tag {tag}", remedy="Save the image again"
        )


def unreadable(found: str, where: str) -> DermisError:
    """Return that pixels of a kind are not read."""
    return DermisError(
        "pixels of this kind are not read here",
        where=where,
        value=found,
        limit="one grey sample of up to 64 bits, whole or floating point; colours of 8 bit",
        remedy="Save it as a grey 16-bit PNG, or as a TIFF with one grey sample a pixel",
    )
