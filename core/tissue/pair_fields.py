"""Fields of the second power that displacements bring in tissue that follows them while the pad is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..skin.mesh import TetraMesh
from .neo_hookean import NeoHookean

PARTS = 37  # numbers of a second power in an element


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

    def within(self, elements: slice) -> Slopes:
        """Return those in some elements, around all nodes."""
        return Slopes(self.gradient[:, elements], self.trace[:, elements], self.nodal, self.mean[:, elements])


def mean_of_nodes(mesh: TetraMesh, values: Array) -> Array:
    """Return the mean over each element's nodes, (b, n) to (b, e)."""
    return np.asarray(values[:, mesh.tetrahedra].mean(axis=-1))


def to_nodes(mesh: TetraMesh, values: NDArray[np.floating]) -> Array:
    """Return the transpose of `mean_of_nodes`, (b, e) to (b, n)."""
    out = np.zeros((len(mesh.nodes), len(values)))
    for corner in range(4):
        np.add.at(out, mesh.tetrahedra[:, corner], 0.25 * values.T)
    return np.ascontiguousarray(out.T)


def square_fields(slopes: Slopes, follow: Array) -> Floats32:
    """Return the second powers in some elements that `StressReading.dual` has the other half of.

    H2 of the tissue that follows, H H, t H, H H' and t t, with H the gradient and t its trace.

    Args:
        slopes: of displacements, in the elements. follow: H2, shape (s, e, 3, 3).

    Returns:
        shape (s, e, PARTS).
    """
    h, t = slopes.gradient.astype(np.float32), slopes.trace.astype(np.float32)[..., None, None]
    out = np.empty((*h.shape[:2], PARTS), np.float32)
    for n, product in enumerate((follow, h @ h, t * h, h @ np.swapaxes(h, -1, -2))):
        out[..., 9 * n : 9 * (n + 1)] = product.reshape(*h.shape[:2], 9)
    out[..., 36] = (t * t)[..., 0, 0]
    return out
