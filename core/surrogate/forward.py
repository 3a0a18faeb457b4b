"""ForwardModel: from a device's configuration to what it makes the skin feel, whichever way that is computed."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..arrays import Array
from ..devices.disc import DiscContact
from ..devices.disc_pose import DiscSolution, FrictionState, placed
from ..devices.thimble import Thimble
from ..errors import DermisError


class ForwardModel(Protocol):
    """Stimulus and its derivative for a configuration, from a friction state that is fixed beforehand.

    Source: [S0] 3.4, sigma(x, f).
    """

    @property
    def size(self) -> int:
        """Number of stimulus components, k."""
        ...

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state for the evaluations that follow."""
        ...

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the stimulus, shape (k,), and its derivative by x, shape (k, 3)."""
        ...


class DirectModel:
    """The contact solved for each configuration; the derivative by implicit differentiation.

    Args:
        device: the mechanism. contact: the skin and the disc.
        observation_matrix: from forces on the nodes of the skin's pad to stimulus components, shape (k, 3 m): stress,
            electrodes or total force. What it says of a touch it says of the disc, whose points press on these nodes.

    Raises:
        DermisError: an observation matrix that does not fit the skin.
    """

    def __init__(self, device: Thimble, contact: DiscContact, observation_matrix: Array) -> None:
        if observation_matrix.ndim != 2 or observation_matrix.shape[1] != 3 * contact.points.node_count:
            raise DermisError(
                "the observation matrix does not fit the skin",
                where="direct model",
                value=observation_matrix.shape,
                limit=f"(k, {3 * contact.points.node_count})",
            )
        self.device, self.contact = device, contact
        self.observation_matrix = np.ascontiguousarray(observation_matrix, np.float64)
        self._chosen = -1
        nodal = contact.points.nodal
        self._of_points = self.observation_matrix if nodal is None else self.observation_matrix @ nodal
        self._columns = self._of_points[:, :0]
        self._last: tuple[bytes, DiscSolution] | None = None

    @property
    def size(self) -> int:
        """Number of stimulus components."""
        return len(self.observation_matrix)

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state."""
        self.contact.hold(state)
        self._last = None

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the stimulus and its derivative."""
        found = self.solution(x)
        if self._chosen != self.contact.choice:
            columns = (3 * found.near[:, None] + np.arange(3)).ravel()
            self._columns = np.ascontiguousarray(self._of_points[:, columns])
            self._chosen = self.contact.choice
        both = np.concatenate([found.force[:, :, None], found.slope], axis=2).reshape(-1, 4)
        answer = self._columns @ both
        return answer[:, 0], answer[:, 1:]

    def stimulus(self, solution: DiscSolution) -> Array:
        """Return the stimulus of a contact, shape (k,)."""
        return self._of_points @ solution.spread(self.contact.count).ravel()

    def solution(self, x: Array) -> DiscSolution:
        """Return the contact itself."""
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self.contact.solve(placed(self.device, self.device.pose(x))))
        return self._last[1]
