"""Skin stress optimisation: the device pose whose stress in the skin is nearest to the target's, frame after frame.

On each frame the friction state is fixed, the pose is searched for, and then the friction state is renewed with the
pose fixed (staggering). The search starts from a predicted pose: the Jacobian of the last search gives the step that
compensates for the change of the target. At a new contact it starts from the most promising entries of a small table of
poses. If the touch is still faint, each result is tested with a stronger copy of the target, and the result with the
smallest residual in this test is kept. In later frames of a touch, a second search starts from an entry of the table if
that entry predicts a better match.

Source: [S0] 5.1 and eq. 1, whose norm is minimised through its square.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice, scale_of, seated
from ..devices.disc_pose import DiscSolution, FrictionState, placed
from ..devices.first_contact import first_contact
from ..errors import DermisError
from ..skin.observation import Observer
from ..skin.stimulus import Stimulus
from ..surrogate.forward import DirectModel, ForwardModel
from .descent import Descent
from .minimum import GIVES_WAY, SMALL_STEP, Minimum, ServoLimits
from .onset import AHEAD, FAINT, FIRST_STARTS, SIDES, best_side
from .thimble_use import HOVER
from .warm_start import WarmStartTable, warm_start_table

Search = Callable[[Array, ServoLimits], Minimum]

NOTHING = 1e-12  # a target below this share of the table's strongest stimulus is treated as no touch
PROMISE = 0.9  # a table entry is tried if its predicted mismatch is below this share of the present one
MISTRUST = 0.5  # of the target: a learned model with a larger error at the pose that it chose is rejected
WORTHWHILE = 0.05  # of the cost: the device moves to a distant minimum only for a larger gain
# On nonlinear skin, searches and evaluations of the nonlinear law alternate within a frame. A search uses linear skin
# and adds a correction: the stimulus by the law minus the stimulus on linear skin, both at the last pose. The iteration
# ends when the error of the predicted stimulus is below CLOSE times the target or LEFT times the residual.
# CLOSE: accuracy to which the law is solved.
# LEFT: limit for the error of a correction, relative to the residual. An error of e times the residual multiplies the
# final residual by at most 1 + 2 e. Near the best pose it adds at most e^2 of the residual: 0.25 % for e = LEFT.
CLOSE, LEFT = 5e-3, 0.05
MOST_LOOKS = 6  # largest number of evaluations of the nonlinear law in a frame
# Share of the cost: if the predicted gain of a step is smaller, a learned model's linear prediction is accepted without
# another evaluation. 2 % of the cost is 1 % of the mismatch, which is less than the model's error.
FORESEEN = 0.02
LONGEST_WAIT = 32  # frames: after a failed search from the table, the longest wait before the next one


@dataclass(frozen=True, eq=False)
class ThimbleFrame:
    """Command of the device at one instant, and how well it matches.

    Attributes:
        x: configuration, see `disc_device`, shape (n,).
        angles: angles of the joints from neutral, or lengths of legs, shape (n,).
        stimulus: stimulus of the disc at the pose `x`, shape (k,), from the friction state before it is renewed.
        mismatch: |stimulus - target| / |target|, 0 without a target.
        solution: contact of the disc with the skin.
        minimum: result of the search; None if the target is no touch.
        rescued: a learned model was wrong, and the direct search took its place.
        looks: number of evaluations of the nonlinear law; 0 on linear skin.
        unsettled: 0 unless one of two things happened. All evaluations of the law were used up: then it is the error
            of the last predicted stimulus, relative to the target. The law did not converge at `x`: then it is at least
            1.
        felt: state of the whole skin under the disc, by its law; None on linear skin, without an observer of it, and
            from `Follower`, which needs it for the next value alone.
        stress_error: error of the whole stress, relative to the target's. The matcher leaves it 0; `Follower` sets it.
    """

    x: Array
    angles: Array
    stimulus: Array
    mismatch: float
    solution: DiscSolution
    minimum: Minimum | None
    rescued: bool = False
    looks: int = 0
    unsettled: float = 0.0
    felt: Stimulus | None = None
    stress_error: float = 0.0

    @property
    def touching(self) -> bool:
        """Whether the disc presses on the skin."""
        return self.solution.touching


@dataclass(frozen=True, eq=False)
class _Looked:
    """A pose that a search chose, and the skin's response to it.

    Attributes:
        minimum: result of the search. solution, stimulus: contact and stimulus at its pose, by the nonlinear law if the
            skin has one. beyond: stimulus by the law minus stimulus by the search's model there, shape (k,); None if
            the law was not evaluated.
        looks, unsettled, rescued: see `ThimbleFrame`.
    """

    minimum: Minimum
    solution: DiscSolution
    stimulus: Array
    beyond: Array | None = None
    looks: int = 0
    unsettled: float = 0.0
    rescued: bool = False


class StressMatcher:
    """Follows targets with the device, one frame after the other.

    Args:
        device: the mechanism. contact: disc and skin, for the friction update.
        observation: an `Observer`, which computes the compared quantity from the skin's state. For linear skin a matrix
            is enough; it maps forces on the pad's nodes to the quantity, shape (k, 3 m).
        model: forward model of the search; None uses the contact itself.
        change: largest change of a joint from frame to frame [rad or m]; None: not limited here.
        hover: distance kept from the skin while nothing is touched [m].
        table: poses to start from; None computes it.

    Attributes:
        follows_law: whether the nonlinear law of a skin is used, if it has one.
        noise_floor: targets no stronger than this cannot be told from a sensor's noise; they are treated as no touch.

    Raises:
        DermisError: the servo limits exclude first contact, or model and observation have different numbers of
            components.
    """

    follows_law = True

    def __init__(
        self,
        device: DiscDevice,
        contact: DiscContact,
        observation: Array | Observer,
        model: ForwardModel | None = None,
        *,
        change: float | None = None,
        hover: float = HOVER,
        table: WarmStartTable | None = None,
    ) -> None:
        self.device, self.contact, self.hover, self.change, self.noise_floor = device, contact, hover, change, 0.0
        self.direct = DirectModel(device, contact, observation)
        self.model: ForwardModel = self.direct if model is None else model
        if self.model.size != self.direct.size:
            raise DermisError(
                "model and observation have different numbers of components",
                where="thimble",
                value=f"{self.model.size} and {self.direct.size}",
            )
        self._by_contact, self._by_model = Descent(device, self.direct), Descent(device)
        self.limits = ServoLimits.of(device)
        self.rest_x = self._start_at(0.0, 0.0, -hover)
        self.table = warm_start_table(device, contact, self.model) if table is None else table
        self._foreseen, self._nothing = FORESEEN, NOTHING * float(self.table.strength.max())
        # At a new contact several poses of the disc are tried. A stronger target (see `onset`) compares them only if
        # two conditions hold. The device must have three freedoms: a disc with more can change its pose later. The
        # stimulus must have more than three components: with three it is the total force, which several poses share.
        sided = device.freedoms == 3 < self.model.size
        self._usual = AHEAD * float(np.median(self.table.strength)) if sided else 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the frame before: the device is level, at the hover distance from the pad."""
        self.x = self.rest_x.copy()
        self.angles = self._angles(self.x)
        self.state = FrictionState.rest(self.contact.count)
        self._pressed = False
        self._told: tuple[Array, Array] | None = None  # target of the last search, and the Jacobian at its end
        self._wait, self._patience = 0, 1
        self._goal: Array | None = None  # a better minimum that the servos do not reach within one frame
        self._reach = 1.0  # accepted share of a full step, in the last search
        # stimulus by the law minus stimulus by the model, at the last two commanded poses
        self._beyond: tuple[Array, Array] | None = None

    def save(self) -> tuple[Any, ...]:
        """Return all that the next frame depends on."""
        how = self._wait, self._patience, self._goal, self._reach, self._beyond
        return (self.x, self.angles, self.state, self._pressed, self._told, *how)

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Go back to where `save` was called."""
        self.x, self.angles, self.state, self._pressed, self._told, *how = saved
        self._wait, self._patience, self._goal, self._reach, self._beyond = how

    def step(self, target: Array, search: Search | None = None, start: Array | None = None) -> ThimbleFrame:
        """Find the pose for the next frame's target, shape (k,), and renew the friction state.

        Args:
            start: start of the search, used even if the present configuration is better, shape (n,).
            search: replaces the search; it gets the present configuration and the limits. The target then only decides
                whether there is a touch, and gives the reported mismatch.

        Raises:
            DermisError: a target of another size, or not finite.
        """
        target = np.asarray(target, np.float64)
        size = math.sqrt(target @ target) if target.shape == (self.model.size,) else math.nan
        if not math.isfinite(size):
            raise DermisError(
                "the target does not fit the model or is not finite",
                where="thimble",
                value=target.shape,
                limit=f"({self.model.size},), finite",
            )
        limits = self.limits if self.change is None else self.limits.near(self.angles, self.change)
        found: _Looked | None = None
        if size > max(self.noise_floor, self._nothing):
            expected = self._expected()
            goal = target if expected is None else target - expected
            if search is not None:
                minimum = search(self.x, limits)
                found = _Looked(minimum, *self._held_at(minimum.x))
            else:
                minimum = self._search(goal, limits) if start is None else self._started(start, goal, limits)
                found = self._looked(target, limits, minimum, expected)
                if self.model is not self.direct and self._mistrusted(found, size):
                    found = self._rescued(target, limits, found)
            solution, stimulus = found.solution, found.stimulus
            x, angles = found.minimum.x, found.minimum.joints
        else:
            x, self._goal = self._retracted(limits), None
            angles = self._angles(x)
            solution, stimulus = self._held_at(x)
        self._settle(solution)
        miss = stimulus - target
        searched = found is not None and search is None
        self._told = None
        if found is not None and searched:
            self._told = target if found.beyond is None else target - found.beyond, found.minimum.jacobian
        self._reach = 1.0 if found is None else found.minimum.reach
        before = None if self._beyond is None else self._beyond[0]
        self._beyond = None
        if found is not None and found.beyond is not None and self._pressed:
            self._beyond = found.beyond, found.beyond if before is None else before
        self.x, self.angles = x, angles
        made = None
        if self.contact.law is not None and self.direct.observer is not None:
            made = self.direct.felt(self.direct.observer, solution)
        astray = 1.0 if solution.touching and not solution.settled else 0.0
        if found is None:
            return ThimbleFrame(x, self.angles, stimulus, 0.0, solution, None, unsettled=astray, felt=made)
        mismatch = math.sqrt(miss @ miss) / size
        minimum = found.minimum
        if found.beyond is not None:  # the search used linear skin: add the correction by the law
            minimum = replace(minimum, stimulus=minimum.stimulus + found.beyond)
        return ThimbleFrame(
            x,
            self.angles,
            stimulus,
            mismatch,
            solution,
            minimum,
            found.rescued,
            found.looks,
            max(found.unsettled, astray),
            made,
        )

    def follow(self, targets: Iterable[Array]) -> Iterator[ThimbleFrame]:
        """Take targets one after the other."""
        for target in targets:
            yield self.step(target)

    # -- parts -------------------------------------------------------------------------------------------------------

    def _search(self, target: Array, limits: ServoLimits) -> Minimum:
        self.model.hold(self.state)
        if not self._pressed:
            return self._begun(target, limits)
        size, along = math.sqrt(target @ target), self.table.direction @ target
        nearest = int(along.argmax())
        promised = math.sqrt(max(size * size - float(along[nearest]) ** 2, 0.0))
        foreseen = 0.0 if self.model is self.direct else self._foreseen
        best = self._descended(target, self.x, limits, self._reach, foreseen, True, self._told)
        self._wait = max(self._wait - 1, 0)
        if self._goal is None and (promised >= PROMISE * best.mismatch or self._wait > 0):
            return best
        goal = self._goal
        if goal is None:
            goal = self.table.configuration(nearest, float(along[nearest]))
        other = self._descended(target, self._within(goal, self.limits), self.limits)
        self._goal = None
        if other.cost < (1.0 - WORTHWHILE) * best.cost:
            best, self._patience = self._toward(other, target, limits), 1
        else:  # the predicted gain did not come: wait twice as long before the next attempt
            self._patience = min(2 * self._patience, LONGEST_WAIT)
            self._wait = self._patience
        return best

    def _descended(self, target: Array, start: Array, limits: ServoLimits, *how: Any) -> Minimum:
        """Search from a configuration with the present model; arguments as for `Descent`."""
        descent = self._by_contact if self.model is self.direct else self._by_model
        return descent(self.model.evaluate, target, start, limits, *how)

    def _begun(self, target: Array, limits: ServoLimits) -> Minimum:
        """Search at a new contact from several poses; for a faint touch, compare the results by a stronger target."""
        self._goal, self._patience = None, 1
        growth = self._usual / float(np.sqrt(target @ target))

        def search(start: Array) -> Minimum:
            return self._descended(target, self._within(start, limits), limits)

        def ahead(side: Minimum) -> float:
            return self._left_of(growth * target, side)

        if growth < FAINT:
            return best_side(self.table.promising(target, FIRST_STARTS), search, scale_of(self.device))
        best = best_side(self.table.promising(target, SIDES), search, scale_of(self.device), ahead)
        self.model.hold(self.state)
        return best

    def _left_of(self, target: Array, side: Minimum) -> float:
        """Return the cost of the next frame's search for a target, if contact begins at the pose of `side`."""
        self.model.hold(self.state)
        self.model.hold(self.contact.settle(self._contact_at(side.x)))
        return self._descended(target, side.x, self.limits).cost

    def _started(self, start: Array, target: Array, limits: ServoLimits) -> Minimum:
        """Search from a configuration, wherever the device is now."""
        self.model.hold(self.state)
        self._goal = None
        start = self._within(start, self.limits)
        return self._toward(self._descended(target, start, self.limits), target, limits)

    def _toward(self, goal: Minimum, target: Array, limits: ServoLimits) -> Minimum:
        """Return `goal`, or the farthest pose on the way to it, if the servos do not reach it within one frame."""
        if self._allowed(goal.x, limits):
            return goal
        self._goal = goal.x
        x = self._within(goal.x, limits)
        stimulus, jacobian = self.model.evaluate(x)
        residual = stimulus - target
        cost = 0.5 * float(residual @ residual)
        room = limits.constraints(self.device, x)
        ends = room.copy()
        ends[GIVES_WAY] = np.inf
        slowest = (int(ends.argmin()),)  # the active constraint is the joints' speed; the pose is not optimal
        return Minimum(
            x,
            self._angles(x),
            stimulus,
            residual,
            cost,
            cost,
            0.0,
            slowest,
            np.zeros(1),
            room,
            goal.iterations,
            goal.evaluations + 1,
            "underway",
            1.0,
            jacobian,
        )

    def _expected(self) -> Array | None:
        """Extrapolate the difference between law and model from the last two frames; None for no difference."""
        if self._beyond is None:
            return None
        return 2.0 * self._beyond[0] - self._beyond[1]

    def _looked(self, target: Array, limits: ServoLimits, minimum: Minimum, expected: Array | None) -> _Looked:
        """Evaluate the law at the pose found, and search again while the result differs from the prediction.

        If the residual by the law is not below the smallest so far, the step is shortened, to 1/2, 1/8 and 1/64 of its
        length. If the step becomes too small, or after `MOST_LOOKS` evaluations, the pose with the smallest residual is
        kept. If the law has converged at no pose, the last evaluation is at the pose of the previous frame. The error
        of a learned model exceeds the gain of another search, so with such a model the law is evaluated only once.
        """
        if self.contact.law is None or not self.follows_law:
            solution = self._contact_at(minimum.x)
            return _Looked(minimum, solution, self._rendered_stimulus(solution, minimum))
        ahead = np.zeros(self.model.size) if expected is None else expected
        size = float(np.linalg.norm(target))
        if self.model is not self.direct:
            self.direct.hold(self.state)
        # before, start: state of the law and pose at the last accepted evaluation, initially of the previous frame
        # share: part of the step that is taken
        before, start, share = self.state.law, self.x, 1.0
        best: _Looked | None = None
        least, off = np.inf, 0.0
        for looks in range(1, MOST_LOOKS + 1):
            solution = self.direct.looked(minimum.x)
            stimulus = self.direct.stimulus(solution)
            now = minimum.stimulus if self.model is not self.direct else self.direct.linear(solution)
            found = _Looked(minimum, solution, stimulus, stimulus - now, looks)
            left = float(np.linalg.norm(stimulus - target)) if solution.settled else np.inf
            off = float(np.linalg.norm(stimulus - minimum.stimulus - ahead)) / max(size, 1e-300)
            if best is None or left < least:
                best, least, share = found, left, 1.0
                close = solution.settled and off <= max(CLOSE, LEFT * left / max(size, 1e-300))
                if close or self.model is not self.direct or minimum.why == "underway":
                    return best
                if solution.settled:
                    before, start, ahead = solution.law, minimum.x, stimulus - now
                    minimum = self._descended(target - ahead, start, limits)
                    continue
            # the residual by the law is not below the best so far, or the law did not converge: take a part of the step
            way = minimum.x - start
            share *= 0.0 if not best.solution.settled and looks == MOST_LOOKS - 1 else 0.5
            if best.solution.settled and share * float(np.abs(way / scale_of(self.device)).max()) < SMALL_STEP:
                return replace(best, looks=looks)
            self.contact.go_on(before)
            part = self._part_of(start, way, share)
            stimulus, jacobian = self.model.evaluate(part)
            minimum = replace(minimum, x=part, joints=self._angles(part), stimulus=stimulus, jacobian=jacobian)
        assert best is not None
        return replace(best, looks=MOST_LOOKS, unsettled=off)

    def _part_of(self, start: Array, way: Array, share: float) -> Array:
        """Return start + share * way if that pose is feasible, else start + way."""
        part: Array = start + share * way
        return part if share == 0.0 or self.device.feasible(part) else start + way

    def _rescued(self, target: Array, limits: ServoLimits, found: _Looked) -> _Looked:
        """Use the direct model to repeat a mistrusted search, and keep the better result."""
        learned, self.model = self.model, self.direct
        try:
            expected, goal = None, target
            if self.contact.law is not None:
                expected = found.stimulus - self.direct.linear(found.solution)
                goal = target - expected
            other = self._looked(target, limits, self._search(goal, limits), expected)
        finally:
            self.model = learned
        if np.linalg.norm(other.stimulus - target) >= np.linalg.norm(found.stimulus - target):
            return found
        # the next frame uses the learned model again, so the correction of the learned model is kept
        return replace(other, rescued=True, looks=found.looks + other.looks, beyond=found.beyond)

    def _rendered_stimulus(self, solution: DiscSolution, minimum: Minimum | None) -> Array:
        """Return the stimulus at the pose chosen."""
        return self.direct.stimulus(solution)

    def _mistrusted(self, found: _Looked, size: float) -> bool:
        """Return whether a learned model's stimulus is far from the contact's at the same pose, see `MISTRUST`."""
        return float(np.linalg.norm(found.stimulus - found.minimum.stimulus)) > MISTRUST * size

    def _contact_at(self, x: Array) -> DiscSolution:
        """Return the contact at the pose that a search chose, from the friction state of the frame before."""
        if self.model is self.direct:
            return self.direct.solution(x)  # the search tried this very pose
        self.contact.hold(self.state)
        return self.contact.solve(placed(self.device, self.device.pose(x)))

    def _held_at(self, x: Array) -> tuple[DiscSolution, Array]:
        """Return contact and stimulus at a pose that no search of this matcher chose."""
        self.contact.hold(self.state)
        solution = self.contact.solve(placed(self.device, self.device.pose(x)))
        return solution, self._rendered_stimulus(solution, None)

    def _settle(self, solution: DiscSolution) -> None:
        """Renew the friction state with the pose fixed."""
        self._pressed = solution.touching
        self.state = self.contact.settle(solution) if self._pressed else FrictionState.rest(self.contact.count)

    def _retracted(self, limits: ServoLimits) -> Array:
        """Return a pose without contact: the last tilt, at the hover distance from the skin."""
        if not self._pressed and self.change is None:
            return self.x
        return self._within(self._start_at(self.x[0], self.x[1], -self.hover), limits)

    def _within(self, x: Array, limits: ServoLimits) -> Array:
        """Return the pose farthest on the way to x that the limits allow."""
        way, low, high = x - self.x, 0.0, 1.0
        if self._allowed(x, limits):
            return x
        for _ in range(12):
            middle = 0.5 * (low + high)
            if self._allowed(self.x + middle * way, limits):
                low = middle
            else:
                high = middle
        return self.x + low * way

    def _allowed(self, x: Array, limits: ServoLimits) -> bool:
        return self.device.holds(x, limits.low, limits.high)

    def _angles(self, x: Array) -> Array:
        return self.device.joints(x)[0]

    def _start_at(self, pitch: float, roll: float, depth: float) -> Array:
        x = seated(self.device, pitch, roll, first_contact(self.device, self.contact, pitch, roll) - depth)
        for _ in range(20):
            if self.device.feasible(x):
                return x
            x[:2] *= 0.8
            x[2] = first_contact(self.device, self.contact, x[0], x[1]) - depth
        raise DermisError(
            "the servo limits exclude first contact",
            where="thimble",
            value=f"distance {1e3 * x[2]:.2f} mm",
            limit=_ends(*self.device.servo_limits),
            remedy="Change lengths, ranges or mounting so that the level platform reaches the pad",
        )


def _ends(low: Array, high: Array) -> str:
    return ", ".join(f"{a:.3g} to {b:.3g}" for a, b in zip(low.tolist(), high.tolist(), strict=True))
