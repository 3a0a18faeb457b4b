"""The device's twin: its moving parts as coloured triangles in the finger's frame, for the overlay to draw.

The twin is drawn, not added: no object appears in the artist's scene, nothing is saved, and undo never sees it.
Dimensions follow [S3]: an 8 mm hole in the housing, a 12 mm cap that always covers it, a tactor in its middle.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Colour = tuple[float, float, float, float]

HOUSING: Colour = (0.16, 0.18, 0.21, 0.95)
CAP: Colour = (0.62, 0.66, 0.70, 0.95)
TACTOR: Colour = (1.0, 0.52, 0.10, 1.0)
_LIGHT = np.array([0.35, -0.45, 0.82])
_SEGMENTS = 48


class Part(NamedTuple):
    """Triangles with a colour at every vertex: positions [m] (n, 3), colours (n, 4), indices (t, 3)."""

    positions: NDArray[np.float32]
    colours: NDArray[np.float32]
    triangles: NDArray[np.int32]


@cache
def housing() -> Part:
    """Return the ring under the pad that stays still."""
    return _lathe([(4.0e-3, -0.3e-3), (4.0e-3, -1.7e-3), (9.0e-3, -1.7e-3), (9.4e-3, -1.3e-3), (9.4e-3, -0.7e-3),
                   (9.0e-3, -0.3e-3), (4.0e-3, -0.3e-3)], HOUSING)  # fmt: skip


@cache
def cap() -> Part:
    """Return the cap and the tactor, which move together in the pad's plane."""
    disc = _lathe([(0.0, -1.9e-3), (6.0e-3, -1.9e-3), (6.0e-3, -2.6e-3), (0.0, -2.6e-3)], CAP)
    pin = _lathe([(0.0, 0.25e-3), (1.3e-3, 0.15e-3), (1.8e-3, -0.3e-3), (1.8e-3, -1.9e-3)], TACTOR)
    return Part(
        np.vstack([disc.positions, pin.positions]),
        np.vstack([disc.colours, pin.colours]),
        np.vstack([disc.triangles, pin.triangles + len(disc.positions)]),
    )


@cache
def plan() -> Part:
    """Return housing and hole as flat shapes in the pad's plane, for where a surface hides the solid ones."""
    angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS + 1)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    n, i = len(ring), np.arange(_SEGMENTS)
    positions = np.vstack([ring * 4.0e-3, ring * 9.4e-3, ring * 4.0e-3, np.zeros((1, 3))])
    colours = np.repeat(
        np.array([[*HOUSING[:3], 0.55], [*HOUSING[:3], 0.55], [*CAP[:3], 0.55], [*CAP[:3], 0.55]]), [n, n, n, 1], axis=0
    )
    triangles = np.vstack(
        [
            np.stack([i, n + i, n + i + 1], axis=1),
            np.stack([i, n + i + 1, i + 1], axis=1),
            np.stack([2 * n + i, 2 * n + i + 1, np.full_like(i, 3 * n)], axis=1),
        ]
    )
    return Part(positions.astype(np.float32), colours.astype(np.float32), triangles.astype(np.int32))


@cache
def dot() -> Part:
    """Return the tactor as a flat disc in the pad's plane."""
    rim = circle(1.8e-3)[:-1]
    i = np.arange(len(rim))
    positions = np.vstack([np.zeros((1, 3)), rim]).astype(np.float32)
    triangles = np.stack([np.zeros_like(i), 1 + i, 1 + np.roll(i, -1)], axis=1).astype(np.int32)
    return Part(positions, np.tile(np.array(TACTOR, np.float32), (len(positions), 1)), triangles)


def circle(radius: float, height: float = 0.0) -> NDArray[np.float32]:
    """Return a closed line around the pad's centre: radius and height [m], shape (n, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS + 1)
    z = np.full_like(angle, height)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1).astype(np.float32)


def glow(radius: float, colour: Colour) -> Part:
    """Return a disc in the pad's plane that fades outwards: the field under a finger on a screen."""
    rim = circle(radius, -0.05e-3)[:-1]
    positions = np.vstack([[[0.0, 0.0, -0.05e-3]], rim]).astype(np.float32)
    colours = np.tile(np.array([*colour[:3], 0.0], np.float32), (len(positions), 1))
    colours[0, 3] = colour[3]
    i = np.arange(len(rim))
    triangles = np.stack([np.zeros_like(i), 1 + i, 1 + np.roll(i, -1)], axis=1).astype(np.int32)
    return Part(positions, colours, triangles)


def heat(level: float) -> Colour:
    """Return a colour for a level from 0 to 1: blue, through white, to orange; safe for the colour-blind."""
    level = min(max(level, 0.0), 1.0)
    stops = np.array([[0.20, 0.45, 0.85], [0.85, 0.87, 0.90], [1.0, 0.52, 0.10]])
    r, g, b = (float(np.interp(level, (0.0, 0.5, 1.0), stops[:, k])) for k in range(3))
    return (r, g, b, 1.0)


def _lathe(profile: list[tuple[float, float]], colour: Colour) -> Part:
    """Turn a profile of (radius, height) about Z; shade it by a fixed light, so that it reads as solid."""
    positions, colours, triangles = [], [], []
    angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    base = 0
    for (r0, z0), (r1, z1) in zip(profile[:-1], profile[1:], strict=True):
        normal = np.hypot(z1 - z0, r1 - r0)
        radial, axial = (z1 - z0) / -normal, (r1 - r0) / normal
        normals = np.column_stack([ring * radial, np.full(len(ring), axial)])
        shade = 0.55 + 0.45 * np.abs(normals @ _LIGHT)
        lit = np.column_stack([shade[:, None] * np.array(colour[:3]), np.full(len(ring), colour[3])])
        for r, z in ((r0, z0), (r1, z1)):
            positions.append(np.column_stack([ring * r, np.full(len(ring), z)]))
            colours.append(lit)
        i = np.arange(_SEGMENTS)
        n = len(ring)
        quads = np.stack([base + i, base + i + 1, base + n + i + 1, base + n + i], axis=1)
        triangles += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
        base += 2 * n
    return Part(
        np.vstack(positions).astype(np.float32),
        np.vstack(colours).astype(np.float32),
        np.vstack(triangles).astype(np.int32),
    )
