"""Make the meshes that the example scenes need, at real size [m]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike

from .._core import Array

RIB_PERIOD, RIB_HEIGHT = 0.004, 0.0003


def mesh(name: str, points: ArrayLike, faces: Sequence[Sequence[int]]) -> bpy.types.Mesh:
    """Return a new mesh of points [m], shape (n, 3), and polygons."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.asarray(points).tolist(), [], faces)
    data.update()
    return data


def block(x: float, y: float, z: float) -> bpy.types.Mesh:
    """Return a block; the middle of its top is the origin."""
    a, b = 0.5 * x, 0.5 * y
    corners = [(i, j, k) for k in (-z, 0.0) for j in (-b, b) for i in (-a, a)]
    return mesh("Block", corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])


def chamfered_block(x: float, y: float, z: float) -> bpy.types.Mesh:
    """Return a closed block with a fine chamfer, so that edges catch light.

    The middle of the block is the origin.
    """
    import bmesh

    solid = bmesh.new()
    bmesh.ops.create_cube(solid, size=1.0)
    bmesh.ops.scale(solid, vec=(x, y, z), verts=solid.verts)
    width = 0.05 * min(x, y, z) + 0.0002
    bmesh.ops.bevel(solid, geom=solid.edges[:], offset=width, segments=2, profile=0.5, affect="EDGES")
    return _of_bmesh("Block", solid)


def sphere(radius: float, segments: int = 64) -> bpy.types.Mesh:
    """Return a closed sphere around the origin.

    It is not made with bmesh, which would order the triangles differently in every process.
    """
    rings = segments // 2
    around, down = np.arange(segments) * (2 * math.pi / segments), np.arange(1, rings)[:, None] * (math.pi / rings)
    ring = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down) + 0 * around], axis=-1)
    points = radius * np.vstack([ring.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    top, bottom, last = len(points) - 2, len(points) - 1, (rings - 2) * segments
    faces: list[tuple[int, ...]] = []
    for i in range(segments):
        j = (i + 1) % segments
        faces += [(k + i, k + segments + i, k + segments + j, k + j) for k in range(0, last, segments)]
        faces += [(top, i, j), (bottom, last + j, last + i)]
    ball = mesh("Sphere", points, faces)
    ball.shade_smooth()
    return ball


def ridge(length: float, height: float, angle: float, radius: float = 0.4e-3) -> bpy.types.Mesh:
    """Return a closed bar along X with a rounded upper edge at z = 0.

    `angle` is the angle of the edge.
    """
    half = 0.5 * (math.pi - angle)  # angle of the slopes to the horizontal
    turn = np.linspace(-half, half, 13)
    tip = np.stack([radius * np.sin(turn), radius * (np.cos(turn) - 1.0)], axis=1)
    reach = (height + tip[0, 1]) / math.tan(half)
    profile = np.vstack([[tip[0, 0] - reach, -height], tip, [tip[-1, 0] + reach, -height]])
    n = len(profile)
    return _bar("Edge", profile, length, [(i, i + n, (i + 1) % n + n, (i + 1) % n) for i in range(n)])


def rod(radius: float, length: float, segments: int = 96) -> bpy.types.Mesh:
    """Return a closed round rod along X; its top is the origin."""
    angle = np.arange(segments) * (2 * math.pi / segments)
    circle = np.stack([radius * np.sin(angle), radius * (np.cos(angle) - 1.0)], axis=1)
    n = segments
    return _bar("Rod", circle, length, [(i + n, (i + 1) % n + n, (i + 1) % n, i) for i in range(n)])


def ribbed_plate(
    width: float, depth: float, thickness: float, period: float = RIB_PERIOD, height: float = RIB_HEIGHT
) -> bpy.types.Mesh:
    """Return a plate with ribs along Y on its top; their crests are at z = 0."""
    columns = round(12 * width / period)
    x = np.linspace(-0.5 * width, 0.5 * width, columns + 1)
    top = 0.5 * height * (np.cos(2.0 * np.pi * x / period) - 1.0)
    n, d = columns + 1, 0.5 * depth
    low = np.full(n, -thickness)
    rows = ((-d, top), (d, top), (d, low), (-d, low))
    vertices = np.vstack([np.column_stack([x, np.full(n, y), z]) for y, z in rows])
    faces = [(i, i + 1, i + n + 1, i + n) for start in (0, n, 2 * n) for i in range(start, start + columns)]
    faces += [(i + 3 * n, i + 3 * n + 1, i + 1, i) for i in range(columns)]
    faces += [(0, n, 2 * n, 3 * n), (columns, columns + 3 * n, columns + 2 * n, columns + n)]
    return mesh("Plate", vertices, faces)


def cup(radius: float, rounding: float, height: float, segments: int = 192) -> bpy.types.Mesh:
    """Return a cup whose rim touches the origin from below.

    At the origin the rim runs along X. The middle of the cup lies at -Y.
    """
    arc = np.linspace(0.0, math.pi, 17)
    wall = np.stack([radius + rounding * np.cos(arc), rounding * (np.sin(arc) - 1.0)], axis=1)
    profile = np.vstack([[radius + rounding, -height], wall, [radius - rounding, -height]])
    angle = np.arange(segments) * (2 * math.pi / segments)
    k = len(profile)
    points = np.stack(
        [
            np.outer(np.cos(angle), profile[:, 0]),
            np.outer(np.sin(angle), profile[:, 0]) - radius,
            np.tile(profile[:, 1], (segments, 1)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    faces: list[tuple[int, ...]] = []
    for s in range(segments):
        a, b = s * k, (s + 1) % segments * k
        faces += [(a + i, b + i, b + (i + 1) % k, a + (i + 1) % k) for i in range(k)]
    return mesh("Cup", points, faces)


def _bar(name: str, profile: Array, length: float, sides: list[tuple[int, ...]]) -> bpy.types.Mesh:
    """Return a profile in Y and Z extruded along X, closed at both ends."""
    n = len(profile)
    points = [np.column_stack([np.full(n, x), profile]) for x in (-0.5 * length, 0.5 * length)]
    return mesh(name, np.vstack(points), [*sides, tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1))])


def _of_bmesh(name: str, solid: Any) -> bpy.types.Mesh:
    data = bpy.data.meshes.new(name)
    solid.to_mesh(data)
    solid.free()
    return data
