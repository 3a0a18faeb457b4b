"""Bodies and points, a pad's survey and a touch for the kernels."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array, Indices
from core.contact.solver.bodies import TIE, TURN
from core.kernels import records
from core.skin.tiles import Tiles
from core.surface import shapes
from core.surface.gap import DIRECTIONS, Surface
from core.surface.roundness import roundness
from core.surface.topology import Topology
from core.surface.triangles import TriangleTable

from .case import Case, filled


@dataclass(eq=False)
class Arrays(Case):
    """The arrays of a body and a query."""

    vertices: Array
    triangles: Indices
    points: Array
    limit: float = np.inf
    index, friction, softness = 1, 0.5, 1e-9
    results = "middle", "scale", "largest", "by_rays", "met", "turned"

    def __post_init__(self) -> None:
        self.table = table = TriangleTable.build(self.vertices, self.triangles)
        self.topology = Topology.build(self.vertices, self.triangles)
        self.order = np.flatnonzero(table.usable)
        self.count, n = self.order.size, len(self.points)
        blocks = -(-self.count // records.LANES)
        self.depth = next(k for k in range(16) if blocks >> 2 * k <= 2)
        self.packed = np.full((self.count, records.ROW), np.nan)
        self.boxes = np.full(((4**self.depth - 1) // 3 + blocks, records.BOXES), np.nan, dtype=np.float32)
        self.normals = np.full((len(self.vertices), 3), np.nan)
        self.part = np.sort(np.unique(self.topology.parts[self.order], return_index=True)[1])
        along = self.vertices @ DIRECTIONS.T
        self.slab = np.column_stack([DIRECTIONS, along.min(axis=0), along.max(axis=0)])
        self.by_rays = False
        self.found = {name: np.full((n, 3), np.nan) for name in ("normal", "closest", "weights")}
        self.found |= {"gap": np.full(n, np.nan), "triangle": np.full(n, -7)}
        self.found |= {name: np.full(n, -7, dtype=np.int8) for name in ("feature", "beside")}

    def records(self, packed: bool = True) -> tuple[records.TreeRecord, records.BodyRecord, records.QueryRecord]:
        """Return the records of a call, with a tree or without one; they hold addresses only."""
        table, topology = self.table, self.topology
        made: dict[str, Any] = {"packed": self.packed, "boxes": self.boxes}
        if not packed:
            made = {"packed": None, "boxes": None, "largest": float(np.abs(self.vertices).max())}
        tree = filled(records.TreeRecord, self, table, total=table.usable.size, **made)
        counts = {"vertices": len(self.vertices), "parts": len(self.part), "slabs": len(self.slab)}
        made = {"normals": self.normals if packed else None, "by_rays": self.by_rays or not packed}
        body = filled(records.BodyRecord, self, topology, tree=tree, all=tree, weld=0.0, **counts, **made)
        return tree, body, filled(records.QueryRecord, self, body=body, count=len(self.points), **self.found)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        tree, body, query = self.records()
        for function, record in (("tree_split", tree), ("tree_fit", tree), ("body_fit", body)):
            status = self._call(getattr(own, f"dermis_{function}"), record)
            yield status
            if status:
                return
        yield self.measure(own, packed=False)
        if body.closed:
            yield self._call(own.dermis_body_judge, body)
            self.by_rays = bool(body.by_rays)
        yield self._call(own.dermis_distances, query)

    def measure(self, own: Any, packed: bool) -> int:
        """Return the status of distances alone, by a tree that was made before, or without."""
        return int(own.dermis_distances(ctypes.byref(self.fitted(own, packed)[1])))

    def fitted(self, own: Any, packed: bool = True) -> tuple[records.BodyRecord, records.QueryRecord]:
        """Return the records of a body and a query that the kernels have seen, of triangles that are sorted."""
        tree, body, query = self.records(packed)
        assert not (packed and own.dermis_tree_fit(ctypes.byref(tree))) and not own.dermis_body_fit(ctypes.byref(body))
        return body, query


def edge() -> tuple[Array, Indices]:
    """Return vertices and triangles of an edge."""
    surface = Surface.edge()
    return surface.vertices, surface.triangles


def bumps(seed: int) -> tuple[Array, Indices]:
    """Return two sheets of bumps beside each other, with hollows and a triangle without area in each."""
    rng = np.random.default_rng([seed, 1])
    flat = np.stack(np.meshgrid(np.linspace(0.2e-3, 4e-3, 6), np.linspace(-4e-3, 4e-3, 9), indexing="ij"), axis=-1)
    place = np.arange(54).reshape(6, 9)
    a, b, c, d = (part.ravel() for part in (place[:-1, :-1], place[1:, :-1], place[1:, 1:], place[:-1, 1:]))
    whole = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    first, second, third = whole[20]
    whole[20] = first, second, 54  # cut at the middle of the edge from its third to its first corner
    added = [[54, second, third], [third, first, 54]]
    sheets, triangles = [], np.concatenate([whole, added])
    for way in (1.0, -1.0):
        sheet = np.column_stack([way * flat.reshape(-1, 2), rng.normal(0.0, 0.05e-3, 54)])
        sheets.append(np.concatenate([sheet, 0.5 * (sheet[[first]] + sheet[[third]])]))
    return np.concatenate(sheets), np.concatenate([triangles, triangles + 55])


def drawn(seed: int) -> Arrays:
    """Return triangles and points of all sizes, with slivers, triangles without area and points on triangles."""
    rng = np.random.default_rng(seed)
    kind, count = seed % 4, int(rng.integers(1, 200))
    if kind == 0:
        vertices, triangles = shapes.sphere(5e-3, int(rng.integers(20, 900)))
        if seed % 8 == 0:  # two that run through each other
            triangles = np.concatenate([triangles, triangles + len(vertices)])
            vertices = np.concatenate([vertices, vertices + rng.uniform(-6e-3, 6e-3, 3)])
    elif kind == 1:
        vertices, triangles = edge()
    else:
        size = 10.0 ** rng.uniform(-9.0 if kind == 3 else -4.0, -1.0, (count, 1, 1))
        flat = np.where(rng.random((count, 1, 1)) < 0.3, 10.0 ** rng.uniform(-12, -4, (count, 1, 1)), 1.0)
        corners = (
            rng.normal(size=(count, 3, 3)) * size * np.concatenate([np.ones((count, 1, 2)), flat[:, :, :1]], axis=2)
        )
        vertices = (corners + 0.01 * rng.normal(size=(count, 1, 3))).reshape(-1, 3)
        triangles = np.arange(3 * count).reshape(-1, 3)
        triangles[rng.random(count) < 0.1, 1] = 0
    vertices = np.ascontiguousarray(
        vertices * 10.0 ** rng.uniform(-3, 3) + rng.normal(size=3) * 10.0 ** rng.uniform(-6, 1)
    )
    some = triangles[rng.integers(0, len(triangles), 40)]
    weights = np.concatenate(
        [rng.dirichlet(np.ones(3), 20), np.eye(3)[rng.integers(0, 3, 10)], np.full((10, 3), [0.5, 0.5, 0.0])]
    )
    on = np.einsum("nc,nci->ni", weights, vertices[some])
    size = float(np.ptp(vertices, axis=0).max())
    away = vertices.mean(axis=0) + rng.normal(size=(60, 3)) * size * 10.0 ** rng.uniform(-6, 3, (60, 1))
    points = np.ascontiguousarray(np.concatenate([on, away]))
    limit = np.inf if seed % 3 else size * 10.0 ** float(rng.uniform(-3, 0))
    return Arrays(vertices, np.ascontiguousarray(triangles), points, limit)


@dataclass(eq=False)
class Survey(Case):
    """The arrays of a pad's survey: square cells on a bowl at rest, an edge and a plane near it."""

    positions: Array
    normals: Array
    sides: Array
    limits: Array
    longs: Array
    tiles: Tiles
    solid: Arrays
    poses: Array
    finest: int
    sharpness: float
    rounding: float
    alone: int
    limit, turned, edge, bent, corners, beyond = 2.5e-3, 0.3, 0.9, 0.04e-3, 0.75, 0.4e-3
    beside, odd, above, deep, steep, coarsest, many, round = 0.35, 0.4, 3e-3, 0.02e-3, 0.3, 1, 450, 1.0 / 3.0
    results = "found", "finest"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        tiles = self.tiles
        roots = self.tiles.first[1, 1]
        posed = posed_pair(own, self.solid, self.poses, self.sharpness, self.rounding)
        found = {"leaves": np.zeros(4 * roots, dtype=np.int64), "clearance": np.zeros(4 * roots)}
        numbers = {"bodies": 2 - self.alone, "roots": roots, "levels": tiles.levels, "most": 4 * roots}
        names = "first", "ways", "root", "halved", "place"
        arrays = {name: np.ascontiguousarray(getattr(tiles, name)) for name in names}
        record = filled(records.SurveyRecord, self, posed=posed, **numbers, **arrays, **found)
        yield self._call(own.dermis_find_cells, record, **changed)


def drawn_survey(seed: int) -> Survey:
    """Return a pad of 12 by 12 cells of 0.8 mm, and an edge or bumps, alone or with a plane, far or near."""
    rng, across, side = np.random.default_rng(seed), 12, 0.8e-3
    tiles = Tiles(np.cumsum([0, *(across**2 * 4**k for k in range(4))]).tolist())
    size = side / 2.0**tiles.halved
    corner = np.stack(np.divmod(tiles.root, across), axis=1) * side - 0.5 * across * side
    flat = corner + (tiles.place + 0.5) * size
    positions = np.column_stack([flat, 2.0 * (flat**2).sum(axis=1)])
    normals = np.column_stack([-4.0 * flat, np.ones(len(flat))])
    normals = -normals / np.linalg.norm(normals, axis=1)[:, None]
    sides = np.zeros((len(flat), 2, 3))
    sides[:, 0, 0], sides[:, 1, 1] = size.T
    poses = rng.uniform(-1.5e-3, 1.5e-3, (2, 3))
    return Survey(
        positions,
        normals,
        sides,
        0.4 * size.max(axis=1) + 0.1e-3,
        size.max(axis=1),
        tiles,
        Arrays(*(bumps(seed) if seed % 4 == 1 else edge()), np.zeros((1, 3))),
        poses,
        int(rng.integers(1, 4)),
        float(rng.choice([1.0 / 3.0, 1.0])),
        float(rng.choice([0.0, 0.5e-3])),
        seed % 3 // 2,
    )


@dataclass(eq=False)
class Touch(Case):
    """Points of smooth skin that look at bodies, and the forces that these exert on them.

    Attributes:
        rounding: of the plane's rim [m]; 0: the plane is infinite.
        plane: whether the plane is the only body.
        rubs: friction of the edge; without it, skin on a sharp edge has several states.
        wrong: place of a body that is written into the workspace before the forces are solved; None: none is.
        found: the arrays of the points after a call, by their names in `kernels.h`.
    """

    points: Array
    inward: Array
    spread: Array
    areas: Array
    where: Array
    offset: Array
    shift: Array
    force: Array
    compliance: NDArray[np.float32]
    solid: Arrays
    poses: Array
    sharpness: float
    rounding: float
    bodies: int
    plane: bool = False
    rubs: float = 0.0
    wrong: int | None = None
    limit, lift, ratio, tolerance, most, avx2 = 2.5e-3, 0.3e-3, 6.0, 1e-4, 60, 0
    results = "residual", "sweeps", "looks"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.points)
        pair = posed_pair(own, self.solid, self.poses, self.sharpness, self.rounding, self.rubs)
        posed = pair[1] if self.plane else pair
        room = np.full(int((records.TOUCH_ROOM + 4.5 * n) * n) + 1, np.nan)
        blocks = {"found": np.full(records.FOUND * n, np.nan), "out": np.full(9 * n + -(-n // 8), np.nan), "room": room}
        vectors, numbers, indices = blocks["found"][: 6 * n], blocks["found"][6 * n : 10 * n], blocks["found"][10 * n :]
        forces, status = blocks["out"][: 9 * n].reshape(3, n, 3), blocks["out"][9 * n :].view(np.int8)[:n]
        self.found = dict(zip(("where", "normal"), vectors.reshape(2, n, 3), strict=True))
        told = ("clearance", "gap", "friction", "softness")
        self.found |= dict(zip(told, numbers.reshape(4, n), strict=True))
        self.found |= dict(zip(("owner", "triangle"), indices.view(np.int64).reshape(2, n), strict=True))
        self.found |= dict(zip(("force", "image", "moved"), forces, strict=True), status=status)
        self.found["where"][:], self.found["force"][:] = self.where, self.force
        sizes = {"count": n, "stride": self.compliance.shape[1]}
        none = dict.fromkeys(("compliance", "offset", "shift", "out"))
        look = filled(records.TouchRecord, self, posed=posed, **sizes, **(blocks | none))
        result = self._call(own.dermis_touch_points, look, **changed)
        yield result
        if result:
            return
        if self.wrong is not None:
            room.view(np.int64)[(look.body - room.ctypes.data) // 8] = self.wrong
        solve = filled(records.TouchRecord, self, posed=posed, looked=1, **sizes, **blocks)
        yield self._call(own.dermis_touch_points, solve, **changed)


def drawn_touch(seed: int) -> Touch:
    """Return points of a bowl, on cells of all sizes, and an edge or bumps, a plane or both: away, touching or deep."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 30))
    flat = rng.uniform(-3e-3, 3e-3, (n, 2))
    normals = np.column_stack([4.0 * flat, -np.ones(n)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    spread = np.zeros((n, 2, 3))
    spread[:, 0, 0] = spread[:, 1, 1] = 0.25e-3
    reach = np.linalg.norm(flat[:, None] - flat, axis=2)
    matrix = np.kron(np.exp(-((reach / 2e-3) ** 2)) + 0.2 * np.eye(n), np.diag([1.0, 1.2, 0.8]))
    compliance = np.full((3 * n, 3 * n + int(rng.integers(0, 9))), np.nan, np.float32)
    compliance[:, : 3 * n] = 10.0 ** rng.uniform(-4, -2) * matrix
    return Touch(
        np.column_stack([flat, 2.0 * (flat**2).sum(axis=1)]),
        -normals,
        spread,
        10.0 ** rng.uniform(-8, -6, n),
        1e-4 * rng.normal(size=(n, 3)),
        1e-4 * rng.normal(size=(n, 3)) * (seed % 2),
        1e-4 * rng.normal(size=(n, 3)) * (seed % 4 == 0),
        0.1 * rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.5),
        compliance,
        Arrays(*(bumps(seed) if seed % 3 == 1 else edge()), np.zeros((1, 3))),
        np.column_stack([rng.uniform(-1e-3, 1e-3, (2, 2)), rng.uniform(-1e-3, 1.5e-3, 2)]),
        float(rng.choice([1.0 / 3.0, 0.6, 1.0])),
        float(rng.choice([0.0, 0.5e-3])),
        int(rng.integers(1, 3)),
    )


def posed_pair(
    own: Any, solid: Arrays, poses: Array, sharpness: float, rounding: float, friction: float = 0.0
) -> ctypes.Array[records.PosedRecord]:
    """Return the records of a body and of a rough and soft plane or disc below it.

    The last part of a body with several needs the share `sharpness` of the largest lift, others less.
    """
    assert not any(solid.call(own))
    body, _ = solid.fitted(own)
    turn = {"rotation": np.eye(3), "side": 1.0, "tie": TIE, "turn": TURN}
    part, own_part = roundness(solid.table, solid.topology).part, {"sharpness": sharpness, "friction": friction}
    if part.max() > 0:
        own_part |= {"shares": np.linspace(1.0 / 3.0, sharpness, int(part.max()) + 1), "part": part}
    edge = filled(records.PosedRecord, body=body, translation=poses[0], **own_part, **turn)
    soft = {"sharpness": 1.0 / 3.0, "friction": 0.7, "softness": 1e-9, "radius": 2e-3, "rounding": rounding}
    plane = filled(records.PosedRecord, plane=[0.0, 0.0, 1.0, -2e-3], translation=poses[1], index=1, **soft, **turn)
    pair = (records.PosedRecord * 2)(edge, plane)
    pair.kept = edge.kept  # the array copies addresses alone
    return pair
