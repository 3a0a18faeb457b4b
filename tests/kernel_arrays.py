"""The kernels called without `KernelBody`: with any library, and any arrays."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array, Indices
from core.kernels import building, records
from core.skin.assembly import degrees, stiffness
from core.skin.material import Elastic
from core.skin.mesh_law import MeshLaw
from core.skin.rest_factor import RestFactor
from core.skin.tiles import Tiles
from core.surface import shapes
from core.surface.gap import DIRECTIONS, Surface
from core.surface.topology import Topology
from core.surface.triangles import TriangleTable
from tests.problems import cube_mesh

GIVEN = "compliance", "offset", "normals", "friction", "softness", "force"  # of a contact


SIZES: dict[int, int] = {}  # bytes of an array, by where it begins: a call in another process sends them there


def address(array: Array) -> int:
    """Return where an array begins, and note how long it is."""
    found = int(array.ctypes.data)
    SIZES[found] = array.nbytes
    return found


@dataclass
class Arrays:
    """The arrays of a body and a query; the library gets every change that is made before a call."""

    vertices: Array
    triangles: Indices
    points: Array
    limit: float = np.inf

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
        self.found = {
            "gap": np.full(n, np.nan),
            "normal": np.full((n, 3), np.nan),
            "closest": np.full((n, 3), np.nan),
            "weights": np.full((n, 3), np.nan),
            "triangle": np.full(n, -7),
            "feature": np.full(n, -7, dtype=np.int8),
            "beside": np.full(n, -7, dtype=np.int8),
        }

    def records(self, packed: bool = True) -> tuple[records.TreeRecord, records.BodyRecord, records.QueryRecord]:
        """Return the records of a call, with a tree or without one; they hold addresses only."""
        table, topology = self.table, self.topology
        tree = records.TreeRecord(total=table.usable.size, count=self.count, depth=self.depth)
        for name, array in (("rows", table.rows), ("bounds", table.bounds), ("order", self.order)):
            setattr(tree, name, address(array))
        if table.slivers is not None:
            tree.slivers = address(table.slivers)
        body = records.BodyRecord(None, ctypes.addressof(tree), ctypes.addressof(tree), len(self.vertices))
        body.closed, body.by_rays = topology.closed, self.by_rays or not packed
        body.parts, body.slabs = len(self.part), len(self.slab)
        if packed:
            tree.packed, tree.boxes, body.normals = address(self.packed), address(self.boxes), address(self.normals)
        else:
            tree.largest = float(np.abs(self.vertices).max())
        for name in ("corners", "across", "edge_kind", "vertex_kind"):
            setattr(body, name, address(getattr(topology, name)))
        body.part, body.slab = address(self.part), address(self.slab)
        query = records.QueryRecord(ctypes.addressof(body), len(self.points), self.limit, address(self.points))
        for name, array in self.found.items():
            setattr(query, name, address(array))
        return tree, body, query

    def call(self, library: Any) -> list[int]:
        """Return the statuses of all functions, of distances without a tree and with one; its answers stay."""
        tree, body, query = self.records()
        statuses = [library.dermis_tree_split(ctypes.byref(tree)), library.dermis_tree_fit(ctypes.byref(tree))]
        if not any(statuses):
            statuses.append(library.dermis_body_fit(ctypes.byref(body)))
        if not any(statuses):
            statuses.append(self.measure(library, packed=False))
            if body.closed:
                statuses.append(library.dermis_body_judge(ctypes.byref(body)))
                self.by_rays = bool(body.by_rays)
            statuses.append(library.dermis_distances(ctypes.byref(query)))
            statuses.append(self.node_gaps(library, body))
        return statuses

    def node_gaps(self, library: Any, body: records.BodyRecord) -> int:
        """Return the status of the gaps of nodes at the points, to the body turned upside down about X; they stay."""
        n = len(self.points)
        pose = np.concatenate([np.diag([1.0, -1.0, -1.0]).ravel(), np.zeros(records.POSE - 9)])
        box = np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])
        places, came = np.ascontiguousarray(self.points * [1.0, -1.0, -1.0]), np.arange(n) % 2
        before = np.tile([0.0, 0.0, 1.0], (n, 1))
        self.told, self.which = np.full((7, n), np.nan), np.full((3, n), -7)
        limit = self.limit if self.limit >= 0.0 else 0.0
        fixed = address(pose), address(box), n, 1, limit, -1.0 if self.by_rays else 1.0, 0.5, 1e-9
        arrays = map(address, (places, places, came, before, self.told, self.which))
        return int(library.dermis_node_gaps(ctypes.byref(records.GapsRecord(ctypes.addressof(body), *fixed, *arrays))))

    def measure(self, library: Any, packed: bool) -> int:
        """Return the status of distances alone, by a tree that was made before, or without."""
        tree, _, query = self.records(packed)
        if packed and library.dermis_tree_fit(ctypes.byref(tree)):
            raise AssertionError
        return int(library.dermis_distances(ctypes.byref(query)))

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        arrays = self.order, self.packed, self.boxes, self.normals, *self.found.values()
        gaps = self.told.tobytes() + self.which.tobytes() if hasattr(self, "told") else b""
        return b"".join(array.tobytes() for array in arrays) + bytes([self.by_rays]) + gaps


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
        vertices, triangles = Surface.edge().vertices, Surface.edge().triangles
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


@dataclass
class Contact:
    """The arrays of a contact; the library gets every change that is made before a call."""

    compliance: Array
    offset: Array
    normals: Array
    friction: Array
    softness: Array
    force: Array
    nodes: Indices
    tolerance: float = 1e-9
    most: int = 60

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed; force, image, residual and sweeps stay."""
        n = len(self.force)
        given, step = self.nodes.size, self.compliance.itemsize
        few = given < n
        room = np.full((9 * records.KEPT + 12 + few * (14 + (9 * given * step + 7) // 8)) * given + few, np.nan)
        self.image, self.moved = np.full((2, n, 3), np.nan)
        self.status = np.full(n, -7, dtype=np.int8)
        self.record = record = records.ContactRecord(
            n,
            self.compliance.dtype == np.float32,
            self.compliance.strides[0] // self.compliance.itemsize,
            0,
            *(address(getattr(self, name)) for name in GIVEN[:5]),
            self.tolerance,
            self.most,
            address(self.force),
            address(self.image),
            address(self.moved),
            address(self.status),
            given,
            address(self.nodes),
            address(room),
        )
        for name, value in changed.items():
            setattr(record, name, value)
        return [int(own.dermis_sweep(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        told = np.array([self.record.residual, self.record.sweeps, self.record.missed])
        return b"".join(array.tobytes() for array in (self.force, self.image, self.moved, self.status, told))


def drawn_contact(seed: int) -> Contact:
    """Return nodes of all kinds: few and many, without friction and with much, soft ones, and some far from all."""
    rng = np.random.default_rng(seed)
    n, scale = int(rng.integers(1, 40)), 10.0 ** rng.uniform(-5, -1)
    basis = rng.normal(size=(3 * n, 6 * n))
    compliance = scale * (basis @ basis.T / (6 * n) + 0.1 * np.eye(3 * n))
    room = np.full((3 * n, 3 * n + int(rng.integers(0, 9))), np.nan)
    room[:, : 3 * n] = compliance
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(n) < 0.1] = 0.0
    offset = rng.normal(size=(n, 3)) * 1e-3 - 5e-4 * normals
    friction = rng.choice([0.0, 0.3, 1.0, 5.0], n)
    softness = np.where(rng.random(n) < 0.3, scale * rng.random(n), 0.0)
    start = rng.normal(size=(n, 3)) * (seed % 2)
    nodes = np.flatnonzero(rng.random(n) < 0.7) if seed % 4 else np.arange(n)
    compliance = room.astype(np.float32) if seed % 3 else room
    return Contact(compliance, offset, normals, friction, softness, start, nodes)


@dataclass(eq=False)
class Survey:
    """The arrays of a pad's survey: square cells on a plane, skin that has moved, an edge and a plane near it."""

    positions: Array
    normals: Array
    sides: Array
    limits: Array
    raised: Array
    load: Array
    table: NDArray[np.float32]
    points: Indices
    longs: Array
    tiles: Tiles
    edge: Surface
    poses: Array
    finest: int

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed."""
        tiles = self.tiles
        cells, roots = len(tiles.root), self.tiles.first[1, 1]
        posed = (records.PosedRecord * 2)()
        for record, (pose, side) in zip(posed, ((self.poses[0], 1.0), (self.poses[1], 1.0)), strict=True):
            record.rotation[:], record.translation[:], record.side = np.eye(3).ravel().tolist(), pose.tolist(), side
        posed[0].body = ctypes.addressof(self.edge.kernel_body.record)
        posed[1].plane[:] = [0.0, 0.0, 1.0, -2e-3]
        squares = 4 ** (tiles.levels - 1)
        owner, in_root = np.full((roots + 1, squares), -1), np.full(roots, -1)
        point = np.full(cells, -1)
        point[self.points] = np.arange(len(self.points))
        owner[tiles.root[self.points]] = point[self.points][:, None]
        in_root[tiles.root[self.points]] = point[self.points]
        self.out, self.clearance = np.zeros((5, 4 * roots), dtype=np.int64), np.zeros(4 * roots)
        fixed = {"first": tiles.first, "ways": tiles.ways, "root": tiles.root, "halved": tiles.halved}
        fixed |= {"place": tiles.place, "quarters": tiles.quarters, "ways_before": np.zeros(cells, dtype=np.int64)}
        fixed |= {"positions": self.positions, "normals": self.normals, "sides": self.sides, "limits": self.limits}
        fixed |= {"longs": self.longs, "owner": owner, "afar": np.full((roots, 3), np.nan)}
        fixed |= {"in_root": in_root, "raised": self.raised, "load": self.load, "table": self.table}
        fixed |= {"rows": np.arange(len(self.load)), "clearance": self.clearance, "room": self.out}
        fixed |= {"leaves": self.out[2], "cuts": self.out[3], "cut_ways": self.out[4]}
        kept = {name: np.ascontiguousarray(array) for name, array in fixed.items()}
        self.record = record = records.SurveyRecord(bodies=2, posed=ctypes.addressof(posed), limit=2.5e-3)
        for name, array in kept.items():
            setattr(record, name, address(array))
        record.roots, record.levels, record.squares, record.points = roots, tiles.levels, squares, len(self.points)
        record.loaded, record.filled = len(self.load), len(self.table)
        record.turned, record.edge, record.sharp, record.bent, record.corners = 0.3, 0.9, 1.5, 0.04e-3, 0.75
        record.beyond, record.beside, record.merge, record.odd, record.level = 0.4e-3, 0.35, 0.6, 0.4, 0.1
        record.deep, record.steep, record.often, record.coarsest = 0.06e-3, 0.3, 2, 1
        record.many, record.most, record.finest = 450, 4 * roots, self.finest
        for name, value in changed.items():
            setattr(record, name, value)
        return [int(own.dermis_find_cells(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has found."""
        told, (_, _, leaves, cuts, ways) = self.record, self.out
        numbers = np.array([told.found, told.cut, told.edges, told.finest])
        found = leaves[: told.found], self.clearance[: told.found], cuts[: told.cut], ways[: told.cut]
        return numbers.tobytes() + b"".join(part.tobytes() for part in found)


def drawn_survey(seed: int) -> Survey:
    """Return a pad of 12 by 12 cells of 0.8 mm, and where skin and bodies are: far off, near and in each other."""
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
    points = np.sort(rng.choice(across**2, 30, replace=False)) if seed % 3 else np.zeros(0, dtype=np.int64)
    poses = rng.uniform(-1.5e-3, 1.5e-3, (2, 3))
    return Survey(
        positions,
        normals,
        sides,
        0.4 * size.max(axis=1) + 0.1e-3,
        0.3e-3 * rng.normal(size=(len(points), 3)),
        0.2e-3 * rng.normal(size=(4, 3)) * (seed % 2),
        rng.normal(size=(4, 3, across**2, 3)).astype(np.float32),
        points,
        size.max(axis=1),
        tiles,
        Surface.edge(),
        poses,
        int(rng.integers(1, 4)),
    )


@dataclass(eq=False)
class Law:
    """The arrays of the law on a mesh; the library gets every change that is made before a call."""

    corners: NDArray[np.int32]
    slopes: NDArray[np.float32]
    volumes: NDArray[np.float32]
    around: NDArray[np.float32]
    moved: NDArray[np.float32]
    elements: int

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed; force, stress, energy and the flattest J stay."""
        n = len(self.around)
        room = np.full(9 * self.volumes.size + 8 * n, np.nan, np.float32)
        self.force, self.stress = np.full((n, 3), np.nan, np.float32), np.full((self.elements, 6), np.nan)
        given = self.corners, self.slopes, self.volumes, self.around
        self.record = record = records.LawRecord(n, self.elements, *map(address, given), 8.0, 0.34, 0.06)
        record.moved, record.room, record.stored = address(self.moved), address(room), 1
        record.force, record.stress = address(self.force), address(self.stress)
        for name, value in changed.items():
            setattr(record, name, value)
        return [int(own.dermis_evaluate_law(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        told = np.array([self.record.energy, self.record.flattest])
        return self.force.tobytes() + self.stress.tobytes() + told.tobytes()


def drawn_law(seed: int) -> Law:
    """Return a block of tissue that is hardly moved, much, or inside out."""
    rng = np.random.default_rng(seed)
    mesh = cube_mesh(int(rng.integers(1, 5)), 10.0 ** rng.uniform(-4, 1), 0.1)
    law = MeshLaw(mesh, 0.45)
    size = 10.0 ** rng.uniform(-12, 1) * float(np.ptp(mesh.nodes, axis=0).max())
    moved = (rng.normal(size=mesh.nodes.shape) * size).astype(np.float32)
    return Law(*(table.copy() for table in law.tables), moved, len(mesh.tetrahedra))


@dataclass(eq=False)
class Rest:
    """The arrays of linear tissue and forces on it; the library gets every change that is made before a call."""

    factor: RestFactor
    force: NDArray[np.float32]

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed; the displacement stays."""
        room = np.full(3 * self.factor.slots, np.nan, np.float32)
        self.moved = np.full(self.force.size, np.nan, np.float32)
        record = self.factor.record(self.force, self.moved, room, address)
        for name, value in changed.items():
            setattr(record, name, value)
        return [int(own.dermis_rest_solve(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        return self.moved.tobytes()


def drawn_rest(seed: int) -> Rest:
    """Return a block of tissue that is held below, and forces on all of its nodes."""
    rng = np.random.default_rng(seed)
    mesh = cube_mesh(int(rng.integers(2, 6)), 10.0 ** rng.uniform(-3, 0), 0.1)
    free = degrees(mesh.free)
    matrix = stiffness(mesh, Elastic(1.0, 0.48, 1.0))[free][:, free].tocsr()
    force = (rng.normal(size=len(free)) * 10.0 ** rng.uniform(-20, 5)).astype(np.float32)
    return Rest(RestFactor(matrix, np.searchsorted(mesh.free, mesh.pad)), force)


@dataclass(eq=False)
class Pieces:
    """Pieces of skin that press each other: far ones, near ones, and each on itself."""

    positions: Array
    normals: Array
    sides: Array
    areas: Array
    single: int

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed."""
        n = len(self.areas)
        arrays = (self.positions, self.normals, self.sides, self.areas)
        field = records.PatchesRecord(n, *(address(array) for array in arrays))
        self.out = np.full((n, 3, n, 3), np.nan, np.float32 if self.single else np.float64)
        both = ctypes.addressof(field), ctypes.addressof(field)
        record = records.PiecesRecord(*both, 0.48, self.single, address(self.out))
        for name, value in changed.items():
            setattr(record, name, value)
        return [int(own.dermis_press_pieces(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        return self.out.tobytes()


def drawn_pieces(seed: int) -> Pieces:
    """Return pieces whose sides differ by up to a hundred times, some at one place."""
    rng, n = np.random.default_rng(seed), 12
    positions = 1e-3 * rng.normal(size=(n, 3))
    positions[1] = positions[0]
    normals = rng.normal(size=(n, 3)) + [0.0, 0.0, 3.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sides = 10.0 ** rng.uniform(-5, -3, (n, 1, 1)) * (np.eye(3)[:2] + 0.1 * rng.normal(size=(n, 2, 3)))
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return Pieces(positions, normals, np.ascontiguousarray(sides), areas, seed % 2)


@dataclass(eq=False)
class Points:
    """Points of a grid of 6 by 6 roots that others were before."""

    tiles: Tiles
    around: Indices
    before: Indices
    cells: Indices

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed."""
        tiles, side = self.tiles, 1 << (self.tiles.levels - 1)
        roots = len(self.around)
        self.owner, self.in_root = np.full((roots + 1, side * side), -1), np.full(roots, -1)
        self.number, self.beside = np.full(tiles.count, -1), np.full((len(self.cells), 4), -9)
        record = records.PointsRecord(known=tiles.count, side=side, before=0, count=len(self.before))
        arrays = {"root": tiles.root, "halved": tiles.halved, "place": tiles.place, "around": self.around}
        arrays |= {"owner": self.owner, "in_root": self.in_root, "number": self.number, "old_cells": self.before}
        first = np.zeros((len(self.before), 4), dtype=np.int64)
        for name, array in {**arrays, "cells": self.before, "beside": first}.items():
            setattr(record, name, address(array))
        statuses = [int(own.dermis_number_points(ctypes.byref(record)))]
        record.before, record.count = len(self.before), len(self.cells)
        record.cells, record.beside = address(self.cells), address(self.beside)
        for name, value in changed.items():
            setattr(record, name, value)
        return [*statuses, int(own.dermis_number_points(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        return b"".join(array.tobytes() for array in (self.owner, self.in_root, self.number, self.beside))


def drawn_points(seed: int) -> Points:
    """Return points of all sizes that do not overlap, and others that they take the place of."""
    rng, across = np.random.default_rng(seed), 6
    tiles = Tiles(np.cumsum([0, *(across**2 * 4**k for k in range(4))]).tolist())
    grid = np.full((across + 2, across + 2), across**2)
    grid[1:-1, 1:-1] = np.arange(across**2).reshape(across, across)
    around = np.stack([grid[i : i + across, j : j + across].ravel() for i in range(3) for j in range(3)], axis=1)

    def some() -> Indices:
        chosen = []
        for root in rng.permutation(across**2)[:20]:
            kinds = np.flatnonzero(tiles.root == root)
            halved = tiles.halved[kinds]
            kind = halved[rng.integers(0, len(kinds))]
            cells = kinds[(halved == kind).all(axis=1)]
            chosen.append(rng.permutation(cells)[: 1 + len(cells) // 2])
        return np.concatenate(chosen)

    return Points(tiles, np.ascontiguousarray(around.reshape(-1, 3, 3)), some(), some())


@dataclass(eq=False)
class DrawnSkin:
    """A surface of random triangles, the matrix that refines it, and forces on a pad."""

    points: Array
    corners: NDArray[np.int32]
    rest: Array
    starts: NDArray[np.int32]
    columns: NDArray[np.int32]
    weights: Array
    pad_positions: Array
    pad_normals: Array
    force: Array
    table: NDArray[np.float32] | None
    quantity: int
    given: tuple[Array, Array]

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed."""
        nodes, drawn = len(self.points), len(self.rest)
        self.moved, self.values = (a.copy() for a in self.given)
        self.sums, self.room = np.full((nodes, 9), np.nan, np.float32), np.full((nodes, 8), np.nan)
        self.positions, self.normals, self.shown = (np.full((drawn, k), np.nan) for k in (3, 3, 1))
        self.record = record = records.DrawnRecord(nodes=nodes, triangles=len(self.corners), drawn=drawn)
        record.entries, record.pad, record.quantity = len(self.columns), len(self.force), self.quantity
        record.normal_force, record.modulus, record.exaggeration, record.lift = 2.0, 3e4, 1.5, 2e-3
        record.table = None if self.table is None else address(self.table)
        for name in ("points", "corners", "rest", "starts", "columns", "weights", "pad_positions", "pad_normals"):
            setattr(record, name, address(getattr(self, name)))
        for name in ("force", "moved", "values", "sums", "room", "positions", "normals", "shown"):
            setattr(record, name, address(getattr(self, name)))
        for name, value in changed.items():
            setattr(record, name, value)
        return [int(own.dermis_draw_skin(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        told = np.array([self.record.low, self.record.high, *self.record.centre, *self.record.shear])
        filled = (self.moved, self.values, self.positions, self.normals, self.shown, told)
        return b"".join(array.tobytes() for array in filled)


def drawn_skin(seed: int) -> DrawnSkin:
    """Return a skin with or without a table, of which every quantity occurs; the first has no force."""
    rng = np.random.default_rng(seed)
    nodes, drawn, pad = int(rng.integers(3, 40)), int(rng.integers(1, 90)), int(rng.integers(1, 20))
    starts = np.concatenate([[0], np.cumsum(rng.integers(0, 9, drawn))]).astype(np.int32)
    columns = rng.integers(0, nodes, starts[-1]).astype(np.int32)
    normals = rng.normal(size=(pad, 3))
    force = rng.normal(size=(pad, 3)) * (rng.random((pad, 1)) < 0.6) * 10.0 ** rng.uniform(-20, 5)
    return DrawnSkin(
        1e-3 * rng.normal(size=(nodes, 3)),
        rng.integers(0, nodes, (int(rng.integers(1, 60)), 3)).astype(np.int32),
        1e-3 * rng.normal(size=(drawn, 3)),
        starts,
        columns,
        rng.normal(size=len(columns)),
        1e-3 * rng.normal(size=(pad, 3)),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        force * (seed > 0),
        rng.normal(size=(3 * pad, 9 * nodes)).astype(np.float32) if seed % 3 else None,
        seed % 9 - 1,
        (1e-3 * rng.normal(size=(nodes, 3)), rng.normal(size=nodes)),
    )


def opened(path: Path) -> ctypes.CDLL:
    """Load a library of kernels as it is."""
    library = ctypes.CDLL(str(path))
    for name in records.HEADER.functions:
        getattr(library, name).argtypes = (ctypes.c_void_p,)
    return library


def gcc(out: Path, *flags: str) -> list[str]:
    """Return the command by which gcc makes a library of the sources, and of others among the flags."""
    made = out.with_name("described.c")
    made.write_text(building.described())
    files = [str(path) for path in (*building.sources(), made) if path.suffix == ".c"]
    return ["gcc", *building.FLAGS, "-fPIC", f"-I{building.FOLDER}", *flags, "-o", str(out), *files]


@dataclass(eq=False)
class Friction:
    """The friction history of some nodes, and a frame; the library gets every change that is made before a call."""

    arrays: dict[str, Array]

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the statuses of all functions, with fields of the record changed; all results stay in the arrays."""
        arrays, n = self.arrays, len(self.arrays["gap"])
        self.record = record = records.FrictionRecord(n, len(arrays["poses"]), radius=1e-3, share=0.7)
        record.drift[:], record.passed[:] = [1e-4, -2e-4, 0.0], [2e-4, 1e-4, 1e-5]
        record.entered = len(arrays["entering"])
        for name in (field[0] for field in records.FrictionRecord._fields_):
            if name in arrays:
                setattr(record, name, address(arrays[name]))
        for name, value in changed.items():
            setattr(record, name, value)
        calls = own.dermis_expect, own.dermis_offset, own.dermis_foresee, own.dermis_keep, own.dermis_drift
        statuses = [int(call(ctypes.byref(record))) for call in calls]
        names = "points", "force", "facing", "moved", "image", "gaps", "status"
        self.sums = records.SumsRecord(n, n % 2, *(address(arrays[name]) for name in names))
        return [*statuses, int(own.dermis_sum(ctypes.byref(self.sums)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        sums = [getattr(self.sums, name) for name in ("normal", "tangential", "depth", "slide", "sticking", "slipping")]
        told = [*self.record.drift, *self.record.passed, self.record.shifted, self.record.slides, *sums]
        return b"".join(array.tobytes() for array in self.arrays.values()) + np.array(told).tobytes()


def drawn_friction(seed: int) -> Friction:
    """Return nodes that stick, slip and are off three bodies, of which one is stretched and one may be away."""
    rng = np.random.default_rng(seed)
    n, scale = int(rng.integers(1, 60)), 10.0 ** rng.uniform(-5, -2)
    poses = np.zeros((3, records.POSE))
    for k, row in enumerate(poses):
        carry = np.eye(3) + (k == 1) * 0.2 * rng.normal(size=(3, 3))
        row[:9], row[9:12] = np.linalg.qr(rng.normal(size=(3, 3)))[0].ravel(), scale * rng.normal(size=3)
        row[12:21], row[21:30] = carry.ravel(), np.linalg.inv(carry).ravel()
    poses[2, 30] = seed % 2
    owner, below = rng.integers(-1, 2 + seed % 3 // 2, (2, n))
    below[: n // 2] = owner[: n // 2]
    facing = rng.normal(size=(n, 3))
    facing /= np.linalg.norm(facing, axis=1)[:, None]
    force = np.where(rng.random((n, 1)) < 0.7, facing + 0.3 * rng.normal(size=(n, 3)), 0.0)
    arrays: dict[str, Array] = {"poses": poses, "owner": owner, "below": below, "facing": facing, "force": force}
    for name in ("material", "normal", "slip", "swept", "points", "image", "moved", "offset"):
        arrays[name] = scale * rng.normal(size=(n, 3))
    for name in ("anchors", "normals", "places", "origins", "sweeping", "shift", "positions", "crossing"):
        arrays[name] = scale * rng.normal(size=(n, 3))
    for name in ("gap", "gaps", "own", "soft", "friction"):
        arrays[name] = scale * rng.random(n) - (name == "gaps") * scale / 2
    for name in ("triangle", "faces", "nodes"):
        arrays[name] = rng.integers(0, 99, n)
    arrays["corners"], arrays["entering"] = rng.integers(0, 99, (n, 3)), rng.permutation(n)[: n // 4]
    for name in ("sticking", "loaded", "renewed"):
        arrays[name] = rng.integers(0, 2, n).astype(np.uint8)
    arrays["status"] = rng.integers(0, 3, n).astype(np.int8)
    return Friction(arrays)


@dataclass(eq=False)
class Pressed:
    """A disc that presses on points of skin, and the step after it; the library gets every change before a call."""

    positions: Array
    places: Array
    anchors: Array
    anchored: NDArray[np.bool_]
    sticking: NDArray[np.bool_]
    near: Indices
    compliance: Array
    less: Array | None
    pose: Array
    told: Array
    friction: float
    weight: float
    freedoms: int

    def call(self, own: Any, **changed: float) -> list[int]:
        """Return the statuses of both functions, with fields of the first record changed; their answers stay."""
        points, n, free = len(self.positions), len(self.near), self.freedoms
        rows = (3 * self.near[:, None] + np.arange(3)).ravel()
        part = np.ascontiguousarray(self.compliance[np.ix_(rows, rows)])
        self.gap, self.answers = np.full(points, np.nan), np.full((n, 3, 1 + free), np.nan)
        self.moved, self.offset, self.status = np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.full(n, 7, np.int8)
        room, indices = np.full((60 + 3 * free + 18 * n) * n, np.nan), np.full(8 * n, 2**62)
        self.record = record = records.DiscRecord(points=points, radius=4e-3, rounding=1e-3, margin=1e-4)
        record.friction, record.weight, record.tolerance, record.most = self.friction, self.weight, 1e-9, 10
        record.freedoms, record.turning, record.count = free, 2 if free == 3 else free, n
        record.leading = self.told.shape[2] - 1
        given = {"positions": self.positions, "places": self.places, "anchors": self.anchors, "told": self.told}
        given |= {"anchored": self.anchored, "sticking": self.sticking, "near": self.near, "compliance": part}
        given |= {"pose": self.pose, "room": room, "indices": indices, "gap": self.gap, "answer": self.answers}
        given |= {"moved": self.moved, "offset": self.offset, "status": self.status}
        for name, array in given.items():
            setattr(record, name, address(array))
        if self.less is not None:
            record.less = address(self.less)
        for name, value in changed.items():
            setattr(record, name, value)
        statuses = [int(own.dermis_press_disc(ctypes.byref(record)))]
        if statuses[0] or record.strays:
            return statuses
        self.after = np.full((points, 3), np.nan), np.full((points, 3), np.nan), np.full((points, 2), np.nan)
        self.sticks = np.full(points, 7, np.uint8)
        step = records.SettledRecord(points=points, count=n, width=1 + free)
        fixed = {"positions": self.positions, "anchors": self.anchors, "anchored": self.anchored, "near": self.near}
        fixed |= {"compliance": self.compliance, "pose": self.pose, "answer": self.answers, "status": self.status}
        fixed |= dict(zip(("moved", "force", "anchor"), self.after, strict=True)) | {"sticks": self.sticks}
        for name, array in fixed.items():
            setattr(step, name, address(array))
        if self.less is not None:
            step.less = address(self.less)
        return [*statuses, int(own.dermis_settle_disc(ctypes.byref(step)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        record = self.record
        told = np.array([record.residual, record.steps, record.strays, record.touching])
        if record.strays:
            return self.gap.tobytes() + told[2:3].tobytes()
        arrays = self.gap, self.answers, self.moved, self.offset, self.status, *self.after, self.sticks
        return b"".join(array.tobytes() for array in arrays) + told.tobytes()


def drawn_pressed(seed: int) -> Pressed:
    """Return a bowl of skin and a disc: above it, touching or deep, with and without friction, anchors and history."""
    rng = np.random.default_rng(seed)
    points, free = int(rng.integers(4, 40)), 6 if seed % 3 == 0 else 3
    flat = rng.uniform(-6e-3, 6e-3, (points, 2))
    positions = np.column_stack([flat, 12.0 * (flat**2).sum(axis=1)])
    places = positions + 1e-4 * rng.normal(size=(points, 3))
    reach = np.linalg.norm(positions[:, None] - positions, axis=2)
    spread = np.exp(-((reach / 3e-3) ** 2)) + 0.2 * np.eye(points)
    compliance = np.ascontiguousarray(np.kron(spread, np.diag([1.0, 1.2, 0.8]))) * 1e-3
    anchored = rng.random(points) < 0.8 if seed % 2 else np.zeros(points, np.bool_)
    sticking = anchored & (rng.random(points) < 0.5)
    anchors = np.where(anchored[:, None], flat + 1e-4 * rng.normal(size=(points, 2)), 0.0)
    turn = np.linalg.qr(np.eye(3) + 0.1 * rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.diag(turn))
    centre = np.array([*(5e-4 * rng.normal(size=2)), float(rng.choice([-1e-3, 2e-4, 1e-3]))])
    spin, shift = rng.normal(size=(free, 3)), rng.normal(size=(3, free))
    if free == 3:
        spin[2] = 0.0
    pose = np.concatenate([turn.ravel(), centre, spin.ravel(), shift.ravel(), 1e-5 * rng.normal(size=free)])
    near = np.arange(points) if seed % 5 else np.flatnonzero(rng.random(points) < 0.9)
    told = 0.01 * rng.normal(size=(len(near), 3, 1 + free * (seed % 2)))
    less = 1e-5 * rng.normal(size=(points, 3)) if seed % 4 == 0 else None
    friction, weight = float(rng.choice([0.0, 0.4, 1.0])), 1.0 / float(np.median(np.diag(compliance)))
    fixed = positions, places, anchors, anchored, sticking, near, compliance, less, pose, told
    return Pressed(*fixed, friction, weight, free)
