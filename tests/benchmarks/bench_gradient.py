"""Gradient friction: the slope of a map of 1024 x 1024, and reading both slopes at a million points."""

from __future__ import annotations

import numpy as np

from core.effects.gradient import bilinear, gradient

from . import Result, benchmark, measure

SIDE = 1024
POINTS = 1_000_000


def heights() -> np.ndarray:
    """Return a relief of waves and noise, float32, as maps are."""
    x = np.linspace(0, 1, SIDE)
    waves = np.sin(20 * x)[:, None] * np.cos(30 * x)[None, :]
    return (waves + 0.01 * np.random.default_rng(1).normal(size=(SIDE, SIDE))).astype(np.float32)


@benchmark("gradient_1024_ms", limit=3.5, quick=True)
def gradient_1024() -> Result:
    """Both slopes of a map in float32, against numpy's own on the same array."""
    surface = heights()
    out = np.empty((2, SIDE, SIDE), np.float32)
    spacing = (0.2 / SIDE, 0.1 / SIDE)
    ours = measure(lambda: gradient(surface, spacing, scale=1e-3, out=out), 41)
    peer = measure(lambda: np.gradient(surface, spacing[1], spacing[0]))
    along_y, along_x = np.gradient(1e-3 * surface.astype(np.float64), spacing[1], spacing[0])
    error = max(np.abs(out[0] - along_x).max(), np.abs(out[1] - along_y).max()) / np.abs(along_x).max()
    wrong = f"differs from np.gradient by {error:.1e}" if error > 1e-4 else None
    return Result("gradient_1024_ms", ours.median, "ms", ours.p95, {"np.gradient": peer.median}, wrong)


@benchmark("bilinear_1e6_ms", limit=50, quick=True)
def bilinear_1e6() -> Result:
    """Both slopes at a million scattered points, against scipy's spline of order 1 on the same arrays."""
    from scipy.ndimage import map_coordinates

    slopes = gradient(heights(), (1 / SIDE, 1 / SIDE))
    # Half a pixel inside the border, where both take the same four neighbours.
    x, y = np.random.default_rng(2).uniform(-0.499, 0.499, (2, POINTS))
    places = np.stack([(y + 0.5) * SIDE - 0.5, (x + 0.5) * SIDE - 0.5])
    ours = measure(lambda: bilinear(slopes, (1.0, 1.0), x, y))
    peer = measure(lambda: [map_coordinates(plane, places, order=1) for plane in slopes], 7)
    reference = np.stack([map_coordinates(plane, places, order=1) for plane in slopes])
    error = np.abs(bilinear(slopes, (1.0, 1.0), x, y) - reference).max() / np.abs(reference).max()
    wrong = f"differs from scipy by {error:.1e}" if error > 1e-5 else None
    return Result("bilinear_1e6_ms", ours.median, "ms", ours.p95, {"scipy.ndimage.map_coordinates": peer.median}, wrong)
