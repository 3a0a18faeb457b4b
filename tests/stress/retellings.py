"""The same touch told otherwise: scenes, meshes and ways of working that must not change what is felt."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from core.cache import Cache
from core.contact.skin_stepper import SkinStepper
from core.contact.solver.path_solver import PathSolver
from core.pipeline import shares
from core.pipeline.kept_shares import KeptShares
from core.scene.tactile_scene import Body, Mesh
from core.surface import shapes

from .paths import poses, turned
from .placed import Touch, with_parts
from .setups import Setup

Array = NDArray[np.float64]
Retold = Iterator[Setup]
CUTS = (1, 7, 16)  # samples of a chunk
SHIFTS = (1e-9, 1e-8, 1e-7, 1e-6)  # [m]
CRACK = 1e-9  # between triangles that are not welded [m]
STARTS = ("zero", "last", "random")
STRANGERS = ({"friction": 0.05}, {"friction": 2.0, "surface_stiffness": 1e6, "mass": 0.3, "held_mode": "keyed"})
APART = np.array([3e-3, 2e-3, -0.3e-3])  # of a finger that touches the same body elsewhere [m]
FAR = 100.0  # [m] from the world's origin


# -- scenes --------------------------------------------------------------------------------------------------------


def untouched(touch: Touch, setup: Setup) -> Retold:
    """Add a body that is not touched: beside the finger, above its nail, and behind what it touches."""
    yield beside(setup)
    yield with_body(setup, shapes.block(12e-3, 12e-3, 8e-3), still_at(setup, (0.0, 0.0, 24e-3)))
    behind = np.eye(4)
    behind[2, 3] = -4e-3
    yield with_body(setup, shapes.block(20e-3, 20e-3, 8e-3), setup.bodies[0][1] @ behind)


def beside(setup: Setup) -> Setup:
    """Return a setup with a body that lies 9 mm beside the middle of the pad, a millimetre from the skin."""
    return with_body(setup, shapes.block(12e-3, 12e-3, 8e-3), still_at(setup, (15e-3, 0.0, 2e-3)))


def twinned(setup: Setup) -> Setup:
    """Return a setup with a body beside, and one of another material in the place of the first."""
    body, way = setup.bodies[0]
    twin = replace(body, name="twin", parameters={**body.parameters, "friction": 0.8})
    setup = beside(setup)
    return replace(setup, bodies=(*setup.bodies, (twin, way)))


def stranger(touch: Touch, setup: Setup) -> Retold:
    """Give a body that is not touched another friction, a soft surface, and a weight that could be held."""
    body, way = setup.bodies[-1]
    for material in STRANGERS:
        yield replace(setup, bodies=(*setup.bodies[:-1], (replace(body, parameters=material), way)))


def still_at(setup: Setup, place: tuple[float, float, float]) -> Array:
    """Return poses of something that keeps still in the finger's frame [m], shape (n, 4, 4)."""
    return poses(np.tile(place, (setup.count, 1)))


def with_body(setup: Setup, shape: shapes.Shape, way: Array) -> Setup:
    """Return a setup with one body more."""
    mesh = Mesh(shape[0], shape[1].astype(np.int32))
    return replace(setup, bodies=(*setup.bodies, (Body("another", mesh, {"friction": 0.5}), way)))


def order(touch: Touch, setup: Setup) -> Retold:
    """Put bodies in another order, and a finger before the finger that touches the same bodies elsewhere."""
    yield replace(setup, bodies=setup.bodies[::-1])
    yield replace(setup, before=("another",), apart=APART)


def names(touch: Touch, setup: Setup) -> Retold:
    """Call bodies and the finger something else."""
    called = [f"{9 - k} Kugel é" for k in range(len(setup.bodies))]
    bodies = zip(called, setup.bodies, strict=True)
    yield replace(setup, name="Ω", bodies=tuple((replace(b, name=name), way) for name, (b, way) in bodies))


def turned_about(touch: Touch, setup: Setup) -> Retold:
    """Turn the scene and carry it away; then let the finger move over bodies that keep still."""
    rng, world = np.random.default_rng(int(touch.values["random"])), np.eye(4)
    world[:3, :3] = turned(*rng.uniform(-180.0, 180.0, 3))
    yield replace(setup, world=world)
    world = world.copy()
    world[:3, 3] = rng.uniform(-FAR, FAR, 3)
    yield replace(setup, world=world)
    yield replace(setup, world=np.linalg.inv(setup.bodies[0][1]))


def shifted(touch: Touch, setup: Setup) -> Retold:
    """Shift the solid by far less than can be seen."""
    way = np.random.default_rng(int(touch.values["random"])).normal(size=3)
    for far in SHIFTS:
        yield carried(setup, far * way / np.linalg.norm(way))


def carried(setup: Setup, by: Array) -> Setup:
    """Return a setup whose bodies are elsewhere [m], shape (3,)."""
    move = np.eye(4)
    move[:3, 3] = by
    return replace(setup, bodies=tuple((body, move @ way) for body, way in setup.bodies))


def mirrored(touch: Touch, setup: Setup) -> Retold:
    """Mirror the scene in the middle plane of the finger, which is its own mirror image."""
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    bodies = []
    for body, way in setup.bodies:
        assert body.mesh is not None
        mesh = Mesh(body.mesh.vertices * [-1.0, 1.0, 1.0], np.ascontiguousarray(body.mesh.triangles[:, ::-1]))
        bodies.append((replace(body, mesh=mesh), flip @ way @ flip))
    yield replace(setup, bodies=tuple(bodies), probes=setup.probes * [-1.0, 1.0, 1.0])


# -- meshes --------------------------------------------------------------------------------------------------------


def meshes(touch: Touch, setup: Setup, change: Callable[[Mesh, np.random.Generator], Mesh]) -> Setup:
    """Return a setup whose meshes are changed."""
    rng = np.random.default_rng(int(touch.values["random"]))
    return with_parts(touch, [change(part, rng) for part in touch.parts], setup)


def triangles(touch: Touch, setup: Setup) -> Retold:
    """Cut the same surface otherwise: diagonals of flat faces turned, each triangle in four, all in another order."""
    yield meshes(touch, setup, flipped)
    yield meshes(touch, setup, quartered)
    yield meshes(touch, setup, shuffled)


def flipped(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return a mesh with diagonals of flat quadrilaterals turned."""
    v, faces = mesh.vertices, mesh.triangles.astype(np.int64).copy()
    normal = np.cross(v[faces[:, 1]] - v[faces[:, 0]], v[faces[:, 2]] - v[faces[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    beside: dict[tuple[int, int], int] = {}
    for t, face in enumerate(faces.tolist()):
        beside.update({(face[k], face[(k + 1) % 3]): t for k in range(3)})
    free = np.ones(len(faces), bool)
    for t in range(len(faces)):
        for k in range(3):
            a, b, c = (int(faces[t, (k + i) % 3]) for i in range(3))
            other = beside.get((b, a), -1)
            if not free[t] or other < 0 or not free[other] or normal[t] @ normal[other] < 1.0 - 1e-12:
                continue
            d = next(int(x) for x in faces[other] if x not in (a, b))
            new = np.array([[c, a, d], [d, b, c]])
            areas = np.einsum("ij,j->i", np.cross(v[new[:, 1]] - v[new[:, 0]], v[new[:, 2]] - v[new[:, 0]]), normal[t])
            if (areas > 1e-3 * np.abs(areas).sum()).all():  # the quadrilateral is convex
                faces[t], faces[other] = new
                free[[t, other]] = False
    return Mesh(v, np.ascontiguousarray(faces, np.int32))


def quartered(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return a mesh with each triangle cut in four."""
    vertices, faces = shapes._divided(mesh.vertices, mesh.triangles.astype(np.int64))
    return Mesh(vertices, np.ascontiguousarray(faces, np.int32))


def shuffled(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return a mesh with corners and faces in another order."""
    order = rng.permutation(len(mesh.vertices))
    place = np.argsort(order)
    faces = np.roll(place[mesh.triangles], 1, axis=1)[rng.permutation(len(mesh.triangles))]
    return Mesh(mesh.vertices[order], np.ascontiguousarray(faces, np.int32))


def unwelded(mesh: Mesh, rng: np.random.Generator, crack: float = 0.0) -> Mesh:
    """Return a mesh whose triangles have corners of their own, drawn in by so much [m]."""
    corners = mesh.vertices[mesh.triangles]
    inward = corners.mean(axis=1, keepdims=True) - corners
    corners = corners + crack * inward / np.linalg.norm(inward, axis=2, keepdims=True)
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3))


def welded(touch: Touch, setup: Setup) -> Retold:
    """Let no two triangles share a corner."""
    yield meshes(touch, setup, unwelded)


def cracked(touch: Touch, setup: Setup) -> Retold:
    """Let no two triangles share a corner, a nanometre apart."""
    yield meshes(touch, setup, partial(unwelded, crack=CRACK))


# -- ways of working -----------------------------------------------------------------------------------------------


def chunks(touch: Touch, setup: Setup) -> Retold:
    """Hand over the samples in parts."""
    for size in CUTS:
        yield replace(setup, chunk=size)


def strides(touch: Touch, setup: Setup) -> Retold:
    """Solve every sample."""
    yield replace(setup, parameters={**setup.parameters, "solved_at": "samples"})


def caches(touch: Touch, setup: Setup) -> Retold:
    """Bake it again; with an empty cache and from a full one; from shares that were kept; and after other touches."""
    yield setup
    with tempfile.TemporaryDirectory(prefix="dermis-invariance-") as folder:
        cached = replace(setup, cache=Cache(Path(folder), 10**9), kept=KeptShares())
        yield cached
        yield cached
        after = replace(cached, kept=KeptShares())
        for other in unlike(touch, after):
            other.bake()
        yield after


def unlike(touch: Touch, setup: Setup) -> Retold:
    """Yield touches that feel otherwise: by friction, by place, by shape, and by where contact is solved."""
    friction = 0.9 - float(touch.values["friction"])
    yield replace(setup, bodies=tuple((replace(b, parameters={"friction": friction}), way) for b, way in setup.bodies))
    yield carried(setup, np.array([0.0, 0.0, 0.1e-3]))
    yield meshes(touch, setup, lambda mesh, _: Mesh(mesh.vertices * [0.9, 1.1, 1.0], mesh.triangles))
    where = {"points": "nodes", "nodes": "points"}[str(touch.values["contact"])]
    yield replace(setup, parameters={**setup.parameters, "contact": where})


def processes(touch: Touch, setup: Setup) -> Retold:
    """Spread fingers over processes."""
    yield replace(setup, workers=2, engine=_spread)


def with_finger(setup: Setup) -> Setup:
    """Return a setup with one finger more that feels the same."""
    return replace(setup, after=("another",))


def broad_phase(touch: Touch, setup: Setup) -> Retold:
    """Hand every body to the solver in every sample."""
    yield replace(setup, engine=_everything_near)


def start(touch: Touch, setup: Setup) -> Retold:
    """Start the iteration of each frame elsewhere."""
    for begin in STARTS:
        yield replace(setup, engine=partial(started, begin, int(touch.values["random"])))


@contextmanager
def _spread() -> Iterator[None]:
    with patch.object(shares, "SAVED", 1):  # however short the scene is
        yield


@contextmanager
def _everything_near() -> Iterator[None]:
    made, around = SkinStepper.__init__, SkinStepper.around

    def begin(self: SkinStepper, *given: Any, **more: Any) -> None:
        made(self, *given, **more)
        self._radius = 1.0  # of the boxes [m]
        self.bone  # noqa: B018 - it is made when it is asked for, and then no sample is idle

    def all_of(self: SkinStepper, approach: Any, i: int, *, untouched: bool = False) -> Any:
        return around(self, approach, i, untouched=True)

    with patch.object(SkinStepper, "__init__", begin), patch.object(SkinStepper, "around", all_of):
        yield


@contextmanager
def started(begin: str, seed: int) -> Iterator[None]:
    """Start iterations from nothing, from the last forces, or from forces drawn at random about these."""
    rng = np.random.default_rng(seed)
    usual = PathSolver._extrapolated

    def elsewhere(force: Array) -> Array:
        factors = {"last": 1.0, "zero": 0.0, "random": rng.uniform(0.0, 2.0, force.shape)}
        return factors[begin] * force

    def extrapolated(self: PathSolver, force: Array) -> Array:
        usual(self, force)  # it notes which points are new
        return elsewhere(force)

    with patch.object(PathSolver, "_extrapolated", extrapolated):
        yield
