"""DiscLaw: correction of linear skin for the neo-Hookean law below a disc.

Contact is solved on linear skin with a constant correction c. The law is then evaluated and gives the next c, see
`LawSkin`. A frame starts from the c that is extrapolated from the last two frames.
"""

from __future__ import annotations

from ..arrays import Array
from ..contact.solver.law_skin import LawSkin, LawState
from ..skin.law_tables import LawTables


class DiscLaw:
    """Neo-Hookean law at the points of one skin.

    Args:
        tables: tables of the skin's mesh.
        modulus: Young's modulus times the personal stiffness factor, E alpha [Pa].
        nodal: maps forces on the points to forces on the pad nodes, shape (3 m, 3 n); None if the points are the nodes.

    Attributes:
        rounds: number of evaluations of the law.
    """

    def __init__(self, tables: LawTables, modulus: float, nodal: Array | None) -> None:
        self._skin, self._nodal = LawSkin(tables, modulus), nodal
        self.rounds = 0

    @property
    def less(self) -> Array:
        """The current correction c at the points [m], shape (n, 3).

        It is the displacement of linear skin minus that of this skin.
        """
        c = self._skin.beyond
        # Displacements are mapped by the transpose, so that the work at the points equals the work at the nodes.
        return c if self._nodal is None else (c.ravel() @ self._nodal).reshape(-1, 3)

    @property
    def amounts(self) -> Array:
        """The correction c at the pad nodes for the last forces [m], shape (3 m,)."""
        return self._skin.amounts

    @property
    def settled(self) -> bool:
        """Whether the residual of the law is within the tolerance."""
        return self._skin.settled

    @property
    def left(self) -> float:
        """Residual of the law at its last evaluation, see `LawSkin.left`."""
        return self._skin.left

    def begin(self, state: LawState | None) -> None:
        """Begin a frame from the state after the last frame; None for rest."""
        if state is None:
            self._skin.reset()
        else:
            self._skin.restore(state)
        self._skin.begin(ahead=1.0 if self._skin.settled else 0.0)

    def go_on(self, state: LawState | None) -> None:
        """Go back to a state, None for rest, without extrapolation."""
        if state is None:
            self._skin.reset()
        else:
            self._skin.restore(state)

    def look_anew(self) -> None:
        """Forget the best residual of this frame.

        The next evaluation is at another pose.
        """
        self._skin.look_anew()

    def take_best(self) -> None:
        """Use the correction of least residual at this pose."""
        self._skin.take_best()

    def look(self, force: Array) -> bool:
        """Evaluate the law for forces on the pad nodes [N], shape (m, 3).

        Returns:
            Whether no step lowers the law's residual any further.
        """
        self.rounds += 1
        self._skin.look(force)
        return self._skin.lost

    def save(self) -> LawState:
        """Return the state for the next frame."""
        return self._skin.save()
