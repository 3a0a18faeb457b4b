"""LearnedModel: a fit instead of the solution of contact.

The inputs of the fit are the configuration, the trial forces, which show where points touch and stick, and the forces
at the end of the previous step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice
from ..devices.disc_pose import FrictionState, placed
from ..errors import DermisError
from .dataset import Dataset
from .ridge import PartOfRidge, QuadraticRidge
from .subspace import TOLERANCE, Subspace, principal_components
from .table import Fit, SampleTable
from .trial import TrialForce

# Largest numbers of components of trial forces and of the previous step's forces. More components take time in every
# evaluation and add hardly any information.
TRIAL_COMPONENTS, FRICTION_COMPONENTS = 30, 20


class LearnedModel:
    """Forward model that evaluates a fit.

    Args:
        fit: the fit, whose inputs are x and the components of trial forces and of the previous step's forces.
        device: the mechanism.
        trial: trial forces on this skin.
        trial_space: subspace of trial forces.
        friction: subspace of the previous step's forces; None for a fit that does not use them. Each pose is then
            pressed from rest, and the fit is evaluated even if nothing touches.
        stiffness: stiffness of this skin, divided by that of the skin in the training. Forces and stresses at given
            poses are proportional to it, so a person's alpha needs no new training.

    Raises:
        DermisError: the fit has another number of inputs, or the skin has another number of pressed points than the
            subspace.

    Source: [S0] 4.2; the friction state is that of the previous step.
    """

    def __init__(
        self,
        fit: Fit,
        device: DiscDevice,
        trial: TrialForce,
        trial_space: Subspace,
        friction: Subspace | None = None,
        stiffness: float = 1.0,
    ) -> None:
        n = device.freedoms
        sizes = n, trial_space.size, 0 if friction is None else friction.size
        if fit.inputs != sum(sizes):
            raise DermisError(
                "fit and model have different numbers of inputs",
                where="surrogate",
                value=fit.inputs,
                limit=str(sum(sizes)),
            )
        places, wanted_places = trial_space.mean.size // 3, len(trial.places)
        if places != wanted_places:
            raise DermisError(
                "the surrogate was made for other pressed points",
                where="surrogate",
                value=f"{places} places",
                limit=str(wanted_places),
                remedy="Adapt it again, or use the direct method",
            )
        self.fit, self.device, self.trial, self.friction, self.stiffness = (
            fit,
            device,
            trial,
            friction,
            float(stiffness),
        )
        by_place = trial_space.basis.reshape(trial_space.size, 3, places).transpose(1, 2, 0)
        self._basis = np.ascontiguousarray(by_place) / self.stiffness
        self._told = slice(n, n + trial_space.size)
        # The friction state stays the same for many poses, so a polynomial is reduced to its other inputs only once.
        self._part = None if friction is None or not isinstance(fit, QuadraticRidge) else PartOfRidge(fit, sizes[2])
        used = fit.inputs if self._part is None else self._told.stop
        self._features, self._ways = np.zeros(used), np.zeros((used, n))
        self._ways[:n] = np.eye(n)
        self._nothing = trial_space.basis @ trial_space.mean
        if friction is not None:
            self._remembers, self._unmoved = friction.basis / self.stiffness, friction.basis @ friction.mean
        self.hold(FrictionState.rest(len(trial.places)))

    @property
    def size(self) -> int:
        """Number of stimulus components."""
        return self.fit.outputs

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state."""
        if self.friction is not None:
            self.trial.hold(state)
            remembered = self._remembers @ state.force.ravel() - self._unmoved
            if self._part is None:
                self._features[self._told.stop :] = remembered
            else:
                self._part.give(remembered)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the stimulus, shape (k,), and its derivative, shape (k, n).

        The derivative is with respect to x and includes that of the trial forces. If nothing touches, both results are
        zero, unless the fit does not use the previous step's forces.
        """
        told = self.trial.told(placed(self.device, self.device.pose(x)), self._basis)
        if told is None:
            if self.friction is not None:
                return np.zeros(self.size), np.zeros((self.size, self._ways.shape[1]))
            told = np.zeros((1 + self._ways.shape[1], len(self._nothing)))
        self._features[: self._told.start] = x
        self._features[self._told] = told[0] - self._nothing
        self._ways[self._told] = told[1:].T
        value, slope = (self._part or self.fit).along(self._features, self._ways)
        if self.stiffness == 1.0:
            return value, slope
        return self.stiffness * value, self.stiffness * slope


@dataclass(frozen=True, eq=False)
class Descriptors:
    """Subspaces for stimuli and friction states of one skin and device.

    Attributes:
        stress: subspace of weighted stresses.
        observation_matrix: W, which maps forces on the pad nodes to components of stress, shape (k, 3 m).
        trial: subspace of trial forces.
        friction: subspace of contact forces.
    """

    stress: Subspace
    observation_matrix: Array
    trial: Subspace
    friction: Subspace

    def table(self, data: Dataset, matrix: Array | None = None) -> SampleTable:
        """Return the samples of a dataset in these descriptors.

        The memory consists of the components of trial forces and of the previous step's forces.

        Args:
            data: the dataset. If an observer saw its components of stress, they must be those of this description.
            matrix: map from forces on the pad nodes to channels, shape (c, 3 m); None for the components of stress.
        """
        told = self.trial.project(data.trial.astype(np.float64)), self.friction.project(data.before.astype(np.float64))
        if matrix is None and data.stress is not None:
            channels = data.stress
        else:
            wanted = self.observation_matrix if matrix is None else matrix
            channels = data.force.astype(np.float64) @ wanted.T
        return SampleTable(data.x, np.concatenate(told, axis=1), channels, data.trajectory)

    def remembering(self, data: Dataset) -> Descriptors:
        """Return the same components of stress, with the subspaces of trial forces and friction of another dataset."""
        return Descriptors(self.stress, self.observation_matrix, *_inputs(data))


def descriptors(
    data: Dataset, stress_operator: Array, *, tolerance: float = TOLERANCE, size: int | None = None
) -> Descriptors:
    """Fit the subspaces to a dataset.

    Args:
        data: the dataset.
        stress_operator: matrix H for which |H f| is the stress norm of forces f on the pad nodes, shape (any, 3 m).
        tolerance: largest relative RMS error of stress, see `Subspace.curve`.
        size: number of components of stress; None to use the tolerance.

    Source: [S0] 4.1, 10 % for stress
    """
    force = data.force.astype(np.float64)
    stress = principal_components(force @ stress_operator.T, tolerance=tolerance, size=size)
    return Descriptors(stress, stress.basis @ stress_operator, *_inputs(data))


def _inputs(data: Dataset) -> Iterator[Subspace]:
    """Yield the subspaces of trial forces and of the previous step's forces, see `descriptors`."""
    for part, most in ((data.trial, TRIAL_COMPONENTS), (data.before, FRICTION_COMPONENTS)):
        yield principal_components(part.astype(np.float64), size=min(most, *part.shape))
