"""Observation: stress, electrodes or total force of a touch.

Touches are compared by these quantities. On linear skin, an observation is a matrix times the contact forces. On
neo-Hookean skin, the law corrects the observed displacement of the pad. Observed stress is computed by the law and then
projected onto the stress fields that forces cause in linear skin, so that the same matrix serves both tissues.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Floats32
from ..cache import cache_key
from ..recent import Recent
from .assembly import degrees
from .stimulus import Stimulus
from .stress import StressOperator

if TYPE_CHECKING:
    from .model import SkinModel

# Eigenvalues of the stress for unit forces that are below this share of the largest one are rounding errors of single
# precision.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Observation:
    """Linear observation of a touch by c channels.

    Attributes:
        matrix: matrix from forces on the pad nodes of linear skin to the channels, shape (c, 3 m).
        pad: matrix from the displacement of the pad nodes to the channels, shape (c, 3 m); None if displacement is not
            observed.
        stress: whether the channels are components of stress.
    """

    matrix: Array
    pad: Array | None = None
    stress: bool = True

    @classmethod
    def of(cls, given: Array | Observation) -> Observation:
        """Return an observation unchanged, or make one of a matrix.

        A matrix gives components of stress.
        """
        return given if isinstance(given, Observation) else cls(np.asarray(given, np.float64))


class Observer:
    """Observation on one skin.

    Args:
        skin: model of the skin.
        observation: the observation, or a matrix of stress components.
    """

    def __init__(self, skin: SkinModel, observation: Array | Observation) -> None:
        self.skin, self.observation = skin, Observation.of(observation)
        self.matrix = self.observation.matrix
        self._of_stress: Floats32 | None = None
        if skin.follows_law and self.observation.stress:
            self._of_stress = _stress_reader(skin, self.matrix)

    def see(self, felt: Stimulus) -> Array:
        """Return the channels of a touch, shape (c,)."""
        flat = np.asarray(felt.force, np.float64).ravel()
        if not self.skin.follows_law or not flat.any():
            return self.linear(flat)
        if self._of_stress is not None:
            return np.asarray(self._of_stress @ felt.stress.astype(np.float32).ravel(), np.float64)
        out = self.matrix @ flat
        if self.observation.pad is not None:
            assert felt.amounts is not None
            out -= self.observation.pad @ felt.amounts
        return np.asarray(out)

    def linear(self, force: Array) -> Array:
        """Return the channels for contact forces on linear skin [N], shape (3 m,); the result has the shape (c,)."""
        return np.asarray(self.matrix @ force)

    def seen(self, force: Array, amounts: Array | None = None) -> Array:
        """Return the channels for contact forces, shape (c,).

        Args:
            force: forces on the pad nodes [N], shape (m, 3) or (3 m,).
            amounts: see `Stimulus.given`; None: they are computed from the forces.
        """
        return self.see(touch_of(self.skin, force, amounts))


def skin_key(skin: SkinModel) -> str:
    """Return the key of a skin and its tissue model.

    It does not depend on E and alpha.
    """
    return cache_key(skin.key, "law") if skin.follows_law else skin.key


def touch_of(skin: SkinModel, force: Array, amounts: Array | None = None) -> Stimulus:
    """Return the stimulus of forces on the pad nodes.

    Args:
        skin: model of the skin.
        force: forces [N], shape (m, 3) or (3 m,).
        amounts: see `Stimulus.given`; None: they are computed from the forces.
    """
    return Stimulus(skin, np.asarray(force, np.float64).reshape(-1, 3), None, amounts)


def stress_vector(felt: Stimulus) -> Array:
    """Return the weighted stress of all elements [Pa m^1.5], shape (6 e,).

    Its norm is the volume-weighted L2 norm of the stress.
    """
    return np.asarray((felt.stress * felt.skin.operator.weights).ravel())


def stress_error(target: Stimulus, made: Stimulus) -> float:
    """Return the relative error of the stress of `made` in all elements.

    The stress is compared with that of `target`. The error is 0 if the target has no stress.
    """
    if not (target.skin.follows_law or made.skin.follows_law):
        return float(stress_errors(target.skin, target.force[None], made.force[None])[0])
    wanted = stress_vector(target)
    size = float(np.linalg.norm(wanted))
    return float(np.linalg.norm(stress_vector(made) - wanted)) / size if size > 0.0 else 0.0


def stress_errors(skin: SkinModel, target: Array, made: Array) -> Array:
    """Return the errors of `stress_error` for many touches of linear skin, shape (n,).

    Args:
        skin: model of the skin.
        target, made: forces on the pad nodes [N], shape (n, m, 3) each.
    """
    root = skin.unit_stress  # it gives the same norm from fewer components
    both = np.concatenate([target, made - target]).reshape(-1, root.shape[1]).astype(root.dtype)
    wanted, off = (both @ root.T).reshape(2, len(target), -1)  # one product, or `root` would be converted twice
    size = np.linalg.norm(wanted, axis=1)
    return np.asarray(np.linalg.norm(off, axis=1) / np.where(size > 0.0, size, np.inf))


def _stress_reader(skin: SkinModel, matrix: Array) -> Floats32:
    """Return the matrix D from stress to channels, shape (c, 6 e).

    For the stress s of forces f on linear skin [Pa], D s = W f, where W is `matrix`. For any other stress field, D also
    projects the field onto such fields, by least squares. With the map S from forces to weighted stress, D is
    W (S'S)^-1 S' for weighted stress.
    """
    return _readers.make((skin.key, matrix.tobytes()), lambda: _made_reader(skin, matrix))


def _made_reader(skin: SkinModel, matrix: Array) -> Floats32:
    root = skin.unit_stress
    values, vectors = np.linalg.eigh(root.T @ root)
    kept = values > ROUNDING * values[-1]
    inverse = (matrix @ vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    operator = StressOperator(skin.mesh, skin.material.unit, skin.element)
    way = np.zeros((len(matrix), skin.mesh.nodes.size), np.float32)
    way[:, degrees(skin.mesh.free)] = inverse.astype(np.float32) @ skin.unit_response
    weighted = operator.weighted_matrix.astype(np.float32)
    return np.asarray((weighted @ way.T).T * operator.weights.ravel().astype(np.float32), np.float32, order="C")


_readers: Recent[tuple[str, bytes], Floats32] = Recent(8)
