"""TiffHeader: the tags of one page of a TIFF, and where they lie in the file; classic and BigTIFF."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PAGE_KIND, WIDTH, ROWS, BITS, COMPRESSION, PHOTOMETRIC, FILL_ORDER = 254, 256, 257, 258, 259, 262, 266
ORIENTATION, SAMPLES, STRIP_ROWS, STRIP_BYTES, PREDICTOR = 274, 277, 278, 279, 317
TILE_WIDTH, TILE_ROWS, TILE_BYTES, SAMPLE_FORMAT, GDAL, NO_DATA = 322, 323, 325, 339, 42112, 42113
REDUCED, MASK = 1, 4  # bits of PAGE_KIND: a smaller copy, a mask of the pixels that are there
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
    """The tags of one page.

    Attributes:
        order: '<' or '>'. big: BigTIFF.
        at: where the page's directory begins. next: where the next page's begins, 0 behind the last page.
    """

    data: bytes
    where: str
    order: Literal["<", ">"]
    big: bool
    entries: Mapping[int, _Entry]
    at: int
    next: int

    @classmethod
    def of(cls, data: bytes, where: str, at: int = 0) -> TiffHeader:
        """Read a page's directory: the one at `at`, the first where that is 0.

        Raises:
            DermisError: it is cut short.
        """
        order: Literal["<", ">"] = "<" if data[:2] == b"II" else ">"
        big = data[:4] in MAGIC[2:]
        head, entry, inline, inline_kind = ("Q", "HHQ", 8, "Q") if big else ("H", "HHI", 4, "I")
        try:
            if not at:
                (at,) = struct.unpack_from(order + inline_kind, data, inline)
            begin = at
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
                    (value_at,) = struct.unpack_from(order + inline_kind, data, value_at)
                entries[tag] = _Entry(kind, number, at, value_at)
                at += size + inline
            further = data[at : at + inline]  # some writers end the file without it
            (following,) = struct.unpack(order + inline_kind, further) if len(further) == inline else (0,)
        except struct.error as error:
            raise DermisError(
                "the image is damaged or cut short", where=where, value="its tags", remedy="Save the image again"
            ) from error
        return cls(data, where, order, big, entries, begin, following)

    def further(self) -> Iterator[TiffHeader | None]:
        """Return the pages behind this one; None in place of one that is damaged, which is the last."""
        page, seen = self, {self.at}
        while page.next and page.next not in seen:
            seen.add(page.next)
            try:
                page = TiffHeader.of(self.data, self.where, page.next)
            except DermisError:
                yield None
                return
            yield page

    def upright(self, values: NDArray[Any]) -> NDArray[Any]:
        """Turn rows and columns, the first two axes, as the tag of the orientation says."""
        turn = self.number(ORIENTATION, 1)
        if 5 <= turn <= 8:  # rows and columns change places
            values = values.swapaxes(0, 1)
        flipped_rows, flipped_columns = turn in (3, 4, 7, 8), turn in (2, 3, 6, 7)
        return values[:: -1 if flipped_rows else 1, :: -1 if flipped_columns else 1]

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
                "the file's value for 'no data' is not a number",
                where=f"{self.where}, tag {NO_DATA}",
                value=text[:40],
                remedy="Write the tag again, as a number",
            ) from error

    def declared(self, role: str) -> float | None:
        """Return the 'scale' or 'offset' of the first sample (tag 42112, written by GDAL); None where there is none."""
        entry = self.entries.get(GDAL)
        if entry is None:
            return None
        text = self.data[entry.value_at : entry.value_at + entry.count].decode("latin-1")
        for attributes, value in re.findall(r"<Item\b([^>]*)>([^<]*)</Item>", text):
            if f'role="{role}"' in attributes and 'sample="0"' in attributes:
                try:
                    return float(value)
                except ValueError:
                    return None
        return None

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
        changed = {WIDTH: columns * item, BITS: 8, SAMPLE_FORMAT: 1, PREDICTOR: 1, PHOTOMETRIC: 1}
        if TILE_WIDTH in self.entries:
            changed[TILE_WIDTH] = self.number(TILE_WIDTH) * item
        return self.changed(changed)

    def changed(self, values: Mapping[int, int]) -> bytes:
        """Return the file with this page as its first, not turned, and with other values of tags that it has."""
        new = bytearray(self.data)
        struct.pack_into(self.order + ("Q" if self.big else "I"), new, 8 if self.big else 4, self.at)
        for tag, value in {ORIENTATION: 1, **values}.items():
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
        "pixels of this kind are not supported",
        where=where,
        value=found,
        limit="one grey sample of up to 64 bits, whole or floating point; colours of 8 bit",
        remedy="Save it as a grey 16-bit PNG, or as a TIFF with one grey sample a pixel",
    )
