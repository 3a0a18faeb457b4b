"""Solid parts of twins: coloured triangles, shaded by a fixed light."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Array

Colour = tuple[float, float, float, float]

HEAT = ((0.20, 0.45, 0.85), (0.85, 0.87, 0.90), (1.0, 0.52, 0.10))  # at levels 0, 0.5 and 1
SEGMENTS = 48  # of a circle
_ANGLE = np.linspace(0.0, 2.0 * np.pi, SEGMENTS + 1)
_ROUND = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)
LIGHT = np.array([0.35, -0.45, 0.82]) / np.linalg.norm([0.35, -0.45, 0.82])


class Part(NamedTuple):
    """Triangles with a colour at every vertex.

    Positions [m] have the shape (n, 3), colours (n, 4), and triangles, which are indices, (t, 3).
    """

    positions: NDArray[np.float32]
    colours: NDArray[np.float32]
    triangles: NDArray[np.int32]


class Line(NamedTuple):
    """A line through points [m], shape (n, 3); width at scale 1 [px]."""

    points: Array
    colour: Colour
    width: float


def part_of(positions: Array, colours: Array, triangles: NDArray[Any]) -> Part:
    """Return a part from arrays, converted to the graphics card's types."""
    return Part(
        positions.astype(np.float32, copy=False),
        colours.astype(np.float32, copy=False),
        triangles.astype(np.int32, copy=False),
    )


def heat(level: float) -> Colour:
    """Return a colour for a level from 0 to 1: blue, through white, to orange.

    These colours are safe for the colour-blind.
    """
    level = min(max(level, 0.0), 1.0)
    first = 0 if level < 0.5 else 1
    r, g, b = (a + 2.0 * (level - 0.5 * first) * (z - a) for a, z in zip(HEAT[first], HEAT[first + 1], strict=True))
    return (r, g, b, 1.0)


def circle(radius: float, height: float = 0.0) -> Array:
    """Return a closed line around the pad's centre: radius and height [m], shape (n, 3)."""
    out = np.full((SEGMENTS + 1, 3), height)
    out[:, :2] = radius * _ROUND
    return out


def disc(radius: float, height: float, middle: Colour, rim: Colour) -> Part:
    """Return a flat disc in the pad's plane, from one colour in its middle to another at its rim."""
    points = np.empty((SEGMENTS + 1, 3))
    points[0], points[1:] = (0.0, 0.0, height), circle(radius, height)[:-1]
    colours = np.empty((SEGMENTS + 1, 4))
    colours[0], colours[1:] = middle, rim
    return part_of(points, colours, _fan())


@cache
def _fan() -> NDArray[np.int32]:
    i = np.arange(SEGMENTS)
    triangles = np.stack([np.zeros_like(i), 1 + i, 1 + np.roll(i, -1)], axis=1).astype(np.int32)
    triangles.flags.writeable = False
    return triangles


def lathe(profile: list[tuple[float, float]], colour: Colour) -> Part:
    """Return the part that a profile of (radius, height) [m] sweeps about Z."""
    pieces = []
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for (r0, z0), (r1, z1) in zip(profile[:-1], profile[1:], strict=True):
        length = np.hypot(z1 - z0, r1 - r0)
        radial, axial = (z1 - z0) / -length, (r1 - r0) / length
        normals = np.column_stack([ring * radial, np.full(len(ring), axial)])
        start, end = (np.column_stack([ring * r, np.full(len(ring), z)]) for r, z in ((r0, z0), (r1, z1)))
        pieces.append(_band(start, end, normals, colour))
    return joined(pieces)


def bar(start: Array, end: Array, half: float, colour: Colour, sides: int = 6) -> Part:
    """Return a bar of a half width between two points [m], closed at both ends."""
    return bars(start[None], end[None], np.array([half]), np.array([colour]), sides)


def bars(starts: Array, ends: Array, halves: Array, colours: Array, sides: int = 6) -> Part:
    """Return bars between points [m], closed at both ends.

    Args:
        starts, ends: ends of the bars [m], shape (n, 3). halves: half widths [m], shape (n,).
        colours: shape (n, 4). sides: number of sides of each bar.
    """
    along = ends - starts
    side, up = across(along / np.maximum(np.sqrt(np.add.reduce(along * along, axis=1)), 1e-12)[:, None])
    cosine, sine = _round(sides)
    normals = cosine * side[:, None] + sine * up[:, None]
    spread = halves[:, None, None] * normals
    rims, shades = (np.empty((len(starts), 2, sides + 1, k), np.float32) for k in (3, 4))
    rims[:, 0], rims[:, 1] = starts[:, None] + spread, ends[:, None] + spread
    shades[..., :3] = (colours[:, None, :3] * _light(normals)[:, :, None])[:, None]
    shades[..., 3] = colours[:, None, None, 3]
    return Part(rims.reshape(-1, 3), shades.reshape(-1, 4), _bar_triangles(len(starts), sides))


@cache
def _round(sides: int) -> tuple[Array, Array]:
    angle = np.arange(sides + 1)[:, None] * (2.0 * np.pi / sides)
    return np.cos(angle), np.sin(angle)


@cache
def _bar_triangles(count: int, sides: int) -> NDArray[np.int32]:
    i, k = np.arange(sides), np.arange(1, sides - 1)
    j = i + sides + 1
    corners = ((i, i + 1, j + 1), (i, j + 1, j), (0 * k, k, k + 1), (0 * k + sides + 1, k + sides + 1, k + sides + 2))
    one = np.concatenate([np.stack(three, axis=1) for three in corners])
    triangles: NDArray[np.int32] = one + (2 * (sides + 1) * np.arange(count, dtype=np.int32))[:, None, None]
    triangles = triangles.reshape(-1, 3).astype(np.int32)
    triangles.flags.writeable = False
    return triangles


def ribbon(first: Array, second: Array, colours: Array) -> Part:
    """Return the strip between two lines of points.

    Args:
        first, second: points of the lines [m], shape (n, 3). colours: colours along the strip, shape (n, 4).
    """
    n, i = len(first), np.arange(len(first) - 1)
    triangles = np.vstack([np.stack([i, i + 1, n + i + 1], axis=1), np.stack([i, n + i + 1, n + i], axis=1)])
    return part_of(np.vstack([first, second]), np.vstack([colours, colours]), triangles)


def across(along: Array) -> tuple[Array, Array]:
    """Return two unit vectors that are perpendicular to each vector and to each other.

    Args:
        along: unit vectors, shape (n, 3), as are the results.
    """
    x, y, z = along.T
    flat = np.abs(y) < 0.9  # the first result is perpendicular to Y, else to X
    side = np.array([np.where(flat, -z, 0.0), np.where(flat, 0.0, z), np.where(flat, x, -y)])
    side /= np.sqrt(np.add.reduce(side * side))
    a, b, c = side
    return side.T, np.array([y * c - z * b, z * a - x * c, x * b - y * a]).T


def joined(pieces: list[Part]) -> Part:
    """Return several parts as one."""
    triangles, start = [], 0
    for piece in pieces:
        triangles.append(piece.triangles + np.int32(start))
        start += len(piece.positions)
    positions, colours = np.concatenate([p.positions for p in pieces]), np.concatenate([p.colours for p in pieces])
    return Part(positions, colours, np.concatenate(triangles))


def placed(part: Part, pose: Array) -> Part:
    """Return a part at a pose, shape (4, 4)."""
    return part._replace(positions=(part.positions @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32))


def faint(part: Part, opacity: float) -> Part:
    """Return a part with its opacity multiplied by a factor."""
    return part._replace(colours=part.colours * np.array([1.0, 1.0, 1.0, opacity], np.float32))


def _band(start: Array, end: Array, normals: Array, colour: Colour) -> Part:
    """Return a lit band between two rings."""
    shade = _light(normals)
    return ribbon(start, end, np.column_stack([shade[:, None] * np.array(colour[:3]), np.full(len(shade), colour[3])]))


def _light(normals: Array) -> Array:
    return np.asarray(0.55 + 0.45 * np.abs(normals @ LIGHT))
