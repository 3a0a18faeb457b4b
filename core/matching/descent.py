"""Gauss-Newton search for a thimble's pose within servo limits.

The unknowns are the three values of the device's configuration. The search is compiled (`core/kernels/search.c`),
together with the kinematics of the linkage and the contact of the disc. Once a trial point violates a limit, each step
minimises the linearised mismatch subject to the linearised limits. This quadratic program is solved exactly; a line
search on the true mismatch follows. Every trial point keeps the limits, and the mismatch never rises.

Source: [S0] 5.2
"""

from __future__ import annotations

import ctypes
from ctypes import byref
from dataclasses import fields

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice, scale_of
from ..devices.linkage import Linkage
from ..devices.thimble import MIN_MARGIN, Thimble
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from ..surrogate.forward import DirectModel
from .box_descent import descend_in_box
from .minimum import (
    ARMIJO,
    EXACT,
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

# `HARDLY` for steps after the first, if another frame follows; 0.5 % of the mismatch.
LATER = 1e-2
DAMPING = 1e-9  # share of the largest diagonal element; keeps a step unique if only one node touches
ON_LIMIT = 1e-9  # a start may violate a limit by this much [rad]

_PARTS = ("low", "high", "x", "trial", "room", "angles", "multipliers")  # of a record, see `records.place_of`
# names of the reasons for the end of a search, see `Minimum.why`, by the numbers of the kernels
_WHY = {
    records.HEADER.constants[name.upper()]: name
    for name in ("limit", "optimal", "gain", "foreseen", "stalled", "step", "exact")
}

_LOW, _HIGH, _X, _TRIAL, _ROOM, _ANGLES, _MULTIPLIERS = (records.place_of(records.SearchRecord, p) for p in _PARTS)


class Descent:
    """Search for the configuration whose stimulus is nearest to a target.

    For a device other than a thimble, `descend_in_box` does the search, without `foreseen` and `follows`.

    Args:
        device: the device, which decides between the two methods.
        model: model that is evaluated by the kernels; None evaluates any model by its function.
        bounded: whether all steps regard the limits, not just those after the first violation. The search then also
            tries steps that promise hardly any gain.
        tolerance: KKT residual at which the search ends.
        most_steps, most_evaluations: largest number of steps, and of evaluations of the model.
    """

    def __init__(
        self,
        device: DiscDevice,
        model: DirectModel | None = None,
        *,
        bounded: bool = False,
        tolerance: float = OPTIMAL,
        most_steps: int = MAX_ITERATIONS,
        most_evaluations: int = MAX_EVALUATIONS,
    ) -> None:
        self.device, self.model, self.most_evaluations = device, model, most_evaluations
        if not isinstance(device, Thimble):
            return
        mount = device.mount[:3, :3].ravel().tolist() + device.mount[:3, 3].tolist()
        links = {field.name: getattr(device, field.name) for field in fields(Linkage)}
        self._thimble = records.ThimbleRecord(**links, least=MIN_MARGIN, mount=tuple(mount))
        self._blank = records.SearchRecord(
            thimble=ctypes.addressof(self._thimble),
            bounded=int(bounded),
            on_limit=ON_LIMIT,
            optimal=tolerance,
            small_step=SMALL_STEP,
            exact=EXACT,
            small_gain=SMALL_GAIN,
            hardly=HARDLY,
            later=LATER,
            least_reach=LEAST_REACH,
            nearly=NEARLY,
            shortest=SHORTEST,
            longest=LONGEST,
            armijo=ARMIJO,
            damping=DAMPING,
            most_steps=most_steps,
            most_evaluations=most_evaluations,
        )

    def __call__(
        self,
        evaluate: Evaluate,
        target: Array,
        start: Array,
        limits: ServoLimits | None = None,
        reach: float = 1.0,
        foreseen: float = 0.0,
        follows: bool = False,
        told: tuple[Array, Array] | None = None,
    ) -> Minimum:
        """Search from a configuration.

        Args:
            evaluate: function that returns the stimulus, shape (k,), and its derivative, shape (k, n), of a
                configuration. It is called where the kernels cannot evaluate `model`.
            target: stimulus to approximate, shape (k,).
            start: configuration to start from, shape (n,).
            limits: limits of the servos; None for their whole range.
            reach: `Minimum.reach` of an earlier search for a similar target.
            foreseen: share of the cost. A step that promises no larger reduction is accepted without an evaluation of
                the model. The search ends there, with the stimulus and the cost that the linearised model predicts.
            follows: whether the next frame is searched from this result. Then every step after the first is tried only
                if it promises to lower the cost by more than the share `LATER`, instead of the smaller `HARDLY`. The
                first step of the next search makes up for the steps left out.
            told: target of an earlier search that ended at `start`, shape (k,), and the derivative there, shape (k, n).
                The search then starts from the configuration that one Gauss-Newton step predicts for the change of the
                target, unless it is outside the limits or the step is longer than `LONGEST`. To first order the
                residual there equals that at the end of the earlier search. So the first evaluation is close to the
                solution, and most points that slip in the solution already slip there.

        Raises:
            DermisError: the start is outside the limits, or the model is not finite.
        """
        device, limits = self.device, limits or ServoLimits.of(self.device)
        if not isinstance(device, Thimble):
            start = start if told is None else self._ahead(start, target, limits, *told)
            most = self.most_evaluations
            return descend_in_box(evaluate, target, start, device, limits, max_evaluations=most, reach=reach)
        size, record = len(target), records.SearchRecord.from_buffer_copy(self._blank)
        numbers, (values, trial) = records.numbers_of(record), np.empty((2, 4, size))
        target = np.ascontiguousarray(target, np.float64)
        record.size, record.reach, record.foreseen, record.follows = size, reach, foreseen, follows
        record.target, record.values, record.trial_values = address(target), address(values), address(trial)
        numbers[_LOW], numbers[_HIGH], numbers[_X] = limits.low, limits.high, start
        if told is not None:
            earlier = np.ascontiguousarray(told[0], np.float64), np.ascontiguousarray(told[1].T, np.float64)
            record.before, record.slope = address(earlier[0]), address(earlier[1])
        if self.model is not None:
            self.model.lend(record)
        while (status := kernels().descend(byref(record))) == records.ASKS:
            trial[0], slopes = evaluate(numbers[_TRIAL].copy())
            trial[1:] = slopes.T
            if self.model is not None:
                self.model.lend(record)
        if status == records.NOT_FINITE:
            raise DermisError("the stimulus of a pose is not finite", where="thimble", value=list(record.trial))
        x, stimulus = numbers[_X], values[0]
        if self.model is not None:
            self.model.take(record, numbers, x, stimulus)
        if record.why not in _WHY:
            room = limits.constraints(device, start)  # an error of its own if a leg cannot reach
            raise DermisError(
                "the start is outside the servos' range",
                where="thimble",
                value=f"{np.degrees(room.min()):.3g} deg of room",
                limit=">= 0",
            )
        active = tuple(record.active[: record.actives])
        return Minimum(
            x,
            numbers[_ANGLES],
            stimulus,
            stimulus - target,
            record.start_cost,
            record.cost,
            record.kkt,
            active,
            numbers[_MULTIPLIERS][: len(active)],
            numbers[_ROOM],
            record.iterations,
            record.evaluations,
            _WHY[record.why],
            record.reach,
            values[1:].T,
        )

    def _ahead(self, start: Array, target: Array, limits: ServoLimits, before: Array, jacobian: Array) -> Array:
        """Return the start of a search that continues an earlier one, see `told`."""
        scale = scale_of(self.device)
        scaled = jacobian * scale
        normal = scaled.T @ scaled
        normal.flat[:: len(normal) + 1] += DAMPING * max(float(normal.max()), 1e-300)
        step = np.linalg.solve(normal, scaled.T @ (target - before))
        ahead: Array = start + scale * step
        near = float(step @ step) <= LONGEST**2 and self.device.holds(ahead, limits.low, limits.high)
        return ahead if near else start
