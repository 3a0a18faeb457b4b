"""StiffTables: what a skin's stiffening is on the mesh that it is solved on, from what its shape has."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..errors import Finding
from ..stiffening.balance import balanced
from ..stiffening.stiffening import Stiffening
from .displaced import displaced_stress, linear_pressure
from .material import Elastic
from .mesh import TetraMesh
from .shape import FingertipShape
from .stress import StressOperator, locate


class StiffTables:
    """Patterns of displacement and fields of stress on a mesh, at E = 1.

    Args:
        stiffening: of the skin's shape. mesh: of that shape, at any level.
        unit_compliance: of its pad at E = 1 [1/m], shape (3 m, 3 m). response: tells `SkinModel.unit_response`.
        poisson: ratio.
    """

    def __init__(
        self,
        stiffening: Stiffening,
        mesh: TetraMesh,
        unit_compliance: Array,
        response: Callable[[], NDArray[np.float32]],
        poisson: float,
    ) -> None:
        self.stiffening, self.mesh, self.poisson = stiffening, mesh, poisson
        self._compliance, self._response = unit_compliance, response
        self._last: tuple[Array, Array, Array] | None = None

    @cached_property
    def bound(self) -> Array:
        """What the patterns store in linear tissue, twice: one on the mesh that they were made on, shape (k, k)."""
        return np.asarray(self.loads.T @ self.pad)

    def balanced(self, work: Array) -> Array:
        """Return how much there is of each pattern under forces, from their work, shape (k,)."""
        return balanced(self.stiffening.energy, work)

    def held(self, force: Array, beyond: Array) -> Array:
        """Return how much there is of each pattern where a pad lies, which the law has found, shape (k,).

        Args:
            force: on the pad nodes over E, shape (3 m,). beyond: by how much less than linear skin they give way [m],
                shape (3 m,).
        """
        return np.asarray(self.pad.T @ force - self.loads.T @ beyond)

    @property
    def pad(self) -> Array:
        """The patterns at the pad nodes, shape (3 m, k)."""
        return self._pad[0]

    @property
    def loads(self) -> Array:
        """Forces on the pad nodes that displace them by the patterns in linear tissue, shape (3 m, k)."""
        return self._pad[1]

    @cached_property
    def _pad(self) -> tuple[Array, Array]:
        """Return the patterns and their loads; what a coarse mesh holds for stiffer than it is, is made smaller.

        Where a pattern stored more than one, skin that stiffens much would give way against what presses it.
        """
        from scipy.linalg import cho_factor, cho_solve

        found = self.stiffening.patterns.at(self.mesh.nodes[self.mesh.pad])
        pad = found.reshape(len(self._compliance), -1).astype(np.float64)
        loads = np.asarray(cho_solve(cho_factor(self._compliance), pad))
        values, vectors = np.linalg.eigh(loads.T @ pad)
        share = (vectors / np.sqrt(np.maximum(values, 1.0))) @ vectors.T
        return pad @ share, loads @ share

    @cached_property
    def _nodes(self) -> Floats32:
        """The patterns at all nodes, with what is beneath the pad free to follow, shape (k, 3 n): read in rows."""
        out = np.zeros((len(self.mesh.nodes), 3, self.stiffening.count), np.float32)
        moved = self._response().T @ self.loads.astype(np.float32)
        out[self.mesh.free] = moved.reshape(-1, 3, self.stiffening.count)
        out[self.mesh.pad] = self.pad.reshape(-1, 3, self.stiffening.count)
        return np.ascontiguousarray(out.reshape(-1, self.stiffening.count).T)

    @cached_property
    def elements(self) -> Floats32:
        """Fields of stress in the elements, shape (6 e, r)."""
        series = self.stiffening.stress
        fields = series.fields
        if not (_same(self.mesh.tetrahedra, series.tetrahedra) and _same(self.mesh.nodes, series.nodes)):
            fields = self._read(self.mesh.nodes, self.stiffening.stress.nodal)[self.mesh.tetrahedra].mean(axis=1)
        return np.ascontiguousarray(fields.reshape(6 * len(self.mesh.tetrahedra), -1))

    @cached_property
    def following(self) -> Floats32 | None:
        """How tissue follows beyond linear tissue, fields at the nodes, shape (r, 4 n); None where it is not known."""
        known = self.stiffening.following
        if known is None:
            return None
        fields = self._read(self.mesh.nodes, known.fields)
        fields[self.mesh.pad, :3] = 0.0  # the pad is held in the patterns
        fields[self.mesh.fixed, :3] = 0.0
        return np.ascontiguousarray(fields.reshape(4 * len(fields), -1).T)

    def beyond(self, q: Array) -> Array:
        """Return the stress of the elements beyond that of the same forces on linear tissue, at E = 1, shape (e, 6).

        Args:
            q: how much of each pattern there is, shape (k,).
        """
        stress, held = self.felt(q)
        return stress - self._unit.stress(held)

    def felt(self, q: Array) -> tuple[Array, Array]:
        """Return the stress of tissue displaced by patterns, and how far the forces of that move linear tissue.

        Beyond the reach of the series both grow no faster than q.

        Args:
            q: how much there is of each pattern, shape (k,).

        Returns:
            stress of the elements at E = 1, shape (e, 6), and displacement of the nodes [m], shape (n, 3).
        """
        energy = self.stiffening.energy
        far = energy.far(q)
        if far > 1.0:
            stress, held = self.felt(q / (far * (1.0 + 1e-12)))
            return far * stress, far * held
        moved, taken = self.moved(q)
        held = moved + taken
        fields, known = self.following, self.stiffening.following
        if fields is None or known is None:
            beyond = (self.elements @ self.stiffening.stress.amounts(q).astype(np.float32)).astype(float).reshape(-1, 6)
            return self._unit.stress(held) + beyond, held
        more = (known.amounts(q).astype(np.float32) @ fields).astype(np.float64).reshape(-1, 4)
        pressure = linear_pressure(self._unit, moved) + more[:, 3]
        return displaced_stress(self._unit, moved + more[:, :3], pressure), held

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Return the displacement of all nodes in the patterns, and what n(q) takes off linear tissue's, (n, 3) [m].

        For no price where q is that of the last time.
        """
        if self._last is None or not np.array_equal(self._last[0], q):
            amounts = np.stack([q, self.stiffening.energy.force(q)])
            both = (amounts.astype(np.float32) @ self._nodes).astype(np.float64).reshape(2, -1, 3)
            self._last = q.copy(), both[0], both[1]
        return self._last[1:]

    @cached_property
    def _unit(self) -> StressOperator:
        return StressOperator(self.mesh, Elastic(1.0, self.poisson, 1.0))

    def _read(self, points: Array, nodal: Floats32) -> Floats32:
        """Return fields of the series' nodes at points, shapes (n, c, r) to (p, c, r)."""
        series = self.stiffening.stress
        if _same(points, series.nodes):
            return nodal.copy()
        from scipy.spatial import cKDTree

        none = np.zeros(0, np.int32)
        mesh = TetraMesh(series.nodes, series.tetrahedra.astype(np.int32), none, none, np.zeros((0, 3), np.int32))
        element, weights = locate(mesh, points)
        out = np.einsum("pj,pjcr->pcr", weights.astype(np.float32), nodal[series.tetrahedra[element]])
        outside = np.flatnonzero(element < 0)
        if len(outside):
            out[outside] = nodal[cKDTree(series.nodes).query(points[outside])[1]]
        return np.asarray(out, np.float32)


def no_series(shape: FingertipShape | None, name: str) -> Finding:
    """Return why devices are matched on linear skin, whose touch was felt by tissue that stiffens.

    Args:
        shape: of the skin; None of a mesh of one's own. name: the finger's.
    """
    if shape is None:
        why, remedy = "a mesh of one's own has no table of it", "Use a fingertip of lengths"
    else:
        why = "these lengths, or this Poisson's ratio, have no table of it yet"
        remedy = "Let Blender make it, which takes some two minutes once, or use a preset's lengths"
    what = "devices are matched on linear skin: what tissue does beyond it is felt, and not rendered"
    return Finding("warning", "matched-linear", what, name, why, remedy=remedy)


def _same(first: NDArray[np.number], second: NDArray[np.number]) -> bool:
    """Return whether arrays are the same but for rounding."""
    return first.shape == second.shape and np.allclose(first, second, rtol=0.0, atol=1e-9)
