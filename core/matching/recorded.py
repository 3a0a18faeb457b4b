"""Recorded: following sensor readings with a model learned from a recording of the real sensor in the real device.

What the channels mean is the recording's own affair: nothing of the simulated skin can check them, take the model's
place or judge the match. The device stays where the recording has been, for no polynomial knows what is beyond.

Source: [S0] 4 and 6, where the skin is a measured one
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..devices.disc import DiscContact
from ..devices.disc_pose import DiscSolution
from ..devices.thimble import Thimble
from ..errors import DermisError
from ..surrogate.forward import ForwardModel
from ..surrogate.table import SampleTable
from .gauss_newton import Minimum, ServoLimits
from .stress import Search, StressMatcher, ThimbleFrame
from .thimble_use import HOVER
from .warm_start import recorded_table

MIN_ROWS = 8  # a quadratic polynomial of three unknowns has ten coefficients
SLACK = np.radians(3.0)  # of the servos' range: a real device is assembled less exactly than it is computed


class RecordedMatcher(StressMatcher):
    """Follows readings in a recording's own units.

    Args:
        device: the mechanism. contact: disc and skin, for the poses in which nothing is touched.
        model: learned from the table. table: what was recorded.
        change, hover, noise_floor: as in `StressMatcher`.

    Attributes:
        outside: frames since the last reset whose best pose was beyond the recorded ones.

    Raises:
        DermisError: no recorded pose makes the channels change, or the servo limits exclude first contact.
    """

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
        unknown = np.zeros((model.size, 3 * contact.points.node_count))  # what simulated forces would read
        starts = recorded_table(device, contact, model, table.x)
        super().__init__(
            device, contact, unknown, model, change=change, hover=hover, noise_floor=noise_floor, table=starts
        )

    def reset(self) -> None:
        """Forget the frame before."""
        super().reset()
        self.outside = 0

    def step(self, target: Array, search: Search | None = None) -> ThimbleFrame:
        """Find the pose for the next frame's readings, shape (k,); see `StressMatcher.step`."""
        frame = super().step(target, search)
        self._pressed = frame.minimum is not None  # what the simulated skin says of it does not count
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

    def _mistrusted(self, stimulus: Array, minimum: Minimum, size: float) -> bool:
        return False


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
