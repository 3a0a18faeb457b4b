"""What the virtual sensor in the pulp reads: 19 electrodes and the pressure, in counts of 12 bits.

Source: [S2] II and III (19 electrodes and DC pressure, 12 bits, 100 Hz)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..skin.felt_state import state_of
from ..skin.model import SkinModel
from ..skin.sensor import electrode_sensor

Counts = NDArray[np.uint16]

CHANNELS = 20
FULL_SCALE = 4095
BITS = (8, 10, 12, 14, 16)  # of sensors that read whole counts
SATURATED = 0.05  # share of the samples that a channel may spend at an end of its scale
# Chosen so that a platform pressed in by 2.4 mm at any tilt stays within the scale, and bulging skin does too.
ELECTRODE_REST, ELECTRODE_GAIN = 1000.0, 6000.0  # counts, counts for tissue that is pressed to nothing
PRESSURE_REST, PRESSURE_GAIN = 500.0, 0.12  # counts, counts a Pa of mean pressure on the pad


@dataclass(frozen=True, eq=False)
class Readings:
    """The sensor of one skin as a linear map and its quantisation.

    Attributes:
        matrix: counts for forces on the pad nodes [1/N], the last row the pressure, shape (20, 3 m); of skin that
            stiffens for all that it feels (`skin.felt_state`).
        rest: counts of untouched skin, shape (20,).
        skin: that it is in, where that stiffens.
    """

    matrix: Array
    rest: Array
    skin: SkinModel | None = None

    def counts(self, force: NDArray[np.floating[Any]], amounts: NDArray[np.floating[Any]] | None = None) -> Array:
        """Return exact counts of contact forces [N], (n, m, 3) to (n, 20).

        Args:
            amounts: of each pattern that skin which stiffens is displaced by, shape (n, k); from the forces where None.
        """
        if self.skin is None:
            flat = np.asarray(force, np.float64).reshape(len(force), self.matrix.shape[1])
            return flat @ self.matrix.T + self.rest
        given = [None] * len(force) if amounts is None else np.asarray(amounts, np.float64)
        states = [state_of(self.skin, row, own) for row, own in zip(force, given, strict=True)]
        return np.array(states).reshape(len(force), self.matrix.shape[1]) @ self.matrix.T + self.rest

    def sense(
        self,
        force: NDArray[np.floating[Any]],
        noise: float = 0.0,
        rng: np.random.Generator | None = None,
        amounts: NDArray[np.floating[Any]] | None = None,
    ) -> Counts:
        """Return what is read: whole counts, with normal noise of a standard deviation [counts], within the scale."""
        exact = self.counts(force, amounts)
        if noise > 0.0:
            exact = exact + noise * (rng or np.random.default_rng(0)).standard_normal(exact.shape)
        return quantised(exact)


def quantised(counts: Array) -> Counts:
    """Return whole counts within the 12 bits of the scale."""
    return np.clip(np.rint(counts), 0, FULL_SCALE).astype(np.uint16)


def at_the_end(readings: Array) -> Array:
    """Return the share of time that each channel spends at an end of its scale, shape (c,), of readings (n, c).

    Whole counts tell their scale, of 8 bits or as many more as they need. A channel that rests at nought is not at an
    end there; readings that are fractional or below nought have no scale that is known.
    """
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
    electrodes = ELECTRODE_GAIN * electrode_sensor(skin).matrix
    pressure = -PRESSURE_GAIN * skin.normals.reshape(1, -1) / skin.areas.sum()
    rest = np.full(CHANNELS, ELECTRODE_REST)
    rest[-1] = PRESSURE_REST
    if skin.stiffening is None:
        return Readings(np.vstack([electrodes, pressure]), rest)
    beyond = np.zeros((1, electrodes.shape[1] - pressure.shape[1]))
    return Readings(np.vstack([electrodes, np.hstack([pressure, beyond])]), rest, skin)
