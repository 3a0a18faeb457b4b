"""Relaxation: fixed-point iteration with Anderson acceleration.

It finds the equilibrium of tissue with a nonlinear law. The basic step solves with the stiffness at rest. Anderson
acceleration corrects this step by the differences between earlier steps, which contain the stiffening of the tissue.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Floats32

# Initial share of the basic step that is taken. Some of the tissue is up to four times as stiff as at rest if it is
# pressed 2 mm deep. With half of the step the iteration does not diverge, and Anderson acceleration makes up for soft
# directions.
SHARE = 0.5
# LEARNED: largest number of differences for Anderson acceleration. HANDED: how many of them an earlier equilibrium may
# supply.
LEARNED, HANDED = 16, 8
FIRM = 3e-2  # regularisation: parts of a difference below this share of its size count as noise
# WORSE: if the residual is more than this factor times the best one, the iteration goes back to the best iterate and
# halves the share of the step. LEAST: the iteration stops if the share is below this value.
WORSE, LEAST = 3.0, 0.02


# Difference between two steps: changes of x, of the basic step `way` and of its forces `pull`.
Taught = tuple[Floats32, Floats32, Floats32]


class Relaxation:
    """Iteration for one equilibrium.

    Anderson acceleration uses the norm of the energy.

    Args:
        learned: differences between steps of a similar equilibrium.

    Attributes:
        lost: whether no step lowers the residual any further.
        best: iterate of least residual, and this residual, which is inf if it was not finite; None before the first
            step.
        learned: differences between steps; the latest is the last.

    Source: Anderson 1965
    """

    def __init__(self, learned: tuple[Taught, ...] = ()) -> None:
        self._share = SHARE
        self.learned = learned[-HANDED:]
        self._last: tuple[Floats32, Floats32, Floats32] | None = None
        self._way: Floats32 | None = None  # basic step from the best iterate
        self.best: tuple[Floats32, float] | None = None
        self.lost = False

    def next(self, x: Floats32, way: Floats32, pull: Floats32, left: float) -> Floats32:
        """Return the next iterate, shape (n,).

        Args:
            x: present iterate, shape (n,).
            way: basic step at x, from a solution with the stiffness K at rest, shape (n,).
            pull: forces of the basic step, K `way`, shape (n,).
            left: residual at x.
        """
        if not np.isfinite(left):
            left = np.inf
        if self.best is None or left < self.best[1]:
            self.best, self._way = (x, left), way
        elif not left <= WORSE * self.best[1]:
            self._share *= 0.5
            self.learned, self._last = (), None
            self.lost = self._share < LEAST
            assert self._way is not None
            return self.best[0] + np.float32(self._share) * self._way
        if left == np.inf:  # at the first iterate, so there is no better iterate to go back to
            self.lost = True
            return x
        if self._last is not None:
            taught = x - self._last[0], way - self._last[1], pull - self._last[2]
            self.learned = (*self.learned[1 - LEARNED :], taught)
        self._last = x, way, pull
        share = np.float32(self._share)
        if not self.learned:
            return x + share * way
        gone, ways, pulls = (np.array(rows) for rows in zip(*self.learned, strict=True))
        gram = (ways @ pulls.T).astype(np.float64)
        own = np.diag(gram)  # not above zero if the difference is rounding alone
        scale = np.where(own > 0.0, 1.0 / np.sqrt(np.maximum(own, 1e-300)), 0.0)
        firm = 0.5 * (gram + gram.T) * scale[:, None] * scale + FIRM * np.eye(len(gram))
        mix = (scale * np.linalg.solve(firm, scale * (pulls @ way))).astype(np.float32)
        return np.asarray(x + share * (way - mix @ ways) - mix @ gone)
