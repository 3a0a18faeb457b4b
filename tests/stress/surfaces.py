"""Gaps to any surface, held to the closest of its triangles, solid by solid, and to the faces of a convex body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.errors import DermisError
from core.surface.gap import Surface
from core.surface.winding import winding

from . import tolerances
from .bodies import ANY, draw_body, mesh_of
from .case import Dice, Family, Values, Verdict, bits_of

Array = NDArray[np.float64]
POINTS = 60
FLAT = 1e-12  # of its longest side squared: triangles of less area are ignored by all who ask


def draw(dice: Dice) -> Values:
    """Draw a body, a scale, and how its corners are spoilt."""
    spoilt = dice.one_of("", "", "", "doubled", "collapsed", "flattened", "rounded", "empty", "nan", "index")
    body = {**draw_body(dice, ANY), "facets": dice.one_of(20, 80, 320), "slivers": dice.one_of(0, 0, 30)}
    return {**body, "scale": dice.decades(1e-3, 1e5), "spoilt": spoilt, "near": dice.decades(1e-6, 3.0)}


def judge(values: Values) -> Verdict:
    """Ask for gaps near a surface and far from it."""
    mesh, rng = mesh_of(values), np.random.default_rng(int(values["mesh_seed"]))
    scale, spoilt = float(values["scale"]), str(values["spoilt"])
    vertices, triangles = spoil(mesh.vertices * scale, mesh.triangles.copy(), spoilt, rng)
    verdict = Verdict()
    refused = spoilt in ("empty", "nan", "index")
    try:
        surface = Surface.build(vertices, triangles)
    except DermisError:
        verdict.hold("refused rightly", not refused, 0)
        return verdict
    verdict.hold("refused rightly", refused, 0)
    size = float(np.ptp(vertices, axis=0).max())
    corners = vertices[triangles]
    weight = rng.dirichlet((0.5, 0.5, 0.5), POINTS)
    on = np.einsum("nk,nkj->nj", weight, corners[rng.integers(len(corners), size=POINTS)])
    points = on + rng.normal(size=(POINTS, 3)) * size * float(values["near"])
    points[:5] = on[:5]
    found = surface.query(points)
    again = Surface.build(vertices.copy(), triangles.copy()).query(points.copy())
    verdict.hold("same bits", bits_of(vars(found).values()) != bits_of(vars(again).values()), tolerances.BITS)
    if not surface.table.usable.any():
        verdict.hold("nothing is far", not np.isposinf(found.gap).all(), 0)
        return verdict
    verdict.hold("finite", int((~np.isfinite(found.gap)).sum() + (~np.isfinite(found.normal)).sum()), 0)
    if verdict.missed:
        return verdict
    if surface.solids:  # that run through each other: the smallest signed distance counts
        told, closest = found.gap, np.min([signed(points, corners[own]) for own in surface.solids], axis=0)
    else:
        told, closest = np.abs(found.gap), np.array([distance(p, corners[surface.table.usable]) for p in points])
    verdict.hold("distance", float(np.abs(told - closest).max()) / size, tolerances.DISTANCE)
    length = np.linalg.norm(found.normal, axis=1)
    verdict.hold("unit", float(np.abs(length - 1.0).max()), tolerances.UNIT)
    convex = values["shape"] in ("block", "ball", "edge", "hull", "pillar", "card") and (
        spoilt == "" or spoilt == "rounded" and not values["slivers"]  # slivers of rounded corners stand on end
    )
    if convex and surface.closed:
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        large = np.linalg.norm(normals, axis=1)
        kept = large > 1e-6 * large.max()  # slivers' own normals are rounding
        out = np.einsum("tj,ntj->nt", normals[kept] / large[kept, None], points[:, None] - corners[kept, 0])
        inside = out.max(axis=1)
        sure = np.abs(inside) > 1e-6 * size
        verdict.hold("side", int(((inside < 0) != (found.gap < 0))[sure].sum()), 0)
    return verdict


def spoil(vertices: Array, triangles: Array, how: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a surface spoilt in one way."""
    vertices, some = vertices.copy(), rng.integers(len(vertices), size=max(len(vertices) // 8, 2))
    if how == "doubled":
        return np.vstack([vertices, vertices]), np.vstack([triangles, triangles + len(vertices)])
    if how == "collapsed":
        vertices[some] = vertices[some[0]]
    elif how == "flattened":
        vertices[:, 2] = 0.0
    elif how == "rounded":
        vertices = vertices.astype(np.float32).astype(np.float64)
    elif how == "nan":
        vertices[some[0], 1] = rng.choice([np.nan, np.inf, -np.inf])
    elif how == "index":
        triangles[0, 0] = rng.choice([-1, len(vertices)])
    elif how == "empty":
        triangles = triangles[:0]
    return vertices, triangles


def signed(points: Array, corners: Array) -> Array:
    """Return the distances of points to a solid [m], below zero inside by the solid angles of its triangles."""
    far = np.array([distance(point, corners) for point in points])
    return np.where(winding(corners, points) > 0.5, -far, far)


def distance(point: Array, corners: Array) -> float:
    """Return the distance of a point to the closest of triangles [m], shape (t, 3, 3): to faces, edges and corners.

    In the longest numbers there are: slivers leave a plain one few digits of their normals.
    """
    point, corners = point.astype(np.longdouble), corners.astype(np.longdouble)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    best = np.inf
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        square = np.einsum("ij,ij->i", along, along)
        share = np.einsum("ij,ij->i", point - start, along) / np.where(square > 0.0, square, 1.0)
        off = point - start - np.clip(share, 0.0, 1.0)[:, None] * along
        best = min(best, float(np.sqrt(np.einsum("ij,ij->i", off, off)).min()))
    normal = np.cross(b - a, c - a)
    size = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    normal = normal / np.where(size > 0.0, size, 1.0)[:, None]
    height = np.einsum("ij,ij->i", point - a, normal)
    foot = point - height[:, None] * normal
    inside = size > FLAT * np.einsum("ij,ij->i", b - a, b - a)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(end - start, foot - start), normal) >= 0.0
    return min(best, float(np.abs(height[inside]).min(initial=np.inf)))


FAMILIES = (
    Family(
        "surface",
        "gaps to any surface, against all of its triangles",
        draw,
        judge,
        {"spoilt": "", "scale": 1.0, "slivers": 0},
    ),
)
