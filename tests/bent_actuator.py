"""An actuator that is bent and has play, by its own formula: curves are measured of it, and judged by it."""

from __future__ import annotations

import math

import numpy as np

from core.devices.response import Response, Responses
from core.devices.response_readings import of_readings


class Actuator:
    """A bent actuator with play, by its own formula: what a curve is measured of and judged by."""

    def __init__(self, play: float = 0.04, bend: float = 0.1) -> None:
        self.play, self.bend, self.at = play, bend, 0.0

    def curve(self, driven: float) -> float:
        """Return the middle of both ways."""
        return driven + self.bend * math.sin(2.0 * driven)

    def drive(self, driven: float) -> float:
        """Drive it; return what it reaches."""
        middle = self.curve(driven)
        self.at = min(max(self.at, middle - self.play / 2), middle + self.play / 2)
        return self.at


def measured(actuator: Actuator, count: int = 61, span: float = 1.0) -> Response:
    """Walk up and down, and up again, and read what is reached."""
    grid = np.linspace(-span, span, count)
    way = np.concatenate([grid, grid[-2::-1], grid[1:], grid[-2::-1]])
    actuator.drive(-span)
    return of_readings(way, [actuator.drive(float(d)) for d in way], measured_on="2026-11-27", valid_days=30)


def commands(seed: int, least: float, most: float) -> np.ndarray:
    """A way with reversals, pauses and steps within a range."""
    rng = np.random.default_rng(seed)
    smooth = np.cumsum(rng.normal(size=2000))
    smooth = np.convolve(smooth, np.ones(25) / 25, "same")
    smooth[900:950] = smooth[900]
    smooth[1500:] += np.ptp(smooth) * 0.3 * np.sign(np.sin(np.arange(500) / 40.0))
    return least + (most - least) * (smooth - smooth.min()) / np.ptp(smooth)


def worst_error(actuator: Actuator, curve: Response, wanted: np.ndarray) -> float:
    """Return the largest error of what is reached, of the range [1], once the first reversal is through."""
    limits = np.array([-2.0]), np.array([2.0])
    responses = Responses({0: curve}, *limits)
    last = np.array([curve.drives(float(wanted[0]))])
    for value in (curve.span[0], last[0]):  # from below, as the curve believes it
        actuator.drive(float(value))
    now = responses.believe(np.array([curve.span[0]]))
    now = responses.believe(last, now)
    errors = []
    for value in wanted:
        last, _ = responses.driven(np.array([value]), now, last)
        now = responses.believe(last, now)
        errors.append(abs(actuator.drive(float(last[0])) - value))
    low, high = curve.reach
    return max(errors) / (high - low)
