"""The gaps of points that come and go: those that stay were measured, and those that come are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Array, Indices
from .bodies import ContactBody, Expected, NodeGaps, node_gaps
from .point_sight import OPPOSITE
from .sides import dot

PER_POINT = ("gap", "clearance", "normal", "body", "triangle", "friction", "softness")


def some_of(gaps: NodeGaps, which: slice | Indices) -> NodeGaps:
    """Return the gaps of some points."""
    return NodeGaps(gaps.bodies, *(getattr(gaps, name)[which] for name in PER_POINT))


def laid_on(
    gaps: NodeGaps, nodes: Indices, feet: Array, normal: Array, triangle: Indices, points: Array, places: Array
) -> NodeGaps:
    """Return gaps of which some nodes, shape (k,), are to planes of the same bodies.

    Args:
        feet: points of the planes [m], shape (k, 3). normal, triangle: of the planes.
        points: at rest [m], shape (n, 3). places: where they were looked for [m], shape (n, 3).
    """
    out = replace(gaps, **{name: getattr(gaps, name).copy() for name in ("gap", "clearance", "normal", "triangle")})
    out.clearance[nodes], out.gap[nodes] = dot(places[nodes] - feet, normal), dot(points[nodes] - feet, normal)
    out.normal[nodes], out.triangle[nodes] = normal, triangle
    return out


def passed_on(gaps: NodeGaps, count: int, heirs: Indices, sources: Indices) -> NodeGaps:
    """Return the gaps of so many points, of which some have those of others, and others nothing near."""
    out = NodeGaps.nothing(gaps.bodies, count)
    for name in PER_POINT:
        getattr(out, name)[heirs] = getattr(gaps, name)[sources]
    return out


def completed(
    gaps: NodeGaps,
    order: Indices,
    points: Array,
    bodies: tuple[ContactBody, ...],
    expected: Expected,
    search_radius: float,
    bone: Array,
) -> NodeGaps:
    """Return the gaps of points of which the first were measured already.

    Args:
        gaps: that were measured. order: which of them are those of the first points, shape (k,).
        points: undeformed [m], shape (n, 3). expected: where they are looked for.
        search_radius: beyond which nothing is of interest [m]. bone: a point inside the finger [m], shape (3,).
    """
    count = len(order)
    if count == len(points):
        return NodeGaps(bodies, *(getattr(gaps, name)[order] for name in PER_POINT))
    new, normal = points[count:], expected.normal[count:]
    places, origins = expected.places[count:], expected.origins[count:]
    # what a larger cell lay on need not be what its parts lie on, but where that is the back of something thin
    some = Expected(places, origins, normal, np.full(len(new), -1))
    found = node_gaps(new, bodies, search_radius, bone, some)
    opposite = np.einsum("ij,ij->i", normal, found.normal) < OPPOSITE
    turned = np.flatnonzero(opposite & (expected.body[count:] == found.body))
    if len(turned):
        some = Expected(places[turned], origins[turned], normal[turned], found.body[turned])
        again = node_gaps(new[turned], bodies, search_radius, bone, some)
        for name in PER_POINT:
            getattr(found, name)[turned] = getattr(again, name)
    parts = ((getattr(gaps, name)[order], getattr(found, name)) for name in PER_POINT)
    return NodeGaps(bodies, *(np.concatenate(pair) for pair in parts))
