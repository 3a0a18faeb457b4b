"""PinLaw: pin forces for skin that follows the neo-Hookean law.

Forces f displace such skin by G f - c. G is the compliance of linear skin, and the correction c is the difference
between the linear and the nonlinear displacement. A frame is solved by a lagged correction: c is held constant while
the pin forces x are computed on linear skin. The target of this computation is the displacement of the virtual touch
plus c. The law is evaluated for these forces and gives the next c. Both steps alternate until the residual of the law
is small. A frame starts from the c that linear extrapolation of the last two frames predicts, so on smooth paths one
evaluation of the law is enough.

With c held constant, the search follows the gradient of linear skin. Where the correction is large, the gradient by the
law is another one, and pin forces exist that leave less. `Bend` computes the difference between both gradients with the
adjoint of the law's tangent, and `PinSolver` searches once more with it where this pays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..contact.solver.law_frame import USABLE
from ..contact.solver.law_skin import LawSkin, LawState
from ..skin.law_tables import TOLERANCE, LawTables
from ..skin.model import SkinModel
from ..skin.stimulus import Stimulus
from .pin_bend import Bend

MOST_LOOKS = 12  # largest number of evaluations of the law in one search


@dataclass(frozen=True, eq=False)
class PinLook:
    """Effect of pin forces on skin that follows a nonlinear law.

    Attributes:
        moved: displacement of the free nodes [m], shape (3 free,). It is that of linear skin if not `usable`.
        amounts: correction c at the pad nodes [m], see `Stimulus.given`, shape (3 m,).
        looks: number of evaluations of the law.
        left: residual of the law, relative to the forces' own energy, see `Miss.left`.
        settled: whether the residual is below the law's tolerance.
        usable: whether the residual is at most `USABLE`. If not, the effect is computed on linear skin.
    """

    moved: Floats32
    amounts: Array
    looks: int
    left: float
    settled: bool
    usable: bool = True

    def felt(self, skin: SkinModel, force: Array) -> Stimulus:
        """Return the stimulus of forces on the pad nodes.

        The forces [N] have the shape (m, 3). If not `usable`, the stimulus is that of linear elasticity.
        """
        return Stimulus(skin, force, None, self.amounts) if self.usable else Stimulus(skin.linear, force)


@dataclass(frozen=True, eq=False)
class PinLaw:
    """Nonlinear law of one skin, and the pins that press on it.

    Attributes:
        tables: tables of the law.
        modulus: Young's modulus times the personal stiffness factor, E alpha [Pa].
        pins: A, forces on the pad nodes for unit forces of the active pins, shape (3 m, pins).
        chosen: which components of the free nodes are compared, shape (3 free,).
        rendered: L, weighted displacement of the compared nodes for unit pin forces [m/N], shape (3 n, pins).
        weights: square roots of the compared nodes' weights, once for each component, shape (3 n,).
    """

    tables: LawTables
    modulus: float
    pins: Array
    chosen: NDArray[np.bool_]
    rendered: Array
    weights: Array

    def skin(self) -> LawSkin:
        """Return the law in its state at rest, to be advanced frame by frame."""
        return LawSkin(self.tables, self.modulus)

    def moved_by(self, force: Array, amounts: Array | None = None) -> Floats32:
        """Return the displacement of the free nodes by the law [m].

        The shape is (3 free,).

        Args:
            force: forces on the pad nodes [N], shape (3 m,).
            amounts: correction of the pad nodes [m], see `Stimulus.given`, shape (3 m,); None computes it.
        """
        load = (np.asarray(force, np.float64) / self.modulus).astype(np.float32)
        given = self.tables.loaded(load) if amounts is None else np.asarray(amounts, np.float32)
        return self.tables.state(load, given)

    def settles(self, force: Array) -> bool:
        """Return whether the law converges for forces that stay as they are.

        Args:
            force: forces on the pad nodes [N], shape (3 m,).
        """
        load = (np.asarray(force, np.float64) / self.modulus).astype(np.float32)
        moved = self.tables.state(load, self.tables.loaded(load))
        return not load.any() or self.tables.miss(moved, self.tables.pulled(load), load).left <= TOLERANCE

    def goal(self, moved: Floats32, less: Floats32) -> Array:
        """Return the weighted target displacement for linear skin [m].

        The shape is (3 n,).

        Args:
            moved: displacement of the virtual touch by the law [m], shape (3 free,).
            less: correction c, which is held constant [m], shape (3 free,).
        """
        return (moved + less).astype(np.float64)[self.chosen] * self.weights

    def apart(self, first: Floats32, second: Floats32) -> float:
        """Return the weighted RMS distance between two displacements [m].

        Only the compared nodes count.
        """
        off = (first - second).astype(np.float64)[self.chosen] * self.weights
        return float(np.sqrt(off @ off / (len(off) // 3)))

    def share(self, moved: Floats32, less: Floats32) -> float:
        """Return the size of a correction c, relative to that of the displacement of linear skin.

        Only the compared nodes count.

        Args:
            moved: displacement by the law [m], shape (3 free,).
            less: correction c [m], shape (3 free,).
        """
        linear = self.goal(moved, less)
        own = less.astype(np.float64)[self.chosen] * self.weights
        return float(np.linalg.norm(own) / max(float(np.linalg.norm(linear)), 1e-30))

    def bend(self, moved: Floats32, wanted: Floats32) -> Bend:
        """Return the difference between the gradients by the law and on linear skin, to be computed by `Bend.solve`.

        Args:
            moved: displacement u under the pins by the law, not zero everywhere [m], shape (3 free,).
            wanted: displacement of the virtual touch by the law [m], shape (3 free,).
        """
        off = np.zeros(len(moved), np.float32)
        off[self.chosen] = (wanted - moved)[self.chosen] * self.weights**2
        return Bend(self.tables, self.pins / self.modulus, moved, off)

    def follow(self, law: LawSkin, before: LawState, forces: Callable[[Floats32], Array]) -> PinLook:
        """Alternate between pin forces and the law until both agree.

        They agree if the residual of the law is small. The loop also ends when no step lowers the residual
        further, or after `MOST_LOOKS` evaluations of the law. The correction of least residual is then kept. If
        this residual is above `USABLE`, the result is that of linear skin, and `law` returns to rest.

        Args:
            law: law of the skin; it ends in the state of this frame.
            before: state of the law at the previous frame.
            forces: function that returns the pin forces x [N], shape (pins,), for a correction c [m], shape (3 free,).
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
