"""Tissue, and a skin that is drawn, for the kernels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array
from core.kernels import records
from core.skin.assembly import degrees, stiffness
from core.skin.material import Elastic
from core.skin.mesh_law import MeshLaw
from core.skin.rest_factor import RestFactor
from tests.problems import cube_mesh

from .case import Case, filled


@dataclass(eq=False)
class Law(Case):
    """The arrays of the law on a mesh."""

    corners: NDArray[np.int32]
    slopes: NDArray[np.float32]
    volumes: NDArray[np.float32]
    around: NDArray[np.float32]
    moved: NDArray[np.float32]
    elements: int
    results = "energy", "flattest"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.around)
        self.force, self.stress = np.full((n, 3), np.nan, np.float32), np.full((self.elements, 6), np.nan)
        room = np.full(9 * self.volumes.size + 8 * n, np.nan, np.float32)
        record = filled(records.LawRecord, self, nodes=n, first=8.0, shear=0.34, least=0.06, room=room, stored=1)
        yield self._call(own.dermis_evaluate_law, record, **changed)


def drawn_law(seed: int) -> Law:
    """Return a block of tissue that is hardly moved, much, or inside out."""
    rng = np.random.default_rng(seed)
    mesh = cube_mesh(int(rng.integers(1, 5)), 10.0 ** rng.uniform(-4, 1), 0.1)
    law = MeshLaw(mesh, 0.45)
    size = 10.0 ** rng.uniform(-12, 1) * float(np.ptp(mesh.nodes, axis=0).max())
    moved = (rng.normal(size=mesh.nodes.shape) * size).astype(np.float32)
    return Law(*(table.copy() for table in law.tables), moved, len(mesh.tetrahedra))


@dataclass(eq=False)
class Rest(Case):
    """The arrays of linear tissue and forces on it."""

    factor: RestFactor
    force: NDArray[np.float32]

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        arrays = {name.lstrip("_"): array for name, array in vars(self.factor).items() if isinstance(array, np.ndarray)}
        numbers = {"size": self.factor.size, "levels": len(arrays["starts"]) - 1}
        numbers |= {"numbers": arrays["inverses"].size, "couplings": arrays["values"].size}
        room, moved = (np.full(size, np.nan, np.float32) for size in (3 * self.factor.slots, self.force.size))
        record = filled(records.RestRecord, self, **arrays, **numbers, room=room, moved=moved)
        yield self._call(own.dermis_rest_solve, record, **changed)


def drawn_rest(seed: int) -> Rest:
    """Return a block of tissue that is held below, and forces on all of its nodes."""
    rng = np.random.default_rng(seed)
    mesh = cube_mesh(int(rng.integers(2, 6)), 10.0 ** rng.uniform(-3, 0), 0.1)
    free = degrees(mesh.free)
    matrix = stiffness(mesh, Elastic(1.0, 0.48, 1.0))[free][:, free].tocsr()
    force = (rng.normal(size=len(free)) * 10.0 ** rng.uniform(-20, 5)).astype(np.float32)
    return Rest(RestFactor(matrix, np.searchsorted(mesh.free, mesh.pad)), force)


@dataclass(eq=False)
class DrawnSkin(Case):
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
    normal_force, modulus, exaggeration, lift = 2.0, 3e4, 1.5, 2e-3
    results = "low", "high", "centre", "shear"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        nodes, drawn = len(self.points), len(self.rest)
        self.moved, self.values = (a.copy() for a in self.given)
        self.positions, self.normals, self.shown = (np.full((drawn, k), np.nan) for k in (3, 3, 1))
        numbers = {"nodes": nodes, "triangles": len(self.corners), "drawn": drawn}
        numbers |= {"entries": len(self.columns), "pad": len(self.force)}
        work = {"sums": np.full((nodes, 9), np.nan, np.float32), "room": np.full((nodes, 8), np.nan)}
        record = filled(records.DrawnRecord, self, **numbers, **work)
        yield self._call(own.dermis_draw_skin, record, **changed)


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
