"""RecordedMatcher: matching of sensor readings by a model learned from a recording.

The recording is of a real sensor in the real device. Its channels have no meaning for the simulated skin, which can
therefore neither check the model nor judge the match. The device stays within the recorded poses, because polynomials
do not extrapolate.

The model is a quadratic polynomial of the pose and of its penetration into a skin of the finger's shape. A polynomial
of the pose alone cannot represent that a sensor reads nothing before contact. The model has no friction history. The
number of components of the penetration is chosen by the error on runs that are held out, which is also reported.

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
from .minimum import Minimum, ServoLimits
from .stress import Search, StressMatcher, ThimbleFrame
from .warm_start import recorded_table

MIN_ROWS = 8  # a quadratic polynomial of three unknowns has ten coefficients
COMPONENTS = (0, 5, 10, 20, 30)  # numbers of components of the penetration that are tried
FOLDS, STRETCHES = 4, 12  # folds of the cross-validation, and parts into which a recording of one run is divided
NOT_GOOD = 0.15  # relative error on held-out runs above which a warning is given
SLACK = np.radians(3.0)  # tolerance of the servos' range, for inaccuracies of a real device [rad]


class RecordedMatcher(StressMatcher):
    """Matches readings in the units of a recording.

    Args:
        device: the thimble.
        contact: contact of its disc with the simulated skin, for poses without contact.
        model: model learned from the recording.
        table: the recording.
        change: as in `StressMatcher`.

    Attributes:
        outside: number of frames since the last reset whose best pose was outside the recorded range.

    Raises:
        DermisError: no recorded pose changes the channels, or the servo limits exclude first contact.
    """

    follows_law = False  # the law of the simulated skin does not apply to readings

    def __init__(
        self,
        device: Thimble,
        contact: DiscContact,
        model: ForwardModel,
        table: SampleTable,
        *,
        change: float | None = None,
    ) -> None:
        self.low, self.high = table.x.min(axis=0), table.x.max(axis=0)
        self.outside = 0
        unknown = np.zeros((model.size, 3 * contact.points.node_count))  # the readings of simulated forces
        starts = recorded_table(device, contact, model, table.x)
        super().__init__(device, contact, unknown, model, change=change, table=starts)
        # Only predicted readings are known, and the model has no friction history.
        self._usual = self._foreseen = 0.0

    def reset(self) -> None:
        """Forget the frame before."""
        super().reset()
        self.outside = 0

    def step(self, target: Array, search: Search | None = None, start: Array | None = None) -> ThimbleFrame:
        """Find the pose for the next frame's readings, shape (k,); see `StressMatcher.step`."""
        frame = super().step(target, search)
        self._pressed = frame.minimum is not None  # contact of the simulated skin does not count
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
        room = limits.constraints(self.device, x)
        return replace(
            found,
            x=x,
            joints=self._angles(x),
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
        table: the rows, with components of the penetration.
        error: RMS error on held-out runs, relative to the RMS of the channels about their means; nan if no channel
            changes.
        runs: number of runs.
        still: indices of channels that never change.
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
    """Learn the readings of a sensor as a function of the pose, for any number of channels in any unit.

    Args:
        table: the recording.
        device: the device that made it.
        contact: contact of its disc with a skin of the finger's shape, for the penetration.
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
    """Return the cross-validation error of polynomial fits, relative to the channels' spread; nan without spread.

    Args:
        table: the recording.
        fold: index of the fold of each row, shape (n,).
    """
    missed = 0.0
    spread = float(((table.channels - table.channels.mean(axis=0)) ** 2).sum())
    for k in np.unique(fold):
        rest = table.rows(fold == k)
        missed += float(((fit_ridge(table.rows(fold != k)).predict(rest.inputs) - rest.channels) ** 2).sum())
    return float(np.sqrt(missed / spread)) if spread > 0.0 else float("nan")


def _runs(table: SampleTable) -> Indices:
    """Return the run of each row: that in the table, or a stretch of time if the table has too few runs."""
    if len(np.unique(table.trajectory)) >= FOLDS:
        return table.trajectory
    return np.arange(len(table.x)) * min(STRETCHES, len(table.x)) // len(table.x)


def _components(depth: Array, size: int) -> Subspace:
    """Return the principal components of the penetration; an empty subspace for a size of 0."""
    if size:
        return principal_components(depth, size=size)
    mean = depth.mean(axis=0)
    return Subspace(mean, np.zeros((0, len(mean))), np.ones(1))


def check_recording(table: SampleTable, device: Thimble, where: str) -> None:
    """Raise an error for a recording that is too short, or that the device cannot have made.

    Args:
        table: the recording.
        device: the device.
        where: name of the recording, for the error.

    Raises:
        DermisError: there are fewer than `MIN_ROWS` rows, or a pose is outside the device's range, as for poses in
            degrees or mm.
    """
    if len(table.x) < MIN_ROWS:
        raise DermisError("too few rows to learn from", where=where, value=len(table.x), limit=f">= {MIN_ROWS}")
    low, high = device.servo_limits
    low, high = low - SLACK, high + SLACK
    for row, x in enumerate(table.x, 1):
        if not device.holds(x, low, high):
            raise DermisError(
                "the device cannot hold this pose",
                where=f"{where}, row {row}",
                value=", ".join(f"{value:.4g}" for value in x.tolist()),
                limit="pitch and roll in rad, distance in m, within the reach of the servos",
                remedy="Convert degrees to rad and mm to m, or name the device that made the recording",
            )
