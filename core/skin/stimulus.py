"""Stimulus: what contact forces do to the skin, each part computed when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, Floats32
from .point_forces import PointForces
from .stress import COMPONENTS, Probes, nodal_average, stored, von_mises

if TYPE_CHECKING:
    from .model import SkinModel


__all__ = ["COMPONENTS", "Stimulus", "von_mises"]


@dataclass(frozen=True, eq=False)
class Stimulus:
    """The state of a skin under contact.

    Everything is in the finger's frame, whose Z axis points to the nail. Nothing is computed before it is read, and
    then once.

    Attributes:
        skin: the model.
        force: on the skin at each pad node [N], shape (m, 3).
        points: the same forces where they act, on points of the smooth skin; None where they act on nodes.
        given: what a touch keeps of tissue that follows a law, as its contact found it: by how much less than linear
            skin the pad gives way [m], shape (3 m,). Where None it is found from the forces.
    """

    skin: SkinModel
    force: Array
    points: PointForces | None = None
    given: Array | None = None

    def __repr__(self) -> str:
        return f"Stimulus(force ({', '.join(f'{f:.3g}' for f in self.resultant)}) N)"

    @property
    def touching(self) -> bool:
        """Whether any pad node carries force."""
        return bool(np.any(self.force))

    @cached_property
    def amounts(self) -> Array | None:
        """What a touch keeps of tissue that follows a law, see `given`; None of linear skin."""
        if self.given is not None or not self.skin.follows_law:
            return self.given
        return self.skin.law.loaded(self._load).astype(np.float64)

    @cached_property
    def pad_displacement(self) -> Array:
        """Displacement of the pad nodes [m], shape (m, 3)."""
        out = self.skin.pad_displacement(self.force)
        return out - np.asarray(self.amounts, np.float64).reshape(-1, 3) if self._follows else out

    @cached_property
    def displacement(self) -> Array:
        """Displacement of all nodes [m], shape (n, 3)."""
        if self._follows:
            return self.skin.law.nodes(self._state).astype(np.float64)
        return self._linear_displacement

    @property
    def _follows(self) -> bool:
        """Whether the law tells what is felt."""
        return self.skin.follows_law and self.amounts is not None

    @property
    def _load(self) -> Floats32:
        """The forces over E, shape (3 m,)."""
        return (np.asarray(self.force, float).ravel() / self.skin.material.modulus).astype(np.float32)

    @cached_property
    def _state(self) -> Floats32:
        """Displacement of the free nodes by the law [m], shape (3 free,)."""
        return self.skin.law.state(self._load, np.asarray(self.amounts, np.float32))

    @cached_property
    def _linear_displacement(self) -> Array:
        return self.skin.displacement(self.force)

    @cached_property
    def more(self) -> Array | None:
        """Stress of each element beyond linear tissue's [Pa], shape (e, 6); None of linear skin."""
        return self.stress - self.skin.operator.stress(self._linear_displacement) if self._follows else None

    @cached_property
    def stress(self) -> Array:
        """Stress of each element [Pa], xx, yy, zz, yz, xz, xy, shape (e, 6).

        It is that of forces on nodes, smeared over an element: near the skin read `probe_stress`.
        """
        if self._follows:
            return self.skin.material.modulus * self.skin.law.stress(self._state)
        return self.skin.operator.stress(self._linear_displacement)

    @cached_property
    def probe_stress(self) -> Array:
        """Stress at `skin.probes`, at receptor depth under the pad nodes [Pa], shape (k, 6), see `stress_at`."""
        return self.stress_at(self.skin.probes)

    def stress_at(self, probes: Probes) -> Array:
        """Return the stress at points in the tissue [Pa], xx, yy, zz, yz, xz, xy, shape (k, 6).

        Of forces on points it is that of the smooth skin, as deep under it, and what the law adds on the mesh.

        Args:
            probes: of this skin's mesh; where forces are on points their depths are known.
        """
        if self.points is None:
            return probes.read(self.stress)
        under = probes.pad >= 0
        feet = np.where(under[:, None], self.skin.positions[np.where(under, probes.pad, 0)], probes.points)
        out = self.points.stress_below(feet, probes.depth)
        return out if self.more is None else out + probes.read(self.more)

    @cached_property
    def energy_density(self) -> Array:
        """Strain energy density of each element [J/m^3], shape (e,)."""
        if self.more is None:
            return self.skin.operator.energy_density(self._linear_displacement)
        return stored(self.stress, self.skin.material)

    @cached_property
    def energy(self) -> float:
        """Strain energy [J]."""
        if self._follows:
            return self.skin.material.modulus * self.skin.law.energy(self._state)
        return self.skin.energy(self.force)

    @cached_property
    def resultant(self) -> Array:
        """Sum of the forces on the skin [N], shape (3,)."""
        return np.asarray(self.force, float).reshape(-1, 3).sum(axis=0)

    @cached_property
    def moment(self) -> Array:
        """Moment of the forces about the pad's centre [N m], shape (3,)."""
        force = np.asarray(self.force, float).reshape(-1, 3)
        return np.cross(self.skin.positions, force).sum(axis=0)

    @cached_property
    def pressure(self) -> Array:
        """Force into the skin over the area of each pad node [Pa], shape (m,)."""
        return self._push / self.skin.areas

    @cached_property
    def centre_of_pressure(self) -> Array:
        """Mean of the pad nodes at rest, weighted by the force into the skin [m], shape (3,); nan without contact."""
        push = np.maximum(self._push, 0.0)
        total = push.sum()
        return push @ self.skin.positions / total if total > 0 else np.full(3, np.nan)

    @cached_property
    def _push(self) -> Array:
        force = np.asarray(self.force, float).reshape(-1, 3)
        return -np.einsum("ij,ij->i", force, self.skin.normals)

    def surface_values(self, values: Array) -> Array:
        """Return element values smoothed to all nodes for drawing, (e, ...) to (n, ...)."""
        return nodal_average(self.skin.mesh, values)

    def summary(self) -> dict[str, Any]:
        """Return what a result file keeps of a frame, without solving for anything."""
        return {
            "normal_force": float(self._push.sum()),
            "resultant": self.resultant.tolist(),
            "centre_of_pressure": self.centre_of_pressure.tolist(),
            "energy": self.energy,
        }
