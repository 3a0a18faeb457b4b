"""PinLaw: pins under skin that follows the neo-Hookean law.

Such skin moves by G f - c, with c the law's difference from linear skin. While pin forces x are sought c is frozen: the
displacement wanted of linear skin is then the target's own plus c. The law is asked about the forces found, says the
next c, and both go on by turns until the law is satisfied. From frame to frame c is expected to go on changing
as it did, so on smooth ways one look is enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..contact.solver.law_frame import USABLE
from ..contact.solver.law_skin import LawSkin, LawState
from ..skin.law_tables import LawTables
from ..skin.model import SkinModel
from ..skin.stimulus import Stimulus

MOST_LOOKS = 12  # of a frame at the law


@dataclass(frozen=True, eq=False)
class PinLook:
    """Effect of pins on the skin by the law.

    Attributes:
        moved: displacement of the free nodes [m], shape (3 free,). amounts: see `Stimulus.given`, shape (3 m,).
        looks: number of evaluations of the law.
        left: remaining error of the law, relative to the energy of the forces.
        settled: whether this error is small.
        usable: whether it is near enough to the law to describe the tissue; else linear skin does.
    """

    moved: Floats32
    amounts: Array
    looks: int
    left: float
    settled: bool
    usable: bool = True

    def felt(self, skin: SkinModel, force: Array) -> Stimulus:
        """Return the stimulus of forces on the pad nodes [N] on a skin, of linear tissue where the law gives none."""
        return Stimulus(skin, force, None, self.amounts) if self.usable else Stimulus(skin.linear, force)


@dataclass(frozen=True, eq=False)
class PinLaw:
    """The law of one skin and the pins that press it.

    Attributes:
        tables: tables of the law.
        modulus: E alpha [Pa].
        pins: forces on the pad for unit forces of the active pins, A, shape (3 m, pins).
        chosen: which components of the free nodes are compared, shape (3 free,).
        rendered: L, displacement of these for unit forces of the pins, weighted, shape (3 n, pins).
        weights: roots of the nodes' weights, shape (3 n,).
    """

    tables: LawTables
    modulus: float
    pins: Array
    chosen: NDArray[np.bool_]
    rendered: Array
    weights: Array

    def skin(self) -> LawSkin:
        """Return the law at rest, to follow a path with."""
        return LawSkin(self.tables, self.modulus)

    def moved_by(self, force: Array, amounts: Array | None = None) -> Floats32:
        """Return the displacement under forces on the pad [N], shape (3 m,), as a touch has it, shape (3 free,)."""
        load = (np.asarray(force, np.float64) / self.modulus).astype(np.float32)
        given = self.tables.loaded(load) if amounts is None else np.asarray(amounts, np.float32)
        return self.tables.state(load, given)

    def goal(self, moved: Floats32, less: Floats32) -> Array:
        """Return the weighted displacement wanted of linear skin, shape (3 n,), for the target's and a frozen c."""
        return (moved + less).astype(np.float64)[self.chosen] * self.weights

    def apart(self, first: Floats32, second: Floats32) -> float:
        """Return the RMS over the compared nodes of how far two displacements are apart [m]."""
        off = (first - second).astype(np.float64)[self.chosen] * self.weights
        return float(np.sqrt(off @ off / (len(off) // 3)))

    def follow(self, law: LawSkin, before: LawState, forces: Callable[[Floats32], Array]) -> PinLook:
        """Take turns between pin forces and the law, until it is satisfied.

        Args:
            law: to ask. before: its state at the frame before. forces: tells pin forces x [N] for a frozen c.
        """
        law.restore(before)
        law.begin(ahead=1.0 if law.settled else 0.0)
        looks = 0
        for again in range(MOST_LOOKS):
            less = law.expected
            force = self.pins @ forces(less)
            looks += 1
            law.look(force.reshape(-1, 3))
            if law.settled or law.lost:
                break
            if again == MOST_LOOKS - 1:
                law.take_best()
        if not law.settled:
            less = law.expected
            force = self.pins @ forces(less)
        load = (force / self.modulus).astype(np.float32)
        pulled, left = self.tables.pulled(load), law.left
        if left <= USABLE:
            return PinLook(pulled - less, law.amounts, looks, left, law.settled)
        law.reset()
        return PinLook(pulled, np.zeros(len(force)), looks, left, False, False)
