"""Signed gaps of 250 pad nodes to a mesh of 10k faces that the finger slides over.

The mesh is a ball of 9,680 faces of even size, 20 mm in radius. Nothing is kept from one query to the next, so it does
not matter whether a place was visited before. The answer is exact against the facets; `gap_error_um` measures both
against a search that tries every triangle.
"""

from __future__ import annotations

import copy
import functools
import time
from typing import Any

import numpy as np

from tests.closest_points import closest, nearest

from . import Result, benchmark, one_blas_thread, timing

RADIUS, REACH, FRAMES = 0.02, 2.5e-3, 240


@benchmark("gap_ms", limit=0.6, quick=True)
def gap() -> Result:
    """250 nodes against a rigid mesh."""
    ours = timing(_pass())
    return Result("gap_ms", ours.median, "ms", ours.p95)


@benchmark("gap_deforming_ms", limit=6.0, quick=True)
def gap_deforming() -> Result:
    """250 nodes against a mesh that is another one every frame: building it included."""
    from core.surface.gap import Surface

    vertices, triangles = even_sphere(22, RADIUS)
    times = []
    with one_blas_thread():
        Surface.build(vertices, triangles)
        for frame, points in enumerate(_paths()[:60]):
            shape = vertices * (1.0 + 0.01 * np.sin(0.1 * frame))
            started = time.perf_counter()
            Surface.build(shape, triangles).query(points, REACH)
            times.append((time.perf_counter() - started) * 1e3)
    ours = timing(times)
    return Result("gap_deforming_ms", ours.median, "ms", ours.p95)


@benchmark("gap_error_um", limit=10.0, quick=True)
def gap_error() -> Result:
    """Largest difference from trying every triangle, and of the normals [degrees] beside it."""
    from core.surface.gap import Surface

    vertices, triangles = even_sphere(22, RADIUS)
    surface = Surface.build(vertices, triangles)
    worst = turned = 0.0
    everything = np.arange(len(triangles))
    for points in _paths()[::24]:
        found = surface.query(points, REACH)
        near = np.flatnonzero(np.isfinite(found.gap))
        for i in near[::5]:
            square, u, w = closest(surface.table, np.tile(points[i][:, None], len(triangles)), everything)
            best = int(np.argmin(square))
            a, ab, ac = surface.table.rows[:9, best].reshape(3, 3)
            foot = a + u[best] * ab + w[best] * ac
            worst = max(worst, abs(abs(found.gap[i]) - np.sqrt(square[best])))
            if abs(found.gap[i]) > 1e-6:
                away = (points[i] - foot) / found.gap[i]
                turned = max(turned, float(np.degrees(np.arccos(np.clip(away @ found.normal[i], -1.0, 1.0)))))
    return Result("gap_error_um", worst * 1e6, "um", None, {"normals, degrees": turned})


@benchmark("closest_point_us", limit=1.0, quick=True)
def closest_point() -> Result:
    """Signed distance of a point with closest point and normal, in batches of 250.

    Peers: single points; points whose sides rays tell; Blender's own tree, point by point in single precision, which
    has no batches and no sign; and the largest difference of both from trying every triangle [um].
    """
    import bpy  # noqa: F401  # which brings mathutils
    from mathutils.bvhtree import BVHTree

    from core.surface.gap import Surface

    vertices, triangles = even_sphere(22, RADIUS)
    surface = Surface.build(vertices, triangles)
    other = BVHTree.FromPolygons(vertices.tolist(), triangles.tolist())
    times: dict[str, list[float]] = {name: [] for name in ("ours", "rays", "single", "Blender")}
    worst, off = 0.0, 0.0
    body, by_rays = surface._body, copy.copy(surface._body)
    body.by_rays, by_rays.by_rays = surface.tangled, True
    with one_blas_thread():
        for frame, points in enumerate(_paths()):
            marks = [time.perf_counter()]
            found = body.query(points, REACH)
            marks.append(time.perf_counter())
            by_rays.query(points, REACH)
            marks.append(time.perf_counter())
            for point in points[:50]:
                body.query(point[None], REACH)
            marks.append(time.perf_counter())
            told = [other.find_nearest(point, REACH)[3] for point in points.tolist()]
            marks.append(time.perf_counter())
            counts = len(points), len(points), 50, len(points)
            for own, begin, end, count in zip(times.values(), marks[:-1], marks[1:], counts, strict=True):
                own.append((end - begin) * 1e6 / count)
            if frame % 48 == 0:
                _, square, _, _ = nearest(surface.table, points[::5], REACH)
                near = np.flatnonzero(np.isfinite(square))
                exact = np.sqrt(square[near])
                worst = max(worst, float(np.abs(np.abs(found.gap[::5][near]) - exact).max()) * 1e6)
                off = max(off, max(abs(float(told[5 * i] or 0.0) - d) for i, d in zip(near, exact, strict=True)) * 1e6)
    ours, rays, single, blender = (timing(own[1:]) for own in times.values())
    peers = {"sides by rays": rays.median, "single points": single.median, "Blender's BVHTree": blender.median}
    peers |= {"our error, um": worst, "Blender's error, um": off}
    return Result("closest_point_us", ours.median, "us", ours.p95, peers)


@functools.cache
def _pass() -> list[float]:
    from core.surface.gap import Surface

    surface = Surface.build(*even_sphere(22, RADIUS))
    times: list[float] = []
    with one_blas_thread():
        surface.query(_paths()[0], REACH)
        for points in _paths():
            started = time.perf_counter()
            surface.query(points, REACH)
            times.append((time.perf_counter() - started) * 1e3)
    return times


@functools.cache
def _paths() -> Any:
    """Pad nodes in the ball's space, sunk by 1 mm and sliding and rolling at [S1]'s speed, (frames, 250, 3) [m]."""
    from core.skin.model import fingertip_skin

    pad = fingertip_skin(level="standard").positions
    pad = pad[np.argsort(pad[:, 2])]
    pad = np.concatenate([pad, 0.5 * (pad[:60] + pad[1:61])])[:250]
    pad = pad - [0.0, 0.0, pad[:, 2].min()]
    out = []
    for frame in range(FRAMES):
        a = 0.0157 / RADIUS * frame / 240.0 + 0.3
        turn = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        out.append((pad + [3e-3 * np.sin(frame / 40), 0.0, RADIUS - 1e-3]) @ turn.T)
    return np.array(out)


def even_sphere(divisions: int, radius: float) -> tuple[Any, Any]:
    """Return vertices [m] and triangles of an icosahedron whose faces are divided and projected, 20 n^2 faces."""
    golden = (1 + np.sqrt(5)) / 2
    corners = np.array([
        [-1, golden, 0], [1, golden, 0], [-1, -golden, 0], [1, -golden, 0], [0, -1, golden], [0, 1, golden],
        [0, -1, -golden], [0, 1, -golden], [golden, 0, -1], [golden, 0, 1], [-golden, 0, -1], [-golden, 0, 1],
    ])  # fmt: skip
    faces = [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
        (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
        (8, 6, 7), (9, 8, 1),
    ]  # fmt: skip
    n, points, triangles = divisions, [], []
    for a, b, c in faces:
        at = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                at[i, j] = len(points)
                points.append((corners[a] * (n - i - j) + corners[b] * i + corners[c] * j) / n)
        for i in range(n):
            for j in range(n - i):
                triangles.append((at[i, j], at[i + 1, j], at[i, j + 1]))
                if i + j < n - 1:
                    triangles.append((at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]))
    directions = np.array(points)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    merged, index = np.unique(np.round(directions, 9), axis=0, return_inverse=True)
    vertices = merged / np.linalg.norm(merged, axis=1)[:, None] * radius
    return vertices, index.reshape(-1)[np.array(triangles)]
