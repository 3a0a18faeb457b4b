"""The kernels called without `TriangleTree`: with any library, and any arrays."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.arrays import Array, Indices
from core.kernels import building, records
from core.surface import shapes
from core.surface.gap import Surface
from core.surface.triangles import TriangleTable


def address(array: Array) -> int:
    """Return where an array begins."""
    return int(array.ctypes.data)


@dataclass
class Arrays:
    """The arrays of a tree and a query; the library gets every change that is made before a call."""

    table: TriangleTable
    points: Array
    limit: float = np.inf
    hints: Indices | None = None

    def __post_init__(self) -> None:
        self.order = np.flatnonzero(self.table.usable)
        self.count, n = self.order.size, len(self.points)
        blocks = -(-self.count // records.LANES)
        self.depth = next(k for k in range(16) if blocks >> 2 * k <= 2)
        self.packed = np.full((self.count, records.ROW), np.nan)
        self.boxes = np.full(((4**self.depth - 1) // 3 + blocks, records.BOXES), np.nan, dtype=np.float32)
        self.found = {
            "triangle": np.full(n, -7),
            "weights": np.full((n, 3), np.nan),
            "closest": np.full((n, 3), np.nan),
            "square": np.full(n, np.nan),
            "feature": np.full(n, -7, dtype=np.int8),
        }

    def records(self) -> tuple[records.TreeRecord, records.QueryRecord]:
        """Return the records of a call; they hold addresses only."""
        table = self.table
        tree = records.TreeRecord(total=table.usable.size, count=self.count, depth=self.depth)
        for name, array in (("rows", table.rows), ("bounds", table.bounds), ("order", self.order)):
            setattr(tree, name, address(array))
        tree.packed, tree.boxes = address(self.packed), address(self.boxes)
        if table.slivers is not None:
            tree.slivers = address(table.slivers)
        query = records.QueryRecord(ctypes.addressof(tree), len(self.points), self.limit, address(self.points))
        if self.hints is not None:
            query.hints = address(self.hints)
        for name, array in self.found.items():
            setattr(query, name, address(array))
        return tree, query

    def call(self, library: ctypes.CDLL) -> list[int]:
        """Return the statuses of split, fit, and both searches; the tree's answers stay."""
        tree, query = self.records()
        statuses = [library.dermis_tree_split(ctypes.byref(tree)), library.dermis_tree_fit(ctypes.byref(tree))]
        if not any(statuses):
            statuses.append(library.dermis_closest_of_all(ctypes.byref(query)))
            statuses.append(library.dermis_closest(ctypes.byref(query)))
        return statuses

    def answer(self) -> bytes:
        """Return everything that a call has filled."""
        return b"".join(array.tobytes() for array in (self.order, self.packed, self.boxes, *self.found.values()))


def drawn(seed: int) -> Arrays:
    """Return triangles and points of all sizes, with slivers, triangles without area and points on triangles."""
    rng = np.random.default_rng(seed)
    kind, count = seed % 4, int(rng.integers(1, 200))
    if kind == 0:
        vertices, triangles = shapes.sphere(5e-3, int(rng.integers(20, 900)))
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
    table = TriangleTable.build(vertices, triangles)
    some = triangles[rng.integers(0, len(triangles), 40)]
    weights = np.concatenate(
        [rng.dirichlet(np.ones(3), 20), np.eye(3)[rng.integers(0, 3, 10)], np.full((10, 3), [0.5, 0.5, 0.0])]
    )
    on = np.einsum("nc,nci->ni", weights, vertices[some])
    size = float(np.ptp(vertices, axis=0).max())
    away = vertices.mean(axis=0) + rng.normal(size=(60, 3)) * size * 10.0 ** rng.uniform(-6, 3, (60, 1))
    points = np.ascontiguousarray(np.concatenate([on, away]))
    limit = np.inf if seed % 3 else size * 10.0 ** float(rng.uniform(-3, 0))
    hints = rng.integers(-1, len(triangles), len(points)) if seed % 2 else None
    return Arrays(table, points, limit, hints)


def opened(path: Path) -> ctypes.CDLL:
    """Load a library of kernels as it is."""
    library = ctypes.CDLL(str(path))
    for name in ("dermis_tree_split", "dermis_tree_fit", "dermis_closest", "dermis_closest_of_all"):
        getattr(library, name).argtypes = (ctypes.c_void_p,)
    return library


def gcc(out: Path, *flags: str) -> list[str]:
    """Return the command by which gcc makes a library of the sources."""
    files = [str(path) for path in building.sources() if path.suffix == ".c"]
    return ["gcc", *building.FLAGS, "-fPIC", building.defined(), *flags, "-o", str(out), *files]
