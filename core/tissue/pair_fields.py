"""What products of patterns bring in tissue that follows them while the pad is held: fields of the second power.

The second power of a displacement, polarised: what multiplies q_a q_b for each pair a <= b, so that a pair of two
different patterns has both its orders in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..skin.mesh import TetraMesh
from ..stiffening.symmetric import rising
from .held_tissue import HeldTissue
from .neo_hookean import NeoHookean

AT_ONCE = 200  # pairs whose stresses are in memory together
PARTS = 37  # numbers of a pair in an element


@dataclass(frozen=True, eq=False)
class Slopes:
    """Linear fields of patterns.

    Attributes:
        gradient: of the displacement, shape (k, e, 3, 3). trace: of it, shape (k, e).
        nodal: the trace averaged around the nodes, shape (k, n). mean: that of an element's nodes, shape (k, e).
    """

    gradient: Array
    trace: Array
    nodal: Array
    mean: Array

    @classmethod
    def of(cls, tissue: NeoHookean, patterns: Array) -> Slopes:
        """Return the fields of displacements of all nodes, shape (k, n, 3)."""
        mesh = tissue.mesh
        gradient = np.einsum("beai,eaj->beij", patterns[:, mesh.tetrahedra], tissue.geometry.gradients, optimize=True)
        trace = np.einsum("beii->be", gradient)
        nodal = trace @ mesh.averaging.T
        return cls(gradient, trace, nodal, mean_of_nodes(mesh, nodal))

    def first(self, few: int) -> Slopes:
        """Return those of the first patterns."""
        return Slopes(self.gradient[:few], self.trace[:few], self.nodal[:few], self.mean[:few])


def mean_of_nodes(mesh: TetraMesh, values: Array) -> Array:
    """Return the mean over each element's nodes, (b, n) to (b, e)."""
    return np.asarray(values[:, mesh.tetrahedra].mean(axis=-1))


def to_nodes(mesh: TetraMesh, values: NDArray[np.floating]) -> Array:
    """Return the transpose of `mean_of_nodes`, (b, e) to (b, n)."""
    out = np.zeros((len(mesh.nodes), len(values)))
    for corner in range(4):
        np.add.at(out, mesh.tetrahedra[:, corner], 0.25 * values.T)
    return np.ascontiguousarray(out.T)


def second_displacements(linear: HeldTissue, slopes: Slopes) -> Array:
    """Return how tissue follows products of patterns, shape (pairs, n, 3)."""
    tissue, mesh = linear.tissue, linear.tissue.mesh
    first, shear = tissue.lame
    pairs = rising(len(slopes.trace), 2).T
    out = np.empty((len(pairs), len(mesh.nodes), 3))
    for start in range(0, len(pairs), AT_ONCE):
        a, b = pairs[start : start + AT_ONCE].T
        share = np.where(a == b, 0.5, 1.0)[:, None]
        one, other = slopes.gradient[a], slopes.gradient[b]
        square = share[..., None, None] * (one @ other + other @ one)
        widening = share * slopes.trace[a] * slopes.trace[b] - 0.5 * np.einsum("peii->pe", square)
        nodal = widening @ mesh.averaging.T - 3.0 * share * slopes.nodal[a] * slopes.nodal[b]
        squeeze = first * (mean_of_nodes(mesh, nodal) + share * slopes.mean[a] * slopes.trace[b])
        squeeze += first * share * slopes.mean[b] * slopes.trace[a]
        pressed = slopes.mean[a][..., None, None] * other + slopes.mean[b][..., None, None] * one
        stress = -np.swapaxes(shear * square + first * share[..., None, None] * pressed, -1, -2)
        for i in range(3):
            stress[..., i, i] += squeeze
        out[start : start + AT_ONCE] = -linear.followed_forces(tissue.forces(stress))
    return out


def pair_fields(slopes: Slopes, follow: Array) -> Floats32:
    """Return the second powers in some elements that `StressReading.dual` has the other half of.

    H2 of the tissue that follows, H H, t H, H H' and t t, with H the gradient and t its trace.

    Args:
        slopes: of the patterns, in the elements. follow: H2, shape (pairs, e, 3, 3).

    Returns:
        shape (pairs, e, PARTS).
    """
    a, b = rising(len(slopes.trace), 2)
    share = np.where(a == b, 0.5, 1.0).astype(np.float32)[:, None, None, None]
    h, t = slopes.gradient.astype(np.float32), slopes.trace.astype(np.float32)[..., None, None]
    out = np.empty((len(a), h.shape[1], PARTS), np.float32)
    out[..., :9] = follow.reshape(*follow.shape[:2], 9)
    for n, product in enumerate((h[a] @ h[b] + h[b] @ h[a], t[a] * h[b] + t[b] * h[a])):
        out[..., 9 * (n + 1) : 9 * (n + 2)] = (share * product).reshape(*follow.shape[:2], 9)
    turned = h[a] @ np.swapaxes(h[b], -1, -2)
    out[..., 27:36] = (share * (turned + np.swapaxes(turned, -1, -2))).reshape(*follow.shape[:2], 9)
    out[..., 36] = (2.0 * share * t[a] * t[b])[..., 0, 0]
    return out
