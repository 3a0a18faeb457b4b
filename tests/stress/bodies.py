"""Bodies to press on, drawn: convex ones, thin ones, ones with many edges, bad ones; tops at the origin, +Z out."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from core.scene.tactile_scene import Mesh
from core.surface import shapes

from .case import Dice, Values

CONVEX = ("block", "ball", "edge", "hull", "pillar")
WIDE = ("block", "ball", "hull")
ANY = (*CONVEX, "card", "sheet", "ribs", "cross", "shell", "broken")


def draw_body(dice: Dice, kinds: tuple[str, ...], prefix: str = "") -> Values:
    """Draw a body's kind, size [m], angle [rad], how badly it is meshed, and the seed of what else is random in it."""
    return {
        f"{prefix}shape": dice.one_of(*kinds),
        f"{prefix}size": dice.decades(1e-3, 30e-3),
        f"{prefix}angle": dice.between(0.9, 2.8),
        f"{prefix}facets": dice.one_of(80, 320, 1280, 5120),
        f"{prefix}slivers": dice.one_of(0, 0, 0, 20, 200),
        f"{prefix}mesh_seed": dice.whole(0, 10**6),
    }


def mesh_of(values: Values, prefix: str = "") -> Mesh:
    """Return a drawn body's mesh: a new one at every call."""
    kind, size = str(values[f"{prefix}shape"]), float(values[f"{prefix}size"])
    rng = np.random.default_rng(int(values[f"{prefix}mesh_seed"]))
    vertices, triangles = _shape(kind, size, float(values[f"{prefix}angle"]), int(values[f"{prefix}facets"]), rng)
    vertices, triangles = split(vertices, triangles, int(values[f"{prefix}slivers"]), rng)
    return Mesh(np.ascontiguousarray(vertices), np.ascontiguousarray(triangles, dtype=np.int32))


def _shape(kind: str, size: float, angle: float, facets: int, rng: np.random.Generator) -> shapes.Shape:
    if kind == "ball":
        return shapes.sphere(size, facets)
    if kind == "edge":
        return shapes.edge(angle, min(0.2e-3, size), 0.05, 0.02)
    if kind == "hull":
        return hull(rng.normal(size=(30, 3)) * size)
    if kind == "pillar":
        return shapes.block(size, size, 0.02)
    if kind == "card":
        return shapes.block(0.05, 0.05, rng.uniform(0.05e-3, 3e-3))
    if kind == "sheet":
        half = 0.025
        corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
        return corners, np.array([[0, 1, 2], [0, 2, 3]])
    if kind == "ribs":
        period = max(size / 4, 0.6e-3)
        tops = [_moved(shapes.block(period / 2, 0.04, 2e-3), (k * period, 0.0, 0.0)) for k in range(-4, 5)]
        return together(*tops)
    if kind == "cross":  # two blocks that lie in each other
        one, two = shapes.block(size, 0.04, 0.01), shapes.block(0.04, size, 0.01)
        return together(one, _moved(two, (0.0, 0.0, -rng.uniform(0.0, 1e-3))))
    if kind == "shell":  # a ball with holes, as a scan has
        vertices, triangles = shapes.sphere(size, facets)
        return vertices, triangles[rng.uniform(size=len(triangles)) > 0.1]
    if kind == "broken":
        return broken(shapes.sphere(size, facets), rng)
    return shapes.block(0.05, 0.05, 0.02)


def hull(points: np.ndarray) -> shapes.Shape:
    """Return the convex hull of points, its highest one at the origin."""
    found = ConvexHull(points)
    used, triangles = np.unique(found.simplices, return_inverse=True)
    triangles, vertices = triangles.reshape(-1, 3), points[used]
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return vertices - vertices[vertices[:, 2].argmax()], triangles


def broken(shape: shapes.Shape, rng: np.random.Generator) -> shapes.Shape:
    """Return a surface with what meshes have that nobody checked: faces turned over, doubled, missing, without area."""
    vertices, triangles = shape[0].copy(), shape[1].copy()
    count = len(triangles)
    turned = rng.choice(count, count // 20, replace=False)
    triangles[turned] = triangles[turned][:, ::-1]
    doubled, flat = triangles[rng.choice(count, 5)], triangles[rng.choice(count, 5)].copy()
    flat[:, 2] = flat[:, 1]
    triangles = np.vstack([triangles[rng.uniform(size=count) > 0.03], doubled, flat])
    some = rng.choice(len(vertices), 5)
    vertices[some] += rng.normal(size=(5, 3)) * 0.2 * np.ptp(vertices[:, 2])
    return vertices, triangles


def split(vertices: np.ndarray, triangles: np.ndarray, count: int, rng: np.random.Generator) -> shapes.Shape:
    """Return the same surface with so many triangles split at points in them, most of the parts slivers."""
    for _ in range(count):
        at = int(rng.integers(len(triangles)))
        corners = triangles[at]
        weight = rng.dirichlet((0.2, 0.2, 0.2))
        weight = np.maximum(weight, 1e-4)
        new = len(vertices)
        vertices = np.vstack([vertices, (weight / weight.sum()) @ vertices[corners]])
        a, b, c = corners.tolist()
        triangles = np.vstack([np.delete(triangles, at, axis=0), [[a, b, new], [b, c, new], [c, a, new]]])
    return vertices, triangles


def together(*parts: shapes.Shape) -> shapes.Shape:
    """Return several surfaces as one mesh."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [triangles + start for (_, triangles), start in zip(parts, starts, strict=False)]
    return np.vstack([vertices for vertices, _ in parts]), np.vstack(faces)


def _moved(shape: shapes.Shape, by: tuple[float, float, float]) -> shapes.Shape:
    return shape[0] + np.array(by), shape[1]
