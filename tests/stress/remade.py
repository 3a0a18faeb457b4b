"""The same solid, made otherwise: scaled in its matrix, with what bounds no solid, in two halves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.scene.tactile_scene import Body, Mesh

from .placed import Touch
from .setups import Setup

Array = NDArray[np.float64]
# Of an object's matrix: its mesh is in millimetres; it is mirrored; it is stretched, sheared and turned.
SCALES = (
    np.diag([1e-3, 1e-3, 1e-3]),
    np.diag([-1.0, 1.0, 1.0]),
    np.array([[1.3, 0.2, 0.0], [0.0, 0.7, 0.1], [0.1, 0.0, 1.6]]),
)
LOOSE = np.array([[0.0, 0.0, 3e-3], [0.5, -0.4, 0.3]])  # corners without faces, in the finger and far away [m]
NO_AREA = 10  # every so many faces there is one without area
SEAM = 0.2e-3  # of the solid's highest point, farthest [m]
TURNS = 60  # ways that a solid is tried to be cut


def scaled(touch: Touch, setup: Setup) -> Iterator[Setup]:
    """Write a scale into the object's matrix, and its inverse into the mesh."""
    for scale in SCALES:
        pose = np.eye(4)
        pose[:3, :3] = scale
        bodies = ((with_mesh(body, unscaled(mesh_of(body), scale)), way @ pose) for body, way in setup.bodies)
        yield replace(setup, bodies=tuple(bodies))


def unscaled(mesh: Mesh, scale: Array) -> Mesh:
    """Return the mesh that a scale makes into this one, its faces outwards before as after."""
    faces = mesh.triangles if np.linalg.det(scale) > 0.0 else np.ascontiguousarray(mesh.triangles[:, ::-1])
    return Mesh(mesh.vertices @ np.linalg.inv(scale).T, faces)


def litter(touch: Touch, setup: Setup) -> Iterator[Setup]:
    """Add what bounds no solid: loose corners, faces without area, each face once more, each body once more."""
    for change in (with_loose_corners, with_faces_without_area, with_faces_twice):
        yield replace(setup, bodies=tuple((with_mesh(body, change(mesh_of(body))), way) for body, way in setup.bodies))
    again = tuple((replace(body, name=f"{body.name} again"), way) for body, way in setup.bodies)
    yield replace(setup, bodies=(*setup.bodies, *again))


def with_loose_corners(mesh: Mesh) -> Mesh:
    """Return a mesh with corners that no face uses."""
    return Mesh(np.vstack([LOOSE, mesh.vertices]), (mesh.triangles + len(LOOSE)).astype(np.int32))


def with_faces_without_area(mesh: Mesh) -> Mesh:
    """Return a mesh with faces of two corners, and faces whose corners are on one line."""
    some = mesh.triangles[::NO_AREA]
    middles = mesh.vertices[some[:, :2]].mean(axis=1)
    new = np.arange(len(some), dtype=np.int32) + len(mesh.vertices)
    flat, line = some[:, [0, 1, 1]], np.stack([some[:, 0], new, some[:, 1]], axis=1)
    return Mesh(np.vstack([mesh.vertices, middles]), np.ascontiguousarray(np.vstack([flat, mesh.triangles, line])))


def with_faces_twice(mesh: Mesh) -> Mesh:
    """Return a mesh that has each face twice."""
    return Mesh(mesh.vertices, np.vstack([mesh.triangles, mesh.triangles]))


def seam(touch: Touch, setup: Setup) -> Iterator[Setup]:
    """Cut the solid through where it is touched: in two bodies, and in two shells of one body."""
    rng = np.random.default_rng(int(touch.values["random"]))
    start, offset = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-SEAM, SEAM)
    cut = [(halves(mesh_of(body), start, offset), body, way) for body, way in setup.bodies]
    two = [(replace(body, name=f"{body.name} {k}", mesh=h), way) for some, body, way in cut for k, h in enumerate(some)]
    yield replace(setup, bodies=tuple(two))
    yield replace(setup, bodies=tuple((with_mesh(body, joined(some)), way) for some, body, way in cut))


def joined(meshes: list[Mesh]) -> Mesh:
    """Return meshes as one, which share no corners."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.vstack([mesh.vertices for mesh in meshes]), np.vstack(faces).astype(np.int32))


def halves(mesh: Mesh, start: float, offset: float) -> list[Mesh]:
    """Return the closed halves of a closed mesh on both sides of an upright plane.

    Args:
        start: direction of the plane's normal [rad]; the first one from there on whose walls are seen whole from their
            middles is taken. offset: of the plane from the origin [m].

    Raises:
        ValueError: no plane cuts the solid so.
    """
    for turn in start + 2.0 * np.pi * np.arange(TURNS) / TURNS:
        normal = np.array([np.cos(turn), np.sin(turn), 0.0])
        two = [half(mesh, sign * normal, sign * offset) for sign in (1.0, -1.0)]
        if None not in two:
            return [part for part in two if part is not None and len(part.triangles)]
    raise ValueError("no plane cuts the solid into halves with simple walls")


def half(mesh: Mesh, normal: Array, offset: float) -> Mesh | None:
    """Return what is above a plane, closed by walls; None where one of them cannot be seen whole from its middle."""
    height, vertices = mesh.vertices @ normal - offset, [*mesh.vertices]
    between: dict[tuple[int, int], int] = {}  # corners on edges that are cut
    follows: dict[int, int] = {}  # along the rims of the walls, which run against those of the faces
    faces: list[tuple[int, int, int]] = []

    def crossing(a: int, b: int) -> int:
        a, b = sorted((a, b))
        if (a, b) not in between:
            between[a, b] = len(vertices)
            share = height[a] / (height[a] - height[b])
            vertices.append(mesh.vertices[a] + share * (mesh.vertices[b] - mesh.vertices[a]))
        return between[a, b]

    for face in mesh.triangles.tolist():
        ring: list[int] = []
        leaves, enters = -1, -1
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            if height[a] > 0.0:
                ring.append(a)
            if height[a] > 0.0 >= height[b]:
                leaves = crossing(a, b)
                ring.append(leaves)
            elif height[b] > 0.0 >= height[a]:
                enters = crossing(a, b)
                ring.append(enters)
        faces += [(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)]
        if leaves >= 0:
            follows[enters] = leaves
    while follows:
        rim = [next(iter(follows))]
        while rim[-1] in follows:
            rim.append(follows.pop(rim[-1]))
        rim.pop()
        corners = np.array([vertices[k] for k in rim])
        middle = corners.mean(axis=0)
        areas = np.cross(corners - middle, np.roll(corners, -1, axis=0) - middle) @ -normal
        if not (areas > 1e-9 * areas.sum()).all():
            return None
        faces += [(len(vertices), a, b) for a, b in zip(rim, [*rim[1:], rim[0]], strict=True)]
        vertices.append(middle)
    used, places = np.unique(np.array(faces, np.int64).reshape(-1, 3), return_inverse=True)
    return Mesh(np.array(vertices)[used], np.ascontiguousarray(places.reshape(-1, 3), np.int32))


def with_mesh(body: Body, mesh: Mesh) -> Body:
    """Return a body with another mesh."""
    return replace(body, mesh=mesh)


def mesh_of(body: Body) -> Mesh:
    """Return the mesh of a body that does not deform."""
    assert body.mesh is not None
    return body.mesh
