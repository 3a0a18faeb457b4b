"""Where a finger that is inside a body came from: how far the body must be lowered for the finger to be outside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ...arrays import Array
from ...surface.crossing import first_crossing
from ...surface.gap import Surface
from .between import lowered
from .bodies import ContactBody
from .path_solver import PathSolver

# A finger counts as outside an object if no node is deeper in it than this [m].
OUTSIDE = 1e-7
SEARCHES = 40  # largest number of iterations of a search for first contact
# An object that has passed through a finger counts as above the pad if a line upwards from one of this many points of
# the pad meets it within this length [m].
WAYS, ABOVE = 16, 0.1
# Number of corners of an object that are tested for being inside the finger, and least cosine between the directions
# of a vertex and of the point of the skin with which it is compared.
VERTICES, IN_LINE = 64, 0.95


def ways_out(
    solver: PathSolver, some: Iterable[int], bodies: Sequence[ContactBody], deepest: float
) -> dict[int, float]:
    """Return the distance by which bodies must be lowered for the finger to be outside [m], by their index.

    Bodies that are in the finger or above it even farther down are left out. Where a body just touches the skin,
    the points of the pad cannot tell whether one of its vertices is inside.

    Args:
        solver: contact solver of the finger.
        some: indices of bodies.
        bodies: bodies in the finger's frame.
        deepest: largest distance [m].
    """
    ways, more = {i: way_out(solver, bodies[i], deepest) for i in some}, solver.search_radius
    found = {i: far for i, far in ways.items() if far is not None}
    return {i: far for i, far in found.items() if not in_or_above(solver, lowered(bodies[i], far + more))}


def way_out(solver: PathSolver, body: ContactBody, deepest: float) -> float | None:
    """Return the distance by which a body must be lowered for the finger to be outside [m].

    None if it exceeds the largest distance [m].
    """
    far = _above(solver, body, solver.pad, deepest)
    for _ in range(SEARCHES):
        inside = -solver.outside([lowered(body, far)])
        if inside <= OUTSIDE:
            return far
        far += inside
        if far > deepest:
            return None
    return None


def in_or_above(solver: PathSolver, body: ContactBody) -> bool:
    """Return whether a body is in the finger or above its pad."""
    some = solver.pad[:: max(len(solver.pad) // WAYS, 1)]
    if solver.outside([body]) < -OUTSIDE or _above(solver, body, some, ABOVE) > 0.0:
        return True
    return isinstance(body.surface, Surface) and _within(solver, body, body.surface)


def _above(solver: PathSolver, body: ContactBody, points: Array, height: float) -> float:
    """Return the largest height of a body's upper faces above points of the pad, up to a given height [m]."""
    if not isinstance(body.surface, Surface) or not body.surface.closed:
        return 0.0
    up = solver.bone * (height / np.linalg.norm(solver.bone))
    high, low = body.local(points + up, points)
    triangle, share = first_crossing(body.surface.table, high, low)
    return float(((1.0 - share) * (triangle >= 0)).max()) * height


def _within(solver: PathSolver, body: ContactBody, surface: Surface) -> bool:
    """Return whether a face's corner is inside the finger: nearer to the bone than the skin in the same direction.

    A vertex without a face bounds nothing.
    """
    corners = surface.triangles[:: len(surface.triangles) // VERTICES + 1, 0]
    some = body.placed(surface.vertices[corners]) - solver.bone
    skin = solver.pad - solver.bone
    far, deep = (np.sqrt(np.einsum("ij,ij->i", v, v)) for v in (some, skin))
    line = (some @ skin.T) / np.maximum(far[:, None] * deep, 1e-300)
    return bool((far < deep[line.argmax(axis=1)])[line.max(axis=1) > IN_LINE].any())
