"""Deformation and force matching: pin forces whose effect on skin is nearest to a target's.

All matrices that do not change from frame to frame are computed once, so that a frame needs only the contact forces f
of the target. With L = K^-1 A and the target's displacement u = G f, the right-hand side is c = (L'WG) f, and the
squared error is f'(G'WG) f - 2 c'x + x'Hx. The paper's personal factor alpha is a property of the skin
(`SkinModel.with_material`). It is contained in K and in the target's forces, so the pin forces suit this person.

Source: [S1] eq. 5-18 with corrections: eq. 18 has A'f, and pin forces are bounded from above as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..contact.solver.law_skin import LawSkin, LawState
from ..errors import DermisError
from ..interpolate import smoothstep
from ..skin.law_tables import LawTables
from .bounded_lsq import BoundedLeastSquares, BoundedSolution
from .pin_law import PinLaw, PinLook

Method = Literal["DM0", "DM1", "DM2", "FM0", "FM1", "FM2"]
METHODS: tuple[Method, ...] = get_args(Method)

RANK_TOLERANCE = 1e-10  # singular values below this share of the largest are rounding
# The gradient by the law is used where it promises a displacement error that is lower by more than this share. From
# twice this share on it is used in full, so that forces do not jump.
MAY_LEAVE = 0.02
# Residuals of the adjoint, see `Bend`: the rough one decides whether it pays to go on. Below the exact one, forces of
# pins differ by less than what the law's own tolerance leaves.
ROUGH, EXACT = 0.1, 3e-3


class PinStep(NamedTuple):
    """Command of the pins at one instant, as the solver returns it.

    Attributes:
        x: forces of the active pins [N], shape (active pins,).
        optimality, converged: as in `PinForces`.
        look: effect of the forces by the skin's nonlinear law; None for linear skin.
        displacement_error: u_err by the nonlinear law [m]; nan for linear skin, see `Matcher.displacement_error`.
    """

    x: Array
    optimality: float
    converged: bool
    look: PinLook | None = None
    displacement_error: float = float("nan")


@dataclass(frozen=True)
class PinForces:
    """Command of the pins at one instant.

    Attributes:
        forces: pin forces [N], shape (pins,).
        displacement_error: u_err of the rendered skin against the target [m] (eq. 20).
        force_error: f_err [N] (eq. 21).
        optimality: KKT residual, relative; 0 for the methods that only clamp.
        at_limit: number of pins at their upper bound.
        converged: whether the solver found the optimum; True for the methods that only clamp.
        look: effect of the forces by the skin's nonlinear law; None for linear skin.
    """

    forces: Array
    displacement_error: float
    force_error: float
    optimality: float
    at_limit: int
    converged: bool = True
    look: PinLook | None = None


class Matcher:
    """Precomputed matrices of one skin and one pin array.

    Args:
        distribution: A, nodal forces on the pad for unit pin forces, shape (3m, pins).
        influence: G, displacements of the compared nodes for unit forces on the pad [m/N], shape (3n, 3m).
        weights: W, one per compared node (ones as in the paper), shape (n,).
        active: pins that meet the skin, shape (pins,); the others stay at zero.
        tolerance: a pattern of pins is a right singular vector of A, and its gain is the singular value. A pattern
            whose gain is below this share of the largest is not controllable. DM0, DM1, FM0 and FM1 do not use it.
        law: tables of the skin's nonlinear law; None for linear skin.
        chosen: which components of the free nodes are compared, for nonlinear skin, shape (3 free,).
        modulus: E alpha of nonlinear skin [Pa].

    Attributes:
        law: correction by the nonlinear law; None for linear skin.
        controllable_patterns: number of controllable patterns.

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
        law: LawTables | None = None,
        chosen: NDArray[np.bool_] | None = None,
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
        # The matrix is large, so it is not copied if all weights are 1.
        plain = bool((weights == 1.0).all())
        weighted = influence if plain else np.sqrt(np.repeat(weights, 3))[:, None] * influence
        rendered = weighted @ a  # L, weighted
        self.deformation_gram = rendered.T @ rendered
        # In Fortran order, BLAS computes a frame's right-hand side in one pass over the matrix.
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
        self.law = None
        if law is not None and chosen is not None:
            self.law = PinLaw(law, modulus, a, chosen, rendered, np.sqrt(np.repeat(weights, 3)))
        if self.controllable_patterns == a.shape[1]:
            self.rendered_inverse = np.linalg.pinv(rendered, rcond=RANK_TOLERANCE)
        else:  # least squares over the controllable patterns
            self.rendered_inverse = patterns @ np.linalg.pinv(rendered @ patterns, rcond=RANK_TOLERANCE)
        self.deformation_inverse = self.rendered_inverse @ weighted

    def rhs(self, method: Method, force: Array) -> Array:
        """Return c of min 1/2 x'Hx - c'x for target pad forces [N], shape (3m,)."""
        matrix = self.deformation_rhs if method.startswith("DM") else self.force_rhs
        return self._gemv(1.0, matrix, force)

    def gram(self, method: Method) -> Array:
        """Return H of the method, shape (active pins, active pins)."""
        return self.deformation_gram if method.startswith("DM") else self.force_gram

    def displacement_error(self, force: Array, x: Array) -> Array:
        """Return u_err of frames on linear skin [m], shape (k,); for nonlinear skin see `law_error` and `PinStep`.

        Args:
            force: forces of the target on the pad nodes [N], shape (k, 3m).
            x: forces of the active pins [N], shape (k, pins).

        Source: [S1] eq. 20
        """
        return self._error(force, x, self.target_gram, self.deformation_rhs, self.deformation_gram)

    def pressed(self, x: Array) -> Array:
        """Return the forces of active pins on the pad nodes [N], shape (m, 3)."""
        return (self.force_rhs.T @ x).reshape(-1, 3)

    def law_error(self, force: Array, x: Array, amounts: NDArray[np.floating[Any]] | None = None) -> Array:
        """Return u_err of frames by the skin's own law [m], shape (k,); on linear skin as `displacement_error`.

        Args:
            force: forces of the target [N], shape (k, 3m).
            x: forces of the active pins [N], shape (k, pins).
            amounts: `Stimulus.given` of the target [m], shape (k, 3m); None computes it from the forces.
        """
        law = self.law
        if law is None:
            return self.displacement_error(force, x)
        out, skin = np.zeros(len(force)), law.skin()
        for i, (target, own) in enumerate(zip(force, x, strict=True)):
            wanted = law.moved_by(target, None if amounts is None else amounts[i])
            out[i] = law.apart(law.follow(skin, skin.save(), lambda less, own=own: own).moved, wanted)  # type: ignore[misc]
        return out

    def force_error(self, force: Array, x: Array) -> Array:
        """Return f_err of frames over the compared nodes [N], shape (k,).

        Arguments are those of `displacement_error`.

        Source: [S1] eq. 21
        """
        return self._error(force, x, None, self.force_rhs, self.force_gram)

    def _error(self, force: Array, x: Array, target: Array | None, cross: Array, gram: Array) -> Array:
        """Return the root of f'Tf - 2 f'C'x + x'Hx over the number of compared nodes, for all frames at once.

        Args:
            force, x: as in `displacement_error`.
            target: T, shape (3m, 3m); None for the identity.
            cross, gram: C and H, shapes (pins, 3m) and (pins, pins).
        """
        force, x = np.atleast_2d(force), np.atleast_2d(x)
        squared = np.einsum("ij,ij->i", force if target is None else force @ target, force)
        squared += np.einsum("ij,ij->i", x @ gram - 2.0 * (force @ cross.T), x)
        return np.sqrt(np.maximum(squared, 0.0) / self.nodes)


class PinSolver:
    """Pin forces along a track by one method; each frame starts from the one before.

    On nonlinear skin, DM2 searches a frame with the gradient of linear skin. Where the gradient by the law promises an
    error that is lower by more than `MAY_LEAVE`, it searches once more with that gradient.

    Args:
        matcher: matrices of the skin and the pins.
        method: DM0 and FM0 are unconstrained as printed, DM1 and FM1 are clamped, and DM2 and FM2 are optimal within
            the bounds.
        force_limit: largest force of a pin [N], one number or shape (pins,). None for the paper's form, which has no
            upper bound.
        slew: largest change of a pin's force between two calls [N]; None for no limit.

    Raises:
        DermisError: an unknown method.
    """

    # Without an upper bound a pin still needs a finite number. This one is far above the forces on a finger.
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
        self._law = None if matcher.law is None else matcher.law.skin()
        self._bent = None if matcher.law is None else matcher.law.skin()  # skin of the second search of a frame
        self._bends = False  # whether the last frame had a second search
        self._quadratic = BoundedLeastSquares(matcher.gram(method), 0.0, self.high) if method.endswith("2") else None

    def solve(self, force: Array, amounts: Array | None = None) -> PinForces:
        """Match a target and compute the errors.

        Args:
            force: forces of the target on the pad nodes [N], shape (3m,) or (m, 3).
            amounts: as in `step`.

        Raises:
            DermisError: forces of another size, or not finite.
        """
        matcher, force = self.matcher, np.asarray(force, dtype=np.float64).ravel()
        step = self.step(force, amounts)
        result = np.zeros(matcher.pins)
        result[matcher.active] = step.x
        linear = step.look is None
        return PinForces(
            result,
            float(matcher.displacement_error(force, step.x)[0]) if linear else step.displacement_error,
            float(matcher.force_error(force, step.x)[0]),
            step.optimality,
            self.at_limit(step.x),
            step.converged,
            step.look,
        )

    def step(self, force: Array, amounts: Array | None = None) -> PinStep:
        """Match a target without computing further errors, as fast as live frames require.

        Args:
            force: forces of the target on the pad nodes [N], shape (3m,).
            amounts: `Stimulus.given` of the target on skin with a nonlinear law [m], shape (3m,); None computes it from
                the forces.

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
        step = self._active(force) if self._law is None else self._by_law(self._law, force, amounts)
        self._last = step.x
        return step

    def at_limit(self, x: Array) -> int:
        """Return the number of active pins at their upper bound, from their forces [N], shape (pins,)."""
        return int((x >= self.high * (1 - 1e-12)).sum())

    def reset(self) -> None:
        """Return to rest, as before the first frame."""
        self._last = np.zeros(len(self.matcher.active))
        self._bends = False
        if self._law is not None:
            self._law.reset()

    def _by_law(self, skin: LawSkin, force: Array, amounts: Array | None) -> PinStep:
        """Match on nonlinear skin and compute u_err by its law."""
        law = self.matcher.law
        assert law is not None
        wanted = law.moved_by(force, amounts)
        if self.method.startswith("FM"):
            step = self._active(force)
            look = law.follow(skin, skin.save(), lambda _: step.x)
            return PinStep(step.x, step.optimality, step.converged, look, law.apart(look.moved, wanted))
        step = self._lagged(skin, skin.save(), wanted)
        pull = self._pull(step, wanted) if self.method == "DM2" else None
        bends, self._bends = self._bends, pull is not None
        if pull is None:
            return step
        assert self._bent is not None and step.look is not None
        near = skin.save()
        bent = self._lagged(self._bent, self._bent.save() if bends else near._replace(before=near.now), wanted, pull)
        assert bent.look is not None
        looks = step.look.looks + bent.look.looks
        if bent.look.usable and bent.displacement_error < step.displacement_error:
            step = bent
        assert step.look is not None
        return step._replace(look=replace(step.look, looks=looks))

    def _pull(self, step: PinStep, wanted: Floats32) -> Array | None:
        """Return what the gradient by the law adds to that of linear skin [m^2/N], shape (pins,); None for nothing.

        Displacement is nearly quadratic in the forces. The gradients then differ by twice the share of the correction
        in the displacement, and the error that this leaves is at most 2 share^2. The adjoint is not computed where this
        is below `MAY_LEAVE`.
        """
        law, look = self.matcher.law, step.look
        assert law is not None and look is not None
        if not look.usable or not step.displacement_error > 0.0 or not step.x.any():
            return None
        load = (self.matcher.pressed(step.x).ravel() / law.modulus).astype(np.float32)
        less = law.tables.pulled(load) - look.moved
        if 2.0 * law.share(look.moved, less) ** 2 <= MAY_LEAVE:
            return None
        downhill, bend = law.goal(wanted, less) @ law.rendered, law.bend(look.moved, wanted)
        if self._promised(step, downhill + bend.solve(ROUGH)) <= 0.5 * MAY_LEAVE:
            return None
        pull = bend.solve(EXACT)
        more = self._promised(step, downhill + pull)
        return None if more <= MAY_LEAVE else float(smoothstep(np.array(more / MAY_LEAVE - 1.0))) * pull

    def _promised(self, step: PinStep, downhill: Array) -> float:
        """Return by which share the displacement error of a step is above that of the optimum that a gradient promises.

        Args:
            step: the step.
            downhill: descent of half the squared error by the pins' forces, at no force [m^2/N], shape (pins,).
        """
        gram = self.matcher.deformation_gram
        way = self._best(downhill).x - step.x
        gained = float(2.0 * way @ (downhill - gram @ step.x) - way @ gram @ way)
        left = 1.0 - gained / (self.matcher.nodes * step.displacement_error**2)
        return float(1.0 / np.sqrt(max(left, 1e-12)) - 1.0)

    def _lagged(self, skin: LawSkin, before: LawState, wanted: Floats32, pull: Array | None = None) -> PinStep:
        """Match a displacement by the lagged correction.

        Args:
            skin: law of the skin; it ends in the state of this frame.
            before: its state before the frame.
            wanted: displacement of the virtual touch [m], shape (3 free,).
            pull: difference of the gradients that is added, see `Bend`; None for the gradient of linear skin.
        """
        law, step = self.matcher.law, PinStep(self._last, 0.0, True)
        assert law is not None

        def forces(less: Floats32) -> Array:
            nonlocal step
            goal = law.goal(wanted, less)
            if self._quadratic is None:
                step = self._plain(self.matcher.rendered_inverse @ goal)
            else:
                downhill = goal @ law.rendered
                step = self._best(downhill if pull is None else downhill + pull)
            return step.x

        look = law.follow(skin, before, forces)
        return PinStep(step.x, step.optimality, step.converged, look, law.apart(look.moved, wanted))

    def _active(self, force: Array) -> PinStep:
        matcher = self.matcher
        if self._quadratic is not None:
            return self._best(matcher.rhs(self.method, force))
        inverse = matcher.deformation_inverse if self.method.startswith("DM") else matcher.force_inverse
        return self._plain(inverse @ force)

    def _plain(self, x: Array) -> PinStep:
        if not np.isfinite(x).all():
            raise DermisError("the target's forces are not finite", where="pin matching")
        if self.method.endswith("0"):
            return PinStep(x, 0.0, True)
        return PinStep(np.clip(x, *self._bounds()), 0.0, True)

    def _best(self, c: Array) -> PinStep:
        assert self._quadratic is not None
        solution = self._bounded(c)
        optimality = solution.optimality(self._quadratic.box.low, self._quadratic.box.high)
        return PinStep(solution.x, optimality, solution.converged)

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
