"""The kernels called without `KernelBody`: with any library, and any arrays."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.arrays import Array, Indices
from core.kernels import building, records
from core.surface import shapes
from core.surface.gap import DIRECTIONS, Surface
from core.surface.topology import Topology
from core.surface.triangles import TriangleTable

FUNCTIONS = (
    "dermis_tree_split",
    "dermis_tree_fit",
    "dermis_body_fit",
    "dermis_body_judge",
    "dermis_distances",
    "dermis_sweep",
)

GIVEN = "compliance", "offset", "normals", "friction", "softness", "force"  # of a contact


def address(array: Array) -> int:
    """Return where an array begins."""
    return int(array.ctypes.data)


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

    def call(self, library: ctypes.CDLL) -> list[int]:
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
        return statuses

    def measure(self, library: ctypes.CDLL, packed: bool) -> int:
        """Return the status of distances alone, by a tree that was made before, or without."""
        tree, _, query = self.records(packed)
        if packed and library.dermis_tree_fit(ctypes.byref(tree)):
            raise AssertionError
        return int(library.dermis_distances(ctypes.byref(query)))

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        arrays = self.order, self.packed, self.boxes, self.normals, *self.found.values()
        return b"".join(array.tobytes() for array in arrays) + bytes([self.by_rays])


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

    def call(self, own: ctypes.CDLL, **changed: float) -> list[int]:
        """Return the status, with fields of the record changed; force, image, residual and sweeps stay."""
        n = len(self.force)
        given, step = self.nodes.size, self.compliance.itemsize
        few = given < n
        room = np.full((9 * records.KEPT + 12 + few * (14 + (9 * given * step + 7) // 8)) * given + few, np.nan)
        self.image = np.full((n, 3), np.nan)
        self.record = record = records.ContactRecord(
            n,
            self.compliance.dtype == np.float32,
            self.compliance.strides[0] // self.compliance.itemsize,
            *(address(getattr(self, name)) for name in GIVEN[:5]),
            self.tolerance,
            self.most,
            address(self.force),
            address(self.image),
            given,
            address(self.nodes),
            address(room),
        )
        for name, value in changed.items():
            setattr(record, name, value)
        return [int(own.dermis_sweep(ctypes.byref(record)))]

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        told = np.array([self.record.residual, self.record.sweeps])
        return self.force.tobytes() + self.image.tobytes() + told.tobytes()


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


def opened(path: Path) -> ctypes.CDLL:
    """Load a library of kernels as it is."""
    library = ctypes.CDLL(str(path))
    for name in FUNCTIONS:
        getattr(library, name).argtypes = (ctypes.c_void_p,)
    return library


def gcc(out: Path, *flags: str) -> list[str]:
    """Return the command by which gcc makes a library of the sources, and of others among the flags."""
    files = [str(path) for path in building.sources() if path.suffix == ".c"]
    return ["gcc", *building.FLAGS, "-fPIC", building.defined(), *flags, "-o", str(out), *files]
