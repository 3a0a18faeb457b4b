"""Touch on one finger's skin, at one sample and over a whole scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import Finding
from ..skin.model import SkinModel
from ..skin.nodal_forces import NodalForces
from ..skin.point_forces import PointForces
from ..skin.stimulus import Stimulus
from ..skin.surface_compliance import SurfaceCompliance
from .packed_forces import PackedForces, PackedPoints, SpreadForces


@dataclass(frozen=True, eq=False)
class SkinStep:
    """Touch on one finger's skin at one sample.

    Attributes:
        force: forces on the pad nodes in the finger's frame [N], shape (m, 3).
        normal_force, tangential_force: total forces on the pad [N].
        depth: penetration of the undeformed skin, 0 without contact [m].
        lift: displacement of a compliant bone [m].
        sticking, slipping: number of sticking and of slipping nodes.
        work: kind of work of the solver, see `PathStep`; 'between' if interpolated, 'baked' if read from a bake.
        converged: whether the residual of contact is within the tolerance.
        points: forces on points of the smooth skin; None if contact is solved at nodes.
        amounts: displacement of the pad in linear skin minus that in nonlinear skin [m], see `Stimulus.given`; None for
            linear skin.
        slide: mean tangential displacement of the loaded skin by friction, see `PathStep.sums` [m].
    """

    force: Array
    normal_force: float = 0.0
    tangential_force: float = 0.0
    depth: float = 0.0
    lift: float = 0.0
    sticking: int = 0
    slipping: int = 0
    work: str = "idle"
    converged: bool = True
    points: PointForces | None = None
    amounts: Array | None = None
    slide: float = 0.0


@dataclass(frozen=True, eq=False)
class PointRecord:
    """Forces on points of the smooth skin over a scene.

    Attributes:
        surface: the smooth pad.
        starts: index in `cells` and `force` at which each sample in contact begins, and their length, shape (k + 1,).
        cells: indices of the loaded cells of the pad, int32, shape (n,).
        force: force on each of them [N], float32, shape (n, 3).
    """

    surface: SurfaceCompliance
    starts: NDArray[np.intp]
    cells: NDArray[np.int32]
    force: NDArray[np.float32]

    def at(self, k: int) -> PointForces:
        """Return the forces of the k-th sample in contact."""
        part = slice(self.starts[k], self.starts[k + 1])
        return PointForces(self.surface, self.cells[part].astype(np.intp), self.force[part].astype(np.float64))


@dataclass(frozen=True, eq=False)
class SkinContact:
    """Touch on one finger's skin over a whole scene.

    Attributes:
        model: model of the skin.
        times: time of each sample [s], shape (n,).
        frames: scene frame of each sample, shape (n,).
        contact: indices of the samples in contact, rising, shape (k,).
        held: forces on the pad nodes in the finger's frame at these samples [N], float32, shape (k, m, 3); packed in a
            finished bake. `force` is always the array.
        normal_force, tangential_force: total forces on the pad [N], shape (n,).
        depth: penetration of the undeformed skin, 0 without contact [m], shape (n,).
        lift: displacement of a compliant bone [m], shape (n,).
        sticking, slipping: number of sticking and of slipping nodes, shape (n,).
        findings: findings about the touch.
        skipped: counts of work that was left out, by name.
        points: forces on points of the smooth skin, from which the stress near the skin is computed; None if contact
            was solved at nodes.
        given: correction of nonlinear skin at the samples in contact [m], see `Stimulus.given`, float32, shape (k, 3
            m); packed in a finished bake. `amounts` is always the array. None for linear skin.
        slide: mean tangential displacement of the loaded skin by friction, see `PathStep.sums` [m], shape (n,); None
            in results of earlier versions.
    """

    model: SkinModel
    times: Array
    frames: Array
    contact: NDArray[np.intp]
    held: NDArray[np.float32] | PackedForces | SpreadForces
    normal_force: Array
    tangential_force: Array
    depth: Array
    lift: Array
    sticking: NDArray[np.int32]
    slipping: NDArray[np.int32]
    findings: tuple[Finding, ...]
    skipped: Mapping[str, int]
    points: PointRecord | PackedPoints | None = None
    given: NDArray[np.float32] | PackedForces | None = None
    slide: Array | None = None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self.contact)} of {len(self.times)} samples touch, {self.model})"

    @property
    def pressed(self) -> SkinModel:
        """Model of the skin for devices, which are solved on points or at nodes like the touch."""
        return self.model.on_nodes if self.points is None else self.model

    @property
    def force(self) -> NDArray[np.float32]:
        """Forces on the pad nodes at the samples in contact [N], shape (k, m, 3); unpacked at each use."""
        return np.asarray(self.held)

    @property
    def amounts(self) -> NDArray[np.float32] | None:
        """Correction of nonlinear skin at the samples in contact [m], shape (k, 3 m); unpacked at each use."""
        return None if self.given is None else np.asarray(self.given).reshape(len(self.contact), -1)

    @property
    def nbytes(self) -> int:
        """Size of its arrays in memory, without the model [bytes]."""
        arrays = [value for value in self.__dict__.values() if isinstance(value, np.ndarray | PackedForces)]
        if isinstance(self.points, PackedPoints):
            arrays.append(self.points.packed)
        elif self.points is not None:
            arrays += [self.points.starts, self.points.cells, self.points.force]
        return sum(array.nbytes for array in arrays)

    def packed(self) -> SkinContact:
        """Return the same touch in a tenth of the memory, with forces rounded as by `PackedForces`.

        If there are forces on points, those on nodes are then computed from them.
        """
        if not isinstance(self.held, np.ndarray):
            return self
        if self.model.follows_law and isinstance(self.given, np.ndarray):
            pad = np.arange(self.model.pad_count)
            less = PackedForces(((pad, row.reshape(-1, 3)) for row in self.given), self.model.pad_count)
            return replace(self, given=less).packed()
        if isinstance(self.points, PointRecord):
            surface, record = self.points.surface, self.points
            parts = [slice(a, b) for a, b in zip(record.starts[:-1], record.starts[1:], strict=True)]
            points = PackedForces(((record.cells[p], record.force[p]) for p in parts), len(surface.chart.places))
            nodes = NodalForces.of(self.model.mesh, surface.chart, self.model.follows_law)
            return replace(self, held=SpreadForces(points, nodes), points=PackedPoints(surface, points))
        loaded = ((np.flatnonzero(force.any(axis=1)), force) for force in self.held)
        packed = PackedForces(((nodes, force[nodes]) for nodes, force in loaded), self.model.pad_count)
        return replace(self, held=packed)

    def force_at(self, sample: int) -> Array:
        """Return the forces of one sample [N], shape (m, 3); zeros without contact."""
        at = self._place_of(sample)
        return np.zeros((self.model.pad_count, 3)) if at is None else self.held[at].astype(np.float64)

    def points_at(self, sample: int) -> PointForces | None:
        """Return the forces of one sample on points; None without contact, or if it was solved at nodes."""
        at = self._place_of(sample)
        if at is None or self.points is None:
            return None
        return replace(self.points.at(at), amounts=self.amounts_at(sample))

    def amounts_at(self, sample: int) -> Array | None:
        """Return the correction at one sample [m], shape (3 m,); None without contact and for linear skin."""
        at = self._place_of(sample)
        return None if at is None or self.given is None else self.given[at].astype(np.float64).ravel()

    def stimulus_at(self, sample: int) -> Stimulus:
        """Return the stimulus of the forces of one sample."""
        return Stimulus(self.model, self.force_at(sample), self.points_at(sample), self.amounts_at(sample))

    def at(self, sample: int) -> SkinStep:
        """Return the touch at one sample; it counts as converged if all samples have."""
        return SkinStep(
            self.force_at(sample),
            float(self.normal_force[sample]),
            float(self.tangential_force[sample]),
            float(self.depth[sample]),
            float(self.lift[sample]),
            int(self.sticking[sample]),
            int(self.slipping[sample]),
            "baked",
            not any(f.code == "not-converged" for f in self.findings),
            self.points_at(sample),
            self.amounts_at(sample),
            0.0 if self.slide is None else float(self.slide[sample]),
        )

    def _place_of(self, sample: int) -> int | None:
        at = int(np.searchsorted(self.contact, sample))
        return at if at < len(self.contact) and self.contact[at] == sample else None
