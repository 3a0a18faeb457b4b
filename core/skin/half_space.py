"""Closed-form solutions for forces on an elastic half-space with E = 1.

The solutions are those of Boussinesq, Cerruti and Love.

The displacement of pieces of skin is computed by compiled code (`core/kernels/half_space.c`). For a point below the
skin, the surface of the half-space is the tangent plane at the foot of the point, which is the point of the skin above
it.

Source: Johnson, Contact Mechanics, chapter 3; Love, Phil. Trans. A 228 (1929)
"""

from __future__ import annotations

from ctypes import addressof, byref

import numpy as np

from ..arrays import Array, Indices
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .pad_chart import Patches

STRESS_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # xx, yy, zz, yz, xz, xy


def surface_kernel(field: Patches, source: Patches, poisson: float) -> Array:
    """Return the displacement of pieces of skin for unit forces on others.

    It is that of a half-space with E = 1, see `core/kernels/half_space.c`. If field and source are exchanged, the
    result is transposed, up to rounding errors.

    Args:
        field: I pieces whose displacement is computed.
        source: J pieces that carry forces.
        poisson: Poisson's ratio.

    Returns:
        Displacement [1/m], shape (I, 3, J, 3).
    """
    out = np.empty((len(field), 3, len(source), 3))
    both = patches_record(field), patches_record(source)
    pieces = records.PiecesRecord(*map(addressof, both), poisson, address(out))
    kernels().press_pieces(byref(pieces))
    return out


def patches_record(pieces: Patches) -> records.PatchesRecord:
    """Return a record of pieces for the kernels, which keeps the arrays to which it points."""
    arrays = [np.ascontiguousarray(v) for v in (pieces.positions, pieces.normals, pieces.sides, pieces.areas)]
    record = records.PatchesRecord(len(pieces), *map(address, arrays))
    record.kept = arrays
    return record


class Beneath:
    """Displacement and stress at points below the skin for forces on it.

    Young's modulus is 1. The nine components at a point are displacement x, y, z and stress xx, yy, zz, yz, xz, xy.

    Args:
        feet: points of the skin above the points [m], shape (k, 3).
        normals: outward unit normals at the feet, shape (k, 3).
        depths: depths below the skin along the normals [m], above zero, shape (k,).
        poisson: Poisson's ratio.
    """

    def __init__(self, feet: Array, normals: Array, depths: Array, poisson: float) -> None:
        self.feet, self.depths, self.poisson = feet, np.asarray(depths, np.float64), poisson
        inward = -normals
        first = np.cross(np.eye(3)[np.abs(inward).argmin(axis=1)], inward)
        first /= np.sqrt(row_dots(first, first))[:, None]
        self.frames = np.stack([first, np.cross(inward, first), inward], axis=1)
        basis = np.zeros((9, 3, 3))  # stress tensors of unit components
        for n, (i, j) in enumerate(STRESS_PAIRS):
            basis[3 + n, i, j] = basis[3 + n, j, i] = 1.0
        turned = self.frames.transpose(0, 2, 1)[:, None] @ basis @ self.frames[:, None]
        self._turn = np.zeros((len(self.depths), 9, 9))
        self._turn[:, 3:] = np.stack([turned[..., i, j] for i, j in STRESS_PAIRS], axis=1)
        self._turn[:, :3, :3] = self.frames.transpose(0, 2, 1)

    def __len__(self) -> int:
        return len(self.depths)

    def kernel(self, positions: Array) -> Array:
        """Return displacement and stress for unit forces at points of the skin.

        Args:
            positions: points at which the forces act [m], shape (J, 3).

        Returns:
            Displacement [1/m] and stress [1/m^2], shape (k, 9, J, 3).
        """
        probe = np.repeat(np.arange(len(self)), len(positions))
        local = _point_force(self._places(probe, np.tile(positions, (len(self), 1))), self.poisson)
        local = local.reshape(len(self), len(positions), 9, 3) @ self.frames[:, None]
        return (self._turn @ local.transpose(0, 2, 1, 3).reshape(len(self), 9, -1)).reshape(len(self), 9, -1, 3)

    def sum(self, probe: Indices, positions: Array, forces: Array) -> Array:
        """Return displacement and stress, summed over pairs of point and force.

        Args:
            probe: index of the point of each pair, shape (n,).
            positions, forces: position [m] and force [N] of each pair, shape (n, 3) each.

        Returns:
            Displacement for E = 1 Pa [m] and stress [Pa], shape (k, 9).
        """
        local = _point_force(self._places(probe, positions), self.poisson)
        done = (local @ (self.frames[probe] @ forces[:, :, None]))[:, :, 0]
        total = np.stack([np.bincount(probe, column, minlength=len(self)) for column in done.T], axis=1)
        return (self._turn @ total[:, :, None])[:, :, 0]

    def _places(self, probe: Indices, positions: Array) -> Array:
        """Return the points relative to the forces [m], shape (n, 3).

        The axes are those of each point's tangent plane.
        The distance in the plane is the length of the chord from the force to the foot, not that of its projection onto
        the plane. The depth is the point's own.
        """
        chord = self.feet[probe] - positions
        x, y = row_dots(chord, self.frames[probe, 0]), row_dots(chord, self.frames[probe, 1])
        flat = np.hypot(x, y)
        stretch = np.sqrt(row_dots(chord, chord)) / np.where(flat > 0, flat, 1.0)
        return np.stack([x * stretch, y * stretch, self.depths[probe]], axis=1)


def _point_force(place: Array, poisson: float) -> Array:
    """Return displacement and stress for unit forces at the origin.

    The half-space is z > 0, with E = 1.

    Args:
        place: positions in the half-space [m], shape (n, 3).
        poisson: Poisson's ratio.

    Returns:
        Components of displacement [1/m] and stress [1/m^2] for the three unit forces, shape (n, 9, 3).
    """
    x, y, z = place.T
    free = 1.0 - 2.0 * poisson
    r = np.sqrt(x * x + y * y + z * z)
    deep = 1.0 / (r + z)
    cube = 1.0 / r**3
    q = deep / r
    out = np.empty((len(place), 9, 3))
    coordinates = (x, y, z)
    for i in range(3):
        for k in range(3):
            out[:, i, k] = coordinates[i] * coordinates[k] * cube
        out[:, i, i] += 1.0 / r
    for i, a in enumerate((x, y)):
        for k, b in enumerate((x, y)):
            out[:, i, k] -= free * a * b * q * deep
        out[:, i, i] += free * deep
        out[:, i, 2] -= free * a * q
        out[:, 2, i] += free * a * q
    out[:, 2, 2] += free / r
    out[:, :3] *= 1.0 + poisson
    main = -3.0 * cube / r**2
    e, g, h = q * deep, (3.0 * r + z) * (deep * cube * deep * deep), (2.0 * r + z) * deep * deep * cube
    for n, (i, j) in enumerate(STRESS_PAIRS):
        pair = coordinates[i] * coordinates[j]
        for k in range(3):
            out[:, 3 + n, k] = main * pair * coordinates[k]
        if 2 in (i, j):
            continue
        for k in range(2):
            extra = g * pair * coordinates[k]
            if i == j:
                extra += (cube - e) * coordinates[k]
            for one, other in ((i, j), (j, i)):
                if one == k:
                    extra -= e * coordinates[other]
            out[:, 3 + n, k] += free * extra
        out[:, 3 + n, 2] += free * (h * pair + ((z * cube - q) if i == j else 0.0))
    return out / (2.0 * np.pi)


def row_dots(a: Array, b: Array) -> Array:
    """Return the dot products of rows, shape (n,)."""
    return np.einsum("ij,ij->i", a, b)
