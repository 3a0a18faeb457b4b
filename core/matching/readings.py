"""Readings of a virtual sensor in the pulp: 19 electrodes and the pressure, 12 bits.

Source: [S2] II and III (19 electrodes and DC pressure, 12 bits, 100 Hz)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..skin.model import SkinModel
from ..skin.sensor import electrode_sensor
from ..skin.stimulus import Stimulus

Counts = NDArray[np.uint16]

CHANNELS = 20
FULL_SCALE = 4095
BITS = (8, 10, 12, 14, 16)  # resolutions of sensors whose readings are whole counts
# A reading counts as a multiple of a step if it is off by at most this share of the step. Readings in files with nine
# digits are off by less.
WHOLE = 1e-3
ROUNDING = 1e-12  # differences below this share of the largest reading are rounding
SATURATED = 0.05  # largest allowed share of samples with a channel at an end of its scale
# With these values, readings stay within the scale if a platform is pressed in by 2.4 mm at any tilt, and if skin
# bulges.
# Electrodes: counts at rest, and counts that tissue compressed to zero thickness would add to them, before clipping.
ELECTRODE_REST, ELECTRODE_GAIN = 1000.0, 6000.0
# Pressure: counts at rest, and counts that each Pa of mean pressure on the pad adds to them.
PRESSURE_REST, PRESSURE_GAIN = 500.0, 0.12


@dataclass(frozen=True, eq=False)
class Readings:
    """Virtual sensor of one skin: a linear map and its quantisation.

    Attributes:
        matrix: counts for forces on the pad nodes of linear skin [1/N], shape (20, 3 m). The last row is the pressure.
        rest: counts of untouched skin, shape (20,).
        pad: counts for the displacement of the pad nodes [1/m], shape (20, 3 m); None for linear skin.
        skin: model of the skin; None for linear skin.
    """

    matrix: Array
    rest: Array
    pad: Array | None = None
    skin: SkinModel | None = None

    def counts(self, force: NDArray[np.floating[Any]], amounts: NDArray[np.floating[Any]] | None = None) -> Array:
        """Return the counts before quantisation, shape (n, 20).

        Args:
            force: contact forces on the pad nodes [N], shape (n, m, 3).
            amounts: see `Stimulus.given`, for nonlinear skin, shape (n, 3 m); None computes them from the forces.
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
        self, force: NDArray[np.floating[Any]], noise: float = 0.0, rng: np.random.Generator | None = None
    ) -> Counts:
        """Return readings: whole counts within the scale, shape (n, 20).

        Args:
            force: as for `counts`.
            noise: standard deviation of the normal noise in each channel [counts].
            rng: source of the noise; None for one with the seed 0.
        """
        exact = self.counts(force)
        if noise > 0.0:
            exact = exact + noise * (rng or np.random.default_rng(0)).standard_normal(exact.shape)
        return quantised(exact)


def within_scale(counts: Array) -> Array:
    """Clip counts to the scale of 12 bits, without rounding."""
    return np.clip(counts, 0.0, float(FULL_SCALE))


def quantised(counts: Array) -> Counts:
    """Round counts to whole numbers and clip them to the scale of 12 bits."""
    return within_scale(np.rint(counts)).astype(np.uint16)


def step_of(readings: NDArray[Any]) -> float:
    """Return the common quantisation step of all channels.

    Counts of a converter keep a common step if they are multiplied by one factor, and if a constant is added to a
    channel. All differences between neighbouring values of a channel must be multiples of the smallest one. The result
    is this smallest difference, averaged over all differences. Without a common step it is 0.

    Args:
        readings: shape (n, c). For an array of an integer type the step is 1.
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
    return float((gaps / np.rint(multiples)).mean())  # the mean of many estimates is more exact than one


def in_steps(readings: NDArray[Any], origin: Array, step: float) -> Array:
    """Return readings as multiples of a step from an origin, shape (n, c).

    If all of them are whole up to `WHOLE`, they are rounded.

    Args:
        readings: shape (n, c).
        origin: readings that become 0, shape (c,).
        step: the common step, see `step_of`.

    Raises:
        DermisError: the step is not above 0.
    """
    if not step > 0.0:
        raise DermisError(
            "readings cannot be counted in steps of this size",
            where="step",
            value=step,
            limit="> 0",
            remedy="Leave readings without a common step as they are",
        )
    multiples = (np.asarray(readings, np.float64) - origin) / step
    whole = np.rint(multiples)
    return whole if (np.abs(multiples - whole) <= WHOLE).all() else multiples


def at_the_end(readings: Array) -> Array:
    """Return the share of samples at which each channel is at an end of its scale, shape (c,).

    The scale is known if the readings are whole counts, none of them negative, or such counts multiplied by one factor.
    It is then the smallest scale of `BITS` that holds the counts. Without a known scale the result is 0. Zero does not
    count as an end for a channel whose first reading is zero.

    Args:
        readings: shape (n, c).
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
    """Return the number of samples with a channel at an end of the scale.

    The scale is that of 12 bits.

    Args:
        counts: readings, shape (n, c).
    """
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
