"""Interpolation of bodies between two frames, and movement of their material."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Array, Indices
from ...motion import matrices, quaternions
from ...surface.gap import Surface
from ...surface.topology import cut_otherwise
from .bodies import ContactBody, corners_of, from_material, moved, to_material
from .near_surface import NearSurface, NearTriangles


def between(
    a: ContactBody, b: ContactBody, share: float, near: NearTriangles | None = None, *, arc: bool = False
) -> ContactBody:
    """Interpolate a body between two poses and shapes; friction is that of the second.

    Args:
        a, b: the body in both frames.
        share: 0 for `a`, 1 for `b`.
        near: triangles of the intermediate shape that are needed; None for all.
        arc: whether the body turns about an axis that keeps still, so that its way does not depend on where its origin
            is; otherwise its origin moves along a straight line.
    """
    if a.away or b.away or share == 1.0:
        return b
    if np.array_equal(a.rotation, b.rotation):
        rotation: Array = b.rotation
    else:
        ends = quaternions(np.stack([a.rotation, b.rotation]))
        last = ends[1] if ends[0] @ ends[1] >= 0.0 else -ends[1]
        rotation = matrices(((1.0 - share) * ends[0] + share * last)[None])[0]
    translation = (1.0 - share) * a.translation + share * b.translation
    if arc:
        translation = _on_arc(a, b, rotation, share)
    surface, carry = b.surface, b.carry
    if near is not None or reshaped(a, b):
        assert isinstance(a.surface, Surface) and isinstance(surface, Surface)
        if near is not None:
            surface = NearSurface(near, share)
        else:
            vertices = (1.0 - share) * a.surface.vertices + share * surface.vertices
            surface = Surface.build(vertices, surface.triangles)
        if a.carry is not None or carry is not None:
            one, other = (np.eye(3) if c is None else c for c in (a.carry, carry))
            carry = (1.0 - share) * one + share * other
    return replace(b, surface=surface, rotation=rotation, translation=translation, carry=carry)


def _on_arc(a: ContactBody, b: ContactBody, rotation: Array, share: float) -> Array:
    """Return the place of a body's origin on its way as a screw: about one axis, and along it [m], shape (3,).

    Args:
        a, b: the body at both ends.
        rotation: its rotation on the way, shape (3, 3).
        share: share of the way along the axis.
    """
    whole, part = quaternions(np.stack([b.rotation @ a.rotation.T, rotation @ a.rotation.T]))
    whole, part = (q if q[0] >= 0.0 else -q for q in (whole, part))
    half, some = (float(np.arctan2(np.sqrt(q[1:] @ q[1:]), q[0])) for q in (whole, part))
    if not np.sin(half) > 0.0:
        return (1.0 - share) * a.translation + share * b.translation
    axis = whole[1:] / np.sqrt(whole[1:] @ whole[1:])
    apart = b.translation - b.rotation @ a.rotation.T @ a.translation
    along = (apart @ axis) * axis
    # A chord of the circle about the axis: its length goes with the sine of half the angle, its direction turns by it.
    across, turn = apart - along, some - half
    chord = np.cos(turn) * across + np.sin(turn) * np.cross(axis, across)
    return np.asarray(
        rotation @ a.rotation.T @ a.translation + np.sin(some) / np.sin(half) * chord + share * along, np.float64
    )


def reshaped(a: ContactBody, b: ContactBody) -> bool:
    """Return whether a body has a different shape with the same triangles in two frames."""
    one, other = a.surface, b.surface
    if a.away or b.away or one is other or not isinstance(one, Surface) or not isinstance(other, Surface):
        return False
    return len(one.vertices) == len(other.vertices) and np.array_equal(one.triangles, other.triangles)


def lowered(body: ContactBody, far: float) -> ContactBody:
    """Return a body moved away from the pad by a distance along the finger's -Z [m]."""
    return replace(body, translation=body.translation - np.array([0.0, 0.0, far]))


def matter_moved(a: ContactBody, b: ContactBody, points: Array, triangle: Indices) -> Array | None:
    """Return the movement of a body's material at points between two frames [m], shape (n, 3).

    Args:
        a, b: the body in both frames.
        points: points on `b` [m], shape (n, 3).
        triangle: index of the triangle of `b` that is closest to each point, shape (n,).

    Returns:
        The movement; None if the body was or is away, or the faces of its surface have changed.
    """
    if a.away or b.away:
        return None
    if a.surface is b.surface:
        return moved(a, b, points)
    if not reshaped(a, b):
        one, other = a.surface, b.surface
        if not isinstance(one, Surface) or not isinstance(other, Surface):
            return None
        if len(one.vertices) != len(other.vertices) or not cut_otherwise(one.triangles, other.triangles):
            return None
    own = np.zeros(len(points), dtype=np.int64)
    material, corners = to_material((b,), own, triangle, points), corners_of((b,), own, triangle)
    return points - from_material((a,), own, material, triangle, corners)


def vertices_moved(near: NearTriangles, a: ContactBody, b: ContactBody) -> float:
    """Return the largest movement of a deforming body's vertices in the near triangles [m]."""
    some = np.unique(near.end.triangles[near.chosen])
    one, other = (body.placed(surface.vertices[some]) for surface, body in ((near.start, a), (near.end, b)))
    return float(np.sqrt(((other - one) ** 2).sum(axis=1).max()))
