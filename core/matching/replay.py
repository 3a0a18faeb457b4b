"""Replay: forces of a device on the skin along a given motion, with the history of friction.

A bake stores the motion of a device but not its forces on the skin. A replay computes them again for any sample.
Friction states are stored at intervals, so that a step back is fast.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..devices.disc_device import DiscDevice
from ..devices.disc_pose import DiscSolution, FrictionState, placed
from ..devices.servo_limits import SERVOS
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..skin.model import SkinModel
from ..surrogate.store import contact_of
from ..track.command_track import CommandTrack
from .thimble_use import middle_of

INTERVAL = 32  # number of samples from one stored state to the next


class Replay:
    """Motion of a device on a skin.

    Args:
        device: the device.
        skin: model of the skin.
        friction: Coulomb coefficient.
        x: configuration at every sample: pitch, roll [rad], distance [m] and further values, shape (n, freedoms).

    Raises:
        DermisError: the configurations are not finite or have another shape.
    """

    def __init__(self, device: DiscDevice, skin: SkinModel, friction: float, x: Array) -> None:
        x = np.asarray(x, np.float64)
        if x.ndim != 2 or x.shape[1:] != (device.freedoms,) or not np.isfinite(x).all():
            raise DermisError(
                "configurations are pitch, roll and distance (and more), finite", where="replay", value=x.shape
            )
        self.device, self.x, self.contact = device, x, contact_of(device, skin, friction)
        self._states = {0: FrictionState.rest(self.contact.count)}  # before the sample
        self._now = (0, self._states[0])
        self._unsettled: set[int] = set()

    def __len__(self) -> int:
        return len(self.x)

    def forces(self, sample: int, ahead: Array | None = None) -> Array:
        """Return the forces of the disc on the pad nodes at a sample [N], shape (m, 3). See `solution`."""
        return self.contact.nodal(self.solution(sample, ahead))

    def solution(self, sample: int, ahead: Array | None = None) -> DiscSolution:
        """Return the contact of the disc with the skin at a sample.

        Args:
            sample: index of the sample.
            ahead: a configuration shortly after the sample, at which contact is solved instead, shape (freedoms,). The
                friction history is that after the sample.

        Raises:
            DermisError: the sample does not exist.
        """
        if not 0 <= sample < len(self.x):
            raise DermisError("no such sample", where="replay", value=sample, limit=f"0 to {len(self.x) - 1}")
        state = self._before(sample)
        solution = self._solved(state, self.x[sample], sample)
        after = self._after(solution)
        self._now = (sample + 1, after)
        if ahead is not None:
            solution = self._solved(after, ahead, sample)
        return solution

    def findings(self, device: str) -> tuple[Finding, ...]:
        """Return a finding if the nonlinear law did not converge in samples that were solved so far.

        Args:
            device: name of the device.
        """
        return unsettled(len(self._unsettled), device, min(self._unsettled, default=0))

    def _before(self, sample: int) -> FrictionState:
        """Return the friction state at the begin of a sample."""
        start = max(k for k in self._states if k <= sample)
        state = self._states[start]
        if start < self._now[0] <= sample:
            start, state = self._now
        for i in range(start, sample):
            state = self._after(self._solved(state, self.x[i], i))
            if (i + 1) % INTERVAL == 0:
                self._states[i + 1] = state
        return state

    def _solved(self, state: FrictionState, x: Array, sample: int) -> DiscSolution:
        self.contact.hold(state)
        solution = self.contact.solve(placed(self.device, self.device.pose(x)))
        if solution.touching and not solution.settled:
            self._unsettled.add(sample)
        return solution

    def _after(self, solution: DiscSolution) -> FrictionState:
        return self.contact.settle(solution) if solution.touching else FrictionState.rest(self.contact.count)


def unsettled(count: int, device: str, first: int) -> tuple[Finding, ...]:
    """Return the finding for samples of a track whose contact was not settled by the nonlinear law; none for 0 samples.

    Args:
        count: number of samples.
        device: name of the device.
        first: index of the first sample.
    """
    if not count:
        return ()
    return (
        Finding(
            "warning",
            "law-unsettled",
            f"the nonlinear law did not converge while the commands of {device} were played: the forces of these "
            "samples, and the errors computed from them, are uncertain",
            "",
            f"from sample {first}",
            "convergence",
            "Use more samples per second, or touch less deeply",
            count=count,
        ),
    )


def configurations(track: CommandTrack, device: DiscDevice) -> Array:
    """Return the configurations of the platform for the joints in a track, shape (n, freedoms).

    Raises:
        DermisError: the track has no channels for the joints, or no configuration has their values.
    """
    angles = np.stack([track.column(name) for name in _joints(track.spec)], axis=1)
    out, before = np.empty_like(angles), middle_of(track.spec, device)
    for i, row in enumerate(angles):
        out[i] = before = device.forward(row, before)
    return out


def _joints(spec: DeviceSpec) -> tuple[str, ...]:
    return tuple(c.name for c in spec.channels) if spec.kind == "hexapod" else SERVOS
