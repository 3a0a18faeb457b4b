"""A virtual sensor with electrodes in the pulp, after the BioTac: 19 channels that read how far skin is pressed in.

The real sensor's electrodes sit on its core and read the impedance of the fluid between core and skin, which grows as
the skin comes nearer. The virtual ones read the same cause: the share by which the tissue over each electrode gets
thinner, a weighted mean over the skin around it. Readings are linear in the skin's displacement, and so in the contact
forces where skin is linear. Places of the electrodes are this product's own: symmetric, over the same part of the
finger. Whatever is computed with them is simulated and must be called virtual.

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

# Places of the electrodes seen from the pad, as fractions of half the finger's width (x) and of the distance from the
# pad's centre to the tip (y): seven along the middle, six to either side.
_MIDDLE = [(0.0, y) for y in (-0.95, -0.6, -0.3, 0.0, 0.3, 0.55, 0.75)]
_SIDES = [(s * x, y) for s in (1.0, -1.0) for x, y in
          ((0.35, -0.75), (0.6, -0.4), (0.35, -0.1), (0.6, 0.15), (0.35, 0.4), (0.45, 0.65))]  # fmt: skip
LAYOUT = np.array([*_MIDDLE, *_SIDES])
MIN_SAMPLES = 16  # to tell noise from touch
RARE = 4.0  # standard deviations of a normal distribution: 1 in 30,000
SPREAD = 2.0e-3  # [m] radius of the skin that an electrode sees (standard deviation of its weights)


@dataclass(frozen=True, eq=False)
class ElectrodeSensor:
    """A virtual electrode sensor in one skin.

    Attributes:
        places: of the skin over each electrode [m], shape (c, 3).
        thickness: of the tissue there [m], shape (c,).
        weights: how much of each pad node it sees, rows sum to 1, shape (c, m).
        observation: readings [1], of forces on the pad nodes or of their displacement.
    """

    places: Array
    thickness: Array
    weights: Array
    observation: Observation

    @property
    def matrix(self) -> Array:
        """Readings [1] for forces on the pad nodes of linear skin [N], shape (c, 3 m)."""
        return self.observation.matrix


def electrode_sensor(skin: SkinModel, layout: Array = LAYOUT, spread: float = SPREAD) -> ElectrodeSensor:
    """Return the sensor of a skin; electrodes keep their places relative to its size.

    Args:
        layout: places as fractions of half width and of the distance to the tip, shape (c, 2).
        spread: [m].

    Raises:
        DermisError: a spread that is not above zero, or a layout that is none.
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
    # bone and nail below: the fixed node nearest along the way in
    bone = skin.mesh.nodes[skin.mesh.fixed]
    thickness = np.array([np.sqrt(((bone - p) ** 2).sum(axis=1).min()) for p in places])
    inward = -(weights[:, :, None] * normals[None]).reshape(len(places), -1) / thickness[:, None]
    return ElectrodeSensor(places, thickness, weights, Observation(inward @ skin.compliance, inward, stress=False))


def read_stimuli(path: Path, channels: int) -> tuple[Array, Array]:
    """Read a recorded sequence of stimuli: .csv with a column of times and one for each channel, or .npz.

    Returns:
        times [s], rising, shape (n,), and stimuli, shape (n, channels).

    Raises:
        DermisError: the file cannot be read, has another number of channels, values that are not finite, or times that
            do not rise, or whose unit a .csv file does not say and that can hardly be seconds.
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
                    "the stimuli cannot be read: they are no numbers", where=f"{where}, {name}", value=str(array.dtype)
                )
        times, stimuli = times.astype(np.float64), stimuli.astype(np.float64)
    if times.ndim != 1 or stimuli.ndim != 2 or stimuli.shape != (len(times), channels) or len(times) == 0:
        raise DermisError(
            "the stimuli have another shape",
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
    """Return the standard deviation of one channel's noise in a sequence of readings, shape (n, c), in their unit.

    Measured on the second differences, which a touch hardly has and noise has most of; the median over samples leaves
    out the few in which a touch begins or ends. 0 for sequences too short to tell.
    """
    if len(stimuli) < MIN_SAMPLES:
        return 0.0
    bends = np.sqrt(((stimuli[2:] - 2.0 * stimuli[1:-1] + stimuli[:-2]) ** 2).sum(axis=1) / 6.0)
    return float(np.median(bends)) / _chi(stimuli.shape[1], 0.0)


def noise_floor_of(noise: float, channels: int) -> float:
    """Return the strength that readings of an untouched sensor stay below, but for 1 in 30,000.

    Args:
        noise: standard deviation of one channel.
    """
    return noise * _chi(channels, RARE)


def _chi(channels: int, deviations: float) -> float:
    """Quantile of the norm of independent normal numbers. Source: Wilson and Hilferty 1931"""
    share = 2.0 / (9.0 * channels)
    return float(np.sqrt(channels * (1.0 - share + deviations * np.sqrt(share)) ** 3))
