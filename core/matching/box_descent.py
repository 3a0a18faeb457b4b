"""Gauss-Newton search for the pose of a device with as many joints as freedoms.

In joint coordinates, the joints' limits are the bounds of a box. Each linearised step is the exact minimum within this
box. The damping of each value is a share of its own curvature, because a touch determines some values only weakly.
Every trial point keeps the limits, and the mismatch never rises.

Source: [S0] 5.2; Marquardt 1963 for the damping
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice, scale_of
from ..errors import DermisError
from .bounded_lsq import BoundedLeastSquares
from .minimum import (
    ARMIJO,
    EXACT,
    GIVES_WAY,
    HARDLY,
    LEAST_REACH,
    LONGEST,
    MAX_EVALUATIONS,
    MAX_ITERATIONS,
    NEARLY,
    OPTIMAL,
    SHORTEST,
    SMALL_GAIN,
    SMALL_STEP,
    Evaluate,
    Minimum,
    ServoLimits,
)

MARQUARDT = 1e-3  # damping of each value, as a share of its own curvature
LEAST = 1e-7  # damping of all values, as a share of the largest curvature, for values that a touch does not determine
RESTORING = 4  # attempts to bring a point back within the limits
INSIDE = 1e-12  # distance from a limit at which a joint is put back, as a share of its range


def descend_in_box(
    evaluate: Evaluate,
    target: Array,
    start: Array,
    device: DiscDevice,
    limits: ServoLimits | None = None,
    *,
    max_evaluations: int = MAX_EVALUATIONS,
    reach: float = 1.0,
) -> Minimum:
    """Find the configuration whose stimulus is nearest to a target.

    Args:
        evaluate: function that returns the stimulus, shape (k,), and its derivative, shape (k, n), of a configuration.
        target: stimulus to approximate, shape (k,).
        start: configuration to start from, within the limits, shape (n,).
        device: the device, with n joints.
        limits: limits of the joints; None for their whole range.
        max_evaluations: largest number of evaluations of the model.
        reach: `Minimum.reach` of an earlier search for a similar target.

    Returns:
        The minimum. In `Minimum.active`, i is joint i at its upper limit, and 7 + i is joint i at its lower limit.

    Raises:
        DermisError: the start is outside the limits.
    """
    limits = limits or ServoLimits.of(device)
    scale, began = scale_of(device), _restored(np.array(start, np.float64), device, limits)
    if began is None:
        raise DermisError("the start is outside the joints' range", where="device", value=start.tolist())
    x = began
    stimulus, jacobian = evaluate(x)
    residual = stimulus - target
    size = max(float(np.sqrt(target @ target)), 1e-300)
    start_cost = cost = 0.5 * float(residual @ residual)
    evaluations, iterations, why = 1, 0, "limit"
    while True:
        scaled = jacobian * scale
        joints, by_x = device.joints(x)
        by_x = by_x * scale
        gradient = scaled.T @ residual
        step, active, multipliers, left = _step(scaled, gradient, by_x, limits.low - joints, limits.high - joints)
        weight = float(np.sqrt(np.vdot(scaled, scaled) * (2.0 * cost)))
        kkt = left / weight if weight > 0.0 else 0.0
        if np.sqrt(2.0 * cost) <= EXACT * size:
            why = "exact"
            break
        if kkt <= OPTIMAL:
            why = "optimal"
            break
        if iterations >= MAX_ITERATIONS or evaluations >= max_evaluations:
            break
        length = float(np.sqrt(step @ step))
        if length > LONGEST:
            step = step * (LONGEST / length)
        descent = -float(gradient @ step)
        if 0.5 * reach * descent <= HARDLY * cost:
            why = "gain"
            break
        share, found = reach if reach < NEARLY else 1.0, False
        while share >= SHORTEST:
            trial, new_cost = _restored(x + share * scale * step, device, limits), np.inf
            if trial is not None:
                new_stimulus, new_jacobian = evaluate(trial)
                evaluations += 1
                new_residual = new_stimulus - target
                new_cost = 0.5 * float(new_residual @ new_residual)
                reach = _reach_of(share, cost, new_cost, descent)
                # A pose without contact has no gradient that would lead back to contact, so it is never accepted.
                enough = new_cost < cost and new_cost <= cost - share * ARMIJO * max(descent, 0.0)
                found = enough and bool(new_jacobian.any())
                if found:
                    break
            if share * length < SMALL_STEP or evaluations >= max_evaluations:
                break
            if trial is not None and _promised(share, cost, new_cost, descent) <= HARDLY * cost:
                why = "gain"
                break
            share *= 0.5 if trial is None else _shorter(share, cost, new_cost, descent)
        iterations += 1
        if not found or trial is None:
            if why != "gain":
                why = "step" if length <= SMALL_STEP else "limit" if evaluations >= max_evaluations else "stalled"
            break
        moved, gained = float(np.linalg.norm((trial - x) / scale)), 1.0 - new_cost / cost
        x, stimulus, jacobian, residual, cost = trial, new_stimulus, new_jacobian, new_residual, new_cost
        if moved <= SMALL_STEP or gained <= SMALL_GAIN:
            why = "step" if moved <= SMALL_STEP else "gain"
            break
    room = limits.constraints(device, x)
    return Minimum(
        x,
        device.joints(x)[0],
        stimulus,
        residual,
        start_cost,
        cost,
        kkt,
        active,
        multipliers,
        room,
        iterations,
        evaluations,
        why,
        reach,
        jacobian,
    )


def _step(
    jacobian: Array, gradient: Array, by_x: Array, low: Array, high: Array
) -> tuple[Array, tuple[int, ...], Array, float]:
    """Return the damped Gauss-Newton step within low <= by_x step <= high.

    Returns:
        The step, the indices of the active limits, their multipliers, and the norm of the remaining gradient.
    """
    gram = jacobian.T @ jacobian
    curvature = np.diag(gram)
    gram.flat[:: len(gram) + 1] += MARQUARDT * curvature + LEAST * max(float(curvature.max()), 1e-300)
    free: Array = np.asarray(np.linalg.solve(gram, -gradient), np.float64)
    reach = by_x @ free
    if (reach >= low).all() and (reach <= high).all():  # most steps meet no limit
        return free, (), np.zeros(0), float(np.sqrt(gradient @ gradient))
    span = high - low  # divided by it, angles and lengths are comparable
    back = np.linalg.inv(by_x) * span
    found = BoundedLeastSquares(back.T @ gram @ back, np.minimum(low / span, 0.0), np.maximum(high / span, 0.0)).solve(
        -back.T @ gradient
    )
    step = back @ found.x
    held = np.flatnonzero(found.status)
    active = tuple(int(i) if found.status[i] > 0 else GIVES_WAY + 1 + int(i) for i in held)
    # This equals minus the Gram matrix times the step, so it is zero if and only if the step is.
    left = gradient - np.linalg.solve(back.T, np.where(found.status != 0, found.gradient, 0.0))
    return step, active, np.abs(found.gradient[held]), float(np.sqrt(left @ left))


def _restored(x: Array, device: DiscDevice, limits: ServoLimits) -> Array | None:
    """Move a point back within limits that it violates because their linearisation is not exact.

    None if it still violates a limit after `RESTORING` attempts, or if the device cannot take this pose.
    """
    span = INSIDE * (limits.high - limits.low)
    for _ in range(RESTORING):
        try:
            if device.holds(x, limits.low, limits.high):
                return x
            joints, by_x = device.joints(x)
        except DermisError:
            return None
        over = np.clip(joints, limits.low + span, limits.high - span) - joints
        if not over.any():
            return None  # all joints are within their limits, but the platform would give way
        x = x + np.linalg.solve(by_x, over)
    return x if device.holds(x, limits.low, limits.high) else None


def _shorter(share: float, cost: float, new_cost: float, descent: float) -> float:
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


def _promised(share: float, cost: float, new_cost: float, descent: float) -> float:
    """Return how far the parabola of a step falls below the cost at its start; inf if it has no minimum.

    Parabola and arguments are those of `_shorter`.
    """
    curve = new_cost - cost + share * descent
    return 0.25 * (share * descent) ** 2 / curve if curve > 0 else math.inf


def _reach_of(share: float, cost: float, new_cost: float, descent: float) -> float:
    """Return the share of a full step at which its parabola is least, from `LEAST_REACH` to 1.

    A touch that no pose can render leaves a large residual. Gauss-Newton neglects the curvature that this residual
    adds, and its steps are then too long. The reach of one step is used for the next step, and for the next frame.
    Parabola and arguments are those of `_shorter`.
    """
    curve = new_cost - cost + share * descent
    return min(max(0.5 * share * share * descent / curve, LEAST_REACH), 1.0) if curve > 0 else 1.0
