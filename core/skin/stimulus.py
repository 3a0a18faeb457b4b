"""Stimulus: displacement, stress and energy under contact forces."""

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
    """State of a skin under contact forces.

    All quantities are in the finger's frame, whose Z axis points to the nail. Each quantity is computed at its first
    use and then kept.

    Attributes:
        skin: model of the skin.
        force: forces on the pad nodes [N], shape (m, 3).
        points: forces on points of the smooth skin, if contact was solved there; else None.
        given: correction of nonlinear skin as the contact computed it: displacement of the pad nodes in linear skin
            minus that in nonlinear skin [m], shape (3 m,). None: it is computed from the forces.
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
        """Correction of nonlinear skin, see `given` [m], shape (3 m,).

        None for linear skin.
        """
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
        """Whether the nonlinear law determines displacement and stress."""
        return self.skin.follows_law and self.amounts is not None

    @property
    def _load(self) -> Floats32:
        """Forces on the pad nodes, divided by the modulus [m^2], shape (3 m,)."""
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
        """Stress of each element, minus that of linear tissue [Pa], shape (e, 6).

        Both are for the same forces. None for linear skin.
        """
        return self.stress - self.skin.operator.stress(self._linear_displacement) if self._follows else None

    @cached_property
    def stress(self) -> Array:
        """Stress of each element [Pa], xx, yy, zz, yz, xz, xy, shape (e, 6).

        The stress is computed on the mesh, with forces on nodes, and is an average over each element. Near the skin,
        `probe_stress` is more accurate.
        """
        if self._follows:
            return self.skin.material.modulus * self.skin.law.stress(self._state)
        return self.skin.operator.stress(self._linear_displacement)

    @cached_property
    def probe_stress(self) -> Array:
        """Stress at `skin.probes` [Pa], shape (k, 6).

        These are points below the pad nodes, at the depths of receptors.
        """
        return self.stress_at(self.skin.probes)

    def stress_at(self, probes: Probes) -> Array:
        """Return the stress at points in the tissue [Pa], shape (k, 6).

        The components are xx, yy, zz, yz, xz, xy. If `points` is set, the stress is that of the smooth skin at the same
        depth, plus the difference that the nonlinear law makes on the mesh.

        Args:
            probes: points in this skin's mesh, k in number. If `points` is set, their depths must be known.
        """
        if self.points is None:
            return probes.read(self.stress)
        under = probes.pad >= 0
        feet = np.where(under[:, None], self.skin.positions[np.where(under, probes.pad, 0)], probes.points)
        out = self.points.stress_below(feet, probes.depth)
        return out if self.more is None else out + probes.read(self.more)

    @cached_property
    def energy_density(self) -> Array:
        """Strain energy density of each element [J/m^3], shape (e,).

        For nonlinear skin, it is that of linear tissue with the same stress.
        """
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
        """Moment of the forces about the pad's centre [N m], shape (3,).

        The forces are taken to act at the rest positions of the nodes.
        """
        force = np.asarray(self.force, float).reshape(-1, 3)
        return np.cross(self.skin.positions, force).sum(axis=0)

    @cached_property
    def pressure(self) -> Array:
        """Pressure at each pad node [Pa], shape (m,).

        It is the force into the skin, divided by the node's area.
        """
        return self._push / self.skin.areas

    @cached_property
    def centre_of_pressure(self) -> Array:
        """Centre of pressure [m], shape (3,); nan without pressure.

        It is the mean of the pad nodes' rest positions, weighted by the forces into the skin.
        """
        push = np.maximum(self._push, 0.0)
        total = push.sum()
        return push @ self.skin.positions / total if total > 0 else np.full(3, np.nan)

    @cached_property
    def _push(self) -> Array:
        force = np.asarray(self.force, float).reshape(-1, 3)
        return -np.einsum("ij,ij->i", force, self.skin.normals)

    def surface_values(self, values: Array) -> Array:
        """Return values at all nodes for drawing, shape (n, ...).

        Args:
            values: values of the elements, shape (e, ...), which are averaged around each node.
        """
        return nodal_average(self.skin.mesh, values)

    def summary(self) -> dict[str, Any]:
        """Return the quantities that a result file stores, by name."""
        return {
            "normal_force": float(self._push.sum()),
            "resultant": self.resultant.tolist(),
            "centre_of_pressure": self.centre_of_pressure.tolist(),
            "energy": self.energy,
        }
