"""Skin stress optimisation: the device pose whose stress in the skin is nearest to the target's, frame after frame.

On each frame the friction state is fixed, the pose is searched for, and then the friction state is renewed with the
pose fixed (staggering). The search starts where the last one's slope makes up for what the target changed by, or, at
a new contact, from the few entries of a small table of poses that promise most, of which the one is kept that leaves
least of the touch once it is strong; whenever an entry of that table promises a better match, it starts from there too.

Source: [S0] 5.1 and eq. 1, whose norm is minimised through its square.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice, scale_of, seated
from ..devices.disc_pose import DiscSolution, FrictionState, placed
from ..devices.first_contact import first_contact
from ..errors import DermisError
from ..surrogate.forward import DirectModel, ForwardModel
from .descent import descend, response
from .gauss_newton import GIVES_WAY, Minimum, ServoLimits
from .onset import AHEAD, FAINT, FIRST_STARTS, SIDES, best_side
from .thimble_use import HOVER
from .warm_start import WarmStartTable, warm_start_table

Search = Callable[[Array, ServoLimits], Minimum]

NOTHING = 1e-12  # targets below this share of the table's strongest stimulus are no touch
PROMISE = 0.9  # a table entry must leave less than this share of a mismatch to be tried
MISTRUST = 0.5  # of the target: a learned model farther from the true contact at its own pose is not believed
WORTHWHILE = 0.05  # of the cost: for less than that the device does not jump
# Skin that stiffens is searched again on a tangent laid where the search ended, if it was off its own by more than this
# share of the target there, and of what is left of it: a poor match needs no fine one.
BENT, LEFT = 1e-3, 0.02
TANGENTS = 4  # searches of a frame
# Of the cost: what a learned model says of a step that gains less than this is as good as another look at it. It is a
# hundredth of the mismatch; the model's own error is more.
FORESEEN = 0.02
LONGEST_WAIT = 32  # frames between two tries of the table while they fail


@dataclass(frozen=True, eq=False)
class ThimbleFrame:
    """What the device shall do at one instant, and how well that matches.

    Attributes:
        x: configuration, see `disc_device`, shape (n,). angles: of the joints from neutral, shape (n,).
        stimulus: rendered, after the friction update, shape (k,). mismatch: |stimulus - target| / |target|, 0 for none.
        solution: contact of the disc with the skin.
        minimum: the search's own account, None where the target is no touch.
        rescued: a learned model was wrong, and the direct search took its place.
    """

    x: Array
    angles: Array
    stimulus: Array
    mismatch: float
    solution: DiscSolution
    minimum: Minimum | None
    rescued: bool = False

    @property
    def touching(self) -> bool:
        """Whether the disc presses on the skin."""
        return self.solution.touching


class StressMatcher:
    """Follows targets with the device, one frame after the other.

    Args:
        device: the mechanism. contact: disc and skin, for the friction update.
        observation_matrix: stimulus components of forces, shape (k, 3 m), or of all that is felt (`skin.felt_state`).
        model: what the search evaluates; the contact itself where None.
        change: largest change of a joint from frame to frame [rad or m]; None: not limited here.
        hover: distance kept from the skin while nothing is touched [m].
        noise_floor: targets no stronger than this cannot be told from a sensor's noise and are no touch.
        table: to start from; made where None.

    Attributes:
        rescues: frames since the last reset in which a learned model was wrong and the direct search took its place.

    Raises:
        DermisError: the servo limits exclude first contact, or model and observation matrix have different components.
    """

    def __init__(
        self,
        device: DiscDevice,
        contact: DiscContact,
        observation_matrix: Array,
        model: ForwardModel | None = None,
        *,
        change: float | None = None,
        hover: float = HOVER,
        noise_floor: float = 0.0,
        table: WarmStartTable | None = None,
    ) -> None:
        self.device, self.contact, self.hover, self.change, self.noise_floor = (
            device,
            contact,
            hover,
            change,
            noise_floor,
        )
        self.direct = DirectModel(device, contact, observation_matrix)
        self.model: ForwardModel = self.direct if model is None else model
        if self.model.size != self.direct.size:
            raise DermisError(
                "model and observation matrix have different components",
                where="thimble",
                value=f"{self.model.size} and {self.direct.size}",
            )
        self.limits = ServoLimits.of(device)
        self.rest_x = self._start_at(0.0, 0.0, -hover)
        self.table = warm_start_table(device, contact, self.model) if table is None else table
        self._foreseen = FORESEEN
        # a disc that shifts along the pad has other ways back, and total force tells no side from another
        sided = device.freedoms == 3 < self.model.size
        self._usual = AHEAD * float(np.median(self.table.strength)) if sided else 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the frame before: the device hovers level under the pad."""
        self.x = self.rest_x.copy()
        self.angles = self._angles(self.x)
        self.state = FrictionState.rest(self.contact.count)
        self._pressed = False
        self._told: tuple[Array, Array] | None = None  # what was wanted in the last search, and the slope it ended with
        self._wait, self._patience = 0, 1
        self._goal: Array | None = None  # a better minimum that is farther away than one frame
        self._reach = 1.0  # of steps, in the last search
        self.rescues = 0

    def save(self) -> tuple[Any, ...]:
        """Return all that the next frame depends on."""
        how = self._wait, self._patience, self._goal, self._reach
        return (self.x, self.angles, self.state, self._pressed, self._told, *how)

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Go back to where `save` was called."""
        self.x, self.angles, self.state, self._pressed, self._told, *how = saved
        self._wait, self._patience, self._goal, self._reach = how

    def step(self, target: Array, search: Search | None = None, start: Array | None = None) -> ThimbleFrame:
        """Find the pose for the next frame's target, shape (k,), and renew the friction state.

        Args:
            start: a configuration to search from, whether that is better than where the device is or not, shape (n,).
            search: another way to find the pose, from where the device is and within limits; the target then only
                says whether anything is touched, and what to compare with.

        Raises:
            DermisError: a target of another size, or not finite.
        """
        target = np.asarray(target, np.float64)
        if target.shape != (self.model.size,) or not np.isfinite(target).all():
            raise DermisError(
                "the target does not fit the model or is not finite",
                where="thimble",
                value=target.shape,
                limit=f"({self.model.size},), finite",
            )
        limits = self.limits if self.change is None else self.limits.near(self.angles, self.change)
        size = float(np.sqrt(target @ target))
        minimum: Minimum | None = None
        rescued = False
        if size > max(self.noise_floor, NOTHING * float(self.table.strength.max())):
            if search is not None:
                minimum = search(self.x, limits)
            else:
                minimum = self._search(target, limits) if start is None else self._started(start, target, limits)
            x = minimum.x
        else:
            x, self._goal = self._retracted(limits), None
        solution = self._contact_at(x, searched=minimum is not None and search is None)
        stimulus = self._rendered_stimulus(solution, minimum)
        if minimum is not None and search is None and self.model is self.direct:
            minimum, x, solution, stimulus = self._straightened(target, limits, minimum, x, solution, stimulus)
        learned = minimum is not None and search is None and self.model is not self.direct
        if learned and minimum is not None and self._mistrusted(stimulus, minimum, size):
            before = self.rescues
            minimum, x, solution, stimulus = self._rescued(target, limits, minimum, x, solution, stimulus)
            rescued = self.rescues > before
        self._settle(solution)
        miss = stimulus - target
        self._reach = 1.0 if minimum is None else minimum.reach
        self._told = None if minimum is None or search is not None else (target, minimum.jacobian)
        self.x, self.angles = x, self._angles(x)
        mismatch = float(np.sqrt(miss @ miss)) / size if minimum is not None else 0.0
        return ThimbleFrame(x, self.angles, stimulus, mismatch, solution, minimum, rescued)

    def follow(self, targets: Iterable[Array]) -> Iterator[ThimbleFrame]:
        """Take targets one after the other."""
        for target in targets:
            yield self.step(target)

    # -- parts -------------------------------------------------------------------------------------------------------

    def _search(self, target: Array, limits: ServoLimits) -> Minimum:
        self.model.hold(self.state)
        if not self._pressed:
            return self._begun(target, limits)
        size = float(np.sqrt(target @ target))
        alike = self.table.direction @ target / size
        nearest = int(alike.argmax())
        promised = size * float(np.sqrt(max(1.0 - alike[nearest] ** 2, 0.0)))
        start, foreseen = self._ahead(target, limits), 0.0 if self.model is self.direct else self._foreseen
        best = descend(self.model.evaluate, target, start, self.device, limits, self._reach, foreseen, follows=True)
        self._wait = max(self._wait - 1, 0)
        if self._goal is None and (promised >= PROMISE * best.mismatch or self._wait > 0):
            return best
        goal = self._goal
        if goal is None:
            goal = self.table.configuration(nearest, size * float(alike[nearest]))
        other = descend(self.model.evaluate, target, self._within(goal, self.limits), self.device, self.limits)
        self._goal = None
        if other.cost < (1.0 - WORTHWHILE) * best.cost:
            best, self._patience = self._toward(other, target, limits), 1
        else:  # a promise that was not kept: wait longer and longer before the next is believed
            self._patience = min(2 * self._patience, LONGEST_WAIT)
            self._wait = self._patience
        return best

    def _begun(self, target: Array, limits: ServoLimits) -> Minimum:
        """Search at a new contact, on several sides; how faint the touch is says how they are judged."""
        self._goal, self._patience = None, 1
        growth = self._usual / float(np.sqrt(target @ target))

        def search(start: Array) -> Minimum:
            return descend(self.model.evaluate, target, self._within(start, limits), self.device, limits)

        def ahead(side: Minimum) -> float:
            return self._left_of(growth * target, side)

        if growth < FAINT:
            return best_side(self.table.promising(target, FIRST_STARTS), search, scale_of(self.device))
        best = best_side(self.table.promising(target, SIDES), search, scale_of(self.device), ahead)
        self.model.hold(self.state)
        return best

    def _left_of(self, target: Array, side: Minimum) -> float:
        """Return what would be left of a target in the next frame, if the disc began on a side."""
        self.model.hold(self.state)
        self.model.hold(self.contact.settle(self._contact_at(side.x, searched=True)))
        return descend(self.model.evaluate, target, side.x, self.device, self.limits).cost

    def _started(self, start: Array, target: Array, limits: ServoLimits) -> Minimum:
        """Search from a configuration, wherever the device is now."""
        self.model.hold(self.state)
        self._goal = None
        start = self._within(start, self.limits)
        return self._toward(descend(self.model.evaluate, target, start, self.device, self.limits), target, limits)

    def _toward(self, goal: Minimum, target: Array, limits: ServoLimits) -> Minimum:
        """Return a better minimum elsewhere, or where the servos can be on the way to it within one frame."""
        if self._allowed(goal.x, limits):
            return goal
        self._goal = goal.x
        x = self._within(goal.x, limits)
        stimulus, jacobian = self.model.evaluate(x)
        residual = stimulus - target
        cost = 0.5 * float(residual @ residual)
        room, _ = limits.constraints(self.device, x)
        ends = room.copy()
        ends[GIVES_WAY] = np.inf
        slowest = (int(ends.argmin()),)  # it is the joints' speed that decides here, and no optimality
        return Minimum(
            x,
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

    def _ahead(self, target: Array, limits: ServoLimits) -> Array:
        """Return where the device makes up for what the target changed by since the last search, as that one's slope
        says: what it left then, it leaves there, and the right nodes slip from the first evaluation on."""
        if self._told is None:
            return self.x
        before, jacobian = self._told
        ahead: Array = self.x + response(jacobian, before, target, self.device)
        return ahead if self._allowed(ahead, limits) else self.x

    def _rescued(
        self, target: Array, limits: ServoLimits, minimum: Minimum, x: Array, solution: DiscSolution, stimulus: Array
    ) -> tuple[Minimum, Array, DiscSolution, Array]:
        """Search directly where a learned model was far from the contact that its pose made, and keep the better."""
        learned, self.model = self.model, self.direct
        try:
            other = self._search(target, limits)
            found = self.direct.solution(other.x)
        finally:
            self.model = learned
        if other.mismatch >= float(np.linalg.norm(stimulus - target)):
            return minimum, x, solution, stimulus
        self.rescues += 1
        return other, other.x, found, self.direct.stimulus(found)

    def _straightened(
        self, target: Array, limits: ServoLimits, minimum: Minimum, x: Array, solution: DiscSolution, stimulus: Array
    ) -> tuple[Minimum, Array, DiscSolution, Array]:
        """Search again where skin that stiffens was far off the tangent that the search was on."""
        if self.contact.points.stiff is None or minimum.why == "underway":
            return minimum, x, solution, stimulus
        for _ in range(1, TANGENTS):
            off = float(np.linalg.norm(stimulus - minimum.stimulus))
            left = float(np.linalg.norm(stimulus - target))
            if off <= max(BENT * float(np.linalg.norm(target)), LEFT * left):
                break
            minimum = descend(self.model.evaluate, target, x, self.device, limits)
            x, solution = minimum.x, self.direct.solution(minimum.x)
            stimulus = self.direct.stimulus(solution)
        return minimum, x, solution, stimulus

    def _rendered_stimulus(self, solution: DiscSolution, minimum: Minimum | None) -> Array:
        """Return the stimulus at the pose chosen."""
        return self.direct.stimulus(solution)

    def _mistrusted(self, stimulus: Array, minimum: Minimum, size: float) -> bool:
        """Return whether a learned model was far from the contact that its pose made."""
        return float(np.linalg.norm(stimulus - minimum.stimulus)) > MISTRUST * size

    def _contact_at(self, x: Array, *, searched: bool) -> DiscSolution:
        """Return the contact at the pose chosen, from the friction state before it."""
        if searched and self.model is self.direct:
            solution = self.direct.solution(x)  # the search tried this very pose
        else:
            self.contact.hold(self.state)
            solution = self.contact.solve(placed(self.device, self.device.pose(x)))
        return solution

    def _settle(self, solution: DiscSolution) -> None:
        """Renew the friction state with the pose fixed."""
        self._pressed = solution.touching
        self.state = self.contact.settle(solution) if self._pressed else FrictionState.rest(self.contact.count)

    def _retracted(self, limits: ServoLimits) -> Array:
        """Return the pose that hovers under the skin at the tilt held last."""
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
