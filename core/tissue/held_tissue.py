"""HeldTissue: linear tissue at E = 1, its pad loaded or held, as series and energies ask for it."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Indices
from ..skin.assembly import degrees
from .neo_hookean import NeoHookean

if TYPE_CHECKING:
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import SuperLU


class HeldTissue:
    """The linearisation of tissue at rest.

    Args:
        tissue: on a mesh with a pad.
    """

    def __init__(self, tissue: NeoHookean) -> None:
        self.tissue, mesh = tissue, tissue.mesh
        self._free = degrees(mesh.free)
        self.beneath = degrees(np.setdiff1d(mesh.free, mesh.pad))
        self.pad = degrees(mesh.pad)

    def moved(self, loads: Array) -> Array:
        """Return the displacement of all nodes for loads on the pad, shapes (3 m, b) to (b, n, 3)."""
        forces = np.zeros((3 * len(self.tissue.mesh.nodes), loads.shape[1]))
        forces[self.pad] = loads
        out = np.zeros((loads.shape[1], len(forces)))
        out[:, self._free] = self._loaded.solve(forces[self._free]).T
        return out.reshape(len(out), -1, 3)

    def followed(self, pad: Array) -> Array:
        """Return the displacement of all nodes for one of the pad, shapes (3 m, b) to (b, n, 3)."""
        out = np.zeros((pad.shape[1], 3 * len(self.tissue.mesh.nodes)))
        out[:, self.pad] = pad.T
        coupling = self._stiffness[self.beneath][:, self.pad]
        out[:, self.beneath] = self.held(np.ascontiguousarray(-(coupling @ pad))).T
        return out.reshape(len(out), -1, 3)

    def followed_forces(self, forces: Array) -> Array:
        """Return what forces beneath a pad that is held do, those on the pad left out, to (b, n, 3)."""
        flat = forces.reshape(len(forces), -1)
        out = np.zeros_like(flat)
        out[:, self.beneath] = self.held(np.ascontiguousarray(flat[:, self.beneath].T)).T
        return out.reshape(forces.shape)

    def held(self, forces: Array) -> Array:
        """Return what forces beneath a pad that is held do there, (d, b) to (d, b)."""
        return np.asarray(self._held.solve(forces))

    def second_loads(self, loads: Array) -> Array:
        """Return the forces of the second power on a pad that is held where loads displace it, (b, 3 m) to (b, 3 m).

        They are what skin that stiffens takes beyond linear skin, and where it gives way to them is not where it is
        pressed.
        """
        moved = self.moved(np.ascontiguousarray(loads.T))
        series = np.stack([np.zeros_like(moved), moved, np.zeros_like(moved)])
        left = self.tissue.forces(self.tissue.response(series).piola[2])
        follow = -self.followed_forces(left).reshape(len(loads), -1)
        return np.asarray(left.reshape(len(loads), -1)[:, self.pad] + (self._stiffness[self.pad] @ follow.T).T)

    def free_held(self, forces: Array) -> Array:
        """Return what forces on all free nodes do while the pad is held, as `jets` wants it, (d, b) to (d, b)."""
        inside = np.searchsorted(self._free, self.beneath)
        out = np.zeros_like(forces)
        out[inside] = self.held(np.ascontiguousarray(forces[inside]))
        return out

    @cached_property
    def _stiffness(self) -> csr_array:
        return self.tissue.tangent(np.zeros_like(self.tissue.mesh.nodes))

    @cached_property
    def _loaded(self) -> SuperLU:
        return _factor(self._stiffness, self._free)

    @cached_property
    def _held(self) -> SuperLU:
        return _factor(self._stiffness, self.beneath)


def _factor(stiffness: csr_array, rows: Indices) -> SuperLU:
    from scipy.sparse.linalg import splu

    # symmetric and positive definite: pivots on the diagonal, whose order a symmetric ordering keeps
    part = stiffness[rows][:, rows].tocsc()
    return splu(part, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
