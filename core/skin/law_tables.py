"""LawTables: the neo-Hookean law on the mesh that a skin is solved on, with what its stiffness at rest makes of forces.

Forces F on the pad of tissue at E = 1 displace it by u = K^-1 F - c, with K the stiffness at rest; the law holds where
K^-1 R(u) = K^-1 F, R the forces that hold u. c is what stiffening takes: the nodes give way by so much less than linear
tissue's. What a touch keeps of it is its part on the pad, from which the rest is found again.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import Array, Floats32
from ..recent import Recent
from .assembly import degrees, stiffness
from .material import Elastic
from .mesh import TetraMesh
from .mesh_law import MeshLaw
from .relaxation import Relaxation
from .rest_factor import RestFactor

if TYPE_CHECKING:
    from scipy.sparse import csr_array

KEPT = 8  # states whose displacement is kept: what is shown is asked for where contact was solved
TOLERANCE, STEPS = 2e-3, 80  # of what is left where a state is found again, and the steps towards it


class Miss(NamedTuple):
    """How far a displacement is from what the law has for its forces.

    Attributes:
        way: by which c is to change, at rest's stiffness, and pull: the forces of that, shapes (3 free,).
        left: the energy of both, root of its share of the forces' own.
    """

    way: Floats32
    pull: Floats32
    left: float


class LawTables:
    """The law of one mesh; all vectors are of its free nodes, x, y, z each, at E = 1, in single precision.

    Args:
        mesh: the tissue. poisson: ratio.
        response: tells `SkinModel.unit_response`.
    """

    def __init__(self, mesh: TetraMesh, poisson: float, response: Callable[[], Floats32]) -> None:
        self.mesh, self.law = mesh, MeshLaw(mesh, poisson)
        self._poisson, self._response = poisson, response
        self._free = degrees(mesh.free)
        self.pad = np.searchsorted(self._free, degrees(mesh.pad))  # of a vector
        self._inner = np.setdiff1d(np.arange(len(self._free)), self.pad)
        self._states: Recent[bytes, Floats32] = Recent(KEPT)
        # pad nodes that carried force last, their degrees and rows of the response
        self._touched: tuple[Any, ...] = np.zeros(0, bool), np.zeros(0, np.int64), np.zeros((0, len(self._free)))

    @property
    def size(self) -> int:
        """Length of a vector."""
        return len(self._free)

    def pulled(self, force: Floats32) -> Floats32:
        """Return how forces on the pad nodes displace linear tissue, shapes (3 m,) to (3 free,)."""
        touched = force.reshape(-1, 3).any(axis=1)
        if 2 * np.count_nonzero(touched) >= len(self.mesh.pad):
            return np.asarray(force @ self._response())
        if not np.array_equal(touched, self._touched[0]):  # what touches seldom changes from look to look
            rows = degrees(np.flatnonzero(touched))
            self._touched = touched, rows, self._response()[rows]
        _, rows, response = self._touched
        return np.asarray(force[rows] @ response)

    def miss(self, moved: Floats32, pulled: Floats32, force: Floats32) -> Miss:
        """Return what a displacement is off under forces on the pad.

        Args:
            moved: u, shape (3 free,). pulled: of the forces, as `pulled` says. force: on the pad nodes, shape (3 m,).
        """
        pull = self.forces(moved)
        way = self._rest.solve(pull) - pulled
        pull[self.pad] -= force
        own = abs(float(pulled[self.pad] @ force))
        return Miss(way, pull, (abs(float(way @ pull)) / max(own, 1e-30)) ** 0.5)

    def forces(self, moved: Floats32) -> Floats32:
        """Return R: the forces that hold a displacement, shapes (3 free,) to (3 free,)."""
        return self.law.forces(self.nodes(moved)).reshape(-1)[self._free]

    def nodes(self, moved: Floats32) -> Floats32:
        """Return the displacement of all nodes, shape (n, 3)."""
        out = np.zeros(self.mesh.nodes.size, np.float32)
        out[self._free] = moved
        return out.reshape(-1, 3)

    def remember(self, force: Floats32, beyond: Floats32, moved: Floats32) -> None:
        """Keep the displacement of a state, see `state`; light forces of all kinds share the c that is none at all."""
        key = force.tobytes() + beyond.tobytes()
        self._states.pop(key, None)
        self._states.make(key, lambda: moved)

    def state(self, force: Floats32, beyond: Floats32) -> Floats32:
        """Return the displacement under forces on the pad that gives way by so much less, (3 m,) each to (3 free,)."""
        return self._states.make(force.tobytes() + beyond.tobytes(), lambda: self._held(force, beyond))

    def _held(self, force: Floats32, beyond: Floats32) -> Floats32:
        """Find what is beneath a pad that is held where it lies."""
        start = self.pulled(force)
        start[self.pad] -= beyond
        if len(self._inner):
            start[self._inner] -= self._beneath.solve((self._matrix @ start)[self._inner])  # linear tissue beneath it
        return self.held(start)[0]

    def held(self, start: Floats32, tolerance: float | None = None) -> tuple[Floats32, float]:
        """Return the displacement by the law of tissue whose pad stays where it lies, and what is left of its balance.

        Args:
            start: a displacement with this pad, shape (3 free,). tolerance: of what is left, see `Miss.left`.
        """
        held, out = start[self.pad], start.copy()
        if not held.any() or not len(self._inner):
            return out if held.any() else np.zeros_like(out), 0.0

        def miss(inner: Floats32) -> tuple[Floats32, Floats32, float]:
            out[self._inner] = inner
            forces = self.forces(out)
            pull = -forces[self._inner]
            way = self._beneath.solve(pull)
            own = abs(float(forces[self.pad] @ held))
            return way, pull, (abs(float(way @ pull)) / max(own, 1e-30)) ** 0.5

        out[self._inner], left = _relaxed(out[self._inner], miss, TOLERANCE if tolerance is None else tolerance)
        return out, left

    def loaded(self, force: Floats32) -> Floats32:
        """Return by how much less a pad gives way to forces that nothing else is known of, shapes (3 m,) to (3 m,).

        Under dead loads tissue may be unstable: then it is what came nearest to a balance.
        """
        pulled = self.pulled(force)
        if not force.any():
            return np.zeros_like(force)

        def miss(beyond: Floats32) -> tuple[Floats32, Floats32, float]:
            return self.miss(pulled - beyond, pulled, force)

        beyond, _ = _relaxed(np.zeros_like(pulled), miss, TOLERANCE)
        self.remember(force, beyond[self.pad], pulled - beyond)
        return beyond[self.pad]

    def stress(self, moved: Floats32) -> Array:
        """Return the Cauchy stress of the elements, shape (e, 6)."""
        return self.law.stress(self.nodes(moved))

    def energy(self, moved: Floats32) -> float:
        """Return the strain energy."""
        return self.law.energy(self.nodes(moved))

    @cached_property
    def _rest(self) -> RestFactor:
        return RestFactor(self._stiffness, np.searchsorted(self.mesh.free, self.mesh.pad))

    @cached_property
    def _beneath(self) -> RestFactor:
        inner = self._stiffness[self._inner][:, self._inner].tocsr()
        nodes = np.setdiff1d(self.mesh.free, self.mesh.pad)
        return RestFactor(inner, np.array([len(nodes) - 1]))

    @cached_property
    def _matrix(self) -> csr_array:
        return self._stiffness.astype(np.float32)

    @cached_property
    def _stiffness(self) -> csr_array:
        return stiffness(self.mesh, Elastic(1.0, self._poisson, 1.0), "anp")[self._free][:, self._free].tocsr()


def _relaxed(
    x: Floats32, miss: Callable[[Floats32], tuple[Floats32, Floats32, float]], tolerance: float
) -> tuple[Floats32, float]:
    """Return where little is left, or the least that was found, and what that is."""
    steps = Relaxation()
    with np.errstate(over="ignore", invalid="ignore"):  # of a step too far, which is taken back
        for _ in range(STEPS):
            way, pull, left = miss(x)
            following = steps.next(x, way, pull, left)
            if left <= tolerance or steps.lost:
                break
            x = following
    assert steps.best is not None
    return steps.best
