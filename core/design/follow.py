"""Track of a device from a sensor's recording.

The commands are looked up in a table of the device.

Source: [S2] III.B eq. 2-4; with fewer motors eq. 5 and 7; the estimate eq. 8-10
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.coupling import coupling_of, refuse_coupled
from ..devices.spec import DeviceSpec
from ..devices.thimble import Thimble, channel_values
from ..devices.thimble import mechanism as thimble_of
from ..errors import DermisError, Finding
from ..interpolate import interpolate
from ..matching.lookup import commands_of, driven_within, readings_for
from ..matching.nearest import NEIGHBOURS
from ..matching.table import SkinTable, belongs
from ..surrogate.table import SampleTable, read_table
from ..track.command_track import RECORDED, CommandTrack
from .answer import BOUNDS, POOR
from .recorded_table import rest_finding
from .recordings import Recording, same_channels
from .synergies import components, rendering_error
from .task import load_table

SLOWEST = 0.5  # [s] interval between two samples; a live stream ends after such an interval without a reading


@dataclass(frozen=True, eq=False)
class Followed:
    """A track that follows a recording.

    Attributes:
        track: track of the device, within its limits; it starts at the recording's first sample.
        times: time of each sample since the recording's first [s], shape (n,).
        commands: values of the device's channels at these times, before the track's limits of speed, shape (n,
            channels).
        target: readings to be reproduced, in the table's unit, shape (n, channels).
        expected: readings that the table predicts for the commands, before the track's limits, shape (n, channels).
        touched: whether each sample differs from rest by more than the noise, shape (n,).
        error: root mean square of the difference between expected readings and target, in the table's unit.
        touch: root mean square of the difference between target and rest, in the table's unit.
        noise: standard deviation of one channel, in the table's unit.
        findings: reasons to doubt the track.
    """

    track: CommandTrack
    times: Array
    commands: Array
    target: Array
    expected: Array
    touched: NDArray[np.bool_]
    error: float
    touch: float
    noise: float
    findings: tuple[Finding, ...]

    def words(self) -> str:
        """Return the figures as a sentence."""
        share = f"{100.0 * self.error / self.touch:.1f} %" if self.touch else "nothing"
        return (
            f"{len(self.times)} samples, {int(self.touched.sum())} touched, the table leaves {share} of the touch; "
            f"noise {self.noise:.3g} a channel"
        )


def follow(
    spec: DeviceSpec, table: SkinTable, recording: Recording, *, noise: float | None = None, motors: int | None = None
) -> Followed:
    """Return the track with which a device reproduces a recording.

    Args:
        spec: the device.
        table: look-up table of the device and the sensor. For a thimble see `thimble_table`.
        recording: the recording.
        noise: standard deviation of one channel, in the recording's unit; None to estimate it from the recording.
        motors: number of principal components of the looked-up commands to which the movement is restricted; None for
            no restriction. It must be None for a device with coupled motors.

    Raises:
        DermisError: the recording's channels or the device's motors do not fit the table, the recording never touches,
            the number of motors is out of range or given for coupled motors, or a thimble can hold none of the poses.

    Source: [S2] III.B eq. 2-4, IV.B eq. 5 and 7
    """
    same_channels(recording, table)
    thimble = spec.kind == "thimble"
    findings = [*(() if thimble else belongs(table, spec)), *rest_finding(table), *_sensor(table, recording)]
    target = recording.tared(table.exact_readings[table.rest])
    sigma = recording.noise if noise is None else noise
    heard = table.heard_with(sigma)
    off = heard.from_rest(target)
    touched = off > heard.noise_floor
    if not touched.any():
        raise DermisError(
            "nothing is ever touched",
            where=f"recording '{recording.name}'",
            value=f"readings up to {float(off.max()):.3g} from rest",
            limit=f"> {heard.noise_floor:.3g}, which the noise reaches",
            remedy="Check that table and recording are of one sensor in one unit, or state the noise",
        )
    looked_up = commands_of(heard, target)
    if motors is not None:
        looked_up = _reduced(spec, table, looked_up, motors)
    if thimble:
        values, driven, told = _held(spec, looked_up)
    else:
        values, driven, _, told = driven_within(spec, looked_up)
    expected = readings_for(table, driven)
    error, touch = rendering_error(target, expected), float(np.sqrt((off**2).mean()))
    findings += [*told, *_slow(recording), *_left(recording, target - expected, error, touch)]
    times = recording.times - recording.times[0]
    grid = np.arange(int(np.floor(times[-1] * spec.rate + 1e-9)) + 1) / spec.rate
    meta = {
        "method": "lookup",
        "table_rows": str(len(table.commands)),
        "neighbours": str(NEIGHBOURS),
        "sensor": f"{RECORDED}, {len(recording.channels)} channels",
        "stimuli": recording.name,
    }
    track = CommandTrack(spec, grid, interpolate(times, values, grid), meta).within_limits()
    return Followed(track, times, values, target, expected, touched, error, touch, sigma, (*findings, *track.check()))


class Follower:
    """Converts a sensor's readings into commands, one after the other.

    Args:
        spec: the device.
        table: look-up table of the device and the sensor.
        noise: standard deviation of one channel.

    Attributes:
        beyond: number of readings with a channel outside the channel's range in the table by more than a tenth of this
            range. The nearest rows are used for them.
        first_beyond: description of the first of these readings; '' if there is none.

    Raises:
        DermisError: the table belongs to another device.
    """

    def __init__(self, spec: DeviceSpec, table: SkinTable, noise: float = 0.0) -> None:
        self.findings = belongs(table, spec)
        self.table = table.heard_with(noise)
        self.channels = table.readings.shape[1]
        self._coupling = coupling_of(spec)
        known = self.table.exact_readings
        slack = BOUNDS * np.ptp(known, axis=0)
        self._least, self._most = known.min(axis=0) - slack, known.max(axis=0) + slack
        self.beyond, self.first_beyond = 0, ""
        self._last: Array = self.table.commands[self.table.rest]
        # Prepare the search before the first reading comes. The row farthest from rest is looked up for this, because
        # readings at rest need no search.
        commands_of(self.table, known[[int(self.table.from_rest(known).argmax())]])

    def command(self, reading: Array) -> Array:
        """Return the device's commands for a reading.

        They have the shape (motors,). The device's limits are not applied to them.

        Args:
            reading: readings of all channels, shape (channels,).

        Raises:
            DermisError: the number of channels differs from the table's, or a value is not finite.
        """
        self._last = commands_of(self.table, reading[None], self._last)[0]
        outside = (reading < self._least) | (reading > self._most)
        if outside.any():
            self.beyond += 1
            i = int(outside.argmax())
            self.first_beyond = self.first_beyond or (
                f"channel {i + 1} reads {reading[i]:.4g}, beyond {self._least[i]:.4g} to {self._most[i]:.4g}"
            )
        return self._last if self._coupling is None else self._coupling.reduced(self._last)


def table_of(spec: DeviceSpec, file: Path, rest_rows: Sequence[int] = ()) -> SkinTable:
    """Return the table with which a platform or a thimble follows a sensor.

    Args:
        spec: the device.
        file: file of the table.
        rest_rows: see `load_table`; not allowed for a thimble.

    Raises:
        DermisError: the file cannot be read, the table belongs to another device, or `rest_rows` are not allowed.
    """
    if spec.kind != "thimble":
        return load_table(spec, file, rest_rows)
    if rest_rows:
        raise DermisError("the rest of a thimble is its farthest pose", where="--rest-rows", limit="a platform's table")
    return thimble_table(spec, read_table(file).without_memory(), file.name)


def thimble_table(spec: DeviceSpec, samples: SampleTable, source: str, channels: tuple[str, ...] = ()) -> SkinTable:
    """Convert recorded samples of a thimble into a look-up table.

    The commands of the table are the poses: pitch, roll [rad] and distance [m]. The rest row is the one farthest from
    the finger.

    Raises:
        DermisError: there are too few rows, or a component of the pose never changes.
    """
    span = np.ptp(samples.x, axis=0)
    if not (span > 0.0).all():
        raise DermisError("a pose never changes", where=source, value=span.tolist(), limit="pitch, roll, distance")
    meta = {"source": source, "asked": len(samples.x), "rest_rows": 1}
    if channels:
        meta["channels"] = list(channels)
    return SkinTable(samples.x, samples.channels, int(samples.x[:, 2].argmax()), span, 0.0, meta)


def _reduced(spec: DeviceSpec, table: SkinTable, commands: Array, motors: int) -> Array:
    """Return commands restricted to the first components.

    Source: [S2] eq. 5 and 7.
    """
    refuse_coupled(spec)
    if not 1 <= motors <= commands.shape[1]:
        raise DermisError("as many motors as the device has", value=motors, limit=f"1 to {commands.shape[1]}")
    return components(commands, table.scale).reconstructed(commands, motors)


def _held(spec: DeviceSpec, x: Array) -> tuple[Array, Array, list[Finding]]:
    """Return a thimble's channels for poses, the poses held, and findings.

    In place of a pose that the thimble cannot hold, the pose before it is held.
    """
    device: Thimble = thimble_of(spec)
    held, angles, missed = x.copy(), np.empty_like(x), 0
    last = x[[i for i in range(len(x)) if device.feasible(x[i])][:1]]
    if not len(last):
        raise DermisError("the device can hold none of these poses", where=f"device preset '{spec.key}'")
    before = last[0]
    for i, pose in enumerate(x):
        if not device.feasible(pose):
            held[i], missed = before, missed + 1
        before = held[i]
        angles[i] = device.joints(before)[0]
    columns = channel_values(angles, held)
    values = np.stack([columns[c.name] for c in spec.channels], axis=1)
    if not missed:
        return values, held, []
    what = "the device cannot hold a looked-up pose, and keeps the last one"
    return values, held, [Finding("warning", "pose-unreached", what, f"device '{spec.key}'", count=missed)]


def _sensor(table: SkinTable, recording: Recording) -> list[Finding]:
    """Report a table that was swept with the virtual sensor.

    Such a table does not apply to a recording of a real sensor.
    """
    if "source" in table.meta or "channels" in table.meta:
        return []
    return [
        Finding(
            "warning",
            "virtual-table",
            "the table was simulated with the virtual sensor: it does not apply to a real sensor's readings",
            f"recording '{recording.name}'",
            remedy="Use a table that was recorded with this sensor in this device",
        )
    ]


def _slow(recording: Recording) -> list[Finding]:
    """Report a recording with long intervals between its samples.

    A touch can lie between two samples of such a recording.
    """
    apart = float(np.median(np.diff(recording.times)))
    if apart <= SLOWEST:
        return []
    what = "the sensor was read so seldom that a touch can lie between two samples: the track goes straight there"
    where = f"recording '{recording.name}'"
    return [Finding("warning", "slow-recording", what, where, f"{apart:.3g} s", f"{SLOWEST:g} s, as of a live sensor")]


def _left(recording: Recording, off: Array, error: float, touch: float) -> list[Finding]:
    """Report a touch that the table does not reach.

    The finding names the channel and the sample with the largest error.
    """
    if error <= BOUNDS * touch:
        return []
    poor = error > POOR * touch
    k = int((off**2).sum(axis=0).argmax())
    share = float((off[:, k] ** 2).sum() / (off**2).sum())
    i = int(np.abs(off[:, k]).argmax())
    most = f", {100 * share:.0f} % of that in channel '{recording.channels[k]}', most in sample {i + 1}"
    return [
        Finding(
            "warning" if poor else "info",
            "poorly-rendered" if poor else "table-limits",
            "the table has no similar readings for much of this touch"
            if poor
            else "the table limits how well this touch is rendered",
            f"recording '{recording.name}'",
            f"{100 * error / touch:.0f} % of it are left{most}",
            f"{100 * (POOR if poor else BOUNDS):g} %",
            "Check that recording and table are of one sensor in one unit, or use a table that reaches this touch",
        )
    ]
