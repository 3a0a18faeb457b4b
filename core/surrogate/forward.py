"""ForwardModel: from a device's configuration to what it makes the skin feel, whichever way that is computed."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..arrays import Array
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice
from ..devices.disc_pose import DiscSolution, FrictionState, placed
from ..errors import DermisError
from ..skin.felt_state import tissue_size
from .tissue_channels import TissueChannels


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
        """Return the stimulus, shape (k,), and its derivative by x, shape (k, n)."""
        ...


class DirectModel:
    """The contact solved for each configuration; the derivative by implicit differentiation.

    Args:
        device: the mechanism. contact: the skin and the disc.
        observation_matrix: from forces on the nodes of the skin's pad to stimulus components, shape (k, 3 m), or from
            all that skin which stiffens feels (`skin.felt_state`): stress, electrodes or total force. What it says of
            a touch it says of the disc, whose points press on these nodes.

    Raises:
        DermisError: an observation matrix that does not fit the skin.
    """

    def __init__(self, device: DiscDevice, contact: DiscContact, observation_matrix: Array) -> None:
        nodes3, stiff = 3 * contact.points.node_count, contact.points.stiff
        sizes = [nodes3] if stiff is None else [nodes3, nodes3 + tissue_size(stiff.stiffening)]
        if observation_matrix.ndim != 2 or observation_matrix.shape[1] not in sizes:
            raise DermisError(
                "the observation matrix does not fit the skin",
                where="direct model",
                value=observation_matrix.shape,
                limit=f"(k, {sizes[-1]})",
            )
        self.device, self.contact = device, contact
        self.observation_matrix = np.ascontiguousarray(observation_matrix, np.float64)
        self._chosen = -1
        nodal = contact.points.nodal
        of_nodes = self.observation_matrix[:, :nodes3]
        self._of_points = of_nodes if nodal is None else of_nodes @ nodal
        self._columns = self._of_points[:, :0]
        self._last: tuple[bytes, DiscSolution] | None = None
        self._tissue: TissueChannels | None = None
        if stiff is not None and observation_matrix.shape[1] > nodes3:
            self._tissue = TissueChannels(stiff, self.observation_matrix[:, nodes3:])
        self._tried: tuple[bytes, DiscSolution] | None = None

    @property
    def size(self) -> int:
        """Number of stimulus components."""
        return len(self.observation_matrix)

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state."""
        self.contact.hold(state)
        self._last = self._tried = None

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the stimulus and its derivative; of skin that stiffens near where it last was, as its tangent says."""
        found = self._near(x)
        if self._chosen != self.contact.choice:
            columns = (3 * found.near[:, None] + np.arange(3)).ravel()
            self._columns = np.ascontiguousarray(self._of_points[:, columns])
            self._chosen = self.contact.choice
        both = np.concatenate([found.force[:, :, None], found.slope], axis=2).reshape(-1, 1 + found.slope.shape[2])
        answer = self._columns @ both
        if self._tissue is not None and found.touching:
            answer += self._tissue.along(found)
        return answer[:, 0], answer[:, 1:]

    def stimulus(self, solution: DiscSolution) -> Array:
        """Return the stimulus of a contact, shape (k,)."""
        stimulus: Array = self._of_points @ solution.spread(self.contact.count).ravel()
        if self._tissue is not None and solution.touching:
            stimulus = stimulus + self._tissue.along(solution)[:, 0]
        return stimulus

    def solution(self, x: Array) -> DiscSolution:
        """Return the contact itself."""
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self.contact.solve(placed(self.device, self.device.pose(x))))
            self._tried = None  # its tangent may be another now
        return self._last[1]

    def _near(self, x: Array) -> DiscSolution:
        """Return the contact on the skin's tangent; skin that was at rest has none that says much of a touch."""
        if self.contact.points.stiff is None or self.contact.state.last is None:
            return self.solution(x)
        key = x.tobytes()
        if self._tried is None or self._tried[0] != key:
            self._tried = (key, self.contact.tried(placed(self.device, self.device.pose(x))))
        return self._tried[1]
