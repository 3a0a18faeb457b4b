"""Command tracks as a C header for a microcontroller: 16-bit samples in flash, and a player that needs no library.

Only channels with an actuator are written. Sample values are counts from 0 (the channel's low) to 65535 (its high).
The player is called as often as the sketch likes; it interpolates between samples and gives every channel's count::

    #include "thumb.h"
    void loop() {
      uint16_t counts[THUMB_CHANNELS];
      if (!thumb_play(micros() - started, counts)) { /* at its end: the rest pose */ }
      for (uint8_t i = 0; i < THUMB_CHANNELS; i++) drive(i, counts[i]);
    }
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import write_bytes
from ..track import CommandTrack
from .track_header import check_finite

FULL = 65535
_PER_LINE = 12

_PLAYER = """
/* Give the counts of all channels at a time from the start [us]; return 0 from the end on, with the rest pose. */
static uint8_t {name}_play(uint32_t now_us, uint16_t *counts) {{
  uint32_t sample = now_us / {NAME}_PERIOD_US;
  uint8_t c;
  if (sample + 1u >= {NAME}_SAMPLES) {{
    for (c = 0; c < {NAME}_CHANNELS; c++) counts[c] = {NAME}_READ(&{name}_rest[c]);
    return 0;
  }}
  {{
    uint32_t part = now_us % {NAME}_PERIOD_US; /* of a period, in us */
    const uint16_t *from = {name}_values + sample * {NAME}_CHANNELS;
    for (c = 0; c < {NAME}_CHANNELS; c++) {{
      uint16_t a = {NAME}_READ(from + c), b = {NAME}_READ(from + {NAME}_CHANNELS + c);
      /* 16 bits of difference times up to 16 bits of time: no overflow in 32 bits. */
      uint16_t step = (uint16_t)(((uint32_t)(b > a ? b - a : a - b) * part) / {NAME}_PERIOD_US);
      counts[c] = b > a ? (uint16_t)(a + step) : (uint16_t)(a - step);
    }}
  }}
  return 1;
}}
"""


def write(track: CommandTrack, path: Path) -> None:
    """Write a track as a C header named after the file, whole or not at all.

    Raises:
        DermisError: see `dumps`; or the file cannot be written.
    """
    write_bytes(Path(path), dumps(track, identifier(Path(path).stem)).encode("ascii"))


def identifier(text: str) -> str:
    """Return a C identifier in lower case for any text."""
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
    return name if name and not name[0].isdigit() else f"track_{name}".rstrip("_")


def counts(track: CommandTrack) -> tuple[NDArray[np.uint16], list[int]]:
    """Return the samples of the channels with an actuator as counts, shape (n, k), and their columns.

    Raises:
        DermisError: no channel has an actuator, one has no range, or a value lies outside of it.
    """
    columns = [i for i, c in enumerate(track.channels) if c.actuator]
    if not columns:
        raise DermisError("no channel drives an actuator", where=track.spec.key)
    table = np.empty((len(track.times), len(columns)), np.uint16)
    for k, i in enumerate(columns):
        table[:, k] = _counts(track.values[:, i], track, i)
    return table, columns


def dumps(track: CommandTrack, name: str) -> str:
    """Return a track as a C header; equal tracks give equal text.

    Args:
        name: identifier that everything in the header begins with.

    Raises:
        DermisError: no C identifier; fewer than two samples; times that are no regular grid of whole microseconds up
            to 65535 (15.3 Hz or faster); a channel without a range, or a value outside of it.
    """
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    if identifier(name) != name:
        raise DermisError("not a C identifier in lower case", where=where, value=name)
    check_finite(track)
    if len(track.times) < 2:
        raise DermisError("a player needs two samples", where=where, value=len(track.times), limit=">= 2")
    period = 1e6 / track.spec.rate
    grid = track.times[0] + np.arange(len(track.times)) / track.spec.rate
    if abs(period - round(period)) > 1e-6 or not 1 <= round(period) <= 65535 or np.abs(grid - track.times).max() > 1e-7:
        raise DermisError(
            "the samples are not a whole number of microseconds apart", where=where, value=f"{track.spec.rate:g} Hz",
            limit="a regular grid of 16 to 1,000,000 Hz with a period of whole microseconds",
            remedy="Resample it, for example to 1000 or 50 Hz",
        )  # fmt: skip
    table, columns = counts(track)
    rest = [int(_counts(np.array([track.channels[i].rest]), track, i)[0]) for i in columns]
    upper = name.upper()
    lines = [
        f"/* Dermis command track for {_comment(track.spec.name)}.",
        *(f"   {k}: {_comment(track.meta[k])}" for k in sorted(track.meta)),
        *(f"   limited {k}: {v} samples" for k, v in sorted(track.limited.items()) if v),
        "   Counts 0 to 65535 stand for, channel by channel:",
        *(f"   {k}: {c.name} on {_comment(c.actuator)}, {c.low:.9g} to {c.high:.9g} {c.unit}"
          for k, c in enumerate(track.channels[i] for i in columns)),
        "*/",
        f"#ifndef {upper}_H", f"#define {upper}_H", "#include <stdint.h>",
        "#ifdef __AVR__", "#include <avr/pgmspace.h>", f"#define {upper}_FLASH PROGMEM",
        f"#define {upper}_READ(p) pgm_read_word(p)",
        "#else", f"#define {upper}_FLASH", f"#define {upper}_READ(p) (*(p))", "#endif",
        f"#define {upper}_CHANNELS {len(columns)}u", f"#define {upper}_SAMPLES {len(table)}ul",
        f"#define {upper}_PERIOD_US {round(period)}ul", f"#define {upper}_SPEC_HASH \"{track.spec.hash}\"",
        f"static const uint16_t {name}_rest[] {upper}_FLASH = {{{', '.join(map(str, rest))}}};",
        f"static const uint16_t {name}_values[] {upper}_FLASH = {{",
    ]  # fmt: skip
    flat = table.ravel().tolist()
    lines += [f"  {', '.join(map(str, flat[i : i + _PER_LINE]))}," for i in range(0, len(flat), _PER_LINE)]
    return "\n".join(lines) + "\n};\n" + _PLAYER.format(name=name, NAME=upper) + "#endif\n"


def _counts(values: NDArray[np.float64], track: CommandTrack, column: int) -> NDArray[np.uint16]:
    channel = track.channels[column]
    where = f"{track.spec.key}, {channel.name}"
    if channel.low is None or channel.high is None or not channel.high > channel.low:
        raise DermisError("the channel has no range that counts could stand for", where=where,
                          remedy="Give it 'low' and 'high' in the device preset")  # fmt: skip
    part = (values - channel.low) / (channel.high - channel.low)
    if (part < -1e-8).any() or (part > 1 + 1e-8).any():
        raise DermisError("a value outside the channel's range has no count", where=where,
                          value=float(values[np.argmax(np.abs(part - 0.5))]),
                          limit=f"{channel.low:g} to {channel.high:g}", remedy="Limit the track first")  # fmt: skip
    return np.rint(np.clip(part, 0.0, 1.0) * FULL).astype(np.uint16)


def _comment(text: str) -> str:
    return text.encode("ascii", "replace").decode().replace("*/", "* /").replace("\n", " ").replace("\\", "/")
