"""TiffHeader: tags of one page of a TIFF or BigTIFF, with their positions."""

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
# Numbers of tags. GDAL and NO_DATA are written by GDAL.
PAGE_KIND, WIDTH, ROWS, BITS, COMPRESSION, PHOTOMETRIC, FILL_ORDER = 254, 256, 257, 258, 259, 262, 266
ORIENTATION, SAMPLES, STRIP_ROWS, STRIP_BYTES, PREDICTOR = 274, 277, 278, 279, 317
TILE_WIDTH, TILE_ROWS, TILE_BYTES, SAMPLE_FORMAT, GDAL, NO_DATA = 322, 323, 325, 339, 42112, 42113
REDUCED, MASK = 1, 4  # bits of PAGE_KIND: smaller copy of another page; mask of the pixels that exist
_MOST_TAGS = 4096  # largest number of tags of a page; more tags mean damage
_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}  # formats of `struct` for whole numbers, by the type of the tag
_FORMATS = {1: "u", 2: "i", 3: "f", 4: "u"}  # 4 is 'undefined', which other readers, too, take for whole numbers


@dataclass(frozen=True)
class _Entry:
    type: int
    count: int
    at: int  # position of the entry in the file [bytes]
    value_at: int  # position of its value in the file [bytes]


@dataclass(frozen=True, eq=False)
class TiffHeader:
    """The tags of one page.

    Attributes:
        data: bytes of the file.
        where: place of the image in an error.
        order: byte order, '<' or '>'.
        big: whether the file is a BigTIFF.
        entries: entries of the page's directory, by the number of the tag.
        at: position of the page's directory in the file [bytes].
        next: position of the next page's directory [bytes]; 0 for the last page.
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
        """Read the directory of a page.

        Args:
            data: bytes of the file.
            where: place of the image in an error.
            at: position of the directory [bytes]; 0 for the first page.

        Raises:
            DermisError: the directory is cut short or damaged.
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
            further = data[at : at + inline]  # some writers end the file without the position of the next page
            (following,) = struct.unpack(order + inline_kind, further) if len(further) == inline else (0,)
        except struct.error as error:
            raise DermisError(
                "the image is damaged or cut short", where=where, value="its tags", remedy="Save the image again"
            ) from error
        return cls(data, where, order, big, entries, begin, following)

    def further(self) -> Iterator[TiffHeader | None]:
        """Yield the pages after this one.

        None stands for a damaged page, which ends the iteration.
        """
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
        """Mirror and transpose an image as its orientation tag requires.

        Args:
            values: the image, with rows and columns as its first two axes.
        """
        turn = self.number(ORIENTATION, 1)
        if 5 <= turn <= 8:  # rows and columns are exchanged
            values = values.swapaxes(0, 1)
        flipped_rows, flipped_columns = turn in (3, 4, 7, 8), turn in (2, 3, 6, 7)
        return values[:: -1 if flipped_rows else 1, :: -1 if flipped_columns else 1]

    def numbers(self, tag: int, default: int = 0) -> tuple[int, ...]:
        """Return a tag's whole numbers; `default` alone if the page lacks the tag.

        Raises:
            DermisError: the tag does not hold whole numbers, or its value is beyond the end of the file.
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
        """Return the number that means 'no data' in this file.

        GDAL writes it to the tag 42113. Without this tag, the result is None.

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
        """Return the 'scale' or 'offset' of the first sample.

        GDAL writes them to the tag 42112. Without it, or without a number in it, the result is None.

        Args:
            role: 'scale' or 'offset'.
        """
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
        """Return the type of a sample, in the file's byte order.

        Samples of fewer than 8 bits have the type of 8-bit whole numbers.

        Raises:
            DermisError: the samples have a type that NumPy lacks, or several types.
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
        """Return the file as an image of single bytes.

        Pillow can then unpack the bytes without changing them.

        Args:
            item: bytes per sample. A row of the new image has `item` pixels for each sample.
            columns: samples per row of the new image.
        """
        changed = {WIDTH: columns * item, BITS: 8, SAMPLE_FORMAT: 1, PREDICTOR: 1, PHOTOMETRIC: 1}
        if TILE_WIDTH in self.entries:
            changed[TILE_WIDTH] = self.number(TILE_WIDTH) * item
        return self.changed(changed)

    def changed(self, values: Mapping[int, int]) -> bytes:
        """Return the file with this page as the first, and with changed tags.

        The orientation tag is always set to 1, for the stored order of rows and columns. Tags that the page lacks are
        not added.

        Args:
            values: new values by the number of the tag.
        """
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
    """Return the error that pixels of a kind are not read."""
    return DermisError(
        "pixels of this kind are not supported",
        where=where,
        value=found,
        limit="one grey sample of up to 64 bits, whole or floating point; colours of 8 bit",
        remedy="Save it as a grey 16-bit PNG, or as a TIFF with one grey sample a pixel",
    )
