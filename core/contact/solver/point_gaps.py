"""Selection and replacement of the gaps of points."""

from __future__ import annotations

from dataclasses import replace

from ...arrays import Array, Indices
from .bodies import NodeGaps
from .sides import dot

PER_POINT = ("gap", "clearance", "normal", "body", "triangle", "friction", "softness")


def some_of(gaps: NodeGaps, which: slice | Indices) -> NodeGaps:
    """Return the gaps of some points."""
    return NodeGaps(gaps.bodies, *(getattr(gaps, name)[which] for name in PER_POINT))


def laid_on(
    gaps: NodeGaps, nodes: Indices, feet: Array, normal: Array, triangle: Indices, points: Array, places: Array
) -> NodeGaps:
    """Replace the gaps of some nodes by those to planes of the same bodies.

    Args:
        gaps: gaps of all points.
        nodes: indices of the nodes, shape (k,).
        feet: a point on the plane of each node [m], shape (k, 3).
        normal: unit normals of the planes, shape (k, 3).
        triangle: triangles in which the planes lie, shape (k,).
        points: positions at rest [m], shape (n, 3).
        places: displaced positions at which the gaps were measured [m], shape (n, 3).
    """
    out = replace(gaps, **{name: getattr(gaps, name).copy() for name in ("gap", "clearance", "normal", "triangle")})
    out.clearance[nodes], out.gap[nodes] = dot(places[nodes] - feet, normal), dot(points[nodes] - feet, normal)
    out.normal[nodes], out.triangle[nodes] = normal, triangle
    return out


def passed_on(gaps: NodeGaps, count: int, heirs: Indices, sources: Indices) -> NodeGaps:
    """Return the gaps of `count` points: points `heirs` get those of `sources`, and all others are beyond reach."""
    out = NodeGaps.nothing(gaps.bodies, count)
    for name in PER_POINT:
        getattr(out, name)[heirs] = getattr(gaps, name)[sources]
    return out
