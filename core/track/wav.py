"""Command tracks as WAV files, version 1: the voltage of a device.

A sound card and an amplifier play the file, which has one channel of 24-bit PCM at 48 to 192 kHz. If a sinusoid drives
the device, the voltage is amplitude(t) sin(phase(t)) + offset. The amplitude is that of the track. The phase begins at
0 and grows by 2 pi carrier(t) per second. For a voice coil, the voltage is that of the track plus the offset. Each
voltage gives a sample

    sample = voltage / (gain * full_scale)

`full_scale` is the peak voltage of the card, and `gain` is the voltage gain of the amplifier. Both describe the chain
behind the file, and neither changes the voltage at the device. A sample of 1 is full scale and is stored as the count
8388607. A voltage beyond full scale is an error. On request it is clipped instead, and the clipped samples are counted.

A LIST chunk of type INFO is before the samples. Its entries are INAM (finger and device), ISBJ (contents of the file),
ISFT (program) and ICMT, a JSON object in ASCII. The object is the header of the JSON track with the schema below and
one more field, `wave`. The entries of `wave` are rate [Hz], unit of the voltage, gain, full_scale [V], offset [V],
carrier (fixed frequency [Hz]; null if the track gives the frequency or the device has none), clipped (number of
samples), open_loop and counts (count of full scale).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.kinds import KINDS, Kind
from ..devices.spec import Channel
from ..errors import DermisError, Finding
from ..files import write_bytes
from ..interpolate import MAX_SAMPLES
from ..parameters.wave import WAVE
from ..version import version
from .command_track import CommandTrack
from .track_header import check_finite, header_of, text_of
from .upsampling import ratio, upsampled

SCHEMA = "dermis-track-wav 1"
COUNTS = 2**23 - 1  # count of full scale, the largest in 24 bits
SLACK = 1e-9  # relative tolerance of full scale and of the channel's limit, since sums and products are rounded
CHAIN = {
    "full_scale": "the output's peak voltage for the largest sample: 1.414 times the RMS volts of a full-scale tone",
    "gain": "the voltage gain between output and device (1 without an amplifier)",
}
OPEN_LOOP = "open loop: the voltage follows the animated finger, not the position of a real one"


@dataclass(frozen=True)
class Wave:
    """A track's voltage as samples.

    Attributes:
        rate: sampling rate [Hz].
        volts: voltage at the device [V], not yet clipped, shape (n,).
        limit: voltage at the device for a sample at full scale [V].
        header: field `wave` of the header in the file.
        findings: findings of the conversion.
    """

    rate: int
    volts: Array
    limit: float
    header: Mapping[str, Any]
    findings: tuple[Finding, ...]


def write(track: CommandTrack, path: Path, settings: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Write a track as a WAV file in one atomic step; return the findings.

    Args:
        settings: values of the rows of `WAVE`, in SI.

    Raises:
        DermisError: see `wave_of` and `dumps`; or the file cannot be written.
    """
    wave = wave_of(track, settings)
    write_bytes(Path(path), dumps(track, wave))
    return wave.findings


def stated(options: Mapping[str, Any], needed: tuple[str, ...], where: str) -> dict[str, Any]:
    """Return the WAV settings among the options of a command.

    Use this before a real device is driven: its voltage is known only if the settings of the chain are given.

    Args:
        options: values by name ('wav_full_scale' ...), in SI; None for an option that was left out.
        needed: names of the settings without which the voltage at the device is not known.

    Raises:
        DermisError: a needed setting is left out, or is 0.
    """
    given = {name: options[f"wav_{name}"] for name in WAVE if options[f"wav_{name}"] is not None}
    if missing := [name for name in needed if not given.get(name)]:
        raise DermisError(
            "the voltage at the device is not known",
            where=where,
            value=", ".join(f"no --wav-{name.replace('_', '-')}" for name in missing),
            remedy="Measure and give: " + "; ".join(f"--wav-{n.replace('_', '-')}, {CHAIN[n]}" for n in missing),
        )
    return given


def wave_of(track: CommandTrack, settings: Mapping[str, Any]) -> Wave:
    """Return the voltage of a track, sampled at the rate of the WAV file.

    Findings have the codes 'open-loop' and 'constant-voltage' (infos) and 'clipped' (warning).

    Args:
        settings: values of the rows of `WAVE`, in SI.

    Raises:
        DermisError: no waveform drives the device; a setting is out of range; there are no samples or too many; the
            times are no regular grid; the rates have no simple ratio; a value is not finite; the carrier is outside the
            channel's range, too high for the rate, or given for a voice coil; full scale is 0 and the channel has no
            limit; a voltage is beyond full scale and may not be clipped; the offset takes the voltage beyond the
            channel's limit.
    """
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    said = {name: row.of(settings, "WAV") for name, row in WAVE.items()}
    kind = _driven(track, where)
    level = _channel(track, kind.wave or kind.sine[0], where)
    check_finite(track)
    rate = int(said["rate"])
    up = ratio(track.spec.rate, rate, track.duration, where)
    _check_grid(track, float(up), where)
    place = f"{where}, {level.name}"
    limit = said["gain"] * said["full_scale"] or _limit(level, place)
    volts: Array = upsampled(track.column(level.name), up, *_range(level, track))
    if kind.sine:
        phase = _phase(track, _channel(track, kind.sine[1], where), said["carrier"], up, rate, where)
        volts *= np.sin(phase, out=phase)
    elif said["carrier"]:
        raise DermisError(
            "the voltage is the wave itself, so it has no carrier",
            where=place,
            value=f"{said['carrier']:g} Hz",
            limit="0",
            remedy="Leave the carrier at 0",
        )
    _check_offset(volts, said["offset"], level, place)
    volts += said["offset"]
    clipped = _beyond(volts, limit, rate, bool(said["clip"]), level, place)
    findings = [*clipped]
    if not kind.worn:
        findings.append(Finding("info", "open-loop", OPEN_LOOP, where=where))
    if said["offset"]:
        findings.append(
            Finding(
                "info",
                "constant-voltage",
                "most sound cards block a constant voltage, so the offset may not reach the device",
                where=place,
                value=f"{said['offset']:g} V",
                remedy="Measure it behind the amplifier, or add the offset there",
            )
        )
    header = {
        "rate": rate,
        "unit": level.unit,
        "gain": said["gain"],
        "full_scale": limit / said["gain"],
        "offset": said["offset"],
        "carrier": said["carrier"] or None,
        "clipped": sum(finding.count for finding in clipped),
        "open_loop": not kind.worn,
        "counts": COUNTS,
    }
    return Wave(rate, volts, limit, header, tuple(findings))


def dumps(track: CommandTrack, wave: Wave) -> bytes:
    """Return the file's bytes; equal tracks and settings give equal bytes.

    Raises:
        DermisError: the header cannot hold the kind of device, a key or a value.
    """
    scaled = np.clip(wave.volts / wave.limit, -1.0, 1.0) * COUNTS
    data = np.rint(scaled).astype("<i4").view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
    header = header_of(track, SCHEMA) | {"wave": dict(wave.header)}
    owner = f"{track.meta['finger']}, " if "finger" in track.meta else ""
    subject = f"voltage of {track.spec.key}" + (f"; {OPEN_LOOP}" if wave.header["open_loop"] else "")
    entries = {
        b"INAM": f"{owner}{track.spec.name}",
        b"ISBJ": subject,
        b"ISFT": f"Dermis {version()}",
        b"ICMT": text_of(header, ascii_only=True),  # ASCII, which every reader of INFO chunks accepts
    }
    info = b"INFO" + b"".join(_chunk(key, _ascii(text) + b"\0") for key, text in entries.items())
    form = struct.pack("<HHIIHH", 1, 1, wave.rate, 3 * wave.rate, 3, 24)
    return _chunk(b"RIFF", b"WAVE" + _chunk(b"fmt ", form) + _chunk(b"LIST", info) + _chunk(b"data", data))


def _driven(track: CommandTrack, where: str) -> Kind:
    kind = KINDS.get(track.spec.kind)
    if kind is None or not (kind.sine or kind.wave):
        raise DermisError(
            "this device is not driven by a waveform, so it has no WAV file",
            where=where,
            value=track.spec.kind,
            limit=", ".join(name for name, known in KINDS.items() if known.sine or known.wave),
            remedy="Export it as CSV, JSON, binary or C header",
        )
    return kind


def _channel(track: CommandTrack, name: str, where: str) -> Channel:
    for channel in track.channels:
        if channel.name == name:
            return channel
    known = ", ".join(c.name for c in track.channels)
    raise DermisError("the channel of the waveform is missing", where=where, value=name, limit=known)


def _check_grid(track: CommandTrack, up: float, where: str) -> None:
    if len(track.times) == 0:
        raise DermisError("the track has no samples", where=where, value=0, limit=">= 1")
    grid = track.times[0] + np.arange(len(track.times)) / track.spec.rate
    off = np.abs(grid - track.times)
    if off.max() > 1e-6:
        first = int(np.argmax(off > 1e-6))
        raise DermisError(
            "the samples are not evenly spaced",
            where=f"{where}, at {track.times[first]:.6g} s",
            value=f"{track.spec.rate:g} Hz",
            limit="times within 1 us of the device's rate",
            remedy="Resample it",
        )
    if len(track.times) * up > MAX_SAMPLES:
        raise DermisError(
            "more samples than Dermis writes to a WAV file",
            where=where,
            value=f"{len(track.times) * up:.4g}",
            limit=str(MAX_SAMPLES),
            remedy="Export a range, or choose a lower rate",
        )


def _range(channel: Channel, track: CommandTrack) -> tuple[float, float]:
    """Return the lowest and the highest value that interpolation may give.

    They are the limits of the channel. If samples of a forced track are outside the limits, the range extends to them.
    """
    values = track.column(channel.name)
    low = -np.inf if channel.low is None else min(channel.low, float(values.min()))
    return low, np.inf if channel.high is None else max(channel.high, float(values.max()))


def _limit(channel: Channel, place: str) -> float:
    if channel.high is None or not channel.high > 0:
        raise DermisError(
            "full scale is 0, and the channel states no limit to use instead",
            where=place,
            value=channel.high,
            limit="> 0 V",
            remedy="State the full scale, or give the channel a 'high' in the device preset",
        )
    return float(channel.high)


def _phase(track: CommandTrack, channel: Channel, fixed: float, up: Any, rate: int, where: str) -> Array:
    """Return the phase at every sample of the file [rad], 0 at the first.

    Args:
        channel: the track's channel of the carrier frequency.
        fixed: frequency to use instead of the channel [Hz]; 0 for the channel.
        up: samples of the file for each sample of the track.
        rate: rate of the file [Hz].
    """
    place, (low, high) = f"{where}, {channel.name}", _range(channel, track)
    if fixed:
        if not low <= fixed <= high:
            raise DermisError(
                "a carrier outside the channel's range",
                where=place,
                value=f"{fixed:g} Hz",
                limit=f"{low:g} to {high:g} Hz",
                remedy="Choose another carrier, or change the range in the device preset",
            )
        count = int((len(track.times) - 1) * up) + 1
        return np.arange(count, dtype=np.float64) * (2 * np.pi * fixed / rate)
    found = upsampled(track.column(channel.name), up, low, high)
    if found.max() >= 0.45 * rate or found.min() < 0:
        raise DermisError(
            "the carrier is too high for the file's rate",
            where=place,
            value=f"{found[np.argmax(np.abs(found))]:g} Hz",
            limit=f"0 to {0.45 * rate:g} Hz",
            remedy="Choose a higher rate",
        )
    steps = (found[1:] + found[:-1]) * (np.pi / rate)
    found[0] = 0.0
    np.cumsum(steps, out=found[1:])
    return found


def _check_offset(volts: Array, offset: float, channel: Channel, place: str) -> None:
    """Raise an error if the offset takes the voltage beyond the limit.

    The limit is that of the channel, even if full scale is higher.
    """
    if not offset or channel.high is None:
        return
    peak = float(np.abs(volts).max())
    # A forced track may be beyond the limit without an offset. Then no offset is allowed, but the track is.
    if peak + abs(offset) > max(channel.high, peak) * (1 + SLACK):
        raise DermisError(
            "the offset takes the voltage beyond the channel's limit",
            where=place,
            value=f"{peak:.6g} V and {offset:g} V",
            limit=f"{channel.high:g} V",
            remedy="Lower the offset, or the track's amplitude",
        )


def _beyond(volts: Array, limit: float, rate: int, clip: bool, channel: Channel, place: str) -> list[Finding]:
    """Return a finding if samples have to be clipped, otherwise an empty list.

    Raises:
        DermisError: samples are beyond full scale, and may not be clipped.
    """
    rows = np.flatnonzero(np.abs(volts) > limit * (1 + SLACK))
    if not len(rows):
        return []
    worst = volts[rows[np.argmax(np.abs(volts[rows]))]]
    found = Finding(
        "warning",
        "clipped",
        f"{len(rows)} of {len(volts)} samples were clipped at full scale",
        where=f"{place}, first at {rows[0] / rate:.6g} s",
        value=f"{worst:.6g} {channel.unit}",
        limit=f"{limit:.6g} {channel.unit}",
        count=len(rows),
    )
    if clip:
        return [found]
    raise DermisError(
        "a voltage beyond full scale",
        where=found.where,
        value=found.value,
        limit=f"{found.limit}, gain times full scale",
        remedy="Raise full scale or gain to those of your output and amplifier, lower the amplitude, or allow clipping",
        code="beyond-full-scale",
    )


def _ascii(text: str) -> bytes:
    return text.encode("ascii", "replace").replace(b"\0", b"?")


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)
