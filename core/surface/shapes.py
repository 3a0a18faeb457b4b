"""Closed surfaces to press a finger on: ball, block and wedge.

The highest point of each is at the origin, and +Z points out of the surface there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError

MAX_FACETS = 1_000_000  # largest number of a ball's triangles; its surface is then off by 3e-6 of the radius
Shape = tuple[Array, NDArray[np.int64]]  # vertices [m], shape (V, 3), and triangles, counter-clockwise from outside


def sphere(radius: float, facets: int = 20_000) -> Shape:
    """Return a ball made of triangles, with the exact volume of the ball.

    Args:
        radius: radius of the ball [m].
        facets: least number of triangles. The surface is off by about radius * 3 / facets, to both sides.

    Raises:
        DermisError: the radius is not above zero, or `facets` is not from 1 to `MAX_FACETS`.
    """
    _positive("radius", radius)
    if not 0 < facets <= MAX_FACETS:
        raise DermisError("not a number of triangles", where="facets", value=facets, limit=f"1 to {MAX_FACETS}")
    golden = (1 + 5**0.5) / 2
    corners = [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    points = np.array([p[-k:] + p[:-k] for k in range(3) for p in corners], np.float64)
    points /= np.linalg.norm(points[0])
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    edge = np.sort(distance[0])[1] * 1.01
    near = distance < edge
    count = range(len(points))
    faces = [
        (i, j, k)
        for i in count
        for j in count
        if i < j and near[i, j]
        for k in count
        if j < k and near[i, k] and near[j, k]
    ]
    triangles = np.array(faces)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    triangles[inwards] = triangles[inwards][:, [0, 2, 1]]
    while len(triangles) < facets:
        points, triangles = _divided(points, triangles)
        points /= np.linalg.norm(points, axis=1)[:, None]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", np.cross(a, b), c) / 6.0
    points = points * (4.0 / 3.0 * np.pi / volume) ** (1.0 / 3.0) * radius
    points[:, 2] -= points[:, 2].max()
    return points, triangles


def block(width: float = 0.05, length: float = 0.05, height: float = 0.02) -> Shape:
    """Return a block with a level upper face.

    Args:
        width, length, height: size along X, Y and Z [m].

    Raises:
        DermisError: a length is not above zero.
    """
    for name, value in (("width", width), ("length", length), ("height", height)):
        _positive(name, value)
    profile = np.array([(-width / 2, -height), (width / 2, -height), (width / 2, 0.0), (-width / 2, 0.0)])
    return _drawn_out(profile, length)


def edge(angle: float = np.pi / 2, rounding: float = 0.2e-3, length: float = 0.05, height: float = 0.02) -> Shape:
    """Return a wedge whose edge points up and runs along Y.

    Args:
        angle: angle between its faces [rad].
        rounding: radius of the edge [m].
        length: length of the edge [m].
        height: height of the edge above the wedge's foot [m].

    Raises:
        DermisError: the angle is not between 0 and pi, or a length is not above zero.
    """
    if not 0.0 < angle < np.pi:
        raise DermisError("not the angle of a wedge", where="angle", value=angle, limit="above 0, below pi rad")
    for name, value in (("rounding", rounding), ("length", length), ("height", height)):
        _positive(name, value)
    half = angle / 2
    turn = np.pi / 2 - half  # half of the arc's angle; the arc is symmetric about +Z
    arcs = np.linspace(turn, -turn, max(int(np.ceil(turn / np.radians(3.0))), 2) * 2 + 1)
    arc = rounding * np.stack([np.sin(arcs), np.cos(arcs) - 1.0], axis=1)
    x, z = arc[0]
    foot = x + (height + z) * np.tan(half)
    return _drawn_out(np.vstack([[(-foot, -height), (foot, -height)], arc]), length)


def _drawn_out(profile: Array, length: float) -> Shape:
    """Return the prism over a convex profile.

    Args:
        profile: corners in X and Z [m], counter-clockwise seen from -Y, shape (n, 2).
        length: length of the prism along Y [m]; its middle is at Y = 0.
    """
    n = len(profile)
    front = np.insert(profile, 1, -length / 2, axis=1)
    back = np.insert(profile, 1, length / 2, axis=1)
    fan = np.array([(0, i, i + 1) for i in range(1, n - 1)])
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.vstack([np.stack([i, i + n, j], axis=1), np.stack([j, i + n, j + n], axis=1)])
    return np.vstack([front, back]), np.vstack([fan, fan[:, ::-1] + n, sides])


def _divided(points: Array, triangles: NDArray[np.int64]) -> Shape:
    """Divide each triangle into four, by the middles of its edges."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    middle = number.reshape(-1, 3) + len(points)
    a, b, c = triangles.T
    ab, bc, ca = middle.T
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.vstack([points, points[unique].mean(axis=1)]), np.vstack([np.stack(t, axis=1) for t in four])


def _positive(name: str, value: float) -> None:
    numbers = np.asarray(value)
    if numbers.ndim or numbers.dtype.kind not in "iuf" or not 0.0 < numbers < np.inf:
        raise DermisError("a length must be above zero", where=name, value=value, limit="> 0 m")
