"""Fit a fingertip to a finger: its frame, its preset and its scale.

This module does not use Blender.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .._core import Array

MIDDLE = 0.54  # height of the widest part, where joints lie, above the pad, as a share of the thickness
_SAME = 0.07  # log of the scale below which a preset is taken unscaled, because tables of its skin are shipped
_STEPS = 4  # number of iterations in which place and size are found from each other
FEWEST = 8  # least number of triangles, and of points, of a surface
_TRUSTED = (0.4, 2.5)  # size by a surface over size by the bone; outside, the surface is not that of the finger


@dataclass(frozen=True)
class Fit:
    """A fingertip at rest.

    Attributes:
        origin: the pad's centre, in scene units, shape (3,).
        axes: columns X, Y to the tip and Z to the nail, shape (3, 3).
        preset: key of the nearest preset.
        scale: factor of its lengths.
        on_skin: whether the pad was placed by a surface; else it is where a finger round the bone has its pad.
        width: width of the finger [m].
        miss: distance from the pad's centre to the nearest skin [m]; None if there is none.
    """

    origin: Array
    axes: Array
    preset: str
    scale: float
    on_skin: bool
    width: float
    miss: float | None


def fit(
    line: Array,
    nail: Array,
    triangles: Array | None,
    presets: Mapping[str, Mapping[str, float]],
    unit: float,
    width: float = 0.0,
) -> Fit:
    """Return the fit of a fingertip to a finger.

    Args:
        line: joints from the knuckle to the tip, in scene units, shape (n, 3).
        nail: direction of the nail, perpendicular to the last phalanx.
        triangles: triangles of the skin around it, in scene units, shape (t, 3, 3); None if there are none.
        presets: lengths of the presets [m], by their keys. unit: [m] length of a scene unit.
        width: width of the finger if a person has given it [m]; 0 for the width found from the hand.
    """
    joint, ahead = line[-2], line[-1] - line[-2]
    length = float(np.linalg.norm(ahead))
    y = ahead / length
    axes = np.stack([np.cross(y, nail), y, nail], axis=1)
    key, scale = _nearest(presets, {"length": length * unit})
    by_bone = scale
    if width:
        key, scale = _as_wide(presets, width)
    size = presets[key]
    place = np.array([0.0, length * unit - scale * size["tip"], -scale * MIDDLE * size["thickness"]])
    on_skin = False
    if triangles is not None and len(triangles) >= FEWEST:
        here = (triangles - joint) @ axes * unit
        found = _on_skin(here, length * unit, presets, key, scale)
        if found is not None and _TRUSTED[0] < found[2] / by_bone < _TRUSTED[1]:
            said = _on_skin(here, length * unit, presets, key, scale, steps=0) if width else None
            (place, key, scale), on_skin = said or found, True
    origin = joint + axes @ place / unit
    miss = None if triangles is None or not len(triangles) else unit * distance(origin, triangles)
    return Fit(origin, axes, key, scale, on_skin, scale * presets[key]["width"], miss)


def distance(point: Array, triangles: Array) -> float:
    """Return the distance from a point to the nearest of triangles, (t, 3, 3)."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    to = point - triangles
    along = np.einsum("tij,tij->ti", to, sides) / np.maximum(np.einsum("tij,tij->ti", sides, sides), 1e-30)
    away = np.linalg.norm(to - np.clip(along, 0.0, 1.0)[:, :, None] * sides, axis=2).min(axis=1)
    normals = np.cross(sides[:, 0], sides[:, 1])
    sizes = np.linalg.norm(normals, axis=1)
    flat = sizes > 0.0
    over = (np.einsum("tij,tij->ti", np.cross(sides, to), normals[:, None]) >= 0.0).all(axis=1) & flat
    height = np.abs(np.einsum("tj,tj->t", to[:, 0], normals)) / np.where(flat, sizes, 1.0)
    return float(np.where(over, height, away).min())


def section(triangles: Array, height: float) -> Array:
    """Return the points where edges of triangles cross a plane of constant Y.

    Their shape is (k, 3). The two points of a triangle follow one another.
    """
    first = triangles.reshape(-1, 3)
    second = np.roll(triangles, -1, axis=1).reshape(-1, 3)
    below, above = first[:, 1] - height, second[:, 1] - height
    crossing = (below < 0) != (above < 0)
    share = below[crossing] / (below[crossing] - above[crossing])
    return first[crossing] + share[:, None] * (second[crossing] - first[crossing])


def _nearest(presets: Mapping[str, Mapping[str, float]], measured: Mapping[str, float]) -> tuple[str, float]:
    """Return the preset that must be scaled least, and the scale.

    The scale is the geometric mean over the measured lengths, or 1 if it is near 1.
    """
    scales = {
        key: float(np.exp(np.mean([np.log(value / lengths[name]) for name, value in measured.items()])))
        for key, lengths in presets.items()
    }
    key = min(scales, key=lambda k: abs(np.log(scales[k])))
    return key, 1.0 if abs(np.log(scales[key])) < _SAME else scales[key]


def _as_wide(presets: Mapping[str, Mapping[str, float]], width: float) -> tuple[str, float]:
    """Return the preset that must be scaled least to a width, and the scale."""
    scales = {key: width / lengths["width"] for key, lengths in presets.items()}
    key = min(scales, key=lambda k: abs(np.log(scales[k])))
    return key, scales[key]


def _on_skin(
    triangles: Array,
    length: float,
    presets: Mapping[str, Mapping[str, float]],
    key: str,
    scale: float,
    *,
    steps: int = _STEPS,
) -> tuple[Array, str, float] | None:
    """Return the pad's centre [m], preset and scale from a surface.

    The surface is in the finger's frame at its last joint [m].

    Args:
        steps: number of iterations that find the size from the surface; 0 keeps preset and scale.
    """
    points = triangles.reshape(-1, 3)
    points = points[points[:, 1] > 0.3 * length]
    if len(points) < FEWEST:
        return None
    low, high = points[:, 2].min(), points[:, 2].max()
    tip = float(points[points[:, 2] <= low + 0.6 * (high - low), 1].max())  # nails and claws reach beyond it
    for step in range(steps + 1):
        y = tip - scale * presets[key]["tip"]
        ring = section(triangles, y)
        if len(ring) < 4:
            return None
        (left, _, bottom), (right, _, top) = ring.min(axis=0), ring.max(axis=0)
        if right <= left or top <= bottom:
            return None
        x = 0.5 * (left + right)
        if step < steps:
            key, scale = _nearest(presets, {"width": right - left, "thickness": top - bottom})
    return np.array([x, y, _bottom(ring, x, 0.2 * (right - left))]), key, scale


def _bottom(ring: Array, x: float, near: float) -> float:
    """Return the height of the pad's middle in a section.

    It is the lowest height of the skin there, if this lies below the section's mean. Where the skin is open, it is that
    of the lowest point near the middle, else of the lowest of all.
    """
    starts, ends = ring[::2], ring[1::2]
    over = (starts[:, 0] < x) != (ends[:, 0] < x)
    share = (x - starts[over, 0]) / (ends[over, 0] - starts[over, 0])
    heights = starts[over, 2] + share * (ends[over, 2] - starts[over, 2])
    if len(heights) and heights.min() < ring[:, 2].mean():
        return float(heights.min())
    middle = ring[np.abs(ring[:, 0] - x) <= near]
    return float((middle if len(middle) and middle[:, 2].min() < ring[:, 2].mean() else ring)[:, 2].min())
