"""Stimulus: what contact forces do to the skin, each part computed when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, Floats32
from ..parameters.error_bands import LINEAR
from .point_forces import PointForces
from .stress import COMPONENTS, nodal_average, stored, von_mises

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
        given: what a touch keeps of tissue that stiffens, as its contact found it: by how much less than linear skin
            the pad gives way [m], shape (3 m,); of skin that goes by a series how much there is of each pattern, shape
            (k,). Where None it is found from the forces.
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
        """What a touch keeps of tissue that stiffens, see `given`; None of linear skin."""
        skin = self.skin
        if self.given is not None or skin.tissue == LINEAR:
            return self.given
        if skin.follows_law:
            return skin.law.loaded(self._load).astype(np.float64)
        return skin.stiff.balanced(skin.stiff.pad.T @ np.asarray(self.force, float).ravel() / skin.material.modulus)

    @cached_property
    def pad_displacement(self) -> Array:
        """Displacement of the pad nodes [m], shape (m, 3)."""
        out = self.skin.pad_displacement(self.force)
        if self._follows:
            return out - np.asarray(self.amounts, np.float64).reshape(-1, 3)
        return out if self._beyond is None else out - (self.skin.stiff.pad @ self._beyond).reshape(-1, 3)

    @cached_property
    def displacement(self) -> Array:
        """Displacement of all nodes [m], shape (n, 3)."""
        if self._follows:
            return self.skin.law.nodes(self._state).astype(np.float64)
        if self.skin.stiffening is None or self.amounts is None:
            return self._linear_displacement
        return self._linear_displacement - self.skin.stiff.moved(self.amounts)[1]

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
    def _beyond(self) -> Array | None:
        """The force that stiffening takes in each pattern of a series at E = 1, shape (k,); None without it."""
        stiffening, q = self.skin.stiffening, self.amounts
        return None if self.skin.follows_law or stiffening is None or q is None else stiffening.energy.force(q)

    @cached_property
    def _more(self) -> Array | None:
        """Stress of each element beyond linear tissue's [Pa], shape (e, 6); None of linear skin."""
        stiffening, q = self.skin.stiffening, self.amounts
        if self._follows:
            return self.stress - self.skin.operator.stress(self._linear_displacement)
        return None if stiffening is None or q is None else self.skin.material.modulus * self.skin.stiff.beyond(q)

    @cached_property
    def stress(self) -> Array:
        """Stress of each element [Pa], xx, yy, zz, yz, xz, xy, shape (e, 6).

        It is that of forces on nodes, smeared over an element: near the skin read `probe_stress`.
        """
        skin = self.skin
        if self._follows:
            return skin.material.modulus * skin.law.stress(self._state)
        if skin.stiffening is None or self.amounts is None:
            return skin.operator.stress(self._linear_displacement)
        stress, held = skin.stiff.felt(self.amounts)
        return skin.operator.stress(self._linear_displacement - held) + skin.material.modulus * stress

    @cached_property
    def probe_stress(self) -> Array:
        """Stress at `skin.probes`, at receptor depth under the pad nodes [Pa], shape (k, 6).

        Of forces on points it is that of the smooth skin, as deep under it.
        """
        if self.points is not None:
            probes = self.skin.probes
            out = self.points.stress_below(self.skin.positions[probes.pad], probes.depth)
            return out if self._more is None else out + probes.read(self.skin.mesh, self._more)
        return self.skin.probes.read(self.skin.mesh, self.stress)

    @cached_property
    def energy_density(self) -> Array:
        """Strain energy density of each element [J/m^3], shape (e,)."""
        if self._more is None:
            return self.skin.operator.energy_density(self._linear_displacement)
        return stored(self.stress, self.skin.material)

    @cached_property
    def energy(self) -> float:
        """Strain energy [J]."""
        if self._follows:
            return self.skin.material.modulus * self.skin.law.energy(self._state)
        out = self.skin.energy(self.force)
        if self._beyond is None or self.skin.stiffening is None or self.amounts is None:
            return out
        n, stiff, modulus = self._beyond, self.skin.stiff, self.skin.material.modulus
        own = self.skin.stiffening.energy.value(self.amounts) + 0.5 * float(n @ stiff.bound @ n)
        return out - float(np.asarray(self.force, float).ravel() @ stiff.pad @ n) + modulus * own

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
