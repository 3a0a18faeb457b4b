"""Active-set Gauss-Newton search for a thimble's pose within servo limits.

The unknowns are the three values of the device's configuration. Each step minimises the linearised mismatch subject to
the linearised servo limits. This quadratic program is solved exactly; a line search on the true mismatch follows. Every
trial point keeps the servo limits, and the mismatch never rises.

Source: [S0] 5.2
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice
from ..devices.thimble import Thimble
from ..errors import DermisError

Evaluate = Callable[[Array], tuple[Array, Array]]

OPTIMAL = 3e-3  # KKT residual at which the search ends
# Length of a step at which the search ends: tilt [rad], distance over the platform's radius. 0.006 degrees or 1 um.
SMALL_STEP = 1e-4
# Mismatch relative to the target at which the search ends as exact. Contact is solved to the same accuracy.
EXACT = 1e-6
# Reduction of the cost by one step at which the search ends, as a share; 0.05 % of the mismatch. At a kink, where a
# node is about to slip, steps are short and gain hardly anything.
SMALL_GAIN = 1e-3
# Share of the cost, 0.13 % of the mismatch. A step that promises a smaller reduction is not tried. Where a full step
# gains no more than this, the KKT residual is at most 0.05.
HARDLY = 2.5e-3
# The same share for steps after the first, if another frame follows; 0.5 % of the mismatch.
LATER = 1e-2
# Smallest reach, and the reach from which a full step is tried first; both are shares of a full step, see `reach_of`.
LEAST_REACH, NEARLY = 0.25, 0.8
MAX_ITERATIONS = 20
MAX_EVALUATIONS = 16  # bounds the time of a frame; longer searches creep along kinks for hardly any gain
SHORTEST = 1.0 / 64.0  # shortest share of a step that is tried
LONGEST = 0.35  # longest step [rad]; no linearisation holds farther
ARMIJO = 1e-4  # share of the predicted reduction that a step must reach
DAMPING = 1e-9  # share of the largest diagonal element; keeps a step unique if only one node touches
ON_LIMIT = 1e-9  # a start may violate a limit by this much [rad]
RESTORING = 4  # attempts to bring a point back within the limits
GIVES_WAY = 6  # the constraint that keeps the platform from giving way


@dataclass(frozen=True)
class Minimum:
    """Result of a search for a configuration, with the quantities that verify it.

    Shapes are those of a thimble, which has three freedoms and seven constraints.

    Attributes:
        x: configuration (pitch, roll, distance), shape (3,).
        joints: values of the joints there, from neutral [rad or m], shape (3,).
        stimulus: stimulus at x, shape (k,).
        residual: stimulus minus target, shape (k,).
        start_cost, cost: half the squared mismatch at the start and at the end.
        kkt: KKT residual |S (J'r - A'multipliers)| / (|J S| |r|), with the multipliers of the step that would come
            next; 0 at an exact minimum. S scales distance to tilt. For 'exact', r is rounding, and the value is
            |r| / |target|. For 'foreseen', the value is that of the last point at which the model was evaluated.
        active: indices of the active constraints; `GIVES_WAY` is the singularity margin.
        multipliers: Lagrange multipliers of the active constraints, >= 0.
        room: values c(x) of the constraints, >= 0, shape (7,).
        iterations: number of steps.
        evaluations: number of evaluations of the forward model.
        why: reason for the end of the search:
            'optimal' (the KKT residual is small), 'exact' (the mismatch is zero up to rounding), 'step' (the last step
            was short), 'gain' (the last or the next step gains hardly anything), 'stalled' (no descent, as at a kink),
            'limit' (the largest number of steps or evaluations), 'foreseen' (the last step was accepted without an
            evaluation; stimulus and cost are those of the linearised model), 'underway' (the servos cannot reach the
            minimum within one frame; start_cost is then cost, and kkt is 0), or 'edge' (the minimum lies outside a
            recording; start_cost and kkt as for 'underway').
        reach: share of a full step that minimises the cost, as estimated from the last trial; 1 without an estimate.
        jacobian: derivative of the stimulus with respect to the configuration, at the last point at which the model was
            evaluated and accepted, shape (k, n).
    """

    x: Array
    joints: Array
    stimulus: Array
    residual: Array
    start_cost: float
    cost: float
    kkt: float
    active: tuple[int, ...]
    multipliers: Array
    room: Array
    iterations: int
    evaluations: int
    why: str
    reach: float
    jacobian: Array

    @property
    def mismatch(self) -> float:
        """Norm of the residual, in the stimulus's unit."""
        return math.sqrt(2.0 * self.cost)


@dataclass(frozen=True)
class ServoLimits:
    """Bounds of the joints.

    Attributes:
        low, high: from neutral, angles of servos [rad] or lengths of legs [m], shape (n,) each.
    """

    low: Array
    high: Array

    @classmethod
    def of(cls, device: DiscDevice) -> ServoLimits:
        """Return the whole range of a device's joints."""
        return cls(*device.servo_limits)

    def near(self, angles: Array, change: float) -> ServoLimits:
        """Return the limits for one frame, in which no joint may change by more than `change`.

        Args:
            angles: joints in the frame before, from neutral [rad or m], shape (n,).
            change: largest change of a joint [rad or m].
        """
        return ServoLimits(np.maximum(self.low, angles - change), np.minimum(self.high, angles + change))

    def constraints(self, device: DiscDevice, x: Array) -> tuple[Array, Array]:
        """Return the constraints c(x) and their derivative within these bounds, see the device's `constraints`.

        For a thimble the shapes are (7,) and (7, 3).

        Raises:
            DermisError: a leg cannot reach.
        """
        return device.constraints(x, self.low, self.high)


def minimise(
    evaluate: Evaluate,
    target: Array,
    start: Array,
    device: Thimble,
    limits: ServoLimits | None = None,
    *,
    tolerance: float = OPTIMAL,
    max_iterations: int = MAX_ITERATIONS,
    max_evaluations: int = MAX_EVALUATIONS,
) -> Minimum:
    """Find the configuration whose stimulus is nearest to a target.

    Args:
        evaluate: function that returns the stimulus, shape (k,), and its derivative, shape (k, 3), of a configuration.
        target: stimulus to approximate, shape (k,).
        start: configuration to start from, within the limits, shape (3,).
        device: the thimble.
        limits: limits of the servos; None for their whole range.
        tolerance: KKT residual at which the search ends.
        max_iterations, max_evaluations: largest number of steps, and of evaluations of the model.

    Raises:
        DermisError: the start is outside the limits.
    """
    limits = limits or ServoLimits.of(device)
    x = np.array(start, dtype=np.float64)
    room, slopes = limits.constraints(device, x)
    if room.min() < -ON_LIMIT:
        raise DermisError(
            "the start is outside the servos' range",
            where="thimble",
            value=f"{np.degrees(room.min()):.3g} deg of room",
            limit=">= 0",
        )
    stimulus, jacobian = evaluate(x)
    scale = np.array([1.0, 1.0, device.platform_radius])
    size = max(float(np.sqrt(target @ target)), 1e-300)
    residual = stimulus - target
    start_cost = cost = 0.5 * float(residual @ residual)
    evaluations, iterations, why = 1, 0, "limit"
    guess: tuple[int, ...] = ()
    while True:
        scaled = jacobian * scale
        step, guess, multipliers, gradient_left = _quadratic_program(scaled, residual, room, slopes * scale, guess)
        length = np.sqrt(residual @ residual)
        weight = float(np.sqrt(np.vdot(scaled, scaled)) * length)
        kkt = gradient_left / weight if weight > 0 else 0.0
        if length <= EXACT * size:
            break
        if kkt <= tolerance:
            why = "optimal"
            break
        if iterations >= max_iterations or evaluations >= max_evaluations:
            break
        step_length = float(np.sqrt(step @ step))
        if step_length > LONGEST:
            step = step * (LONGEST / step_length)
        wanted = ARMIJO * float(-(residual @ (scaled @ step)))
        share, found = 1.0, False
        while share >= SHORTEST:
            trial = _restored(x + share * scale * step, device, limits, scale)
            if trial is not None:
                new_stimulus, new_jacobian = evaluate(trial[0])
                evaluations += 1
                new_residual = new_stimulus - target
                new_cost = 0.5 * float(new_residual @ new_residual)
                # A pose without contact has no gradient that would lead back to contact, so it is never accepted.
                if new_cost <= cost - share * max(wanted, 0.0) and new_cost < cost and new_jacobian.any():
                    found = True
                    break
            if share * step_length < SMALL_STEP or evaluations >= max_evaluations:
                break
            share *= 0.5 if trial is None else shorter(share, cost, new_cost, wanted / ARMIJO)
        iterations += 1
        if not found or trial is None:
            why = "step" if step_length <= SMALL_STEP else "limit" if evaluations >= max_evaluations else "stalled"
            break
        moved = float(np.sqrt((((trial[0] - x) / scale) ** 2).sum()))
        gained = 1.0 - new_cost / cost
        x, room, slopes = trial
        stimulus, jacobian, residual, cost = new_stimulus, new_jacobian, new_residual, new_cost
        if moved <= SMALL_STEP:
            why = "step"
            break
        if gained <= SMALL_GAIN:
            why = "gain"
            break
    if (left := math.sqrt(2.0 * cost) / size) <= EXACT:
        why, kkt = "exact", left
    return Minimum(
        x,
        limits.high - room[:3],
        stimulus,
        residual,
        start_cost,
        cost,
        float(kkt),
        guess,
        multipliers,
        room,
        iterations,
        evaluations,
        why,
        1.0,
        jacobian,
    )


def shorter(share: float, cost: float, new_cost: float, descent: float) -> float:
    """Return the factor by which to shorten a step, 0.1 to 0.5.

    The factor leads to the minimum of the parabola through the costs at both ends of the step and the slope at its
    start.

    Args:
        share: share of a full step that was tried.
        cost, new_cost: cost at the start and at the end.
        descent: rate at which the cost falls at the start, for a full step.
    """
    curve = new_cost - cost + share * descent
    return float(min(max(0.5 * share * descent / curve, 0.1), 0.5)) if curve > 0 else 0.5


def promised(share: float, cost: float, new_cost: float, descent: float) -> float:
    """Return how far the parabola of a step falls below the cost at its start; inf if it has no minimum.

    Parabola and arguments are those of `shorter`.
    """
    curve = new_cost - cost + share * descent
    return 0.25 * (share * descent) ** 2 / curve if curve > 0 else math.inf


def reach_of(share: float, cost: float, new_cost: float, descent: float) -> float:
    """Return the share of a full step at which its parabola is least, from `LEAST_REACH` to 1.

    A touch that no pose can render leaves a large residual. Gauss-Newton neglects the curvature that this residual
    adds, and its steps are then too long. The reach of one step is used for the next step, and for the next frame.
    Parabola and arguments are those of `shorter`.
    """
    curve = new_cost - cost + share * descent
    return min(max(0.5 * share * share * descent / curve, LEAST_REACH), 1.0) if curve > 0 else 1.0


def _restored(x: Array, device: Thimble, limits: ServoLimits, scale: Array) -> tuple[Array, Array, Array] | None:
    """Move a point back onto limits that it violates because their linearisation is not exact.

    Returns:
        The point, its constraints and their derivative; None if it still violates a limit after `RESTORING` attempts.
    """
    for _ in range(RESTORING):
        try:
            room, slopes = limits.constraints(device, x)
        except DermisError:
            return None
        over = np.flatnonzero(room < 0.0)
        if len(over) == 0:
            return x, room, slopes
        rows = slopes[over] * scale
        x = x + scale * np.linalg.lstsq(rows, ON_LIMIT / 100 - room[over], rcond=None)[0]
    return None


def _quadratic_program(
    jacobian: Array, residual: Array, room: Array, slopes: Array, guess: tuple[int, ...]
) -> tuple[Array, tuple[int, ...], Array, float]:
    """Minimise |J d + r| subject to room + slopes d >= 0 exactly, by trying sets of active limits.

    Returns:
        The step d, the active limits, their multipliers, and the norm of J'r - A'multipliers.
    """
    gram = jacobian.T @ jacobian
    gram.flat[::4] += DAMPING * max(float(gram.max()), 1e-300)
    gradient = jacobian.T @ residual
    room = np.maximum(room, 0.0)
    best: tuple[Array, tuple[int, ...], Array] | None = None
    step = np.zeros(3)
    if gram[0, 0] > 0.0:
        step = np.asarray(np.linalg.solve(gram, -gradient), dtype=np.float64)
    if (room + slopes @ step).min() >= 0.0:  # most steps meet no limit
        return step, (), np.zeros(0), float(np.sqrt(gradient @ gradient))
    for working in _working_sets(guess):
        k = len(working)
        system, right = np.zeros((3 + k, 3 + k)), np.concatenate([-gradient, -room[list(working)]])
        system[:3, :3] = gram
        weight = float(np.sqrt(gram.max()))
        if k:
            # The rows of the constraints are scaled like the Gram matrix, so that they do not worsen the condition.
            system[3:, :3] = slopes[list(working)] * weight
            system[:3, 3:] = -system[3:, :3].T
            right[3:] *= weight
        try:
            answer = np.asarray(np.linalg.solve(system, right), dtype=np.float64)
        except np.linalg.LinAlgError:
            continue
        step, multipliers = answer[:3], answer[3:] * weight
        if (multipliers < 0.0).any():
            continue
        after = room + slopes @ step
        after[list(working)] = 0.0
        if after.min() >= -1e-12:
            best = (step, working, multipliers)
            break
    if best is None:  # only by rounding where limits meet: no step, since every limit holds here
        best = (np.zeros(3), (), np.zeros(0))
    step, working, multipliers = best
    # This equals minus the Gram matrix times the step, so it is zero if and only if the step is.
    left = gradient - slopes[list(working)].T @ multipliers if working else gradient
    return step, working, multipliers, float(np.sqrt(left @ left))


def _working_sets(guess: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return the sets of limits that can be active together, the likely ones first.

    No servo is at both ends of its range.
    """
    return [(), guess, *_SETS] if guess else [(), *_SETS]


_SETS = [
    s for k in (1, 2, 3) for s in combinations(range(7), k) if len({c if c == GIVES_WAY else c % 3 for c in s}) == k
]
