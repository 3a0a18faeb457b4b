"""Virtual sensor with electrodes in the pulp, after the BioTac.

It has 19 channels, which measure the compression of the tissue. The electrodes of the real sensor are on its core. They
measure the impedance of the fluid between core and skin, which rises if the skin comes nearer. Each virtual electrode
reads the relative decrease of the tissue's thickness above it, as a weighted mean over the skin nearby. Readings are
linear in the skin's displacement, and on linear skin also in the contact forces. The positions of the virtual
electrodes are this project's own: they are symmetric and cover the same part of the finger. All results with them are
simulated and must be called virtual.

Source: [S0] 6 (a BioTac with 19 electrodes as a measurable descriptor of the stimulus)
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..npz import opened_npz
from ..number_rows import read_rows
from .model import SkinModel
from .observation import Observation

# Positions of the electrodes in the pad's plane: seven along the middle, and six on each side. x is a fraction of half
# the pad's width, and y is a fraction of the distance from the pad's centre to its end at the tip.
_MIDDLE = [(0.0, y) for y in (-0.95, -0.6, -0.3, 0.0, 0.3, 0.55, 0.75)]
_SIDES = [(s * x, y) for s in (1.0, -1.0) for x, y in
          ((0.35, -0.75), (0.6, -0.4), (0.35, -0.1), (0.6, 0.15), (0.35, 0.4), (0.45, 0.65))]  # fmt: skip
LAYOUT = np.array([*_MIDDLE, *_SIDES])
MIN_SAMPLES = 16  # least number of samples for an estimate of the noise
RARE = 4.0  # a number of standard deviations; 1 in 30,000 values of a normal distribution exceeds the mean by more
SPREAD = 2.0e-3  # standard deviation of the weights of an electrode on the skin [m]


@dataclass(frozen=True, eq=False)
class ElectrodeSensor:
    """Virtual electrode sensor in one skin.

    Attributes:
        places: points of the skin above the electrodes [m], shape (c, 3).
        thickness: thickness of the tissue at these points [m], shape (c,).
        weights: weights of the pad nodes for each electrode, with a sum of 1, shape (c, m).
        observation: matrices from forces on the pad nodes, and from their displacement, to readings [1].
    """

    places: Array
    thickness: Array
    weights: Array
    observation: Observation

    @property
    def matrix(self) -> Array:
        """Matrix from forces on linear skin to readings [1/N], shape (c, 3 m)."""
        return self.observation.matrix


def electrode_sensor(skin: SkinModel, layout: Array = LAYOUT, spread: float = SPREAD) -> ElectrodeSensor:
    """Return the virtual sensor of a skin.

    Args:
        skin: model of the skin.
        layout: positions of the electrodes relative to the size of the pad, see `LAYOUT`, shape (c, 2).
        spread: standard deviation of the weights [m].

    Raises:
        DermisError: the spread is not above zero, or the layout is not valid.
    """
    layout = np.asarray(layout, np.float64)
    if layout.ndim != 2 or layout.shape[1:] != (2,) or not np.isfinite(layout).all() or not spread > 0:
        raise DermisError(
            "electrodes need places (c, 2) and a spread above zero",
            where="virtual sensor",
            value=f"{layout.shape}, {spread}",
        )
    positions, normals = skin.positions, skin.normals
    half, tip = float(np.abs(positions[:, 0]).max()), float(positions[:, 1].max())
    wanted = layout * np.array([half, tip])
    nearest = ((positions[:, None, :2] - wanted[None]) ** 2).sum(axis=2).argmin(axis=0)
    places = positions[nearest]
    distance = ((positions[None] - places[:, None]) ** 2).sum(axis=2)
    weights = np.exp(-0.5 * distance / spread**2) * skin.areas
    weights /= weights.sum(axis=1, keepdims=True)
    # The thickness is the distance from the nearest fixed node, on bone or nail.
    bone = skin.mesh.nodes[skin.mesh.fixed]
    thickness = np.array([np.sqrt(((bone - p) ** 2).sum(axis=1).min()) for p in places])
    inward = -(weights[:, :, None] * normals[None]).reshape(len(places), -1) / thickness[:, None]
    return ElectrodeSensor(places, thickness, weights, Observation(inward @ skin.compliance, inward, stress=False))


def read_stimuli(path: Path, channels: int) -> tuple[Array, Array]:
    """Read a recorded sequence of stimuli from a .csv or .npz file.

    A .csv file has a column of times and one column for each channel. An .npz file has the arrays 'times' and
    'stimuli'.

    Args:
        path: path of the file.
        channels: number of channels that the stimuli must have.

    Returns:
        Times [s], rising, shape (n,), and stimuli, shape (n, channels).

    Raises:
        DermisError: the file cannot be read, has another number of channels or values that are not finite, times do not
            rise, or the times of a .csv file have no unit and are hardly in seconds.
    """
    path, where = Path(path), str(path)
    if path.suffix.lower() == ".csv":
        rows = read_rows(path)
        times, index = rows.times()
        stimuli = np.delete(rows.values, index, axis=1)
    else:
        with opened_npz(path, kind="a recording of stimuli") as archive:
            times, stimuli = archive.array("times"), archive.array("stimuli")
        for name, array in (("times", times), ("stimuli", stimuli)):
            if array.dtype.kind not in "buif":
                raise DermisError(
                    "the stimuli cannot be read: they are not numbers", where=f"{where}, {name}", value=str(array.dtype)
                )
        times, stimuli = times.astype(np.float64), stimuli.astype(np.float64)
    if times.ndim != 1 or stimuli.ndim != 2 or stimuli.shape != (len(times), channels) or len(times) == 0:
        raise DermisError(
            "the stimuli do not have the expected shape",
            where=where,
            value=stimuli.shape,
            limit=f"(n, {channels}) after the times, separated by commas",
        )
    bad = np.flatnonzero(~np.isfinite(stimuli).all(axis=1) | ~np.isfinite(times))
    if len(bad):
        raise DermisError("a stimulus is not finite", where=f"{where}, row {bad[0] + 1}")
    if (np.diff(times) <= 0).any():
        raise DermisError("times do not rise", where=f"{where}, row {int(np.argmax(np.diff(times) <= 0)) + 2}")
    return times, stimuli


def noise_of(stimuli: Array) -> float:
    """Estimate the standard deviation of one channel's noise.

    The estimate uses second differences, which are small for a touch and large for noise. The median over the samples
    is not affected by the few samples in which a touch begins or ends. The result is 0 if there are fewer samples than
    `MIN_SAMPLES`.

    Args:
        stimuli: sequence of readings, shape (n, c).
    """
    if len(stimuli) < MIN_SAMPLES:
        return 0.0
    bends = np.sqrt(((stimuli[2:] - 2.0 * stimuli[1:-1] + stimuli[:-2]) ** 2).sum(axis=1) / 6.0)
    return float(np.median(bends)) / _chi(stimuli.shape[1], 0.0)


def noise_floor_of(noise: float, channels: int) -> float:
    """Return the norm of noise that 1 in 30,000 readings exceeds.

    The readings are those of an untouched sensor.

    Args:
        noise: standard deviation of one channel.
        channels: number of channels.
    """
    return noise * _chi(channels, RARE)


def _chi(channels: int, deviations: float) -> float:
    """Return a quantile of the norm of `channels` standard normal numbers.

    Its probability is that of a normal number to be at most `deviations` standard deviations above the mean.

    Source: Wilson and Hilferty 1931
    """
    share = 2.0 / (9.0 * channels)
    return float(np.sqrt(channels * (1.0 - share + deviations * np.sqrt(share)) ** 3))
