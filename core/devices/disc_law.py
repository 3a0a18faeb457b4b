"""DiscLaw: skin that follows the neo-Hookean law under a disc: what it gives way less than linear skin at the points.

Contact is solved on linear skin with an offset c; the law then says which c the displacement wants. From frame to frame
c is expected to go on changing as it did, and what looks taught of the law goes along.
"""

from __future__ import annotations

from ..arrays import Array
from ..contact.solver.law_skin import LawSkin, LawState
from ..skin.law_tables import LawTables


class DiscLaw:
    """The law on the points of one skin.

    Args:
        tables: of its mesh. modulus: E alpha [Pa].
        nodal: forces on the nodes for forces on the points, shape (3 m, 3 n); None where they are the nodes.

    Attributes:
        rounds: how often the law was evaluated.
    """

    def __init__(self, tables: LawTables, modulus: float, nodal: Array | None) -> None:
        self._skin, self._nodal = LawSkin(tables, modulus), nodal
        self.rounds = 0

    @property
    def less(self) -> Array:
        """By how much less than linear skin the points give way now, c [m], shape (n, 3)."""
        c = self._skin.beyond
        # forces and displacement of points do the same work as those of the nodes
        return c if self._nodal is None else (c.ravel() @ self._nodal).reshape(-1, 3)

    @property
    def amounts(self) -> Array:
        """The same at the pad nodes, for the last forces, shape (3 m,)."""
        return self._skin.amounts

    @property
    def settled(self) -> bool:
        """Whether the law has what it wants."""
        return self._skin.settled

    @property
    def left(self) -> float:
        """What the law leaves of the last forces, over their own energy."""
        return self._skin.left

    def begin(self, state: LawState | None) -> None:
        """Begin a frame after a state; None at rest."""
        if state is None:
            self._skin.reset()
        else:
            self._skin.restore(state)
        self._skin.begin(ahead=1.0 if self._skin.settled else 0.0)

    def go_on(self, state: LawState | None) -> None:
        """Go back to a state, with its offset as it is; None at rest."""
        if state is None:
            self._skin.reset()
        else:
            self._skin.restore(state)

    def look_anew(self) -> None:
        """Forget how near the law was in this frame: the next look is at another pose."""
        self._skin.look_anew()

    def take_best(self) -> None:
        """Go to the offset that left least at this pose."""
        self._skin.take_best()

    def look(self, force: Array) -> bool:
        """Ask the law about forces on the pad nodes [N], shape (m, 3); return whether no step leads nearer."""
        self.rounds += 1
        self._skin.look(force)
        return self._skin.lost

    def save(self) -> LawState:
        """Return the state for the next frame."""
        return self._skin.save()
