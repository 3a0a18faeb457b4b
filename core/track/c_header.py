"""Command tracks as a C header with a player for microcontrollers.

The samples are in flash memory, and the player needs no library. Only channels with an actuator are written. Samples
are counts of 16 bits: 0 is the channel's low, and 65535 is its high. A sketch may call the player at any rate. The
player interpolates between samples and gives the count of every channel::

    #include "thumb.h"
    void loop() {
      uint16_t counts[THUMB_CHANNELS];
      if (!thumb_play(micros() - started, counts)) { /* the track is over: counts of the rest pose */ }
      for (uint8_t i = 0; i < THUMB_CHANNELS; i++) drive(i, counts[i]);
    }

The period of the samples is a ratio of whole numbers: THUMB_PERIOD_SAMPLES samples take THUMB_PERIOD_US microseconds
(at 240 Hz, 3 samples take 12500 us). Each call computes the sample from the time alone, in 32 bits and without
rounding, so no error accumulates. THUMB_FORMAT is the version of the format, 2. In version 1 the period was a whole
number of microseconds, and there was no THUMB_FORMAT.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import write_bytes
from .command_track import CommandTrack
from .track_header import check_finite

FULL = 65535  # count of a channel's high
VERSION = 2  # version of the format
_PER_LINE = 12  # counts in a line of the header
_WORD = 2**32  # number of values that 32 bits can hold
_LONGEST = 2**23  # [us] largest numerator of a period for which the player's interpolation stays within 32 bits
# A ratio that is not exact is accepted if one of two errors is small enough.
# _DRIFT: [us] largest error at the last sample. _PART: largest relative error, a hundredth of that of a quartz clock.
_DRIFT, _PART = 0.5, 1e-7

_PLAYER = """
/* Give the counts of all channels at a time from the start [us]; return 0 from the end on, with the rest pose. */
static uint8_t {name}_play(uint32_t now_us, uint16_t *counts) {{
{clock}
  uint8_t c;
  if (sample + 1u >= {NAME}_SAMPLES) {{
    for (c = 0; c < {NAME}_CHANNELS; c++) counts[c] = {NAME}_READ(&{name}_rest[c]);
    return 0;
  }}
  {{
    const uint16_t *from = {name}_values + sample * {NAME}_CHANNELS;
    for (c = 0; c < {NAME}_CHANNELS; c++) {{
      uint16_t a = {NAME}_READ(from + c), b = {NAME}_READ(from + {NAME}_CHANNELS + c);
      uint16_t d = b > a ? b - a : a - b;
{step}
      counts[c] = b > a ? (uint16_t)(a + step) : (uint16_t)(a - step);
    }}
  }}
  return 1;
}}
"""

# Clocks of the player, for a period of whole microseconds and for a ratio. Both compute `sample` and `part`. The share
# of the sample's period that has elapsed is part / PERIOD_US.
_WHOLE = """  uint32_t sample = now_us / {NAME}_PERIOD_US;
  uint32_t part = now_us % {NAME}_PERIOD_US;"""
_RATIO = """  /* PERIOD_SAMPLES samples take PERIOD_US: whole groups of them, then samples of the last. Exact. */
  uint32_t group = now_us / {NAME}_PERIOD_US;
  uint32_t within = (uint32_t)(now_us % {NAME}_PERIOD_US) * {NAME}_PERIOD_SAMPLES;
  uint32_t sample = group * {NAME}_PERIOD_SAMPLES + within / {NAME}_PERIOD_US;
  uint32_t part = within % {NAME}_PERIOD_US;"""

_SHORT = """      /* 16 bits of difference times up to 16 bits of time: no overflow in 32 bits. */
      uint16_t step = (uint16_t)(((uint32_t)d * part) / {NAME}_PERIOD_US);"""
_LONG = """      /* Up to 23 bits of time: long division, a byte of the difference at a time. */
      uint32_t high = (uint32_t)(d >> 8) * part, low = (uint32_t)(d & 255u) * part;
      uint32_t rest = (uint32_t)(high % {NAME}_PERIOD_US) * 256u + low;
      uint16_t step = (uint16_t)((high / {NAME}_PERIOD_US) * 256u + rest / {NAME}_PERIOD_US);"""


def write(track: CommandTrack, path: Path) -> None:
    """Write a track as a C header in one atomic step.

    The names in the header begin with the file's name.

    Raises:
        DermisError: see `dumps`; or the file cannot be written.
    """
    write_bytes(Path(path), dumps(track, identifier(Path(path).stem)).encode("ascii"))


def identifier(text: str) -> str:
    """Return a C identifier in lower case for any text."""
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
    return name if name and not name[0].isdigit() else f"track_{name}".rstrip("_")


def counts(track: CommandTrack) -> tuple[NDArray[np.uint16], list[int]]:
    """Return the samples as counts, shape (n, k), and the columns used.

    The k columns are those of the track's channels with an actuator.

    Raises:
        DermisError: no channel has an actuator, such a channel has no range, or a value is outside the range.
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
        name: C identifier in lower case with which the names in the header begin.

    Raises:
        DermisError: `name` is no C identifier in lower case; there are fewer than two samples; a time or a value is
            not finite; the times are no regular grid; a clock of microseconds in 32 bits cannot keep the rate or the
            length; no channel has an actuator, such a channel has no range, or a value is outside the range.
    """
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    if identifier(name) != name:
        raise DermisError("not a C identifier in lower case", where=where, value=name)
    check_finite(track)
    if len(track.times) < 2:
        raise DermisError("a player needs two samples", where=where, value=len(track.times), limit=">= 2")
    grid = track.times[0] + np.arange(len(track.times)) / track.spec.rate
    if np.abs(grid - track.times).max() > 1e-7:
        raise DermisError(
            "the samples are not evenly spaced",
            where=where,
            value=f"{track.spec.rate:g} Hz",
            limit="times within 0.1 us of the device's rate",
            remedy="Resample it",
        )
    period = _period(track.spec.rate, len(track.times), where)
    table, columns = counts(track)
    rest = [int(_counts(np.array([track.channels[i].rest]), track, i)[0]) for i in columns]
    upper = name.upper()
    lines = [
        f"/* Dermis command track for {_comment(track.spec.name)}.",
        *(f"   {k}: {_comment(track.meta[k])}" for k in sorted(track.meta)),
        *(f"   limited {k}: {v} samples" for k, v in sorted(track.limited.items()) if v),
        "   Counts 0 to 65535 stand for, channel by channel:",
        *(
            f"   {k}: {c.name} on {_comment(c.actuator)}, {c.low:.9g} to {c.high:.9g} {c.unit}"
            for k, c in enumerate(track.channels[i] for i in columns)
        ),
        "*/",
        f"#ifndef {upper}_H",
        f"#define {upper}_H",
        "#include <stdint.h>",
        "#ifdef __AVR__",
        "#include <avr/pgmspace.h>",
        f"#define {upper}_FLASH PROGMEM",
        f"#define {upper}_READ(p) pgm_read_word(p)",
        "#else",
        f"#define {upper}_FLASH",
        f"#define {upper}_READ(p) (*(p))",
        "#endif",
        f"#define {upper}_CHANNELS {len(columns)}u",
        f"#define {upper}_SAMPLES {len(table)}ul",
        f"/* {_rate(period, track.spec.rate)} */",
        f"#define {upper}_FORMAT {VERSION}u",
        f"#define {upper}_PERIOD_US {period.numerator}ul",
        f"#define {upper}_PERIOD_SAMPLES {period.denominator}ul",
        f'#define {upper}_SPEC_HASH "{track.spec.hash}"',
        f"static const uint16_t {name}_rest[] {upper}_FLASH = {{{', '.join(map(str, rest))}}};",
        f"static const uint16_t {name}_values[] {upper}_FLASH = {{",
    ]
    flat = table.ravel().tolist()
    lines += [f"  {', '.join(map(str, flat[i : i + _PER_LINE]))}," for i in range(0, len(flat), _PER_LINE)]
    clock = (_WHOLE if period.denominator == 1 else _RATIO).format(NAME=upper)
    step = (_SHORT if period.numerator <= FULL else _LONG).format(NAME=upper)
    return "\n".join(lines) + "\n};\n" + _PLAYER.format(name=name, NAME=upper, clock=clock, step=step) + "#endif\n"


def _period(rate: float, samples: int, where: str) -> Fraction:
    """Return the period of the samples [us] as a ratio of whole numbers.

    The player computes with the ratio n / d exactly if n * d < 2^32 and n <= 2^23. Rates such as 240, 1000 or
    24000/1001 Hz have an exact ratio within these bounds. For other rates the nearest ratio within them is returned.

    Raises:
        DermisError: the nearest ratio is off by more than 0.5 us at the last sample and by more than 1e-7 of the time;
            or the track is longer than a clock of microseconds in 32 bits counts.
    """
    exact = Fraction(10**6) / Fraction(rate)
    largest = min(math.isqrt(int((_WORD - 1) / exact)), int(_LONGEST / exact)) if exact >= 1 else 0
    found = None
    for limit in range(largest, max(largest - 8, 0), -1):  # rounding may cross a bound: smaller limits follow
        near = exact.limit_denominator(limit)
        if near >= 1 and near.numerator * near.denominator < _WORD and near.numerator <= _LONGEST:
            found = near
            break
    if found is None or abs(found - exact) > max(_DRIFT / (samples - 1), _PART * exact):
        raise DermisError(
            "a clock of microseconds cannot keep this rate",
            where=where,
            value=f"{rate:g} Hz",
            limit="0.12 to 1,000,000 Hz",
            remedy="Resample it, for example to 1000 Hz",
        )
    if found * (samples - 1) >= _WORD:
        raise DermisError(
            "the track is longer than a clock of microseconds in 32 bits counts",
            where=where,
            value=f"{float(found) * (samples - 1) * 1e-6:g} s",
            limit=f"{(_WORD - 1) * 1e-6:.0f} s",
            remedy="Export a part of it",
        )
    return found


def _rate(period: Fraction, rate: float) -> str:
    """Return a sentence about the period for a comment in the header.

    Args:
        period: period of the samples in the header [us].
        rate: rate of the track [Hz].
    """
    off = float(abs(period * Fraction(rate) / 10**6 - 1))
    # A float holds a rate such as 24000/1001 Hz only to 16 digits, so a difference that small counts as none.
    kept = "exactly" if off < 1e-15 else f"right to {off:.1e} of the time"
    if period.denominator == 1:
        return f"A sample each {period.numerator} us, {kept}."
    return f"{period.denominator} samples in {period.numerator} us, {kept}: the player keeps this ratio without drift."


def _counts(values: NDArray[np.float64], track: CommandTrack, column: int) -> NDArray[np.uint16]:
    channel = track.channels[column]
    where = f"{track.spec.key}, {channel.name}"
    if channel.low is None or channel.high is None or not channel.high > channel.low:
        raise DermisError(
            "the channel needs a range to be written as counts",
            where=where,
            remedy="Give it 'low' and 'high' in the device preset",
        )
    part = (values - channel.low) / (channel.high - channel.low)
    if (part < -1e-8).any() or (part > 1 + 1e-8).any():
        raise DermisError(
            "a value outside the channel's range cannot be a count",
            where=where,
            value=float(values[np.argmax(np.abs(part - 0.5))]),
            limit=f"{channel.low:g} to {channel.high:g}",
            remedy="Limit the track first",
        )
    return np.rint(np.clip(part, 0.0, 1.0) * FULL).astype(np.uint16)


def _comment(text: str) -> str:
    return text.encode("ascii", "replace").decode().replace("*/", "* /").replace("\n", " ").replace("\\", "/")
