"""The formats of a track, by name: what menus and the command line offer, without what writes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Format:
    """One view of a track.

    Attributes:
        module: of this package. suffix: of its files. title, text: for menus.
        levels: counts that it gives a channel's range; None where it does not quantise.
        readable: it can be read back.
    """

    module: str
    suffix: str
    title: str
    text: str
    levels: int | None = None
    readable: bool = True


FORMATS: Mapping[str, Format] = {
    "csv": Format("csv", ".csv", "CSV", "Version 1"),
    "json": Format("json_track", ".json", "JSON", "Every float exactly"),
    "binary": Format("binary", ".dtrack", "Compact Binary", "Four bytes a value, with a check sum"),
    "c": Format("c_header", ".h", "C Header", "With a player loop for a microcontroller", levels=65536, readable=False),
}
