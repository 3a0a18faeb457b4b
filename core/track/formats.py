"""Formats of track files, for menus and for the command line.

The modules that write the files are loaded only when they are needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..parameters.parameter import Table
from ..parameters.wave import WAVE


@dataclass(frozen=True)
class Format:
    """One format of track files.

    Attributes:
        module: module of this package that writes the files.
        suffix: ending of the files' names, with its dot.
        title: name in menus.
        text: description in menus.
        levels: number of counts for the range of a channel; None if the format does not quantise.
        readable: whether files can be read back.
        settings: table of the options.
    """

    module: str
    suffix: str
    title: str
    text: str
    levels: int | None = None
    readable: bool = True
    settings: Table = field(default_factory=dict)


FORMATS: Mapping[str, Format] = {
    "csv": Format("csv", ".csv", "CSV", "Version 1"),
    "json": Format("json_track", ".json", "JSON", "Every float exactly"),
    "binary": Format("binary", ".dtrack", "Compact Binary", "Four bytes a value, with a check sum"),
    "c": Format("c_header", ".h", "C Header", "With a player loop for a microcontroller", levels=65536, readable=False),
    "wav": Format(
        "wav", ".wav", "WAV", "The voltage itself, for a sound card and an amplifier", readable=False, settings=WAVE
    ),
    "ahap": Format("ahap", ".ahap", "AHAP", "A voice coil's vibration for Apple's Core Haptics", readable=False),
    "haptic": Format(
        "haptic_clip", ".haptic", "Haptic Clip", "A voice coil's vibration for Meta's SDK", readable=False
    ),
    "hjif": Format("hjif", ".hjif", "MPEG Haptics", "A voice coil's vibration, ISO/IEC 23090-31", readable=False),
}
