"""MeshLaw: neo-Hookean law of tissue with E = 1 on a mesh.

Compiled code computes forces, stress and energy. The strain energy is
W = sum_e V_e mu/2 (I1 - 3 - 2 ln J_e) + sum_a V_a lambda/2 (ln J_a)^2, where J_a is the volume average of J around node
a. It is evaluated in single precision in a fraction of a millisecond. The kernel uses the gradient H of the
displacement, F = 1 + H. In J - 1 = tr H + ... no large numbers cancel, so that small deformations are as accurate as
large ones. `tests/exact/neo_hookean.py` has the same law in double precision, with its tangent.
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

# Below this J, ln J is continued by its second-order expansion. An element that a step would invert is then stiff, and
# its forces are finite.
FLATTEST = 0.06


class MeshLaw:
    """Neo-Hookean law on a mesh.

    For a displacement that is not finite, forces and stress are not finite either.

    Args:
        mesh: mesh of the tissue at rest.
        poisson: Poisson's ratio.
    """

    def __init__(self, mesh: TetraMesh, poisson: float) -> None:
        self.mesh = mesh
        self._lame = lame(1.0, poisson)

    def forces(self, displacement: Floats32) -> Floats32:
        """Return the forces for a displacement at E = 1 Pa [N], shape (n, 3).

        Args:
            displacement: displacement of the nodes [m], shape (n, 3).
        """
        out = np.empty(self.mesh.nodes.shape, np.float32)
        self._evaluate(displacement, force=address(out))
        return out

    def stress(self, displacement: Floats32) -> Array:
        """Return the Cauchy stress of the elements at E = 1 Pa [Pa], shape (e, 6).

        The stress is mu (b - 1) / J + p, with the columns xx, yy, zz, yz, xz, xy.
        """
        out = np.empty((len(self.mesh.tetrahedra), 6))
        self._evaluate(displacement, stress=address(out))
        return out

    def energy(self, displacement: Floats32) -> float:
        """Return the strain energy at E = 1 Pa [J]."""
        return float(self._evaluate(displacement, stored=1).energy)

    def flattest(self, displacement: Floats32) -> float:
        """Return the smallest J of all elements."""
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
        kernels().law(byref(record))
        return record

    @cached_property
    def tables(self) -> tuple[NDArray[Any], ...]:
        """Corners, gradients, volumes and nodal volumes for the kernel.

        Their layout is that of `kernels.h`.
        """
        mesh = self.mesh
        around = np.bincount(mesh.tetrahedra.ravel(), np.repeat(mesh.volumes, 4), minlength=len(mesh.nodes))
        slopes = geometry(mesh).gradients[:, 1:].reshape(-1, 9)
        volumes = _blocks(mesh.volumes[:, None].astype(np.float32))
        volumes[-1, :, (len(slopes) - 1) % records.LANES + 1 :] = 0.0
        corners, slopes = _blocks(mesh.tetrahedra.astype(np.int32)), _blocks(slopes.astype(np.float32))
        return corners, slopes, volumes, around.astype(np.float32)


def _blocks(values: NDArray[Any]) -> NDArray[Any]:
    """Return values of elements in blocks, shape (blocks, k, lanes).

    Copies of the last element fill the last block.

    Args:
        values: values of the elements, shape (e, k).
    """
    count, width = values.shape
    filled = np.minimum(np.arange(-(-count // records.LANES) * records.LANES), count - 1)
    return np.ascontiguousarray(values[filled].reshape(-1, records.LANES, width).transpose(0, 2, 1))
