"""Skin stress optimisation: the device pose whose stress in the skin is nearest to the target's, frame after frame.

On each frame the friction state is fixed, the pose is searched for, and then the friction state is renewed with the
pose fixed (staggering). The search starts where the last frame ended, or, at a new contact, from the nearest entry of a
small table of poses; whenever an entry of that table promises a clearly better match, the search starts from there too.

Source: [S0] 5.1 and eq. 1, whose norm is minimised through its square.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..devices.disc import DiscContact, DiscSolution, FrictionState, first_contact, placed
from ..devices.thimble import Thimble
from ..errors import DermisError
from ..surrogate.forward import DirectModel, ForwardModel
from .gauss_newton import Minimum, ServoLimits, minimise

Array = NDArray[np.float64]

HOVER = 0.4e-3  # [m] between disc and skin while nothing is touched
NOTHING = 1e-12  # targets below this share of the table's strongest stimulus are no touch
PROMISE = 0.85  # a table entry must leave less than this share of a mismatch to be tried
TABLE_TILTS = np.radians([-24.0, -16.0, -8.0, 0.0, 8.0, 16.0, 24.0])
TABLE_DEPTHS = (0.05e-3, 0.15e-3, 0.35e-3, 0.7e-3, 1.1e-3, 1.5e-3)


@dataclass(frozen=True, eq=False)
class ThimbleFrame:
    """What the device shall do at one instant, and how well that matches.

    Attributes:
        x: pitch, roll [rad] and distance [m]. angles: of the servos from neutral [rad], shape (3,).
        stimulus: rendered, after the friction update, shape (k,). mismatch: |stimulus - target| / |target|, 0 for none.
        solution: contact of the disc with the skin.
        minimum: the search's own account, None where the target is no touch.
        searches: how many starts were tried.
    """

    x: Array
    angles: Array
    stimulus: Array
    mismatch: float
    solution: DiscSolution
    minimum: Minimum | None
    searches: int

    @property
    def touching(self) -> bool:
        """Whether the disc presses on the skin."""
        return self.solution.touching


class StressMatcher:
    """Follows targets with the device, one frame after the other.

    Args:
        device: the mechanism. contact: disc and skin, for the friction update.
        model: what the search evaluates; the contact itself where None is given for it (`readout` is then needed).
        readout: stimulus components of forces, shape (k, 3 m).
        change: largest change of a servo angle from frame to frame [rad]; None: not limited here.
        hover: distance kept from the skin while nothing is touched [m].

    Raises:
        DermisError: the servo limits exclude first contact, or neither model nor readout.
    """

    def __init__(
        self, device: Thimble, contact: DiscContact, readout: Array, model: ForwardModel | None = None, *,
        change: float | None = None, hover: float = HOVER,
    ) -> None:  # fmt: skip
        self.device, self.contact, self.hover, self.change = device, contact, hover, change
        self.direct = DirectModel(device, contact, readout)
        self.model: ForwardModel = self.direct if model is None else model
        if self.model.size != self.direct.size:
            raise DermisError("model and readout have different components", where="thimble",
                              value=f"{self.model.size} and {self.direct.size}")  # fmt: skip
        self.limits = ServoLimits.of(device)
        self.rest_x = self._start_at(0.0, 0.0, -hover)
        self._table_x, self._table = self._build_table()
        self.reset()

    def reset(self) -> None:
        """Forget the frame before: the device hovers level under the pad."""
        self.x = self.rest_x.copy()
        self.angles = self._angles(self.x)
        self.state = FrictionState.rest(self.contact.count)
        self._pressed = False

    def step(self, target: Array) -> ThimbleFrame:
        """Find the pose for the next frame's target, shape (k,), and renew the friction state.

        Raises:
            DermisError: a target of another size, or not finite.
        """
        target = np.asarray(target, np.float64)
        if target.shape != (self.model.size,) or not np.isfinite(target).all():
            raise DermisError("the target does not fit the model or is not finite", where="thimble",
                              value=target.shape, limit=f"({self.model.size},), finite")  # fmt: skip
        limits = self.limits if self.change is None else self.limits.near(self.angles, self.change)
        size = float(np.sqrt(target @ target))
        minimum, searches = None, 0
        if size > NOTHING * self._strongest:
            minimum, searches = self._search(target, limits)
            x = minimum.x
        else:
            x = self._retracted(limits)
        self.contact.hold(self.state)
        solution = self._settle(x)
        stimulus = self.direct.readout @ solution.spread(self.contact.count).ravel()
        miss = stimulus - target
        self.x, self.angles = x, self._angles(x)
        mismatch = float(np.sqrt(miss @ miss)) / size if minimum is not None else 0.0
        return ThimbleFrame(x, self.angles, stimulus, mismatch, solution, minimum, searches)

    def follow(self, targets: Iterable[Array]) -> Iterator[ThimbleFrame]:
        """Take targets one after the other."""
        for target in targets:
            yield self.step(target)

    # -- parts -------------------------------------------------------------------------------------------------------

    def _search(self, target: Array, limits: ServoLimits) -> tuple[Minimum, int]:
        self.model.hold(self.state)
        miss = ((self._table - target) ** 2).sum(axis=1)
        nearest = int(miss.argmin())
        best: Minimum | None = None
        searches = 0
        if self._pressed:
            best = minimise(self.model.evaluate, target, self.x, self.device, limits)
            searches = 1
        if best is None or 0.5 * miss[nearest] < PROMISE**2 * best.cost:
            start = self._within(self._table_x[nearest], limits)
            other = minimise(self.model.evaluate, target, start, self.device, limits)
            searches += 1
            if best is None or other.cost < best.cost:
                best = other
        return best, searches

    def _settle(self, x: Array) -> DiscSolution:
        """Renew the friction state with the pose fixed."""
        if self.model is self.direct:
            solution = self.direct.solution(x)  # the search ended with this very contact
        else:
            solution = self.contact.solve(placed(self.device, self.device.pose(x)))
        self._pressed = solution.touching
        self.state = self.contact.settle(solution) if self._pressed else FrictionState.rest(self.contact.count)
        return solution

    def _retracted(self, limits: ServoLimits) -> Array:
        """Return the pose that hovers under the skin at the tilt held last."""
        if not self._pressed and self.change is None:
            return self.x
        return self._within(self._start_at(self.x[0], self.x[1], -self.hover), limits)

    def _within(self, x: Array, limits: ServoLimits) -> Array:
        """Return the pose nearest in servo angles that the limits allow."""
        angles = self._angles(x)
        clipped = np.clip(angles, limits.low, limits.high)
        if np.array_equal(angles, clipped):
            return x
        return self.device.forward(clipped + self.device.servo_zero, self.x)

    def _angles(self, x: Array) -> Array:
        return self.device.servo_angles(x)[0] - self.device.servo_zero

    def _start_at(self, pitch: float, roll: float, depth: float) -> Array:
        x = np.array([pitch, roll, first_contact(self.device, self.contact, pitch, roll) - depth])
        for _ in range(20):
            if self.device.feasible(x):
                return x
            x[:2] *= 0.8
            x[2] = first_contact(self.device, self.contact, x[0], x[1]) - depth
        raise DermisError(
            "the servo limits exclude first contact", where="thimble", value=f"distance {1e3 * x[2]:.2f} mm",
            limit=f"servo angles within {np.degrees(self.device.servo_range):.3g} deg",
            remedy="Change link lengths, servo range or mounting so that the level platform reaches the pad",
        )  # fmt: skip

    def _build_table(self) -> tuple[Array, Array]:
        """Return poses and what they make felt from rest, those that touch."""
        rows, stimuli = [], []
        self.model.hold(FrictionState.rest(self.contact.count))
        for pitch in TABLE_TILTS:
            for roll in TABLE_TILTS:
                z = first_contact(self.device, self.contact, pitch, roll)
                for depth in TABLE_DEPTHS:
                    x = np.array([pitch, roll, z - depth])
                    if self.device.feasible(x):
                        stimulus, slope = self.model.evaluate(x)
                        if slope.any():
                            rows.append(x)
                            stimuli.append(stimulus)
        if not rows:
            raise DermisError("no pose within the servo limits touches the skin", where="thimble")
        table = np.array(stimuli)
        self._strongest = float(np.sqrt((table**2).sum(axis=1).max()))
        return np.array(rows), table
