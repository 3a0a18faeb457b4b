"""TissueChannels: what a tissue that stiffens adds to a stimulus, from the contact of a disc with its skin."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..devices.disc_pose import DiscSolution
from ..devices.stiff_points import StiffPoints
from ..stiffening.stress_channels import StressChannels
from ..stiffening.tangent import StiffTangent


class TissueChannels:
    """Stimulus components of the tissue's part of a state (see `skin.felt_state`).

    Args:
        points: that are pressed.
        matrix: components of fields of stress and of the patterns' forces, shape (c, r + k).
    """

    def __init__(self, points: StiffPoints, matrix: Array) -> None:
        fields = matrix.shape[1] - points.stiffening.count
        self.points, self._of_force = points, np.ascontiguousarray(matrix[:, fields:])
        self._stress = None
        if matrix[:, :fields].any():
            self._stress = StressChannels(points.stiffening.stress, points.modulus * matrix[:, :fields])
        self._line: tuple[StiffTangent, Array, Array] | None = None

    def along(self, found: DiscSolution) -> Array:
        """Return the components and their derivative by the configuration, on the tangent, shape (c, 1 + n)."""
        assert found.tangent is not None
        value, slope = self._of_work(found.tangent)
        both = np.concatenate([found.force[:, :, None], found.slope], axis=2).reshape(-1, 1 + found.slope.shape[2])
        columns = (3 * found.near[:, None] + np.arange(3)).ravel()
        work = (self.points.patterns[columns].T @ both) / self.points.modulus
        work[:, 0] -= found.tangent.q + found.tangent.force
        out: Array = slope @ work
        out[:, 0] += value
        return out

    def _of_work(self, tangent: StiffTangent) -> tuple[Array, Array]:
        """Return the components where a tangent was laid, shape (c,), and their slope by the forces' work, (c, k)."""
        if self._line is None or self._line[0] is not tangent:
            value, slope = self._of_force @ tangent.force, self._of_force @ tangent.softening
            if self._stress is not None:
                stress, bend = self._stress.at(tangent.q)
                value, slope = value + stress, slope + bend - bend @ tangent.softening
            self._line = tangent, value, slope
        return self._line[1:]
