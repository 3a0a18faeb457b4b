"""The part of a device that a sender drives.

It is the channels with an actuator, their limits, and the safe state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...devices.calibration import Calibration
from ...devices.frequency_response import FrequencyResponse
from ...devices.response import FACTOR, Responses
from ...devices.safe_state import bare_channels, safe_state
from ...devices.spec import Channel, DeviceSpec, range_disc
from ...errors import DermisError
from .packets import FULL, Reach

REACH = {"at_once": Reach.AT_ONCE, "ramp": Reach.RAMP, "release": Reach.RELEASE}
SAFE_SWEEP = 1.0  # [s] time in which a channel without a stated speed crosses its range on the ramp to its safe value
POSES = ("m", "rad", "1")  # units of poses. A calibration moves a safe pose; a safe force or voltage of 0 stays 0


@dataclass(frozen=True)
class Wire:
    """The description of a device for a sender.

    Every array has the shape (channels,), with one entry for each channel that drives an actuator.

    Attributes:
        spec: device preset. columns: index of each channel in the preset and in tracks.
        names, units: names and units of the channels.
        range_low, range_high: values at the smallest and the largest count [units]; -inf and inf without a range.
        slew: slew limit [units/s], inf without a limit. rest: neutral pose [units].
        safe: driven values of the safe state, after calibration [units]. reach: transition to the safe state.
        zero, gain: zero and gain of the calibration. responses: its measured curves.
        frequency: its frequency responses, by index of the channel in these arrays.
        lower_limit, upper_limit: limits of the driven values [units]: the narrowest of preset, calibration and
            measured curve.
        disc: indices of two channels that share a disc as their range, and its radius [units]; None without one.
    """

    spec: DeviceSpec
    columns: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    range_low: Array
    range_high: Array
    slew: Array
    rest: Array
    safe: Array
    reach: Reach
    zero: Array
    gain: Array
    responses: Responses
    frequency: Mapping[int, FrequencyResponse]
    lower_limit: Array
    upper_limit: Array
    disc: tuple[int, int, float] | None

    @classmethod
    def of(cls, spec: DeviceSpec, calibration: Calibration | None = None) -> Wire:
        """Read a device preset and its calibration.

        Zero and gain apply to a worn device's safe pose as to every other pose, so that the platform stands at the
        preset's pose. They do not apply to a voltage or a force, so a safe value of 0 stays 0. Limits that exclude the
        safe state are refused, because one of the two would have to be broken.

        Raises:
            DermisError: no channel drives an actuator, more than 255 channels do, or two drive the same actuator;
                a channel of a worn device lacks a safe value or a speed; the safe state is invalid, or the limits
                exclude it; or the calibration does not fit the device.
        """
        columns = tuple(i for i, c in enumerate(spec.channels) if c.actuator)
        if not columns:
            raise DermisError(
                "no channel drives an actuator, so there is nothing to stream",
                where=spec.name,
                remedy="Give channels an 'actuator' in the device preset",
            )
        if len(columns) > 255:
            raise DermisError("more channels than a packet can hold", where=spec.name, value=len(columns), limit="255")
        twice = [spec.channels[i].actuator for i in columns]
        if len(set(twice)) != len(twice):
            raise DermisError("two channels drive one actuator", where=spec.name, value=", ".join(twice))
        channels = [spec.channels[i] for i in columns]
        calibration = calibration or Calibration.of(spec)
        zero, gain, lower, upper = (calibration.for_spec(spec)[k][list(columns)] for k in range(4))
        responses = _responses(calibration, channels, lower, upper)
        entries = {k: calibration.entries.get(channel.name) for k, channel in enumerate(channels)}
        frequency = {k: own.frequency for k, own in entries.items() if own is not None and own.frequency is not None}
        way, safe = safe_state(spec)
        reach = REACH[way]
        _check_worn(spec, reach)
        disc = range_disc(spec)
        if disc is not None:
            disc = (columns.index(disc[0]), columns.index(disc[1]), disc[2]) if {*disc[:2]} <= {*columns} else None

        def pick(name: str, missing: float) -> Array:
            return np.array([missing if getattr(c, name) is None else getattr(c, name) for c in channels])

        values = np.array([safe.get(c.name, c.rest) for c in channels])
        if spec.worn:
            values = np.where([c.unit in POSES for c in channels], zero + gain * values, values)
        names = [c.name for c in channels]
        _check_safe(spec, names, values, *responses.reachable)
        values = responses.driven(values, None, values)[0]
        for k, curve in responses.curves.items():  # beyond the measured span the response is unknown
            lower[k], upper[k] = max(lower[k], curve.span[0]), min(upper[k], curve.span[1])
        _check_safe(spec, names, values, lower, upper)
        return cls(
            spec,
            columns,
            tuple(c.name for c in channels),
            tuple(c.unit for c in channels),
            pick("low", -np.inf),
            pick("high", np.inf),
            pick("slew", np.inf),
            pick("rest", 0.0),
            values,
            reach,
            zero,
            gain,
            responses,
            frequency,
            lower,
            upper,
            disc,
        )

    @property
    def count(self) -> int:
        """Number of channels on the wire."""
        return len(self.columns)

    @property
    def safe_command(self) -> Array:
        """The command that drives the safe state [units], shape (channels,)."""
        return self.commanded(self.safe)

    def commanded(self, driven: Array) -> Array:
        """Return the command for driven values [units], shape (channels,).

        An actuator with a measured curve is assumed midway between the curve's two directions, so its pose is off by
        up to half of the curve's play.
        """
        return (self.responses.reached(driven) - self.zero) / self.gain

    @property
    def latency(self) -> float:
        """The largest latency of the measured curves [s]; 0 without any."""
        return max((curve.latency for curve in self.responses.curves.values()), default=0.0)

    @property
    def safe_slew(self) -> Array:
        """Speed of the ramp to the safe state [units/s], shape (channels,).

        It is infinite for a channel without a slew limit and without a range.
        """
        return np.where(np.isfinite(self.slew), self.slew, (self.range_high - self.range_low) / SAFE_SWEEP)

    @property
    def safe_seconds(self) -> float:
        """Longest duration of the ramp to the safe state [s].

        It is that of a ramp from the farthest limit of every channel, counted from the start of the ramp: infinite
        if a channel has no limit, 0 if the safe state is reached at once. A device that lets go may be ramped to its
        safe values before, so it has a duration, too.
        """
        if self.reach == Reach.AT_ONCE:
            return 0.0
        far = np.maximum(self.upper_limit - self.safe, self.safe - self.lower_limit)
        with np.errstate(invalid="ignore"):
            return float(np.where(np.isfinite(far), far / self.safe_slew, np.inf).max())

    @property
    def hash(self) -> bytes:
        """First 8 bytes of the preset's hash, filled up with zeros."""
        try:
            return bytes.fromhex(self.spec.hash)[:8].ljust(8, b"\0")
        except ValueError:
            return self.spec.hash.encode()[:8].ljust(8, b"\0")

    def need_ranges(self, protocol: str) -> None:
        """Refuse channels without a range, for protocols that send counts.

        Raises:
            DermisError: a channel has no low or no high.
        """
        bare = [
            n for n, lo, hi in zip(self.names, self.range_low, self.range_high, strict=True) if not 0 < hi - lo < np.inf
        ]
        if bare:
            raise DermisError(
                f"{protocol} sends counts, and a channel has no range for them to stand for",
                where=self.spec.name,
                value=", ".join(bare),
                remedy="Give it 'low' and 'high' in the device preset",
            )

    def counts(self, values: Array, full: int = FULL) -> NDArray[np.uint16]:
        """Return values [units] as counts from 0 to `full` over each range.

        Values outside a channel's range become its first or last count.
        """
        part = (values - self.range_low) / (self.range_high - self.range_low)
        return np.rint(np.minimum(np.maximum(part, 0.0), 1.0) * full).astype(np.uint16)

    def values(self, counts: NDArray[np.uint16], full: int = FULL) -> Array:
        """Return counts as values [units]."""
        return self.range_low + (self.range_high - self.range_low) * (counts / full)

    def named(self, values: Array) -> dict[str, float]:
        """Return values by channel name, for people and JSON."""
        return dict(zip(self.names, values.tolist(), strict=True))

    def slew_counts(self, full: int = FULL) -> NDArray[np.uint16]:
        """Return the slew limits in counts a millisecond, from 1 to 65535."""
        part = self.slew / (self.range_high - self.range_low) * full / 1000.0
        return np.clip(np.floor(part), 1, 65535).astype(np.uint16)


def _responses(calibration: Calibration, channels: list[Channel], lower: Array, upper: Array) -> Responses:
    """Return the measured curves of channels.

    Raises:
        DermisError: a curve is much wider than its channel's range; or the curve of a force or a voltage does not
            contain 0 -> 0, or has play.
    """
    curves = {}
    for k, channel in enumerate(channels):
        entry = calibration.entries.get(channel.name)
        if entry is None or entry.response is None:
            continue
        curve = curves[k] = entry.response
        width, most = curve.span[1] - curve.span[0], FACTOR * (upper[k] - lower[k])
        if width > most:
            raise DermisError(
                "a measured curve is much wider than the range of its channel",
                where=f"calibration of '{calibration.device}', {channel.name}",
                value=f"{curve.span[0]:.4g} to {curve.span[1]:.4g} {channel.unit}",
                limit=f"{lower[k]:.4g} to {upper[k]:.4g} {channel.unit}",
                remedy="Write the readings in SI, or name their units in the CSV's line of names",
            )
        none = curve.span[0] <= 0.0 <= curve.span[1] and curve.play == 0.0 and curve.between(0.0) == 0.0
        if channel.unit not in POSES and not none:
            raise DermisError(
                "a measured curve would give an output for a command at rest",
                where=f"calibration of '{calibration.device}', {channel.name}",
                value=f"{curve.between(0.0):.4g} {channel.unit} at 0, play {curve.play:.4g}",
                limit="0 at a command of 0, without play",
                remedy="Start the readings at zero, and give the curve in one direction",
            )
    return Responses(curves, lower.copy(), upper.copy())


def _check_worn(spec: DeviceSpec, reach: Reach) -> None:
    """Refuse a worn device without safe values, or without speeds for a ramp."""
    if bare := bare_channels(spec):
        raise DermisError(
            "a worn device states no safe pose, and at rest it may press the finger that is in it",
            where=f"device preset '{spec.key}', safe",
            value=f"none for {', '.join(bare[:6])}",
            limit="a value for every channel with an actuator",
            remedy="Add 'safe' to the preset: a retracted pose, clear of your finger",
        )
    free = [c.name for c in spec.channels if spec.worn and c.actuator and c.slew is None]
    if free and reach == Reach.RAMP:
        raise DermisError(
            "the safe pose is reached by a ramp, but a channel states no speed for it",
            where=f"device preset '{spec.key}'",
            value=", ".join(free[:6]),
            remedy="Give it 'slew', or let 'safe' be reached 'at_once'",
        )


def _check_safe(spec: DeviceSpec, names: list[str], safe: Array, lower: Array, upper: Array) -> None:
    """Refuse limits that exclude the safe state."""
    slack = 1e-9 * np.maximum(np.abs(safe), 1e-3)  # rounding errors of unit conversions
    outside = np.flatnonzero((safe < lower - slack) | (safe > upper + slack))
    if outside.size:
        k = int(outside[0])
        raise DermisError(
            "the safe state lies outside the calibrated limits",
            where=f"'{spec.key}', {names[k]}",
            value=f"{safe[k]:g}",
            limit=f"{lower[k]:g} to {upper[k]:g}",
            remedy="Widen the limits, or state in a device preset of your own what is safe",
        )
