"""Readings of the virtual sensor in the pulp: 19 electrodes and the pressure, in counts of 12 bits.

Source: [S2] II and III (19 electrodes and DC pressure, 12 bits, 100 Hz)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..skin.model import SkinModel
from ..skin.sensor import electrode_sensor
from ..skin.stimulus import Stimulus

Counts = NDArray[np.uint16]

CHANNELS = 20
FULL_SCALE = 4095
BITS = (8, 10, 12, 14, 16)  # of sensors that read whole counts
WHOLE = 1e-3  # of a step: readings this near to a multiple of it are one; a file's nine digits leave less
ROUNDING = 1e-12  # of the greatest reading: smaller differences between two are rounding's
SATURATED = 0.05  # share of the samples that a channel may spend at an end of its scale
# Chosen so that a platform pressed in by 2.4 mm at any tilt stays within the scale, and bulging skin does too.
ELECTRODE_REST, ELECTRODE_GAIN = 1000.0, 6000.0  # counts, counts for tissue that is pressed to nothing
PRESSURE_REST, PRESSURE_GAIN = 500.0, 0.12  # counts, counts a Pa of mean pressure on the pad


@dataclass(frozen=True, eq=False)
class Readings:
    """The sensor of one skin as a linear map and its quantisation.

    Attributes:
        matrix: counts for forces on the pad nodes of linear skin [1/N], the last row the pressure, shape (20, 3 m).
        rest: counts of untouched skin, shape (20,).
        pad: counts for displacement of the pad nodes [1/m], shape (20, 3 m), on skin that follows a law; else None.
        skin: that it is in, on skin that follows a law.
    """

    matrix: Array
    rest: Array
    pad: Array | None = None
    skin: SkinModel | None = None

    def counts(self, force: NDArray[np.floating[Any]], amounts: NDArray[np.floating[Any]] | None = None) -> Array:
        """Return exact counts of contact forces [N], (n, m, 3) to (n, 20).

        Args:
            amounts: see `Stimulus.given`, of skin that follows a law, shape (n, 3 m); from the forces where None.
        """
        flat = np.asarray(force, np.float64).reshape(len(force), self.matrix.shape[1])
        out: Array = flat @ self.matrix.T + self.rest
        if self.skin is None or self.pad is None:
            return out
        if amounts is None:
            found = [Stimulus(self.skin, row.reshape(-1, 3)).amounts for row in flat]
            amounts = np.array(found, np.float64).reshape(flat.shape)
        return out - np.asarray(amounts, np.float64).reshape(flat.shape) @ self.pad.T

    def sense(
        self,
        force: NDArray[np.floating[Any]],
        noise: float = 0.0,
        rng: np.random.Generator | None = None,
        amounts: NDArray[np.floating[Any]] | None = None,
    ) -> Counts:
        """Return the readings: whole counts, with normal noise of a standard deviation [counts], within the scale."""
        exact = self.counts(force, amounts)
        if noise > 0.0:
            exact = exact + noise * (rng or np.random.default_rng(0)).standard_normal(exact.shape)
        return quantised(exact)


def quantised(counts: Array) -> Counts:
    """Return whole counts within the 12 bits of the scale."""
    return np.clip(np.rint(counts), 0, FULL_SCALE).astype(np.uint16)


def step_of(readings: NDArray[Any]) -> float:
    """Return the step that all channels of readings share, shape (n, c): 1 of whole counts; 0 where there is none.

    A converter's counts keep a common step when they are multiplied by one factor, and when constants are added to
    channels. The step is the least difference between two values of a channel; all differences must be multiples of it.
    """
    if readings.dtype.kind in "ui":
        return 1.0
    values = np.asarray(readings, np.float64)
    gaps = np.concatenate([np.diff(np.unique(column)) for column in values.T])
    gaps = gaps[gaps > ROUNDING * np.abs(values).max()]
    if not len(gaps):
        return 0.0
    multiples = gaps / gaps.min()
    if (np.abs(multiples - np.rint(multiples)) > WHOLE).any():
        return 0.0
    return float((gaps / np.rint(multiples)).mean())  # the mean of many is more exact than the least of them


def in_steps(readings: NDArray[Any], origin: Array, step: float) -> Array:
    """Return readings (n, c) as multiples of a step from an origin, shape (c,): whole numbers where they are.

    Raises:
        ZeroDivisionError: there is no step.
    """
    multiples = (np.asarray(readings, np.float64) - origin) / step
    whole = np.rint(multiples)
    return whole if (np.abs(multiples - whole) <= WHOLE).all() else multiples


def at_the_end(readings: Array) -> Array:
    """Return the share of time that each channel spends at an end of its scale, shape (c,), of readings (n, c).

    Whole counts, or counts times one factor, tell their scale, of 8 bits or as many more as they need. A channel that
    rests at nought is not at an end there; readings that are fractional or below nought have no scale that is known.
    """
    step = 1.0 if (readings == np.rint(readings)).all() else step_of(readings)
    if not step:
        return np.zeros(readings.shape[1])
    readings = in_steps(readings, np.zeros(readings.shape[1]), step)
    if not (readings >= 0.0).all() or (readings != np.rint(readings)).any():
        return np.zeros(readings.shape[1])
    full = next((2**bits - 1 for bits in BITS if readings.max() < 2**bits), np.inf)
    at: Array = ((readings >= full) | ((readings <= 0.0) & (readings[0] > 0.0))).mean(axis=0)
    return at


def saturated(counts: NDArray[Any]) -> int:
    """Return how many readings (rows) have a channel at either end of the scale."""
    return int(((counts <= 0) | (counts >= FULL_SCALE)).any(axis=1).sum())


def readings_of(skin: SkinModel) -> Readings:
    """Return the virtual sensor of a skin."""
    sensor = electrode_sensor(skin).observation
    pressure = -PRESSURE_GAIN * skin.normals.reshape(1, -1) / skin.areas.sum()
    rest = np.full(CHANNELS, ELECTRODE_REST)
    rest[-1] = PRESSURE_REST
    matrix = np.vstack([ELECTRODE_GAIN * sensor.matrix, pressure])
    if not skin.follows_law or sensor.pad is None:
        return Readings(matrix, rest)
    return Readings(matrix, rest, np.vstack([ELECTRODE_GAIN * sensor.pad, np.zeros_like(pressure)]), skin)
