"""MeshLaw: the forces of neo-Hookean tissue at E = 1, node by node, compiled, in a fraction of a millisecond.

W = sum_e V_e mu/2 (I1 - 3 - 2 ln J_e) + sum_a V_a lambda/2 (ln J_a)^2, J_a the volume average of J around node a, in
single precision. It is told in the gradient H of displacement, F = 1 + H: of J - 1 = tr H + ... no large numbers
cancel, so that a light touch is as right as a deep one. `tests/exact/neo_hookean.py` has the same law in double
precision, with its tangent.
"""

from __future__ import annotations

from ctypes import byref
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .assembly import geometry
from .material import lame
from .mesh import TetraMesh

# Below it ln J goes on as its parabola: an element that a step would turn inside out is hard, and its force is finite.
FLATTEST = 0.06


class MeshLaw:
    """The law on a mesh.

    A displacement that is not finite has forces and stress that are not finite either.

    Args:
        mesh: the tissue at rest. poisson: ratio.
    """

    def __init__(self, mesh: TetraMesh, poisson: float) -> None:
        self.mesh = mesh
        self._lame = lame(1.0, poisson)

    def forces(self, displacement: Floats32) -> Floats32:
        """Return the forces that hold a displacement of the nodes [m], shapes (n, 3) to (n, 3)."""
        out = np.empty(self.mesh.nodes.shape, np.float32)
        self._evaluate(displacement, force=address(out))
        return out

    def stress(self, displacement: Floats32) -> Array:
        """Return the Cauchy stress mu (b - 1) / J + p of the elements, xx, yy, zz, yz, xz, xy, shape (e, 6)."""
        out = np.empty((len(self.mesh.tetrahedra), 6))
        self._evaluate(displacement, stress=address(out))
        return out

    def energy(self, displacement: Floats32) -> float:
        """Return the strain energy."""
        return float(self._evaluate(displacement, stored=1).energy)

    def flattest(self, displacement: Floats32) -> float:
        """Return the least J of the elements."""
        return float(self._evaluate(displacement).flattest)

    def _evaluate(self, displacement: Floats32, **wanted: int) -> records.LawRecord:
        moved = np.ascontiguousarray(displacement, np.float32)
        if moved.shape != self.mesh.nodes.shape:
            raise DermisError("a displacement does not fit the mesh", where="skin", value=moved.shape)
        corners, slopes, volumes, around = self.tables
        room = np.empty(9 * volumes.size + 8 * len(around), np.float32)
        record = records.LawRecord(
            len(around),
            len(self.mesh.tetrahedra),
            *map(address, (corners, slopes, volumes, around)),
            *self._lame,
            FLATTEST,
            address(moved),
            address(room),
            **wanted,
        )
        status = kernels().law(byref(record))
        if status != records.DONE:
            raise DermisError("a record for the kernels is damaged", where=kernels().path.name, value=status)
        return record

    @cached_property
    def tables(self) -> tuple[NDArray[Any], ...]:
        """Corners, slopes, volumes and the volume around each node, as `kernels.h` wants them."""
        mesh = self.mesh
        around = np.bincount(mesh.tetrahedra.ravel(), np.repeat(mesh.volumes, 4), minlength=len(mesh.nodes))
        slopes = geometry(mesh).gradients[:, 1:].reshape(-1, 9)
        volumes = _blocks(mesh.volumes[:, None].astype(np.float32))
        volumes[-1, :, (len(slopes) - 1) % records.LANES + 1 :] = 0.0
        corners, slopes = _blocks(mesh.tetrahedra.astype(np.int32)), _blocks(slopes.astype(np.float32))
        return corners, slopes, volumes, around.astype(np.float32)


def _blocks(values: NDArray[Any]) -> NDArray[Any]:
    """Return values of the elements in blocks, the last filled up with copies, shape (e, k) to (blocks, k, lanes)."""
    count, width = values.shape
    filled = np.minimum(np.arange(-(-count // records.LANES) * records.LANES), count - 1)
    return np.ascontiguousarray(values[filled].reshape(-1, records.LANES, width).transpose(0, 2, 1))
