"""Gauss-Newton search for a thimble's pose while no servo limit is active.

The steps are those of `gauss_newton.minimise` without constraints. One search takes a few tenths of a millisecond. At
that speed NumPy's overhead for arrays of three elements exceeds the cost of their arithmetic. The normal equations of
the three unknowns, bordered by the residual, are therefore a 4 x 4 matrix of Python floats, see `_gram`. If a trial
point violates a limit, `minimise` continues from the current point.

Source: [S0] 5.2, without active constraints
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice, scale_of
from ..devices.thimble import Thimble
from .box_descent import descend_in_box
from .gauss_newton import (
    ARMIJO,
    DAMPING,
    EXACT,
    HARDLY,
    LATER,
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
    minimise,
    promised,
    reach_of,
    shorter,
)


def descend(
    evaluate: Evaluate,
    target: Array,
    start: Array,
    device: DiscDevice,
    limits: ServoLimits | None = None,
    reach: float = 1.0,
    foreseen: float = 0.0,
    follows: bool = False,
) -> Minimum:
    """Find the configuration whose stimulus is nearest to a target.

    For a device other than a thimble, `descend_in_box` does the search, without `foreseen` and `follows`.

    Args:
        evaluate: function that returns the stimulus, shape (k,), and its derivative, shape (k, n), of a configuration.
        target: stimulus to approximate, shape (k,).
        start: configuration to start from, shape (n,).
        device: the device, which decides between the two methods.
        limits: limits of the servos; None for their whole range.
        reach: `Minimum.reach` of an earlier search for a similar target.
        foreseen: share of the cost. A step that promises no larger reduction is accepted without an evaluation of the
            model. The search ends there, with the stimulus and the cost that the linearised model predicts.
        follows: whether the next frame is searched from this result. Then every step after the first is tried only if
            it promises to lower the cost by more than the share `LATER`, instead of the smaller `HARDLY`. The first
            step of the next search makes up for the steps left out.

    Raises:
        DermisError: the start is outside the limits.
    """
    if not isinstance(device, Thimble):
        return descend_in_box(evaluate, target, start, device, limits, reach=reach)
    limits = limits or ServoLimits.of(device)
    low, high = limits.low.tolist(), limits.high.tolist()
    size, radius = len(target), device.platform_radius
    pitch, roll, distance = start.tolist()
    room = device.room(pitch, roll, distance, low, high)
    if room is None:
        return minimise(evaluate, target, start, device, limits)  # it raises the error, or handles an active limit
    both = np.empty((size, 4))
    x = np.array(start, np.float64)
    stimulus, jacobian = evaluate(x)
    gram = _gram(both, stimulus, jacobian, target, radius)
    cost = start_cost = 0.5 * gram[3][3]
    exact = EXACT**2 * float(target @ target)
    evaluations, iterations, why = 1, 0, "limit"
    while True:
        gradient, weight = gram[3][:3], (gram[0][0] + gram[1][1] + gram[2][2]) * gram[3][3]
        left = math.sqrt(gradient[0] ** 2 + gradient[1] ** 2 + gradient[2] ** 2)
        kkt = left / math.sqrt(weight) if weight > 0.0 else 0.0
        if 2.0 * cost <= exact:
            break
        if kkt <= OPTIMAL:
            why = "optimal"
            break
        if iterations >= MAX_ITERATIONS or evaluations >= MAX_EVALUATIONS:
            break
        step = _step(gram)
        if step is None:
            break
        step_length = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        if step_length > LONGEST:
            step = [s * (LONGEST / step_length) for s in step]
        descent = -(gradient[0] * step[0] + gradient[1] * step[1] + gradient[2] * step[2])
        hardly = (LATER if follows and evaluations > 1 else HARDLY) * cost
        if 0.5 * reach * descent <= hardly:
            why = "gain"
            break
        share, found = reach if reach < NEARLY else 1.0, False
        at = (pitch + share * step[0], roll + share * step[1], distance + share * radius * step[2])
        new_room = device.room(*at, low, high)
        if new_room is not None and 0.5 * reach * descent <= foreseen * cost:
            x, room = np.array(at), new_room
            stimulus = stimulus + both[:, :3] @ (share * np.array(step))
            cost -= share * (1.0 - 0.5 * share) * descent
            iterations, why = iterations + 1, "foreseen"
            break
        while share >= SHORTEST:
            if new_room is None:
                more = minimise(evaluate, target, x, device, limits)
                return _after(more, start_cost, iterations, evaluations)
            trial = np.array(at)
            new_stimulus, new_jacobian = evaluate(trial)
            evaluations += 1
            new_gram = _gram(both, new_stimulus, new_jacobian, target, radius)
            new_cost = 0.5 * new_gram[3][3]
            reach = reach_of(share, cost, new_cost, descent)
            # A pose without contact has no gradient that would lead back to contact, so it is never accepted.
            slope = new_gram[0][0] + new_gram[1][1] + new_gram[2][2]
            if new_cost <= cost - share * ARMIJO * max(descent, 0.0) and new_cost < cost and slope > 0.0:
                found = True
                break
            if share * step_length < SMALL_STEP or evaluations >= MAX_EVALUATIONS:
                break
            if follows:
                hardly = LATER * cost
            if promised(share, cost, new_cost, descent) <= hardly:
                why = "gain"
                break
            share *= shorter(share, cost, new_cost, descent)
            at = (pitch + share * step[0], roll + share * step[1], distance + share * radius * step[2])
            new_room = device.room(*at, low, high)
        iterations += 1
        if not found or new_room is None:
            if why != "gain":
                why = "step" if step_length <= SMALL_STEP else "limit" if evaluations >= MAX_EVALUATIONS else "stalled"
            break
        moved, gained = share * min(step_length, LONGEST), 1.0 - new_cost / cost
        (pitch, roll, distance), x, room, gram, cost = at, trial, new_room, new_gram, new_cost
        stimulus, jacobian = new_stimulus, new_jacobian
        if moved <= SMALL_STEP or gained <= SMALL_GAIN:
            why = "step" if moved <= SMALL_STEP else "gain"
            break
    if 2.0 * cost <= exact:
        why, kkt = "exact", EXACT * math.sqrt(2.0 * cost / exact) if exact > 0.0 else 0.0
    return Minimum(
        x,
        stimulus,
        stimulus - target,
        start_cost,
        cost,
        kkt,
        (),
        np.zeros(0),
        np.array(room),
        iterations,
        evaluations,
        why,
        reach,
        jacobian,
    )


def response(jacobian: Array, before: Array, target: Array, device: DiscDevice) -> Array:
    """Predict the change of a configuration for a change of the target.

    The prediction is one Gauss-Newton step.

    Args:
        jacobian: derivative of the stimulus at the configuration, shape (k, n).
        before, target: the previous and the current target, shape (k,).
        device: the device, for the scale of a configuration's values.

    Returns:
        Change of the configuration, shape (n,). It is zero if the step is longer than `LONGEST`: the linearisation does
        not hold over such a step.
    """
    scale = scale_of(device)
    if isinstance(device, Thimble):
        gram = _gram(np.empty((len(target), 4)), before, jacobian, target, device.platform_radius)
        step = np.array(_step(gram) or (0.0, 0.0, 0.0))
    else:
        scaled = jacobian * scale
        normal = scaled.T @ scaled
        normal.flat[:: len(normal) + 1] += DAMPING * max(float(normal.max()), 1e-300)
        step = np.linalg.solve(normal, scaled.T @ (target - before))
    out: Array = scale * step if float(step @ step) <= LONGEST**2 else np.zeros_like(scale)
    return out


def _gram(both: Array, stimulus: Array, jacobian: Array, target: Array, radius: float) -> list[list[float]]:
    """Return B'B for B = (J S, r) as rows of Python floats.

    Args:
        both: buffer for B, shape (k, 4).
        stimulus, jacobian: of a configuration, shapes (k,) and (k, 3).
        target: stimulus to approximate, shape (k,); r is the stimulus minus the target.
        radius: the platform's radius [m], by which S scales the derivative with respect to the distance.
    """
    both[:, :3] = jacobian
    both[:, 2] *= radius
    np.subtract(stimulus, target, out=both[:, 3])
    return (both.T @ both).tolist()


def _step(gram: list[list[float]]) -> list[float] | None:
    """Return the damped Gauss-Newton step -(J'J + D)^-1 J'r.

    The result is None if J is zero.
    """
    (a, b, c, u), (_, d, e, v), (_, _, f, w), _ = gram
    more = DAMPING * max(a, d, f)
    if more <= 0.0:
        return None
    a, d, f = a + more, d + more, f + more
    # Cholesky factorisation of a symmetric 3 x 3 matrix; the damping keeps it positive definite
    l11 = math.sqrt(a)
    l21, l31 = b / l11, c / l11
    l22 = math.sqrt(max(d - l21 * l21, more))
    l32 = (e - l31 * l21) / l22
    l33 = math.sqrt(max(f - l31 * l31 - l32 * l32, more))
    y1 = -u / l11
    y2 = (-v - l21 * y1) / l22
    y3 = (-w - l31 * y1 - l32 * y2) / l33
    s3 = y3 / l33
    s2 = (y2 - l32 * s3) / l22
    return [(y1 - l21 * s2 - l31 * s3) / l11, s2, s3]


def _after(more: Minimum, start_cost: float, iterations: int, evaluations: int) -> Minimum:
    """Add earlier iterations and evaluations to a minimum of `minimise`."""
    return replace(
        more, start_cost=start_cost, iterations=more.iterations + iterations, evaluations=more.evaluations + evaluations
    )
