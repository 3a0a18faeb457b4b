"""ForwardModel: stimulus of the skin for a device's configuration.

`DirectModel` solves the contact; learned models have the same interface.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..arrays import Array
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice
from ..devices.disc_pose import DiscSolution, FrictionState, placed
from ..errors import DermisError
from ..kernels import records
from ..kernels.records import address
from ..skin.observation import Observer
from ..skin.stimulus import Stimulus


class ForwardModel(Protocol):
    """Interface of models of the stimulus for a configuration.

    Models return the stimulus and its derivative. The friction state is fixed beforehand.

    Source: [S0] 3.4, sigma(x, f).
    """

    @property
    def size(self) -> int:
        """Number of stimulus components, k."""
        ...

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state for the following evaluations."""
        ...

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the stimulus, shape (k,), and its derivative, shape (k, n).

        Args:
            x: configuration, shape (n,). The derivative is with respect to x.
        """
        ...


class DirectModel:
    """Forward model that solves the contact for each configuration.

    The derivative is computed by implicit differentiation. On skin that follows the neo-Hookean law, `evaluate` uses
    linear skin with the current correction of the contact, while `looked` and `stimulus` use the law.

    Args:
        device: the mechanism.
        contact: contact of the disc with the skin.
        observation: the observed quantities. For linear skin, a matrix that maps forces on the pad nodes to stimulus
            components, shape (k, 3 m), is enough. A search uses the same observation for a touch and for the disc.

    Raises:
        DermisError: the observation does not fit the skin, or is a matrix although the skin follows a law.
    """

    def __init__(self, device: DiscDevice, contact: DiscContact, observation: Array | Observer) -> None:
        self.observer = observation if isinstance(observation, Observer) else None
        matrix = observation.matrix if isinstance(observation, Observer) else observation
        nodes3 = 3 * contact.points.node_count
        if matrix.ndim != 2 or matrix.shape[1] != nodes3:
            raise DermisError(
                "the observation matrix does not fit the skin",
                where="direct model",
                value=matrix.shape,
                limit=f"(k, {nodes3})",
            )
        if contact.law is not None and self.observer is None:
            raise DermisError(
                "a matrix cannot observe neo-Hookean skin", where="direct model", remedy="Pass an Observer"
            )
        self.device, self.contact = device, contact
        self.observation_matrix = np.ascontiguousarray(matrix, np.float64)
        nodal, k = contact.points.nodal, len(matrix)
        self._of_points = self.observation_matrix if nodal is None else self.observation_matrix @ nodal
        # stimulus for unit forces on each point, shape (points, 3, k)
        self._by_force = np.ascontiguousarray(self._of_points.T).reshape(-1, 3, k)
        self._last: tuple[bytes, DiscSolution] | None = None
        self._told: tuple[DiscSolution, Array] | None = None
        self._felt: tuple[DiscSolution, Stimulus] | None = None

    @property
    def size(self) -> int:
        """Number of stimulus components."""
        return len(self.observation_matrix)

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state."""
        self.contact.hold(state)
        self._last = None

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the stimulus and its derivative, computed on linear skin."""
        found = self.solution(x)
        by_force = self._by_force[found.near].reshape(-1, self.size)
        answer = by_force.T @ found.answer.reshape(-1, found.answer.shape[2])
        self._told = found, answer[:, 0]
        return answer[:, 0], answer[:, 1:]

    def lend(self, search: records.SearchRecord) -> None:
        """Let a search of the kernels evaluate this model, see `DiscContact.lend`."""
        self.contact.lend(search)
        search.observation = address(self._by_force)

    def take(self, search: records.SearchRecord, numbers: Array, x: Array, stimulus: Array) -> None:
        """Keep the contact at the result of such a search.

        Args:
            search, numbers: the search, see `DiscContact.taken`.
            x: its result, shape (n,). stimulus: stimulus there, shape (k,).
        """
        found = self.contact.taken(search, numbers)
        if found is not None:
            self._last, self._told = (x.tobytes(), found), (found, stimulus)

    def linear(self, solution: DiscSolution) -> Array:
        """Return the stimulus of a contact's forces on linear skin, shape (k,)."""
        if self._told is not None and self._told[0] is solution:
            return self._told[1]
        return np.asarray(self._of_points @ solution.spread(self.contact.count).ravel())

    def stimulus(self, solution: DiscSolution) -> Array:
        """Return the stimulus of a contact, shape (k,).

        If the contact was solved by the law, the stimulus is computed by the law too.
        """
        if solution.amounts is None or self.observer is None or not solution.touching:
            return self.linear(solution)
        return self.observer.see(self.felt(self.observer, solution))

    def felt(self, observer: Observer, solution: DiscSolution) -> Stimulus:
        """Return the state of the skin in a contact.

        The last state is kept, because its stress is needed more than once.
        """
        if self._felt is None or self._felt[0] is not solution:
            made = Stimulus(observer.skin, self.contact.nodal(solution), None, solution.amounts)
            self._felt = solution, made
        return self._felt[1]

    def solution(self, x: Array) -> DiscSolution:
        """Return the contact solved on linear skin.

        On skin that follows a law, the current correction of the contact is used.
        """
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self.contact.tried(placed(self.device, self.device.pose(x))))
        return self._last[1]

    def looked(self, x: Array) -> DiscSolution:
        """Return the contact solved by the law.

        Later evaluations use the correction found here. On linear skin the result is that of `solution`.
        """
        if self.contact.law is None:
            return self.solution(x)
        key = x.tobytes()
        known = self._last[1] if self._last is not None and self._last[0] == key else None
        found = self.contact.solve(placed(self.device, self.device.pose(x)), known)
        self._last = key, found
        return found
