"""Solution: contact forces on nodes, and the residual of Coulomb's law.

The unknowns are the forces f on the nodes. The relative displacement of the nodes is w = C f + b. The history of
friction (anchors of sticking nodes, movement of the object) enters only through the offset b.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from .cone import OPEN, SLIP, STICK, along, carrying


@dataclass(frozen=True)
class Solution:
    """Contact forces, with the residual of Coulomb's law.

    Attributes:
        force: force on the skin at each node [N], in the frame of the compliance, shape (m, 3).
        displacement: relative displacement w = C f + b [m], shape (m, 3): gap along the normal, slip across it.
        normals: unit normals from the object into the skin, shape (m, 3).
        friction: friction coefficients, shape (m,).
        status: OPEN (0), STICK (1) or SLIP (2) at each node, shape (m,).
        iterations: number of sweeps over the nodes, or of the iterations of another method.
        residual: |f - P(f - w / own)| / |f|. P projects on the friction cone, and own is the mean compliance of a node
            to its own force; see `cone.assess`.
        tolerance: largest residual of a converged solution.
        method: 'none' (nothing touches) or 'sweeps'.
    """

    force: Array
    displacement: Array
    normals: Array
    friction: Array
    status: NDArray[np.int8]
    iterations: int
    residual: float
    tolerance: float
    method: str

    @property
    def converged(self) -> bool:
        """Whether the residual is within the tolerance."""
        return self.residual <= self.tolerance

    @cached_property
    def normal_force(self) -> Array:
        """Force along the normal at each node [N], shape (m,)."""
        return along(self.force, self.normals)

    @cached_property
    def loaded(self) -> NDArray[np.bool_]:
        """Whether each node carries force, shape (m,)."""
        return carrying(self.force)


def status_of(force: Array, normals: Array, friction: Array) -> NDArray[np.int8]:
    """Return the status of nodes whose forces are in their friction cones, shape (m,).

    A node whose force is on the surface of the cone slips.

    Args:
        force, normals: shape (m, 3) each.
        friction: friction coefficients, shape (m,).
    """
    fn = along(force, normals)
    tangential = force - fn[:, None] * normals
    on_cone = np.sqrt(along(tangential, tangential)) >= friction * fn * (1.0 - 1e-9)
    return np.where(fn <= 0.0, OPEN, np.where(on_cone, SLIP, STICK)).astype(np.int8)
