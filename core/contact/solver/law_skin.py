"""LawSkin: what skin that follows the neo-Hookean law gives way less than linear skin, from frame to frame.

Contact is solved on linear skin from where the law leaves it: u = C f - c. The law then says what c the displacement
wants (`LawTables`); a frame is done when that is nearly the c that contact was solved with. The next frame expects c to
go on changing as it did, as far as what presses goes on as it did, so that on smooth ways one look is enough, at little
more than the price of linear skin; and what looks taught of the law goes from frame to frame.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from ...arrays import Array, Floats32
from ...skin.law_tables import LawTables
from ...skin.model import SkinModel
from ...skin.relaxation import Relaxation, Taught

# Of what the law leaves, see `Miss.left`, where a frame is done: stress is then a hundredth off, force a third of that.
TOLERANCE = 5e-3
# Work of the forces at the points of the smooth skin over their work on the mesh, by the law: .94 to 2.6 were measured,
# since the smooth skin is softer where little is touched. Below this the mesh is far from the skin it stands for.
FOLDED = 0.5
FASTER = 2.0  # times as far as in the last frame what presses may go before more is not expected of c either


class Fold(Enum):
    """How the last frame's skin has to do with a fold of itself, pushed in on the mesh and out where forces act."""

    NONE = 0
    LEFT = 1  # it is in balance on one too; straight pressing led to another balance, which was taken
    KEPT = 2  # no balance off it was found


class LawState(NamedTuple):
    """What one frame leaves to the next.

    Attributes:
        felt: c that contact was solved with. now: what the law wants of it, and before: wanted in the frame before,
            shapes (3 free,). left: see `LawSkin.left`.
        went: how what presses moved [m], shape (6,), None where that is not known. taught: what looks taught.
        fold: whether the skin was on a fold of itself.
        work: work of the forces on the mesh [J].
    """

    felt: Floats32
    now: Floats32
    before: Floats32
    left: float
    went: Array | None = None
    taught: tuple[Taught, ...] = ()
    fold: Fold = Fold.NONE
    work: float = 0.0


class LawSkin:
    """The law on one finger's skin.

    Args:
        tables: of its mesh. modulus: E alpha [Pa]. tolerance: of what the law leaves.

    Attributes:
        left: what the law left of the last forces that it was asked about, over their own energy.
    """

    def __init__(self, tables: LawTables, modulus: float, tolerance: float | None = None) -> None:
        self.tables, self.modulus = tables, modulus
        self.tolerance = TOLERANCE if tolerance is None else tolerance
        self._none = np.zeros(tables.size, np.float32)
        self.reset()

    @classmethod
    def of(cls, skin: SkinModel, tolerance: float | None = None) -> LawSkin | None:
        """Return that of a skin; None where it is linear."""
        return cls(skin.law, skin.material.modulus, tolerance) if skin.follows_law else None

    def reset(self) -> None:
        """Go back to rest."""
        self._state = self._start = LawState(self._none, self._none, self._none, 0.0)
        self._c = self._none
        self._went: Array | None = None
        self._steps = Relaxation()
        self.left = 0.0

    def save(self) -> LawState:
        """Return the state between two frames, for `restore`."""
        return self._state

    def restore(self, state: LawState) -> None:
        """Go back to a saved state."""
        self._state = self._start = state
        self._c, self.left, self._went = state.felt, state.left, state.went

    @property
    def beyond(self) -> Array:
        """By how much less than linear skin its pad nodes give way now, c [m], shape (m, 3)."""
        return self._c[self.tables.pad].reshape(-1, 3).astype(np.float64)

    @property
    def expected(self) -> Floats32:
        """The c that contact is solved with now, of all free nodes [m], shape (3 free,)."""
        return self._c

    @property
    def amounts(self) -> Array:
        """The same for the forces of the last frame, as a touch keeps it, shape (3 m,)."""
        return self._state.felt[self.tables.pad].astype(np.float64)

    @property
    def settled(self) -> bool:
        """Whether the law has what it wants."""
        return self.left <= self.tolerance

    @property
    def lost(self) -> bool:
        """Whether no step leads nearer to what it wants."""
        return self._steps.lost

    @property
    def fold(self) -> Fold:
        """How the last frame's skin has to do with a fold of itself."""
        return self._state.fold

    def folded(self, work: float) -> bool:
        """Return whether skin lies on a fold, from the work that the last forces do at the points they act on [J]."""
        return self.settled and self._state.work != 0.0 and work < FOLDED * abs(self._state.work)

    def note_fold(self, fold: Fold) -> None:
        """Keep in the state of this frame whether its skin is on a fold."""
        self._state = self._state._replace(fold=fold)

    def begin(self, went: Array | None = None, ahead: float = 1.0) -> None:
        """Begin a frame.

        Args:
            went: how what presses moved where it touched, and turned about there [m], shape (6,). c is expected to
                change as that does to the last frame's; where either is not known, as it did.
            ahead: times that, where it is not known; 0 for not at all.
        """
        self._start = last = self._state
        if went is not None and last.went is not None:
            ahead = min(max(float(went @ last.went) / max(float(last.went @ last.went), 1e-30), 0.0), FASTER)
        self._went = went
        self._c = last.now + np.float32(ahead) * (last.now - last.before)
        self._steps = Relaxation(last.taught)

    def look_anew(self) -> None:
        """Forget how near the law was in this frame, but not where: forces are other ones now."""
        self._steps = Relaxation(self._steps.learned)

    def go_back(self) -> None:
        """Go back to where the frame began."""
        self.restore(self._start)

    def look(self, force: Array) -> None:
        """Ask what the law leaves of forces on the pad nodes [N], shape (m, 3); where that is much, c is the next."""
        tables = self.tables
        load = (force.reshape(-1) / self.modulus).astype(np.float32)
        if not load.any():
            self.left = 1.0 if self._c.any() else 0.0  # without c something may touch all the same
            self._c, self._steps = self._none, Relaxation()
            self._state = LawState(self._none, self._none, self._none, self.left)
            return
        with np.errstate(over="ignore", invalid="ignore"):  # of a step too far, which is taken back
            pulled = tables.pulled(load)
            miss = tables.miss(pulled - self._c, pulled, load)
            following = self._steps.next(self._c, miss.way, miss.pull, miss.left)
        self.left = miss.left
        self._state = self._reached(following)._replace(
            work=float(load @ (pulled - self._c)[tables.pad]) * self.modulus
        )
        if self.settled:
            tables.remember(load, self._c[tables.pad], pulled - self._c)
        elif self.lost:
            self.take_best()
        else:
            self._c = following

    def take_best(self) -> None:
        """Go to what left least of all that this frame has seen."""
        if self._steps.best is None:  # nothing touched when it was asked last
            return
        self._c, self.left = self._steps.best
        self._state = self._reached(self._c)

    def _reached(self, now: Floats32) -> LawState:
        """Return the state where contact was solved with c, and the law wants `now`."""
        return LawState(self._c, now, self._start.now, self.left, self._went, self._steps.learned)

    def give_up(self) -> None:
        """Go on as linear skin, which never has what the law wants."""
        self.reset()
        self.left = np.inf
        self._state = self._start = self._state._replace(left=self.left)
