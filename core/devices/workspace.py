"""Workspace: limits of the poses of a thimble's platform."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .thimble import Thimble

STEEPEST = np.radians(60.0)  # [rad] tilt at which the search for the largest tilt ends
HALVINGS = 14  # number of halvings of a step in the search for a limit, for an accuracy of 0.004 degrees or 1 um


@dataclass(frozen=True, eq=False)
class Workspace:
    """Largest tilts of a platform at several distances.

    Attributes:
        distance: distance of the platform from the base [m], rising, shape (d,).
        direction: direction of tilt about the base's Z [rad], shape (a,); 0 is pitch, 90 degrees is roll.
        tilt: largest tilt at each distance in each direction [rad], shape (d, a).
    """

    distance: Array
    direction: Array
    tilt: Array

    def configurations(self, level: int) -> Array:
        """Return the configurations on the limit at one distance, shape (a, 3).

        Args:
            level: index of the distance.
        """
        tilt, distance = self.tilt[level], np.full(len(self.direction), self.distance[level])
        return np.stack([tilt * np.cos(self.direction), tilt * np.sin(self.direction), distance], axis=1)


def distance_range(device: Thimble, around: float, pitch: float = 0.0, roll: float = 0.0) -> tuple[float, float]:
    """Return the smallest and largest distance of the platform at a tilt [m].

    Args:
        device: the thimble.
        around: a distance that the platform reaches at this tilt [m].
        pitch, roll: the tilt [rad].

    Raises:
        DermisError: the platform does not reach `around`.
    """
    if not device.feasible((pitch, roll, around)):
        raise DermisError(
            "the platform does not reach this pose",
            where="thimble",
            value=f"{1e3 * around:.2f} mm",
            limit=f"servos within {np.degrees(device.servo_range):.3g} deg",
        )
    start, out = np.array([pitch, roll, around]), device.crank + device.rod  # no leg is longer than this
    low, high = (_edge(device, start, np.array([0.0, 0.0, sign]), out) for sign in (-1.0, 1.0))
    return around - low, around + high


def workspace(device: Thimble, around: float, levels: int = 9, directions: int = 48) -> Workspace:
    """Return the largest tilts of a platform at several distances.

    Args:
        device: the thimble.
        around: a distance that the level platform reaches [m].
        levels: number of distances.
        directions: number of directions.

    Raises:
        DermisError: the level platform does not reach `around`.
    """
    low, high = distance_range(device, around)
    margin = 0.02 * (high - low)  # at the ends of the range no tilt is possible
    distance = np.linspace(low + margin, high - margin, levels).astype(np.float64)
    direction = np.arange(directions, dtype=np.float64) * (2 * np.pi / directions)
    ways = np.stack([np.cos(direction), np.sin(direction), np.zeros(directions)], axis=1)
    tilt = np.array(
        [[_edge(device, np.array([0.0, 0.0, z]), way, STEEPEST) for way in ways] for z in distance.tolist()], np.float64
    )
    return Workspace(distance, direction, tilt)


def _edge(device: Thimble, start: Array, way: Array, most: float) -> float:
    """Return the largest feasible multiple of a direction.

    The multiples from 0 to the result are feasible, as far as they are tested.

    Args:
        device: the thimble.
        start: configuration for the multiple 0.
        way: direction in the space of configurations.
        most: multiple at which the search ends; the result may exceed it by one step, `most` / 24.
    """
    low, step = 0.0, most / 24
    while low + step <= most and device.feasible(start + (low + step) * way):
        low += step
    high = low + step
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if device.feasible(start + middle * way) else (low, middle)
    return low
