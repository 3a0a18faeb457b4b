"""Deformation and force matching: pin forces whose effect on the skin is nearest to the target's.

Everything that does not change from frame to frame is folded into small matrices, so that a frame needs the contact
forces f of the target and nothing else: with L = K^-1 A and u = G f, the right-hand side is (L'WG) f and the squared
error f'(G'WG) f - 2 c'x + x'Hx. The paper's personal factor alpha is the skin's (`SkinModel.with_material`): it is in K
and in the target's forces, so pin forces come out as this person needs them.

Source: [S1] eq. 5-18 with the corrections: eq. 18 has A'f, and pins are bounded from above as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..skin.stiff_tables import StiffTables
from ..stiffening.tangent import StiffTangent
from .bounded_lsq import BoundedLeastSquares, BoundedSolution
from .pin_tissue import ROUNDS, SETTLED, PinTissue

Method = Literal["DM0", "DM1", "DM2", "FM0", "FM1", "FM2"]
METHODS: tuple[Method, ...] = get_args(Method)

RANK_TOLERANCE = 1e-10  # of the largest singular value: below it there is only rounding


class PinStep(NamedTuple):
    """What the pins shall do at one instant, as it comes from the solver.

    Attributes:
        x: forces of the active pins [N], shape (active pins,).
        optimality, converged: as in `PinForces`.
        goal: of skin that stiffens the forces that `Matcher.displacement_error` compares with; None of linear skin,
            where they are the target's.
    """

    x: Array
    optimality: float
    converged: bool
    goal: Array | None = None


@dataclass(frozen=True)
class PinForces:
    """What the pins shall do at one instant.

    Attributes:
        forces: [N], shape (pins,).
        displacement_error: u_err of the rendered skin against the target [m] (eq. 20).
        force_error: f_err [N] (eq. 21).
        optimality: KKT residual, relative; 0 for the methods that only clamp.
        at_limit: pins at their upper bound.
    """

    forces: Array
    displacement_error: float
    force_error: float
    optimality: float
    at_limit: int
    converged: bool = True


class Matcher:
    """The matrices of one skin and one pin array.

    Args:
        distribution: A, nodal forces on the pad for unit pin forces, shape (3m, pins).
        influence: G, displacements of the compared nodes for unit forces on the pad [m/N], shape (3n, 3m).
        weights: W, one per compared node (ones as in the paper), shape (n,).
        active: pins that meet the skin, shape (pins,); the others stay at zero.
        tolerance: patterns of pins whose gain on the pad, a singular value of A, is below this share of the largest
            are not controllable: DM0, DM1, FM0 and FM1 do without them.
        stiff: tables of skin that stiffens, of E alpha = `modulus` [Pa]; None where it is linear.

    Attributes:
        tissue: what stiffening changes; None of linear skin.
        controllable_patterns: how many patterns of pins are controllable.

    Raises:
        DermisError: shapes that do not fit, negative weights, or no active pin.
    """

    def __init__(
        self,
        distribution: Array,
        influence: Array,
        weights: Array | None = None,
        active: NDArray[np.bool_] | None = None,
        *,
        tolerance: float = RANK_TOLERANCE,
        stiff: StiffTables | None = None,
        modulus: float = 1.0,
    ) -> None:
        pins = distribution.shape[1]
        active = np.ones(pins, dtype=bool) if active is None else np.asarray(active, dtype=bool)
        nodes = len(influence) // 3
        weights = np.ones(nodes) if weights is None else np.asarray(weights, dtype=np.float64)
        if influence.shape[1] != len(distribution) or len(weights) != nodes or len(active) != pins:
            raise DermisError(
                "the pins' force distribution, the skin's influence and the weights do not fit",
                where="pin matching",
                value=f"{distribution.shape}, {influence.shape}, {weights.shape}",
            )
        if not active.any():
            raise DermisError("no pin meets the skin", where="pin matching")
        if (weights < 0).any() or not weights.any():
            raise DermisError("node weights must not be negative, nor all zero", where="pin matching")
        from scipy.linalg.blas import dgemv  # numpy may come without a BLAS

        self._gemv = dgemv
        self.pins, self.active, self.nodes = pins, np.flatnonzero(active), nodes
        self.loaded = len(distribution) // 3
        a = np.ascontiguousarray(distribution[:, self.active])
        # large: not copied where nothing is weighted
        plain = bool((weights == 1.0).all())
        weighted = influence if plain else np.sqrt(np.repeat(weights, 3))[:, None] * influence
        rendered = weighted @ a  # L, weighted
        self.deformation_gram = rendered.T @ rendered
        # in Fortran's order: a frame's right-hand side is then one pass of BLAS over the matrix
        self.deformation_rhs = np.asfortranarray(rendered.T @ weighted)  # L'WG
        self.target_gram = weighted.T @ weighted  # G'WG
        self.force_gram = a.T @ a
        self.force_rhs = np.asfortranarray(a.T)
        left, gains, right = np.linalg.svd(a, full_matrices=False)
        seen = gains > tolerance * gains[0]
        self.controllable_patterns = int(seen.sum())
        patterns = right[seen].T
        self.force_inverse = (patterns / gains[seen]) @ left[:, seen].T
        self.patterns = patterns
        self.tissue = None if stiff is None else PinTissue(stiff, modulus, a, self.target_gram)
        if self.controllable_patterns == a.shape[1]:
            self.deformation_inverse = np.linalg.pinv(rendered, rcond=RANK_TOLERANCE) @ weighted
        else:  # the least squares among what is left
            self.deformation_inverse = patterns @ (np.linalg.pinv(rendered @ patterns, rcond=RANK_TOLERANCE) @ weighted)

    def rhs(self, method: Method, force: Array) -> Array:
        """Return c of min 1/2 x'Hx - c'x for target pad forces [N], shape (3m,)."""
        matrix = self.deformation_rhs if method.startswith("DM") else self.force_rhs
        return self._gemv(1.0, matrix, force)

    def gram(self, method: Method) -> Array:
        """Return H of the method, shape (active pins, active pins)."""
        return self.deformation_gram if method.startswith("DM") else self.force_gram

    def displacement_error(self, force: Array, x: Array) -> Array:
        """Return u_err [m] of frames: pad forces f of the target, (k, 3m), against active pins' x, (k, pins); (k,).

        Of skin that stiffens f are the goals of the steps (`PinStep`), or from `goals`.

        Source: [S1] eq. 20
        """
        return self._error(force, x, self.target_gram, self.deformation_rhs, self.deformation_gram)

    def goals(self, force: Array, x: Array, amounts: NDArray[np.floating[Any]] | None = None) -> Array:
        """Return what `displacement_error` compares with: of skin that stiffens less than the target's forces.

        Args:
            force: of the target [N], shape (k, 3m). x: of the active pins [N], shape (k, pins).
            amounts: of each pattern in the target, shape (k, patterns); from the forces where None.
        """
        if self.tissue is None:
            return force
        given = [None] * len(force) if amounts is None else np.asarray(amounts, np.float64)
        rows = zip(force, x, given, strict=True)
        return np.array([self._goal(self.tissue, *row) for row in rows]).reshape(force.shape)

    def _goal(self, tissue: PinTissue, force: Array, x: Array, amounts: Array | None) -> Array:
        return tissue.like(force, tissue.taken_by(force, amounts) - tissue.settled(x))

    def force_error(self, force: Array, x: Array) -> Array:
        """Return f_err [N] of frames over the compared nodes, as `displacement_error`. Source: [S1] eq. 21."""
        return self._error(force, x, None, self.force_rhs, self.force_gram)

    def _error(self, force: Array, x: Array, target: Array | None, cross: Array, gram: Array) -> Array:
        """Expand |u - u*|^2 / n, all frames at once."""
        force, x = np.atleast_2d(force), np.atleast_2d(x)
        squared = np.einsum("ij,ij->i", force if target is None else force @ target, force)
        squared += np.einsum("ij,ij->i", x @ gram - 2.0 * (force @ cross.T), x)
        return np.sqrt(np.maximum(squared, 0.0) / self.nodes)


class PinSolver:
    """Pin forces along a track by one method, warm from frame to frame.

    Args:
        matcher: the matrices.
        method: DM0, FM0 unconstrained as printed; DM1, FM1 clamped; DM2, FM2 optimal within the bounds.
        force_limit: what a pin can do [N], one number or shape (pins,); None for the paper's unbounded form (only
            f >= 0).
        slew: largest change of a pin's force between two calls [N]; None for no limit.

    Raises:
        DermisError: an unknown method.
    """

    # an 'unbounded' pin still needs a finite number; far above any finger's forces
    UNBOUNDED = 1e6

    def __init__(
        self,
        matcher: Matcher,
        method: Method = "DM2",
        *,
        force_limit: float | Array | None = 0.4,
        slew: float | None = None,
    ) -> None:
        if method not in METHODS:
            raise DermisError("unknown matching method", where="pin matching", value=method, limit=", ".join(METHODS))
        self.matcher, self.method, self.slew = matcher, method, slew
        most = self.UNBOUNDED if force_limit is None else force_limit
        self.high = np.broadcast_to(np.asarray(most, np.float64), (matcher.pins,))[matcher.active]
        self._last = np.zeros(len(matcher.active))
        self._tangent = None if matcher.tissue is None else matcher.tissue.rest
        self._quadratic = BoundedLeastSquares(matcher.gram(method), 0.0, self.high) if method.endswith("2") else None
        self._status: NDArray[np.int8] | None = None

    def solve(self, force: Array, amounts: Array | None = None) -> PinForces:
        """Match target pad forces [N], shape (3m,) or (m, 3), and say how far off the skin is.

        Args:
            amounts: as in `step`.

        Raises:
            DermisError: forces of another size, or not finite.
        """
        matcher, force = self.matcher, np.asarray(force, dtype=np.float64).ravel()
        step = self.step(force, amounts)
        goal = force if step.goal is None else step.goal
        result = np.zeros(matcher.pins)
        result[matcher.active] = step.x
        return PinForces(
            result,
            float(matcher.displacement_error(goal, step.x)[0]),
            float(matcher.force_error(force, step.x)[0]),
            step.optimality,
            self.at_limit(step.x),
            step.converged,
        )

    def step(self, force: Array, amounts: Array | None = None) -> PinStep:
        """Match target pad forces [N], shape (3m,), and nothing else: what a frame costs live.

        Args:
            amounts: of each pattern that skin which stiffens is displaced by, shape (k,); from the forces where None.

        Raises:
            DermisError: forces of another size, or not finite.
        """
        if force.shape != (3 * self.matcher.loaded,):
            raise DermisError(
                "the target's forces do not fit the skin",
                where="pin matching",
                value=force.shape,
                limit=f"({3 * self.matcher.loaded},)",
            )
        tissue = self.matcher.tissue
        step = self._active(force) if tissue is None else self._bent(tissue, force, amounts)
        self._last = step.x
        return step

    def at_limit(self, x: Array) -> int:
        """Return how many pins are at their upper bound."""
        return int((x >= self.high * (1 - 1e-12)).sum())

    def reset(self) -> None:
        """Forget the frame before: the pins are at rest."""
        self._last = np.zeros(len(self.matcher.active))
        self._tangent = None if self.matcher.tissue is None else self.matcher.tissue.rest

    def _bent(self, tissue: PinTissue, force: Array, amounts: Array | None) -> PinStep:
        """Match the displacement of skin that stiffens, on its tangent, laid anew until the law of its tissue holds."""
        taken, settled = tissue.taken_by(force, amounts), False
        tangent, deforming = self._tangent or tissue.rest, self.method.startswith("DM")
        step = PinStep(self._last, 0.0, True) if deforming else self._active(force)
        for _ in range(ROUNDS):
            if deforming:
                step = self._on(tissue, tangent, tissue.like(force, taken))
            tangent, off = tissue.moved(tangent, step.x)
            settled = off <= SETTLED
            if settled:
                break
        self._tangent = tangent
        goal = tissue.like(force, taken - tissue.taken_at(tangent, step.x))
        return PinStep(step.x, step.optimality, step.converged and settled, goal)

    def _on(self, tissue: PinTissue, tangent: StiffTangent, goal: Array) -> PinStep:
        """Match displacement on a tangent by the method."""
        low, high = self._bounds()
        if self._quadratic is None:
            x = tissue.least_squares(tangent, goal, self.matcher.patterns, RANK_TOLERANCE)
            return PinStep(x if self.method.endswith("0") else np.clip(x, low, high), 0.0, True)
        gram, c = tissue.quadratic(tangent, goal)
        found = BoundedLeastSquares(gram, low, high).solve(c, start=self._status)
        self._status = found.status
        return PinStep(found.x, found.optimality(low, high), found.converged)

    def _active(self, force: Array) -> PinStep:
        matcher = self.matcher
        if self._quadratic is not None:
            solution = self._bounded(matcher.rhs(self.method, force))
            optimality = solution.optimality(self._quadratic.box.low, self._quadratic.box.high)
            return PinStep(solution.x, optimality, solution.converged)
        inverse = matcher.deformation_inverse if self.method.startswith("DM") else matcher.force_inverse
        x = inverse @ force
        if not np.isfinite(x).all():
            raise DermisError("the target's forces are not finite", where="pin matching")
        if self.method.endswith("0"):
            return PinStep(x, 0.0, True)
        return PinStep(np.clip(x, *self._bounds()), 0.0, True)

    def _bounded(self, c: Array) -> BoundedSolution:
        assert self._quadratic is not None
        if self.slew is None:
            return self._quadratic.solve(c)
        low, high = self._bounds()
        return self._quadratic.solve(c, low=low, high=high)

    def _bounds(self) -> tuple[Array, Array]:
        low, high = np.zeros_like(self._last), self.high
        if self.slew is not None:
            low, high = np.maximum(low, self._last - self.slew), np.minimum(high, self._last + self.slew)
        return low, high
