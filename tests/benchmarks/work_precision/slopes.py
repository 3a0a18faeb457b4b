"""Slopes of a relief, as a screen's friction needs them: of a map by its pixels, and read at points between them.

The relief is a sum of waves whose slopes are known: errors are RMS over RMS, all of them discretisation and rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from core.arrays import Array
from core.effects.gradient import bilinear, gradient

from .. import one_blas_thread, timing
from .measured import Panel, Point, clocked

SIDES = (128, 256, 512, 1024, 2048)
POINTS, REPEAT, SEED = 200_000, 7, 3
INSIDE = (slice(None), slice(1, -1), slice(1, -1))  # all pixels but the border's, where each has a rule of its own
WAVES = ((3.0, 5.0, 1.0), (11.0, 2.0, 0.4), (7.0, 17.0, 0.2))  # periods across x and y, and height


def relief(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return height and its slopes along x and y, on a square of 1 by 1 about the origin."""
    height, along_x, along_y = (np.zeros(np.broadcast_shapes(x.shape, y.shape)) for _ in range(3))
    for a, b, size in WAVES:
        phase = 2.0 * np.pi * (a * x + b * y)
        height += size * np.sin(phase)
        along_x += size * 2.0 * np.pi * a * np.cos(phase)
        along_y += size * 2.0 * np.pi * b * np.cos(phase)
    return height, along_x, along_y


def of_maps() -> Panel:
    """Return slopes of whole maps: ours in both precisions, numpy's and scipy's."""
    from scipy.ndimage import sobel

    panel = Panel("gradient", "slopes of a map, by its side in pixels", "error of slopes", each="ms a map")
    for side in SIDES:
        at = (np.arange(side) + 0.5) / side - 0.5
        height, *exact = relief(at[None, :], at[:, None])
        single, step = height.astype(np.float32), 1.0 / side
        out = np.empty((2, side, side), np.float32)
        ways: dict[str, Callable[[], object]] = {
            "ours, float32": lambda m=single, s=step, o=out: gradient(m, (s, s), out=o),
            "ours, float64": lambda m=height, s=step, o=out: gradient(m, (s, s), out=o),
            "np.gradient, float32": lambda m=single, s=step: np.gradient(m, s)[::-1],
            "np.gradient, float64": lambda m=height, s=step: np.gradient(m, s)[::-1],
            "scipy sobel, float64": lambda m=height, s=step: [sobel(m, axis) / (8.0 * s) for axis in (1, 0)],
        }
        for name, make in ways.items():
            default = name == "ours, float32" and side == 1024
            panel.points.append(_timed(name, str(side), make, np.array(exact), default, INSIDE))
    return panel


def at_points() -> Panel:
    """Return slopes read at points that lie anywhere, by the pixels of the map and the way to read between them."""
    from scipy.ndimage import map_coordinates

    panel = Panel("sampling", f"slopes read at {POINTS:,} points, by the map's side", "error of slopes")
    panel.each = "ms a million points"
    x, y = np.random.default_rng(SEED).uniform(-0.48, 0.48, (2, POINTS))
    exact = np.array(relief(x, y)[1:])
    for side in SIDES:
        at = (np.arange(side) + 0.5) / side - 0.5
        slopes = gradient(relief(at[None, :], at[:, None])[0].astype(np.float32), (1.0 / side, 1.0 / side))
        places = np.stack([(y + 0.5) * side - 0.5, (x + 0.5) * side - 0.5])
        ways: dict[str, Callable[[], object]] = {
            "ours, bilinear": lambda p=slopes: bilinear(p, (1.0, 1.0), x, y),
            "scipy, linear": lambda p=slopes, at=places: [map_coordinates(plane, at, order=1) for plane in p],
            "scipy, cubic": lambda p=slopes, at=places: [map_coordinates(plane, at, order=3) for plane in p],
        }
        for name, make in ways.items():
            found = _timed(name, str(side), make, exact, name == "ours, bilinear" and side == 1024)
            scale = 1e6 / POINTS
            panel.points.append(found._replace(median=scale * found.median, p95=scale * found.p95))
    return panel


def _timed(curve: str, knob: str, make: Callable[[], object], exact: Array, default: bool, seen: Any = ...) -> Point:
    times = []
    with one_blas_thread():
        make()
        for _ in range(REPEAT):
            found, taken = clocked(make)
            times.append(taken)
    off = float(np.sqrt(((np.asarray(found, np.float64) - exact)[seen] ** 2).sum() / (exact[seen] ** 2).sum()))
    told = timing(times)
    return Point(curve, knob, told.median, told.p95, off, None, default)
