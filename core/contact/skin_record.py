"""SkinRecord: touch on one finger's skin during a sweep."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import Finding
from ..skin.model import SkinModel
from ..skin.point_forces import PointForces
from ..skin.surface_compliance import SurfaceCompliance
from .skin_contact import PointRecord, SkinContact, SkinStep

_NOTHING = (0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)


class SkinRecord:
    """Forces of the samples in contact so far, and a few numbers of every sample."""

    def __init__(self) -> None:
        self._contact: list[int] = []
        self._force: list[NDArray[np.float32]] = []
        self._amounts: list[NDArray[np.float32]] = []  # as many as forces, or none
        self._points: list[PointForces] = []  # as many as forces, or none
        self._scalars: list[tuple[float, float, float, float, int, int, float]] = []

    def nothing(self, count: int) -> None:
        """Take `count` samples in which nothing is near."""
        self._scalars.extend([_NOTHING] * count)

    def keep(self, step: SkinStep) -> None:
        """Take a sample."""
        if step.force.any():
            self._contact.append(len(self._scalars))
            self._force.append(step.force.astype(np.float32))
            if step.amounts is not None:
                self._amounts.append(step.amounts.astype(np.float32))
            if step.points is not None:
                self._points.append(step.points)
        self._scalars.append(
            (step.normal_force, step.tangential_force, step.depth, step.lift, step.sticking, step.slipping, step.slide)
        )

    def finished(
        self,
        model: SkinModel,
        surface: SurfaceCompliance | None,
        times: Array,
        frames: Array,
        findings: tuple[Finding, ...],
        skipped: Mapping[str, int],
    ) -> SkinContact:
        """Return the touch over the whole sweep.

        Args:
            model: model of the skin.
            surface: smooth pad on which contact was solved; None for nodes.
            times, frames: time [s] and scene frame of each sample, shape (n,).
            findings: findings about the touch.
            skipped: counts of work that was left out, by name.
        """
        scalars = np.array(self._scalars, dtype=np.float64).reshape(-1, 7)
        return SkinContact(
            model=model,
            times=times,
            frames=frames,
            contact=np.array(self._contact, dtype=np.intp),
            held=np.array(self._force, dtype=np.float32).reshape(-1, model.pad_count, 3),
            normal_force=scalars[:, 0],
            tangential_force=scalars[:, 1],
            depth=scalars[:, 2],
            lift=scalars[:, 3],
            sticking=scalars[:, 4].astype(np.int32),
            slipping=scalars[:, 5].astype(np.int32),
            findings=findings,
            skipped={name: count for name, count in skipped.items() if count},
            points=None if surface is None else self._point_record(surface),
            given=np.array(self._amounts) if self._amounts else None,
            slide=scalars[:, 6],
        )

    def _point_record(self, surface: SurfaceCompliance) -> PointRecord:
        return PointRecord(
            surface,
            np.cumsum([0, *(len(one.cells) for one in self._points)]),
            np.concatenate([np.zeros(0, np.int32), *(one.cells for one in self._points)]).astype(np.int32),
            np.concatenate([np.zeros((0, 3)), *(one.force for one in self._points)]).astype(np.float32),
        )
