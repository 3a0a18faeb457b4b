"""Remainder: compliance of a fingertip minus that of a half-space.

Near a force, skin moves as the surface of a half-space does, for which there is a closed form (`half_space`). Far from
the force, the displacement depends on bone, nail and shape. The difference between skin and half-space is smooth, so
few functions of the position represent it. Their coefficients are fitted once to the condensed compliance of a fine
mesh. The fit uses pairs of nodes that are far enough apart for the mesh to be accurate.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..errors import DermisError
from ..files import write_npz
from ..npz import opened_npz
from .half_space import Beneath, surface_kernel
from .pad_chart import PadChart, Patches

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from .condense import Condensed
    from .mesh import TetraMesh

LENGTH = 4e-3  # length l of the Gaussians exp(-r^2 / 2 l^2) [m], similar to that over which the remainder changes
CENTRES = 96  # number of Gaussians; each function is a linear combination of them
RANK = 50  # number of functions for the remainder on the skin
LOW_RANK = 30  # number of functions for the remainder below the skin: the smoothest of the `RANK`
FAR = 1.5e-3  # distance of two nodes above which the mesh is accurate [m]
ROUNDS = 12  # number of rounds of the fit; each replaces the values for pairs nearer than `FAR` by those of the fit
DEPTHS = (0.6e-3, 1.2e-3, 2.0e-3, 3.0e-3)  # depths below the skin at which the fine mesh is evaluated [m]
DEGREE = 2  # degree of the polynomial in the depth
PROBES = 160  # largest number of points at each depth
STEPS = 1 + ROUNDS + len(DEPTHS)  # number of progress steps of a fit; the first is the condensation
_AT_ONCE = 200  # number of rows of large tables that are computed together


@dataclass(frozen=True, eq=False)
class Remainder:
    """Displacement and stress for forces on skin, minus a half-space's.

    Both are for E = 1.

    Attributes:
        centres: centres of Gaussians of the length `LENGTH` [m], shape (c, 3).
        mixing: coefficients of the Gaussians in each function phi, the smoothest function first, shape (c, rank).
        surface: matrix D [1/m], symmetric, shape (rank, 3, rank, 3). A force f_j at point j displaces the skin at point
            i by phi_i D phi_j' f_j, where phi_i are the functions at point i.
        beneath: displacement [1/m] and stress [1/m^2] below the skin as a polynomial of the depth in mm, shape (powers,
            low, 9, low, 3). The axes are the power of the depth, the function at the foot, the component (displacement
            x, y, z and stress xx, yy, zz, yz, xz, xy), the function at the force, and the component of the force.
    """

    centres: Array
    mixing: Array
    surface: Floats32
    beneath: Floats32

    @property
    def rank(self) -> int:
        """Number of functions on the skin."""
        return self.mixing.shape[1]

    def functions(self, positions: Array) -> Floats32:
        """Return the functions phi at points of the skin, shape (n, rank).

        Args:
            positions: the points [m], shape (n, 3).
        """
        return (_gaussians(positions, self.centres) @ self.mixing).astype(np.float32)

    def below(self, phi_feet: Floats32, depths: Array, moments: Array) -> Array:
        """Return the remainder of displacement and stress below the skin.

        Args:
            phi_feet: functions at the feet of the points, shape (k, rank).
            depths: depths of the points [m], shape (k,).
            moments: for each function, sum of the forces weighted with it, phi' f [N], shape (rank, 3).

        Returns:
            Displacement for E = 1 Pa [m] and stress [Pa], shape (k, 9), see `beneath`.
        """
        low = self.beneath.shape[1]
        fields_ = np.einsum("pkclb,lb->pkc", self.beneath, moments[:low])
        powers = (depths[:, None] * 1e3) ** np.arange(len(self.beneath))
        return np.einsum("np,nk,pkc->nc", powers, phi_feet[:, :low], fields_)

    def write(self, path: Path) -> None:
        """Write the remainder to an .npz file."""
        write_npz(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def read(cls, path: Path) -> Remainder:
        """Read a remainder from a file that `write` wrote.

        Raises:
            DermisError: the file cannot be read, or its arrays do not fit together.
        """
        with opened_npz(path) as archive:
            found = archive.arrays(field.name for field in fields(cls))
        centres, mixing, surface, beneath = found.values()
        rank = mixing.shape[-1]
        low = beneath.shape[1] if beneath.ndim == 5 else -1
        fits = centres.shape == (mixing.shape[0], 3) and surface.shape == (rank, 3, rank, 3)
        fits = fits and beneath.shape[1:] == (low, 9, low, 3) and 0 < low <= rank
        if not fits or any(a.dtype.kind != "f" or not np.isfinite(a).all() for a in found.values()):
            raise DermisError("a remainder's arrays do not fit", where=str(path), value=mixing.shape)
        return cls(centres, mixing, surface, beneath)


def fit_remainder(
    chart: PadChart, mesh: TetraMesh, condensed: Condensed, poisson: float
) -> Generator[tuple[int, int], None, Remainder]:
    """Fit the remainder of a fingertip to its compliance on a fine mesh.

    Args:
        chart: chart of the fingertip.
        mesh: fine mesh of the same fingertip.
        condensed: condensation of the mesh for E = 1, with the response.
        poisson: Poisson's ratio.

    Yields:
        Number of finished steps, which begins at 1 since the condensation is done, and `STEPS`.

    Returns:
        The remainder.
    """
    places, _ = chart.project(mesh.nodes[mesh.pad])
    skin = chart.surface(places)
    skin = Patches(skin.positions, skin.normals, 1e-6 * skin.sides, 1e-12 * skin.areas)  # almost points
    centres = _spread(chart.cells.positions[chart.base], CENTRES)
    left, scale, right = np.linalg.svd(_gaussians(skin.positions, centres), full_matrices=False)
    rank = min(RANK, len(scale))
    phi, mixing = left[:, :rank], right[:rank].T / scale[:rank]
    near = _near(skin.positions, skin.positions)
    rest = np.asarray(condensed.compliance, np.float32).reshape(len(skin), 3, len(skin), 3).copy()
    for start in range(0, len(skin), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        rest[part] -= surface_kernel(skin.take(part), skin, poisson).astype(np.float32)
    i, j = np.nonzero(near)
    rest[i, :, j, :] = 0.0
    phi32 = phi.astype(np.float32)
    for done in range(ROUNDS):
        yield 1 + done, STEPS
        half = np.tensordot(phi32, rest, axes=(0, 0))  # rank, 3, n, 3
        surface = np.tensordot(half, phi32, axes=(2, 0)).transpose(0, 1, 3, 2)
        spread = np.tensordot(phi32, surface, axes=(1, 0))  # n, 3, rank, 3
        for k in range(3):
            for m in range(3):
                rest[i, k, j, m] = np.einsum("nl,nl->n", spread[i, k, :, m], phi32[j])
    surface = 0.5 * (surface + surface.transpose(2, 3, 0, 1))
    beneath = yield from _fit_beneath(mesh, condensed, skin, phi[:, : min(LOW_RANK, rank)], poisson)
    return Remainder(centres, mixing, np.ascontiguousarray(surface, np.float32), beneath)


def _fit_beneath(
    mesh: TetraMesh, condensed: Condensed, skin: Patches, phi: Array, poisson: float
) -> Generator[tuple[int, int], None, Floats32]:
    """Fit the remainder below the skin.

    It is fitted at each of the `DEPTHS`, and then a polynomial in the depth is fitted to the results.

    Args:
        mesh: fine mesh.
        condensed: condensation of the mesh for E = 1, with the response.
        skin: pieces of skin at the pad nodes.
        phi: functions at the pad nodes, shape (m, low).
        poisson: Poisson's ratio.

    Returns:
        `Remainder.beneath`.
    """
    from .stress import locate

    response = condensed.response
    assert response is not None
    low, feet = phi.shape[1], np.arange(0, len(skin), 1 + len(skin) // PROBES)
    outer, near = phi[feet], _near(skin.positions[feet], skin.positions)
    at_depth = []
    for done, depth in enumerate(DEPTHS):
        yield 1 + ROUNDS + done, STEPS
        element, weights = locate(mesh, skin.positions[feet] - depth * skin.normals[feet])
        inside = np.flatnonzero(element >= 0)
        reading = _reading(mesh, element[inside], weights[inside], poisson)
        seen = np.concatenate(
            [reading @ np.ascontiguousarray(response[s : s + 600].T) for s in range(0, len(response), 600)], axis=1
        ).reshape(len(inside), 9, len(skin), 3)
        known = np.empty((len(inside), 9, low, 3))
        for n, probe in enumerate(inside):
            foot = feet[[probe]]
            plane = Beneath(skin.positions[foot], skin.normals[foot], np.array([depth]), poisson)
            far = ~near[probe]
            rest = seen[n][:, far] - plane.kernel(skin.positions[far])[0]
            gram = phi[far].T @ phi[far] + 1e-3 * np.eye(low)
            right = np.einsum("jl,cjb->lcb", phi[far], rest).reshape(low, -1)
            known[n] = np.linalg.solve(gram, right).reshape(low, 9, 3).transpose(1, 0, 2)
        flat = np.linalg.lstsq(outer[inside], known.reshape(len(inside), -1), rcond=None)[0]
        at_depth.append(flat.reshape(low, 9, low, 3))
    powers = (np.array(DEPTHS)[:, None] * 1e3) ** np.arange(DEGREE + 1)
    return np.tensordot(np.linalg.pinv(powers), np.stack(at_depth), axes=1).astype(np.float32)


def _reading(mesh: TetraMesh, element: NDArray[Any], weights: Array, poisson: float) -> csr_array:
    """Return the matrix from nodal displacement to values at points.

    The nodes are the free ones. The values are displacement and stress for E = 1, nine rows for each point, as in
    `Beneath`. The stress of the elements is averaged at the nodes, and interpolated between them.

    Args:
        mesh: mesh of the tissue.
        element: index of the element that contains each point, shape (k,).
        weights: barycentric coordinates of each point in its element, shape (k, 4).
        poisson: Poisson's ratio.
    """
    from scipy.sparse import csr_array as csr
    from scipy.sparse import eye_array, kron, vstack

    from .assembly import degrees
    from .material import Elastic
    from .stress import StressOperator

    count = len(element)
    starts = np.arange(0, 4 * count + 1, 4)
    interpolation = csr((weights.ravel(), mesh.tetrahedra[element].ravel(), starts), (count, len(mesh.nodes)))
    operator = StressOperator(mesh, Elastic(1.0, poisson, 1.0))
    moved = kron(interpolation, eye_array(3)).tocsr()
    stressed = kron(interpolation @ mesh.averaging, eye_array(6)).tocsr() @ operator.matrix
    both = vstack([moved, stressed]).tocsr()[:, degrees(mesh.free)]
    rows = np.arange(count)[:, None]
    order = np.concatenate([3 * rows + np.arange(3), 3 * count + 6 * rows + np.arange(6)], axis=1).ravel()
    return both[order].astype(np.float32)


def _near(feet: Array, positions: Array) -> NDArray[np.bool_]:
    return np.sqrt(_squares(feet, positions)) < FAR


def _gaussians(positions: Array, centres: Array) -> Array:
    return np.exp(_squares(positions, centres) / (-2.0 * LENGTH**2))


def _squares(first: Array, second: Array) -> Array:
    """Return squared distances between points [m^2], shape (n, m)."""
    out = (first[:, 0, None] - second[None, :, 0]) ** 2
    for k in (1, 2):
        out += (first[:, k, None] - second[None, :, k]) ** 2
    return out


def _spread(points: Array, count: int) -> Array:
    """Return up to `count` of the points, evenly spread.

    The first point is the one nearest to the origin. Each further point is the one whose distance from the points
    chosen before is largest.
    """
    chosen = [int(np.argmin(np.einsum("ij,ij->i", points, points)))]
    far = _squares(points, points[chosen])[:, 0]
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(far)))
        far = np.minimum(far, _squares(points, points[chosen[-1:]])[:, 0])
    return points[chosen].copy()
