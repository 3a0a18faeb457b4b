"""Result of a search for a pose, the bounds of the joints, and the rules by which searches end.

`descent` searches for a thimble's pose, `box_descent` for that of any other device.

Source: [S0] 5.2
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice

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
# Smallest reach, and the reach from which a full step is tried first, as shares of a full step; see `box_descent`.
LEAST_REACH, NEARLY = 0.25, 0.8
MAX_ITERATIONS = 20
MAX_EVALUATIONS = 16  # bounds the time of a frame; longer searches creep along kinks for hardly any gain
SHORTEST = 1.0 / 64.0  # shortest share of a step that is tried
LONGEST = 0.35  # longest step [rad]; no linearisation holds farther
ARMIJO = 1e-4  # share of the predicted reduction that a step must reach
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

    def constraints(self, device: DiscDevice, x: Array) -> Array:
        """Return the constraints c(x) within these bounds, see the device's `constraints`; shape (7,) for a thimble.

        Raises:
            DermisError: a leg cannot reach.
        """
        return device.constraints(x, self.low, self.high)
