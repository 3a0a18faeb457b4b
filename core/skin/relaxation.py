"""Relaxation: steps towards a balance with the stiffness at rest, which learn from each other what that leaves out."""

from __future__ import annotations

import numpy as np

from ..arrays import Floats32

# Of the way that the stiffness at rest asks for. Tissue that is pressed 2 mm is up to four times as stiff in places:
# half of the way never leads farther off, and what is soft is then learned.
SHARE = 0.5
LEARNED, HANDED = 16, 8  # steps that a next one learns from, and those of them that come from another balance at most
FIRM = 3e-2  # of a step's size, below which what it taught is noise
WORSE, LEAST = 3.0, 0.02  # what is left may grow so much before the way back, and a share so small leads nowhere


# From one step to the next: how x, the way that was asked for from there and the forces of that changed.
Taught = tuple[Floats32, Floats32, Floats32]


class Relaxation:
    """One balance, sought from some x on (Anderson 1965, least in the energy's own norm).

    Args:
        learned: what another balance near this one taught.

    Attributes:
        lost: no step leads nearer. best: the x that left least, and what it left, inf where that is no number.
        learned: what steps taught, the last of them last.
    """

    def __init__(self, learned: tuple[Taught, ...] = ()) -> None:
        self._share = SHARE
        self.learned = learned[-HANDED:]
        self._last: tuple[Floats32, Floats32, Floats32] | None = None
        self._way: Floats32 | None = None  # from the best
        self.best: tuple[Floats32, float] | None = None
        self.lost = False

    def next(self, x: Floats32, way: Floats32, pull: Floats32, left: float) -> Floats32:
        """Return where to look next.

        Args:
            x: where it was looked now, shape (n,). way: that the stiffness at rest asks for from there, shape (n,).
            pull: the forces of that, K way, shape (n,). left: how far from balance x is.
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
        if left == np.inf:  # from the first: there is no way back
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
        own = np.diag(gram)  # not above zero where it is rounding alone, which teaches nothing
        scale = np.where(own > 0.0, 1.0 / np.sqrt(np.maximum(own, 1e-300)), 0.0)
        firm = 0.5 * (gram + gram.T) * scale[:, None] * scale + FIRM * np.eye(len(gram))
        mix = (scale * np.linalg.solve(firm, scale * (pulls @ way))).astype(np.float32)
        return np.asarray(x + share * (way - mix @ ways) - mix @ gone)
