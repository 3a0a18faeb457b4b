"""LawTables: neo-Hookean law of a skin's mesh, and solutions by this law.

Forces F on the pad displace tissue with E = 1 by u = K^-1 F - c. K is the stiffness at rest. The correction c is the
displacement of linear tissue minus that of neo-Hookean tissue. The law holds if K^-1 R(u) = K^-1 F, where R(u) are the
forces that hold the displacement u. The record of a touch has only the part of c on the pad, from which u is computed
again.
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

KEPT = 8  # number of states whose displacement is kept, so that results of solved contact can be shown at once
TOLERANCE, STEPS = 2e-3, 80  # residual at which an iteration ends, see `Miss.left`; largest number of its steps
# Step of the difference quotient in `LawTables.stiffened`, as a share of the displacement. The error of a product is
# then about 1e-4: the truncation grows with the square of the step, and the rounding of single precision with its
# inverse.
QUOTIENT = 3e-3


class Miss(NamedTuple):
    """Residual of the law for a displacement and its forces.

    Attributes:
        way: basic step of c, computed with the stiffness at rest, K^-1 (R(u) - F), shape (3 free,).
        pull: forces of this step, R(u) - F, shape (3 free,).
        left: residual relative to the forces, in the norm of the energy: square root of |way . pull| / |K^-1 F . F|.
    """

    way: Floats32
    pull: Floats32
    left: float


class LawTables:
    """Neo-Hookean law on one mesh.

    Vectors contain x, y and z of each free node, shape (3 free,), or of each pad node, shape (3 m,). They are in single
    precision. Displacements are in metres and forces in newtons for E = 1 Pa.

    Args:
        mesh: mesh of the tissue.
        poisson: Poisson's ratio.
        response: function that returns `SkinModel.unit_response`.

    Attributes:
        pad: indices of the pad's components in a vector of the free nodes, shape (3 m,).
    """

    def __init__(self, mesh: TetraMesh, poisson: float, response: Callable[[], Floats32]) -> None:
        self.mesh, self.law = mesh, MeshLaw(mesh, poisson)
        self._poisson, self._response = poisson, response
        self._free = degrees(mesh.free)
        self.pad = np.searchsorted(self._free, degrees(mesh.pad))
        self._inner = np.setdiff1d(np.arange(len(self._free)), self.pad)
        self._states: Recent[bytes, Floats32] = Recent(KEPT)
        # Pad nodes that carried force at the last call, their degrees of freedom, and their rows of the response.
        self._touched: tuple[Any, ...] = np.zeros(0, bool), np.zeros(0, np.int64), np.zeros((0, len(self._free)))

    @property
    def size(self) -> int:
        """Length of a vector of the free nodes."""
        return len(self._free)

    def pulled(self, force: Floats32) -> Floats32:
        """Return the displacement of linear tissue, K^-1 F, shape (3 free,).

        Args:
            force: forces F on the pad nodes, shape (3 m,).
        """
        touched = force.reshape(-1, 3).any(axis=1)
        if 2 * np.count_nonzero(touched) >= len(self.mesh.pad):
            return np.asarray(force @ self._response())
        if not np.array_equal(touched, self._touched[0]):  # the loaded nodes rarely change between calls
            rows = degrees(np.flatnonzero(touched))
            self._touched = touched, rows, self._response()[rows]
        _, rows, response = self._touched
        return np.asarray(force[rows] @ response)

    def miss(self, moved: Floats32, pulled: Floats32, force: Floats32) -> Miss:
        """Return the residual of the law.

        Args:
            moved: displacement u, shape (3 free,).
            pulled: displacement of linear tissue for the same forces, see `pulled`, shape (3 free,).
            force: forces F on the pad nodes, shape (3 m,).
        """
        pull = self.forces(moved)
        way = self._rest.solve(pull) - pulled
        pull[self.pad] -= force
        own = abs(float(pulled[self.pad] @ force))
        return Miss(way, pull, (abs(float(way @ pull)) / max(own, 1e-30)) ** 0.5)

    def forces(self, moved: Floats32) -> Floats32:
        """Return R(u), the forces that hold a displacement, shape (3 free,)."""
        return self.law.forces(self.nodes(moved)).reshape(-1)[self._free]

    def yielded(self, force: Floats32) -> Floats32:
        """Return the displacement of linear tissue K^-1 F, shape (3 free,), for forces on all free nodes."""
        return self._rest.solve(force)

    def stiffened(self, moved: Floats32, way: Floats32) -> Floats32:
        """Return the product of the tangent stiffness dR/du and a direction, shape (3 free,).

        It is a central difference of R(u).

        Args:
            moved: displacement u, not zero everywhere, shape (3 free,).
            way: direction, not zero everywhere, shape (3 free,).
        """
        size = np.float32(QUOTIENT * np.linalg.norm(moved) / np.linalg.norm(way))
        return np.asarray((self.forces(moved + size * way) - self.forces(moved - size * way)) / (2 * size))

    def nodes(self, moved: Floats32) -> Floats32:
        """Return the displacement of all nodes, shape (n, 3).

        Args:
            moved: displacement of the free nodes, shape (3 free,).
        """
        out = np.zeros(self.mesh.nodes.size, np.float32)
        out[self._free] = moved
        return out.reshape(-1, 3)

    def remember(self, force: Floats32, beyond: Floats32, moved: Floats32) -> None:
        """Keep the displacement of a state for `state`.

        Args:
            force: forces on the pad nodes, shape (3 m,).
            beyond: correction c at the pad nodes, shape (3 m,). It does not identify a state, because it is 0 for all
                light forces; therefore the forces are needed as well.
            moved: displacement, shape (3 free,).
        """
        key = force.tobytes() + beyond.tobytes()
        self._states.pop(key, None)
        self._states.make(key, lambda: moved)

    def state(self, force: Floats32, beyond: Floats32) -> Floats32:
        """Return the displacement of a state, shape (3 free,).

        It is computed unless `remember` has kept it.

        Args:
            force: forces on the pad nodes, shape (3 m,).
            beyond: correction c at the pad nodes, shape (3 m,).
        """
        return self._states.make(force.tobytes() + beyond.tobytes(), lambda: self._held(force, beyond))

    def _held(self, force: Floats32, beyond: Floats32) -> Floats32:
        """Compute the displacement, shape (3 free,), from that of the pad, K^-1 F - c."""
        start = self.pulled(force)
        start[self.pad] -= beyond
        if len(self._inner):
            start[self._inner] -= self._beneath.solve((self._matrix @ start)[self._inner])  # as in linear tissue
        return self.held(start)[0]

    def held(self, start: Floats32) -> tuple[Floats32, float]:
        """Return the equilibrium for a fixed displacement of the pad.

        Args:
            start: initial displacement, whose part on the pad stays as it is, shape (3 free,).

        Returns:
            Displacement, shape (3 free,), and its residual.
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

        out[self._inner], left = _relaxed(out[self._inner], miss)
        return out, left

    def loaded(self, force: Floats32) -> Floats32:
        """Return the correction c at the pad nodes, shape (3 m,), for forces.

        Tissue may have no stable equilibrium under constant forces. The result is then that of the iterate with the
        least residual.

        Args:
            force: forces on the pad nodes, shape (3 m,).
        """
        pulled = self.pulled(force)
        if not force.any():
            return np.zeros_like(force)

        def miss(beyond: Floats32) -> tuple[Floats32, Floats32, float]:
            return self.miss(pulled - beyond, pulled, force)

        beyond, _ = _relaxed(np.zeros_like(pulled), miss)
        self.remember(force, beyond[self.pad], pulled - beyond)
        return beyond[self.pad]

    def stress(self, moved: Floats32) -> Array:
        """Return the Cauchy stress of the elements for E = 1 Pa [Pa], shape (e, 6).

        The components are xx, yy, zz, yz, xz, xy.
        """
        return self.law.stress(self.nodes(moved))

    def energy(self, moved: Floats32) -> float:
        """Return the strain energy for E = 1 Pa [J]."""
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


def _relaxed(x: Floats32, miss: Callable[[Floats32], tuple[Floats32, Floats32, float]]) -> tuple[Floats32, float]:
    """Iterate to `TOLERANCE`; return the best iterate and its residual.

    Args:
        x: iterate to start from.
        miss: function that returns the basic step, its forces and the residual of an iterate, see `Relaxation.next`.
    """
    steps = Relaxation()
    with np.errstate(over="ignore", invalid="ignore"):  # a step may be too long, and is then undone
        for _ in range(STEPS):
            way, pull, left = miss(x)
            following = steps.next(x, way, pull, left)
            if left <= TOLERANCE or steps.lost:
                break
            x = following
    assert steps.best is not None
    return steps.best
