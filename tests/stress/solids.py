"""Solids where touch is sharp or small, by name: parts that are closed each for itself, highest point at the origin."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from core.scene.tactile_scene import Mesh
from core.surface import shapes
from tests.benchmarks.references.shapes import Ribs

Array = NDArray[np.float64]
HIGH = 20e-3  # [m] of what stands upright
ROUND = 72  # triangles about an axis
RIM = 0.1e-3  # radius of rounded rims [m]


def revolved(profile: Array, around: int = ROUND) -> shapes.Shape:
    """Return the solid that a profile sweeps about the Z axis.

    Args:
        profile: radius and height [m], from the axis at the top to the axis at the bottom, shape (k, 2).
    """
    turns = 2.0 * np.pi * np.arange(around) / around
    rings = profile[1:-1]
    inner = np.stack(
        [
            np.outer(rings[:, 0], np.cos(turns)),
            np.outer(rings[:, 0], np.sin(turns)),
            np.repeat(rings[:, 1:], around, 1),
        ],
        axis=2,
    ).reshape(-1, 3)
    vertices = np.vstack([[[0.0, 0.0, profile[0, 1]]], inner, [[0.0, 0.0, profile[-1, 1]]]])
    i, j = np.arange(around), (np.arange(around) + 1) % around
    last, bottom = 1 + (len(rings) - 1) * around, len(vertices) - 1
    faces = [np.stack([np.zeros_like(i), 1 + i, 1 + j], axis=1), np.stack([last + j, last + i, i * 0 + bottom], axis=1)]
    for k in range(len(rings) - 1):
        upper, lower = 1 + k * around, 1 + (k + 1) * around
        faces += [np.stack([upper + i, lower + i, upper + j], 1), np.stack([upper + j, lower + i, lower + j], 1)]
    return vertices, np.vstack(faces)


def arc(radius: float, middle: tuple[float, float], start: float, end: float, step: float = 6.0) -> Array:
    """Return points of a circle from one angle to another [degrees, from +X to +Z], shape (k, 2)."""
    angles = np.radians(np.linspace(start, end, max(round(abs(end - start) / step), 2) + 1))
    return np.asarray(middle) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def peg(radius: float, rim: float, height: float = HIGH, around: int = ROUND) -> shapes.Shape:
    """Return an upright cylinder, its upper rim rounded; a rim as wide as the cylinder makes its end a ball."""
    top = [[0.0, 0.0]] if rim < radius else []
    edge = arc(rim, (radius - rim, -rim), 90.0, 0.0) if rim else np.array([[radius, 0.0]])
    return revolved(np.vstack([*top, edge, [[radius, -height], [0.0, -height]]]), around)


def torus(minor: float, major: float, around: int = 96, across: int = 48) -> shapes.Shape:
    """Return a ring that lies flat."""
    n, m = around, across
    about, turn = 2.0 * np.pi * np.arange(n) / n, 2.0 * np.pi * np.arange(m) / m
    far = major + minor * np.cos(turn)
    vertices = np.stack(
        [np.outer(np.cos(about), far), np.outer(np.sin(about), far), np.tile(minor * (np.sin(turn) - 1.0), (n, 1))],
        axis=2,
    ).reshape(-1, 3)
    i, k = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a, b, c, d = i * m + k, (i + 1) % n * m + k, (i + 1) % n * m + (k + 1) % m, i * m + (k + 1) % m
    return vertices, np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def bump(half_width: float, height: float) -> shapes.Shape:
    """Return a wide plate with a cap of a ball on it, or a hollow of one where the height is below zero [m]."""
    radius = (half_width**2 + height**2) / (2.0 * abs(height))
    angle = float(np.degrees(np.arcsin(half_width / radius)))
    cap = arc(radius, (0.0, -radius), 90.0, 90.0 - angle, 1.5 if height < 0.0 else 4.0)
    if height < 0.0:
        cap[:, 1] *= -1.0
        cap[:, 1] += height
    top = cap[-1, 1]
    return revolved(np.vstack([cap, [[20e-3, top], [20e-3, top - 10e-3], [0.0, top - 10e-3]]]))


def moved(shape: shapes.Shape, x: float = 0.0, y: float = 0.0) -> shapes.Shape:
    """Return a shape somewhere else [m]."""
    return shape[0] + np.array([x, y, 0.0]), shape[1]


def _ribs() -> list[shapes.Shape]:
    surface = Ribs().surface()
    return [(surface.vertices, surface.triangles)]


def _edge(degrees: float) -> Callable[[], list[shapes.Shape]]:
    return lambda: [shapes.edge(np.radians(degrees))]


def _ball(radius: float) -> Callable[[], list[shapes.Shape]]:
    return lambda: [shapes.sphere(radius, 5_000)]


SHAPES: dict[str, Callable[[], Sequence[shapes.Shape]]] = {
    "edge_60": _edge(60.0),
    "edge_90": _edge(90.0),
    "edge_120": _edge(120.0),
    "corner": lambda: [moved(shapes.block(10e-3, 10e-3, HIGH), 5e-3, 5e-3)],
    "pillar": lambda: [shapes.block(2e-3, 2e-3, HIGH)],
    "plate": lambda: [shapes.block(0.5e-3, 30e-3, HIGH)],
    "coin": lambda: [moved(peg(6e-3, RIM, 2e-3, 120), 6e-3)],
    "torus": lambda: [moved(torus(1e-3, 5e-3), 5e-3)],
    "ridges": lambda: [moved(shapes.edge(np.pi / 2, RIM, height=2e-3), x) for x in (-1e-3, 1e-3)],
    "punch": lambda: [peg(1e-3, RIM)],
    "ball_1": _ball(1e-3),
    "ball_3": _ball(3e-3),
    "ball_6": _ball(6e-3),
    "ball_12": _ball(12e-3),
    "ribs": _ribs,
    "dimple": lambda: [bump(2e-3, -0.5e-3)],
    "braille": lambda: [bump(0.72e-3, 0.48e-3)],
    "needle": lambda: [peg(0.5e-3, 0.0, around=24)],
    "needles": lambda: [moved(peg(0.25e-3, 0.25e-3, around=24), x) for x in (-2e-3, 0.0, 2e-3)],
    "block": lambda: [shapes.block()],
}
NARROW = ("needle", "needles")


def parts_of(name: str) -> list[Mesh]:
    """Return a solid's parts, each a new mesh."""
    return [Mesh(np.ascontiguousarray(v), np.ascontiguousarray(t, dtype=np.int32)) for v, t in SHAPES[name]()]
