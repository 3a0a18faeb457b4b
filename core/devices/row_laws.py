"""RowLaws: corrections by the neo-Hookean law for a batch of rows.

Each row has its own state of the law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices
from ..contact.solver.law_frame import USABLE
from ..contact.solver.law_skin import LawSkin
from .press_problem import PressPoints


class RowLaws:
    """Nonlinear laws of a batch of rows, and their corrections.

    Args:
        points: points of the skin, which has a nonlinear law.
        columns: indices of the points' components, in the order of `less`, shape (c,).
        count: number of rows, n, all at rest.

    Attributes:
        less: correction of each row at these components [m], shape (n, c): displacement of linear skin minus own.
    """

    def __init__(self, points: PressPoints, columns: Indices, count: int) -> None:
        assert points.law is not None
        self.points, self.columns = points, columns
        self._laws = [LawSkin(points.law, points.modulus) for _ in range(count)]
        self.less = np.zeros((count, len(columns)))

    def begin(self) -> None:
        """Begin the next step with extrapolated corrections.

        A row whose residual was large begins with linear skin, since a wrong correction gives wrong forces, and these a
        worse correction.
        """
        for row, law in enumerate(self._laws):
            if not law.left <= USABLE:
                law.reset()
            law.begin(ahead=1.0 if law.settled else 0.0)
            self.less[row] = self._at(law, self.columns)

    def look(self, rows: Indices, force: Floats32) -> NDArray[np.bool_]:
        """Evaluate the law for some rows.

        Args:
            rows: indices of the rows, shape (k,).
            force: forces at the components [N], shape (k, c).

        Returns:
            Whether each row is done, with a converged law or not, shape (k,).
        """
        done = np.zeros(len(rows), bool)
        for at, (row, nodal) in enumerate(zip(rows.tolist(), self._nodal(force), strict=True)):
            law = self._laws[row]
            if not law.lost:
                law.look(nodal.reshape(-1, 3))
                done[at] = law.settled
                if not law.settled:
                    self.less[row] = self._at(law, self.columns)
            else:  # these are the forces for the best correction
                done[at] = True
        return done

    def look_anew(self) -> None:
        """Forget the best residuals, since the contact has changed.

        Rows with a large residual keep it, so that steps that raise it are still undone.
        """
        for law in self._laws:
            if law.left <= USABLE:
                law.look_anew()

    def take_best(self, rows: Indices) -> None:
        """Use the corrections of least residual in some rows."""
        for row in rows.tolist():
            self._laws[row].take_best()
            self.less[row] = self._at(self._laws[row], self.columns)

    def left(self, rows: Indices) -> Array:
        """Return the residuals of the law in rows, shape (k,).

        They are 0 for rows in which the law converged.
        """
        laws = [self._laws[row] for row in rows.tolist()]
        return np.array([0.0 if law.settled else law.left for law in laws])

    def less_at(self, columns: Indices) -> Array:
        """Return the corrections at other components of points [m], shape (n, d)."""
        return np.stack([self._at(law, columns) for law in self._laws])

    @property
    def amounts(self) -> Floats32:
        """Correction of each row at the pad nodes [m], shape (n, 3 m).

        See `Stimulus.given`.
        """
        return np.stack([law.amounts for law in self._laws]).astype(np.float32)

    def _at(self, law: LawSkin, columns: Indices) -> Array:
        beyond, nodal = law.beyond.ravel(), self.points.nodal
        return beyond[columns] if nodal is None else beyond @ nodal[:, columns]

    def _nodal(self, force: Floats32) -> Array:
        """Return forces on the pad nodes [N], shape (n, 3 m).

        Args:
            force: forces at the components [N], shape (n, c).
        """
        if self.points.nodal is not None:
            return np.asarray(force @ self.points.nodal[:, self.columns].T, np.float64)
        out = np.zeros((len(force), self.points.positions.size))
        out[:, self.columns] = force
        return out
