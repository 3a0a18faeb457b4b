"""Contact by what an object's mesh is like: a scan with noise and holes, and a ball that swells while it is pressed.

Both end as a ball of 5 mm, 1 mm deep, and are judged by the reference of the exact ball: without friction the way there
is no matter. Beside each stands the same ball as a clean and rigid mesh of as many faces.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from core.arrays import Array
from core.parameters.error_bands import LINEAR, NEO_HOOKEAN, error_band

from .. import one_blas_thread
from ..bench_shapes import stress_at
from .measured import Panel, Point
from .on_shapes import DEPTH, PROBED, RUNS, SAMPLES, TIGHT, Setting, point, pressed

if TYPE_CHECKING:
    from core.scene.tactile_scene import Mesh

RADIUS, SEED = 5e-3, 17
FACES = (320, 1280, 5120, 20480)
NOISE = 10e-6  # of a scan's vertices, standard deviation along the normal [m]
HOLE, HOLES = 0.3e-3, 60  # radius of a hole [m], and how many there are: a hundredth of the ball
SWELLS = 0.1  # of its radius
DEFAULT, AT_NODES = Setting("points", "", "points"), Setting("nodes", "", "nodes")


class Ball(NamedTuple):
    """The reference: where its origin is at first contact [m], probes [m], their stress [Pa] and its own error."""

    place: Array
    probes: Array
    stress: Array
    own: float


@functools.cache
def exact() -> Ball:
    """Return the reference of a ball of 5 mm, 1 mm deep."""
    from ..references.cases import FAMILIES
    from ..references.results import load

    case = load()["cases"]["ball 5 mm, 1 mm deep"]
    place = 1e-3 * np.array(case["place"]) - [0.0, 0.0, DEPTH]
    probes = 1e-3 * FAMILIES["ball 5"].probes
    return Ball(place, probes, np.asarray(case["stress"]), case["error"]["stress"][PROBED])


def scanned() -> Panel:
    """Return what a scan costs in accuracy, by its faces."""

    def scan(faces: int) -> tuple[Any, Sequence[Mesh]]:
        return _surface(*scan_of_ball(faces)), ()

    return _panel("scan", f"scan of a ball, {HOLES} holes, noise {1e6 * NOISE:g} um: faces", "scan", scan)


def deforming() -> Panel:
    """Return what a surface of its own at each sample costs, by its faces."""

    def swelling(faces: int) -> tuple[Any, Sequence[Mesh]]:
        from core.scene.tactile_scene import Mesh

        vertices, triangles = ball(faces)
        whole = _surface(vertices, triangles)
        sizes = np.linspace(1.0 - SWELLS, 1.0, SAMPLES)
        return whole, [Mesh(vertices * size, whole.triangles) for size in sizes]

    return _panel("deforming", "ball that swells while it is pressed: faces", "swelling", swelling)


def _panel(name: str, title: str, what: str, make: Callable[[int], tuple[Any, Sequence[Mesh]]]) -> Panel:
    bands = {tissue: error_band(tissue, DEPTH).stress.median for tissue in (LINEAR, NEO_HOOKEAN)}
    panel = Panel(name, title, "error of stress 1.2 mm deep", own=exact().own, bands=bands)
    for setting, said in ((DEFAULT, f"{what}, on points"), (AT_NODES, f"{what}, at nodes")):
        panel.points += [_judged(*make(faces), setting, said, faces) for faces in FACES]
    panel.points += [
        _judged(_surface(*ball(faces)), (), DEFAULT, "clean and rigid, on points", faces) for faces in FACES
    ]
    return panel


def _judged(surface: Any, shapes: Sequence[Mesh], setting: Setting, said: str, faces: int) -> Point:
    from ..references.results import difference

    times: list[float] = []
    with one_blas_thread():
        tight = stress_at(pressed(surface, exact().place, setting._replace(tolerance=TIGHT), shapes)[0], exact().probes)
        for _ in range(RUNS):
            felt, taken = pressed(surface, exact().place, setting, shapes)
            times += taken
    stress = stress_at(felt, exact().probes)
    off, solved, method = (
        difference(a, b, 3)[PROBED] for a, b in ((stress, exact().stress), (stress, tight), (tight, exact().stress))
    )
    named = setting._replace(curve=said, knob=_count(faces))
    return point(named, times, off, solved, method)


def _count(faces: int) -> str:
    return f"{faces / 1000:.3g}k" if faces >= 1000 else str(faces)


def _surface(vertices: Array, triangles: Array) -> Any:
    from core.surface.gap import Surface

    return Surface.build(vertices, triangles)


def ball(faces: int) -> tuple[Array, Any]:
    """Return vertices [m] and triangles of a ball with its top at the origin, in triangles as scanners leave them.

    Its vertices are on the sphere at places that follow no pattern; the triangles are those of their convex hull.
    """
    from scipy.spatial import ConvexHull

    count, rng = faces // 2 + 2, np.random.default_rng(SEED)
    k = np.arange(count) + 0.5
    turn, up = np.pi * (1.0 + 5.0**0.5) * k, 1.0 - 2.0 * k / count
    out = np.sqrt(1.0 - up**2)
    points = np.stack([out * np.cos(turn), out * np.sin(turn), up], axis=1)
    points += 0.3 * np.sqrt(4.0 * np.pi / count) * rng.uniform(-1.0, 1.0, points.shape)
    points /= np.linalg.norm(points, axis=1)[:, None]
    triangles = np.asarray(ConvexHull(points).simplices)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    return RADIUS * (points - [0.0, 0.0, 1.0]), triangles.astype(np.int32)


def scan_of_ball(faces: int) -> tuple[Array, Any]:
    """Return the same with noise along its normals, and without the triangles whose middle is in a hole."""
    vertices, triangles = ball(faces)
    rng = np.random.default_rng(SEED + 1)
    normals = vertices / RADIUS + [0.0, 0.0, 1.0]
    holes = rng.standard_normal((HOLES, 3))
    holes /= np.linalg.norm(holes, axis=1)[:, None]
    holes[0] = [0.2, 0.0, np.sqrt(0.96)]  # one is where it touches, whatever the draw
    middles = normals[triangles].mean(axis=1)
    away = np.linalg.norm(middles[:, None] - holes, axis=2).min(axis=1)
    noisy = vertices + NOISE * rng.standard_normal(len(vertices))[:, None] * normals
    return noisy, triangles[away * RADIUS > HOLE]
