"""Recorded: following sensor readings with a model learned from a recording of the real sensor in the real device.

The recording alone gives its channels a meaning: nothing of the simulated skin can check them, take the model's place
or judge the match. The device stays where the recording has been, for polynomials do not extrapolate.

The model is a quadratic polynomial of the pose and of how deep it presses into a skin of the finger's shape: a sensor
reads nothing before it touches, which no polynomial of the pose alone can say. A recording tells no friction memory.
How many components of that depth help is settled by runs that are held out; so is how good the model is.

Source: [S0] 4 and 6, where the skin is a measured one
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Indices
from ..devices.disc import DiscContact
from ..devices.disc_pose import DiscSolution, placed
from ..devices.thimble import Thimble
from ..errors import DermisError, Finding
from ..surrogate.forward import ForwardModel
from ..surrogate.learned import LearnedModel
from ..surrogate.ridge import fit_ridge
from ..surrogate.subspace import Subspace, principal_components
from ..surrogate.table import SampleTable
from ..surrogate.trial import TrialForce
from .gauss_newton import Minimum, ServoLimits
from .stress import Search, StressMatcher, ThimbleFrame
from .thimble_use import HOVER
from .warm_start import recorded_table

MIN_ROWS = 8  # a quadratic polynomial of three unknowns has ten coefficients
COMPONENTS = (0, 5, 10, 20, 30)  # of depth, that are tried
FOLDS, STRETCHES = 4, 12  # held out in turn; parts that a recording of one run is cut into
NOT_GOOD = 0.15  # of the readings: a model that leaves more on runs held out is worth a warning
SLACK = np.radians(3.0)  # of the servos' range: a real device is assembled less exactly than it is computed


class RecordedMatcher(StressMatcher):
    """Follows readings in a recording's own units.

    Args:
        device: the mechanism. contact: disc and skin, for the poses in which nothing is touched.
        model: learned from the table. table: the recording.
        change, hover, noise_floor: as in `StressMatcher`.

    Attributes:
        outside: frames since the last reset whose best pose was beyond the recorded ones.

    Raises:
        DermisError: no recorded pose makes the channels change, or the servo limits exclude first contact.
    """

    follows_law = False  # of the simulated skin, which knows nothing of the readings

    def __init__(
        self,
        device: Thimble,
        contact: DiscContact,
        model: ForwardModel,
        table: SampleTable,
        *,
        change: float | None = None,
        hover: float = HOVER,
        noise_floor: float = 0.0,
    ) -> None:
        self.low, self.high = table.x.min(axis=0), table.x.max(axis=0)
        self.outside = 0
        unknown = np.zeros((model.size, 3 * contact.points.node_count))  # the readings of simulated forces
        starts = recorded_table(device, contact, model, table.x)
        super().__init__(
            device, contact, unknown, model, change=change, hover=hover, noise_floor=noise_floor, table=starts
        )
        # the predicted reading is all that is known of the skin, and friction is not remembered
        self._usual = self._foreseen = 0.0

    def reset(self) -> None:
        """Forget the frame before."""
        super().reset()
        self.outside = 0

    def step(self, target: Array, search: Search | None = None, start: Array | None = None) -> ThimbleFrame:
        """Find the pose for the next frame's readings, shape (k,); see `StressMatcher.step`."""
        frame = super().step(target, search)
        self._pressed = frame.minimum is not None  # the simulated skin's answer to it does not count
        return frame

    def _search(self, target: Array, limits: ServoLimits) -> Minimum:
        found = super()._search(target, limits)
        x = np.clip(found.x, self.low, self.high)
        if np.array_equal(x, found.x):
            return found
        self.outside += 1
        x = self._within(x, limits)
        stimulus, _ = self.model.evaluate(x)
        residual = stimulus - target
        cost = 0.5 * float(residual @ residual)
        room, _ = limits.constraints(self.device, x)
        return replace(
            found,
            x=x,
            stimulus=stimulus,
            residual=residual,
            start_cost=cost,
            cost=cost,
            kkt=0.0,
            room=room,
            active=(),
            multipliers=np.zeros(0),
            why="edge",
        )

    def _rendered_stimulus(self, solution: DiscSolution, minimum: Minimum | None) -> Array:
        return np.zeros(self.model.size) if minimum is None else minimum.stimulus

    def _mistrusted(self, found: object, size: float) -> bool:
        return False


@dataclass(frozen=True, eq=False)
class Recording:
    """Model learned from a recording, with its error.

    Attributes:
        model: model of all rows.
        table: the rows, with components of depth as memory, shape (n, components).
        error: RMS over that of the channels about their mean, on runs that the model of the others has not seen; nan
            where no channel changes.
        runs: how many there are. still: channels that never change.
    """

    model: LearnedModel
    table: SampleTable
    error: float
    runs: int
    still: tuple[int, ...]

    def findings(self, where: str) -> list[Finding]:
        """Return the findings about a recording."""
        out = []
        if self.error > NOT_GOOD:
            out.append(
                Finding(
                    "warning",
                    "recording-unlearned",
                    "the recording does not tell readings from poses well: what is rendered will be off as much",
                    where,
                    f"{100 * self.error:.0f} % off on runs held out",
                    f"<= {100 * NOT_GOOD:.0f} %",
                    remedy="Record more runs like those to follow, each from no touch to no touch, with this device",
                )
            )
        if self.still:
            names = ", ".join(str(i + 1) for i in self.still[:8])
            what = f"{len(self.still)} channels never change and tell nothing: {names}"
            out.append(Finding("info", "still-channels", what, where, count=len(self.still)))
        return out


def learn(table: SampleTable, device: Thimble, contact: DiscContact) -> Recording:
    """Learn how a sensor reads poses from a recording; any number of channels, in any unit.

    Args:
        contact: the device's disc against a skin of the finger's shape, for how deep poses press.
    """
    trial = TrialForce.of(contact)
    depth = np.array([trial.at(placed(device, device.pose(x)))[0] for x in table.x])
    run = _runs(table)
    count = len(np.unique(run))
    fold = np.unique(run, return_inverse=True)[1] * FOLDS // count
    least = max(np.ptp(table.channels), 1e-300) * 1e-12
    still = np.flatnonzero(np.ptp(table.channels, axis=0) <= least)
    best: tuple[float, int, Subspace] | None = None
    for size in COMPONENTS:
        terms = (4 + size) * (5 + size) // 2
        if best is not None and (size > min(depth.shape) or terms > len(depth) or not depth.any()):
            break
        space = _components(depth, size)
        told = SampleTable(table.x, space.project(depth), table.channels, run)
        error = held_out_error(told, fold)
        if best is None or error < best[0]:
            best = error, size, space
    assert best is not None
    error, _, space = best
    told = SampleTable(table.x, space.project(depth), table.channels, run)
    model = LearnedModel(fit_ridge(told), device, trial, space)
    return Recording(model, told, error, count, tuple(still.tolist()))


def held_out_error(table: SampleTable, fold: Indices) -> float:
    """Return the error of polynomials on rows that they were not fitted to, one fold after the other; nan for none.

    Args:
        fold: number of the fold of each row, shape (n,).
    """
    missed = 0.0
    spread = float(((table.channels - table.channels.mean(axis=0)) ** 2).sum())
    for k in np.unique(fold):
        rest = table.rows(fold == k)
        missed += float(((fit_ridge(table.rows(fold != k)).predict(rest.inputs) - rest.channels) ** 2).sum())
    return float(np.sqrt(missed / spread)) if spread > 0.0 else float("nan")


def _runs(table: SampleTable) -> Indices:
    """Return the run of each row: as the table says, or, of one that says nothing, stretches of time."""
    if len(np.unique(table.trajectory)) >= FOLDS:
        return table.trajectory
    return np.arange(len(table.x)) * min(STRETCHES, len(table.x)) // len(table.x)


def _components(depth: Array, size: int) -> Subspace:
    """Return components of depth; none of them is a space too."""
    if size:
        return principal_components(depth, size=size)
    mean = depth.mean(axis=0)
    return Subspace(mean, np.zeros((0, len(mean))), np.ones(1))


def check_recording(table: SampleTable, device: Thimble, where: str) -> None:
    """Refuse a recording that a device cannot have made, or too short to learn from.

    Raises:
        DermisError: fewer than eight rows, or a pose beyond the device's range: most often one in degrees or mm.
    """
    if len(table.x) < MIN_ROWS:
        raise DermisError("too few rows to learn from", where=where, value=len(table.x), limit=f">= {MIN_ROWS}")
    low, high = device.servo_limits
    low, high = low - SLACK, high + SLACK
    for row, (pitch, roll, distance) in enumerate(table.x.tolist(), 1):
        if not device.within(pitch, roll, distance, low.tolist(), high.tolist()):
            raise DermisError(
                "the device cannot hold this pose",
                where=f"{where}, row {row}",
                value=f"{pitch:.4g}, {roll:.4g}, {distance:.4g}",
                limit="pitch and roll in rad, distance in m, within the reach of the servos",
                remedy="Convert degrees to rad and mm to m, or name the device that made the recording",
            )
