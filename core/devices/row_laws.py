"""RowLaws: skin that follows the neo-Hookean law under a batch of rows, each in a state of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices
from ..contact.solver.law_frame import USABLE
from ..contact.solver.law_skin import LawSkin
from .press_problem import PressPoints


class RowLaws:
    """The law of rows, and by how much less than linear skin each gives way.

    Args:
        points: points of the skin, which follows a nonlinear law.
        columns: indices of their components, in the order of the rows.
        count: number of rows, all at rest.

    Attributes:
        less: at these components [m], shape (n, c).
    """

    def __init__(self, points: PressPoints, columns: Indices, count: int) -> None:
        assert points.law is not None
        self.points, self.columns = points, columns
        self._laws = [LawSkin(points.law, points.modulus) for _ in range(count)]
        self.less = np.zeros((count, len(columns)))

    def begin(self) -> None:
        """Begin the next part of the way: every offset is expected to go on changing as it did.

        Where the law's residual was large, the row goes on from linear skin: an offset that is wrong makes forces
        that are, and those make the next offset worse.
        """
        for row, law in enumerate(self._laws):
            if not law.left <= USABLE:
                law.reset()
            law.begin(ahead=1.0 if law.settled else 0.0)
            self.less[row] = self._at(law, self.columns)

    def look(self, rows: Indices, force: Floats32) -> NDArray[np.bool_]:
        """Ask the law about forces (n, c) [N] of some rows; return which of them are done, settled or not, (n,)."""
        done = np.zeros(len(rows), bool)
        for at, (row, nodal) in enumerate(zip(rows.tolist(), self._nodal(force), strict=True)):
            law = self._laws[row]
            if not law.lost:
                law.look(nodal.reshape(-1, 3))
                done[at] = law.settled
                if not law.settled:
                    self.less[row] = self._at(law, self.columns)
            else:  # this was the contact where least was left
                done[at] = True
        return done

    def look_anew(self) -> None:
        """Forget how near the law was: forces are those of another touch.

        Rows of large residual keep it: they are held back by knowing when a step leads farther off.
        """
        for law in self._laws:
            if law.left <= USABLE:
                law.look_anew()

    def take_best(self, rows: Indices) -> None:
        """Go to the offsets that left least in some rows."""
        for row in rows.tolist():
            self._laws[row].take_best()
            self.less[row] = self._at(self._laws[row], self.columns)

    def left(self, rows: Indices) -> Array:
        """Return the law's residual of rows that it did not settle for, over the forces' own energy, else 0, (n,)."""
        laws = [self._laws[row] for row in rows.tolist()]
        return np.array([0.0 if law.settled else law.left for law in laws])

    def less_at(self, columns: Indices) -> Array:
        """Return the offsets at other components of the points [m], shape (n, d)."""
        return np.stack([self._at(law, columns) for law in self._laws])

    @property
    def amounts(self) -> Floats32:
        """The amounts that each row keeps, see `Stimulus.given`, shape (n, 3 m)."""
        return np.stack([law.amounts for law in self._laws]).astype(np.float32)

    def _at(self, law: LawSkin, columns: Indices) -> Array:
        beyond, nodal = law.beyond.ravel(), self.points.nodal
        return beyond[columns] if nodal is None else beyond @ nodal[:, columns]

    def _nodal(self, force: Floats32) -> Array:
        """Return forces on the pad nodes for forces at the components, shapes (n, c) to (n, 3 m)."""
        if self.points.nodal is not None:
            return np.asarray(force @ self.points.nodal[:, self.columns].T, np.float64)
        out = np.zeros((len(force), self.points.positions.size))
        out[:, self.columns] = force
        return out
