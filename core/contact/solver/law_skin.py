"""LawSkin: correction of linear skin for the neo-Hookean law, frame by frame.

The displacement is u = C f - c, with the compliance C of linear skin and a correction c. Contact is solved on linear
skin with c held constant. The law is then evaluated for the contact forces (`LawTables`), and Anderson acceleration
gives the next c (`Relaxation`). A frame is done when the residual of the law is small. The next frame starts from an
extrapolated c: c is assumed to change in proportion to the movement of the pressing objects. On smooth paths one
evaluation of the law is then enough, and a frame costs little more than on linear skin. The differences between
evaluations, which Anderson acceleration uses, are passed on from frame to frame.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from ...arrays import Array, Floats32
from ...skin.law_tables import LawTables
from ...skin.model import SkinModel
from ...skin.relaxation import Relaxation, Taught

# Residual of the law, see `Miss.left`, at which a frame is done. The error of stress is then 1 %, that of force 0.3 %.
TOLERANCE = 5e-3
# Skin counts as folded below this ratio: work of the forces at the points of the smooth skin, over their work on the
# mesh by the law. Ratios from 0.94 to 2.6 were measured without a fold; they exceed 1 because the smooth skin is softer
# under small contacts.
FOLDED = 0.5
FASTER = 2.0  # largest factor by which the change of c may exceed that of the last frame in the extrapolation


class Fold(Enum):
    """Whether skin was folded in the last frame: pushed in on the mesh, and out where forces act; in words."""

    NONE = ""
    LEFT = (
        "contact has two solutions here, one with the skin folded into itself; the other one, found by "
        "pressing straight in, was used"
    )
    KEPT = "only a solution with skin folded into itself was found: its forces are too large"


class LawState(NamedTuple):
    """State that one frame leaves to the next.

    Attributes:
        felt: correction c with which contact was solved [m], shape (3 free,).
        now: the next c by the law [m], shape (3 free,).
        before: `now` of the frame before [m], shape (3 free,).
        left: residual of the law, see `LawSkin.left`.
        went: movement of the pressing objects, see `LawSkin.begin`, shape (6,); None if it is not known.
        taught: differences between evaluations of the law, see `Relaxation`.
        fold: whether the skin was folded.
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
    """Neo-Hookean law on the skin of one finger.

    Args:
        tables: tables of the skin's mesh.
        modulus: Young's modulus times the personal stiffness factor, E alpha [Pa].
        tolerance: residual at which a frame is done; None for `TOLERANCE`.

    Attributes:
        left: residual of the law at its last evaluation, relative to the forces' own energy, see `Miss.left`.
    """

    def __init__(self, tables: LawTables, modulus: float, tolerance: float | None = None) -> None:
        self.tables, self.modulus = tables, modulus
        self.tolerance = TOLERANCE if tolerance is None else tolerance
        self._none = np.zeros(tables.size, np.float32)
        self.reset()

    @classmethod
    def of(cls, skin: SkinModel, tolerance: float | None = None) -> LawSkin | None:
        """Return the law of a skin; None if the skin is linear."""
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
        """The current correction c at the pad nodes [m], shape (m, 3): displacement of linear skin minus own."""
        return self._c[self.tables.pad].reshape(-1, 3).astype(np.float64)

    @property
    def expected(self) -> Floats32:
        """The current correction c of all free nodes [m], shape (3 free,)."""
        return self._c

    @property
    def amounts(self) -> Array:
        """The correction c at the pad nodes for the last forces [m], see `Stimulus.given`, shape (3 m,)."""
        return self._state.felt[self.tables.pad].astype(np.float64)

    @property
    def settled(self) -> bool:
        """Whether the residual of the law is within the tolerance."""
        return self.left <= self.tolerance

    @property
    def lost(self) -> bool:
        """Whether no further step lowers the residual of the law."""
        return self._steps.lost

    @property
    def fold(self) -> Fold:
        """Whether the skin was folded in the last frame."""
        return self._state.fold

    def folded(self, work: float) -> bool:
        """Return whether skin is folded, from the work of the last forces at the points on which they act [J]."""
        return self.settled and self._state.work != 0.0 and work < FOLDED * abs(self._state.work)

    def note_fold(self, fold: Fold) -> None:
        """Store in the state of this frame whether its skin is folded."""
        self._state = self._state._replace(fold=fold)

    def begin(self, went: Array | None = None, ahead: float = 1.0) -> None:
        """Begin a frame.

        Args:
            went: mean movement of the pressing objects where they touch, and their rotation about there times a lever
                [m], shape (6,). The change of c in the last frame is extrapolated in proportion to it.
            ahead: factor of the extrapolation if this movement or the last one is not known; 0 for none.
        """
        self._start = last = self._state
        if went is not None and last.went is not None:
            ahead = min(max(float(went @ last.went) / max(float(last.went @ last.went), 1e-30), 0.0), FASTER)
        self._went = went
        self._c = last.now + np.float32(ahead) * (last.now - last.before)
        self._steps = Relaxation(last.taught)

    def look_anew(self) -> None:
        """Forget the best residual of this frame, because the forces are those of another contact now.

        The correction and the differences between evaluations are kept.
        """
        self._steps = Relaxation(self._steps.learned)

    def go_back(self) -> None:
        """Go back to the state at the begin of the frame."""
        self.restore(self._start)

    def look(self, force: Array) -> None:
        """Evaluate the law for forces on the pad nodes.

        If the residual is above the tolerance, c becomes the next iterate, or the best one if no step lowers it.

        Args:
            force: contact forces [N], shape (m, 3).
        """
        tables = self.tables
        load = (force.reshape(-1) / self.modulus).astype(np.float32)
        if not load.any():
            self.left = 1.0 if self._c.any() else 0.0  # with c = 0 something may touch
            self._c, self._steps = self._none, Relaxation()
            self._state = LawState(self._none, self._none, self._none, self.left)
            return
        with np.errstate(over="ignore", invalid="ignore"):  # a step may be too long; it is undone then
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
        """Use the correction of least residual of this frame."""
        if self._steps.best is None:  # nothing touched at the last evaluation
            return
        self._c, self.left = self._steps.best
        self._state = self._reached(self._c)

    def _reached(self, now: Floats32) -> LawState:
        """Return the state after contact was solved with c; `now` is the next c by the law."""
        return LawState(self._c, now, self._start.now, self.left, self._went, self._steps.learned)

    def give_up(self) -> None:
        """Continue as linear skin; the law counts as not settled."""
        self.reset()
        self.left = np.inf
        self._state = self._start = self._state._replace(left=self.left)
