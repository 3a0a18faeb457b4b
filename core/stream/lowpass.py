"""A low-passed track, for actuators that take few values a second."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..interpolate import interpolate
from ..units import from_si

FINE = 4  # [1] least number of samples for each value of the output, if the track's own are unevenly spaced
MAX_SAMPLES = 20_000_000  # [1] most samples that an uneven track may become: over an hour for an output of 1 kHz
NOTHING = 1e-3  # [1] A loss up to this part of a channel's span is not shown. A servo's dead band is five times that.
SHOWN = {"m": "mm", "rad": "deg"}


def low_passed(times: Array, values: Array, output_hz: float) -> tuple[Array, Array]:
    """Return a track's Hann-weighted mean over two periods of the output.

    The result is evenly spaced. A track is known beforehand, so the mean covers as much of its future as of its past
    and has no delay. Its weights are positive and sum to one, so it has no overshoot either. It keeps all ranges, round
    ranges and speed limits that the track keeps.

    Args:
        times: [s], strictly rising, shape (n,). values: shape (n, channels). output_hz: values a second of the output;
            a track with no more than that is returned as it is.

    Raises:
        DermisError: an uneven track is too long for its shortest step.
    """
    steps = np.diff(times)
    if not len(steps) or steps.min() * output_hz >= 1 - 1e-6:
        return times, values
    step = float(times[-1] - times[0]) / len(steps)
    if np.abs(steps - step).max() >= 1e-6 * step:
        count = math.ceil((times[-1] - times[0]) / min(step, 1 / (FINE * output_hz))) + 1
        if count > MAX_SAMPLES:
            raise DermisError(
                "a track of uneven steps is too long to be played so finely",
                where="track",
                value=f"{count} samples",
                limit=str(MAX_SAMPLES),
                remedy="Sample it evenly",
            )
        even = np.linspace(times[0], times[-1], count)
        times, values = even, interpolate(times, values, even)
        step = float(times[1] - times[0])
    reach = math.ceil(1 / (output_hz * step) - 1e-6) - 1  # samples within a period of the output to each side
    if reach < 1:
        return times, values
    weights = 1 + np.cos(np.pi * np.arange(-reach, reach + 1) * step * output_hz)
    held = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
    columns = [np.convolve(column, weights / weights.sum(), "valid") for column in held.T]
    return times, np.stack(columns, axis=1)


@dataclass(frozen=True)
class Loss:
    """The part of a track that the output does not show.

    Attributes:
        output_hz: values a second that it takes. names, units: of the channels.
        largest, rms: largest value and root mean square of the difference between track and output, in the channel's
            unit, shape (channels,).
        span: range of each channel, in its unit, shape (channels,).
    """

    output_hz: float
    names: Sequence[str]
    units: Sequence[str]
    largest: Array
    rms: Array
    span: Array

    def __str__(self) -> str:
        """Return the loss as a message; '' if it is negligible."""
        parts = []
        for i in np.flatnonzero(self.largest > NOTHING * self.span):
            unit = SHOWN.get(self.units[i], self.units[i])
            largest, rms = (from_si(float(x[i]), unit) for x in (self.largest, self.rms))
            parts.append(f"{self.names[i]} {largest:.2g} {unit} (rms {rms:.2g})")
        if not parts:
            return ""
        return (
            f"{self.output_hz:g} values a second reach the actuators, so what the track holds above "
            f"{self.output_hz / 2:g} Hz is not rendered: {', '.join(parts)}"
        )
