"""LearnedModel: a fit in place of the contact, with the previous step's friction state among its inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..devices.disc_pose import FrictionState
from ..errors import DermisError
from .dataset import Dataset
from .subspace import TOLERANCE, Subspace, principal_components
from .table import Fit, SampleTable


class LearnedModel:
    """A fit as a forward model.

    Args:
        fit: of (x, friction descriptor).
        friction: the subspace of the previous step's forces on nodes; None for a fit of x alone.
        stiffness: of this skin over that of the skin it was learned on. Forces and stresses at given poses are
            proportional to it, so a person's alpha needs no new training.
        nodal: forces on nodes for those of a friction state, as in `PressPoints`.

    Raises:
        DermisError: a fit with another number of inputs.

    Source: [S0] 4.2; the friction state is that of the previous step.
    """

    def __init__(
        self, fit: Fit, friction: Subspace | None = None, stiffness: float = 1.0, nodal: Array | None = None
    ) -> None:
        wanted = 3 + (0 if friction is None else friction.size)
        if fit.inputs != wanted:
            raise DermisError(
                "the fit has other inputs than the model", where="surrogate", value=fit.inputs, limit=str(wanted)
            )
        self.fit, self.friction, self.stiffness = fit, friction, float(stiffness)
        if friction is not None:
            self._basis = friction.basis if nodal is None else friction.basis @ nodal
            self._start = friction.basis @ friction.mean
        self._memory, self._evaluate = np.zeros(wanted - 3), fit.fixed(np.zeros(wanted - 3))

    @property
    def size(self) -> int:
        """Number of stimulus components."""
        return self.fit.outputs

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state."""
        if self.friction is not None:
            memory = self._basis @ (state.force.ravel() / self.stiffness) - self._start
            if not np.array_equal(memory, self._memory):
                self._memory, self._evaluate = memory, self.fit.fixed(memory)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the stimulus and its derivative."""
        value, slope = self._evaluate(x)
        if self.stiffness == 1.0:
            return value, slope
        return self.stiffness * value, self.stiffness * slope


@dataclass(frozen=True, eq=False)
class Descriptors:
    """The spaces that stimuli and friction states of one skin and device are described in.

    Attributes:
        stress: of weighted stresses, about their mean. observation_matrix: its components of forces, W, shape (k, 3 m).
        friction: of contact forces, about their mean.
    """

    stress: Subspace
    observation_matrix: Array
    friction: Subspace

    def table(self, data: Dataset) -> SampleTable:
        """Return a dataset in these descriptors, with the previous step's friction state as memory."""
        force = data.force.astype(np.float64)
        before = self.friction.project(data.before.astype(np.float64))
        return SampleTable(data.x, before, force @ self.observation_matrix.T, data.trajectory)


def descriptors(
    data: Dataset,
    stress_operator: Array,
    *,
    tolerance: float = TOLERANCE,
    size: int | None = None,
    friction_size: int | None = None,
) -> Descriptors:
    """Fit both subspaces to a dataset.

    Args:
        stress_operator: H with |H f| the stress norm of forces, shape (any, 3 m), as `SkinModel.stress_components`.
        tolerance: relative RMS of the residual about the mean that both may leave.
        size, friction_size: numbers of components instead of the tolerance.

    Source: [S0] 4.1, 10 % for both
    """
    force = data.force.astype(np.float64)
    stress = principal_components(force @ stress_operator.T, tolerance=tolerance, size=size)
    friction = principal_components(data.before.astype(np.float64), tolerance=tolerance, size=friction_size)
    return Descriptors(stress, stress.basis @ stress_operator, friction)
