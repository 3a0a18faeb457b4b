"""Nonlinear least squares in a device's configuration, within its servos' range: active-set Gauss-Newton.

Each step minimises the linearised mismatch subject to the linearised servo limits, a quadratic program with three
unknowns that is solved exactly; a line search on the true mismatch follows. Every point that is tried keeps the servo
limits, and the mismatch never rises.

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

OPTIMAL = 3e-3  # KKT residual to stop at
SMALL_STEP = 1e-4  # of tilt [rad], and of distance over the platform's radius: 0.006 degrees, 1 um
EXACT = 1e-6  # mismatch relative to the target below which nothing is left to gain: contact is solved to as much
SMALL_GAIN = 1e-3  # of the cost in one step, 0.05 % of the mismatch: at a kink (a node about to slip) steps creep
# Of the cost, 0.13 % of the mismatch: for less no step is tried. A full step that gains no more starts where the KKT
# residual is 0.05 at most.
HARDLY = 2.5e-3
LATER = 1e-2  # the same of steps after the first, where another frame follows: 0.5 % of the mismatch
LEAST_REACH, NEARLY = 0.25, 0.8  # of a full step: the least reach, and the reach from which a step is tried whole
MAX_ITERATIONS = 20
MAX_EVALUATIONS = 16  # the longest searches creep along kinks for hardly any gain: frames must come in time
SHORTEST = 1.0 / 64.0
LONGEST = 0.35  # rad: a step beyond it leaves the range of any linearisation
ARMIJO = 1e-4
DAMPING = 1e-9  # of the largest diagonal: keeps a step unique where a single node touches
ON_LIMIT = 1e-9  # rad
RESTORING = 4
GIVES_WAY = 6  # the constraint that keeps the platform from giving way


@dataclass(frozen=True)
class Minimum:
    """Where the search ended, and why it may be trusted.

    Attributes:
        x: configuration (pitch, roll, distance), shape (3,).
        stimulus: there, shape (k,). residual: stimulus minus target.
        start_cost, cost: half the squared mismatch at the start and at the end.
        kkt: |S (J'r - A'multipliers)| / (|J S| |r|), with the multipliers of the step that would come next: 0 at
            an exact minimum. S scales distance to tilt. Of an 'exact' one r is rounding, and this is |r| / |target|; of
            a 'foreseen' one it is that of the last point that was looked at.
        active: indices of the active ones of the seven constraints; `GIVES_WAY` is the singularity margin.
        multipliers: Lagrange multipliers of the active constraints, >= 0.
        room: c(x) of the seven constraints, >= 0.
        iterations: number of steps.
        evaluations: number of evaluations of the forward model.
        why: 'optimal', 'exact', 'step' (no longer moving), 'gain' (no longer better), 'foreseen' (by a last step that
            was not looked at: stimulus and cost are the linearised model's), 'stalled' (no descent at a kink),
            'limit', 'underway' (the servos cannot reach a better minimum within one frame; start_cost is cost
            and kkt is 0, for speed decides), or 'edge' (the same where a recording ends).
        reach: share of a full step that leads furthest down, as the last one that was tried told; 1 if nothing did.
        jacobian: derivative of the stimulus by the configuration there, or where it was looked at last, shape (k, n).
    """

    x: Array
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
        return float(np.sqrt(2.0 * self.cost))


@dataclass(frozen=True)
class ServoLimits:
    """Bounds of the joints from neutral, servos' angles [rad] or legs' lengths [m], shape (n,) each."""

    low: Array
    high: Array

    @classmethod
    def of(cls, device: DiscDevice) -> ServoLimits:
        """Return the servos' whole range."""
        return cls(*device.servo_limits)

    def near(self, angles: Array, change: float) -> ServoLimits:
        """Return the limits of a step from given angles from neutral when none may change by more than `change`."""
        return ServoLimits(np.maximum(self.low, angles - change), np.minimum(self.high, angles + change))

    def constraints(self, device: DiscDevice, x: Array) -> tuple[Array, Array]:
        """Return c(x) and dc/dx, of a thimble (7,) and (7, 3), as the device's `constraints` does within these bounds.

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
    """Return the configuration whose stimulus is nearest to the target, from a feasible start.

    Args:
        evaluate: stimulus (k,) and derivative (k, 3) of a configuration.
        target: shape (k,).
        limits: limits of the servos; None for their whole range.

    Raises:
        DermisError: a start outside the limits.
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
                # where nothing touches there is no slope to come back by, so such a point is never accepted
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
    """Return the factor that shortens a step to the minimum of the parabola through its costs, within limits."""
    curve = new_cost - cost + share * descent
    return float(min(max(0.5 * share * descent / curve, 0.1), 0.5)) if curve > 0 else 0.5


def promised(share: float, cost: float, new_cost: float, descent: float) -> float:
    """Return by how much the parabola through the costs of a step falls below the first cost; inf if it has no end."""
    curve = new_cost - cost + share * descent
    return 0.25 * (share * descent) ** 2 / curve if curve > 0 else math.inf


def reach_of(share: float, cost: float, new_cost: float, descent: float) -> float:
    """Return the share of a full step at which that parabola ends, within limits.

    A touch that no pose can make leaves a large residual. Its curvature, which Gauss-Newton leaves out, makes steps too
    long. The reach of one step holds for the next, and for the next frame.
    """
    curve = new_cost - cost + share * descent
    return min(max(0.5 * share * share * descent / curve, LEAST_REACH), 1.0) if curve > 0 else 1.0


def _restored(x: Array, device: Thimble, limits: ServoLimits, scale: Array) -> tuple[Array, Array, Array] | None:
    """Bring a point back onto the limits that its linearisation overshot; None where it cannot be."""
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
    """Minimise |J d + r| subject to room + slopes d >= 0, exactly: there are at most 45 sets of limits to hold.

    Returns:
        d, the working limits, their multipliers, and the norm of J'r - A'multipliers.
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
            # rows of the constraints are scaled alike, so that the system is no worse than the Gram matrix
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
    if best is None:  # only by rounding at a degenerate corner: stay where every limit holds
        best = (np.zeros(3), (), np.zeros(0))
    step, working, multipliers = best
    # this is minus the Gram matrix times the step: zero exactly where there is no step left to make
    left = gradient - slopes[list(working)].T @ multipliers if working else gradient
    return step, working, multipliers, float(np.sqrt(left @ left))


def _working_sets(guess: tuple[int, ...]) -> list[tuple[int, ...]]:
    """All sets of limits that can hold together (no servo at both ends), the likely ones first."""
    return [(), guess, *_SETS] if guess else [(), *_SETS]


_SETS = [
    s for k in (1, 2, 3) for s in combinations(range(7), k) if len({c if c == GIVES_WAY else c % 3 for c in s}) == k
]
