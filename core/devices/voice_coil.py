"""VoiceCoil: a coil and a magnet that shake the fingertip, driven by a voltage through a measured response.

The wanted movement is a displacement along its one axis. The voltage for it is the inverse of the measured response, in
the band in which that was measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .gain_curve import GainCurve, filter_taps, filtered
from .spec import DeviceSpec

DISPLACEMENT, VOLTAGE = "displacement", "voltage"
# A wave of four samples a period or more keeps its amplitude when a track is made into sound (`track/upsampling.py`).
SAMPLES_A_PERIOD = 4.0


@dataclass(frozen=True)
class VoiceCoil:
    """One actuator.

    Attributes:
        radius: the displacement that a rendered 1 stands for, A [m].
        response: acceleration [m/s^2] for each V.
        rate: samples per second of its commands [Hz].
    """

    radius: float
    response: GainCurve
    rate: float

    @classmethod
    def of(cls, spec: DeviceSpec) -> VoiceCoil:
        """Read a device preset of kind 'voice_coil'.

        Raises:
            DermisError: a channel, a limit or a parameter missing, no response, or a response beyond a quarter of the
                rate.
        """
        where = f"device preset '{spec.key}'"
        names = {c.name for c in spec.channels}
        if names != {DISPLACEMENT, VOLTAGE}:
            raise DermisError(
                "a voice coil has two channels",
                where=where,
                value=", ".join(sorted(names)),
                limit=f"{DISPLACEMENT}, {VOLTAGE}",
            )
        volts = spec.channel(VOLTAGE)
        if volts.low is None or volts.high is None or not volts.low < 0.0 < volts.high:
            raise DermisError(
                "the voltage has no limit to both sides",
                where=where,
                value=(volts.low, volts.high),
                limit="low < 0 V < high",
                remedy="Give the channel 'voltage' a 'low' and a 'high'",
            )
        try:
            response = GainCurve(tuple(spec.value("response_frequency")), tuple(spec.value("response_gain")))
        except DermisError as error:
            raise error.changed(where=f"{where}, {error.where}") from error
        if response.band[1] * SAMPLES_A_PERIOD > spec.rate:
            raise DermisError(
                "the response reaches beyond a quarter of the device's rate",
                where=where,
                value=f"{response.band[1]:g} Hz",
                limit=f"<= {spec.rate / SAMPLES_A_PERIOD:g} Hz",
                remedy="Raise 'rate', or leave the higher frequencies out",
            )
        return cls(spec.value("range"), response, spec.rate)

    def gain(self, frequency: Array) -> Array:
        """Return the displacement for each V [m/V] at frequencies [Hz]; NaN outside of the measured band."""
        return self.response.at(frequency) / (2.0 * np.pi * np.asarray(frequency)) ** 2

    @cached_property
    def drive_taps(self) -> Array:
        """Weights that turn displacements [m] into the voltage [V], the newest sample's first, shape (taps,)."""
        return filter_taps(lambda frequency: 1.0 / self.gain(frequency), self.response.band, self.rate)

    def volts(self, displacement: Array, before: Array | None = None) -> Array:
        """Return the voltage [V] for displacements [m] at the device's rate, shapes (n,).

        Args:
            before: the displacements before them, shape (taps - 1,); None: the first one, for ever, so that a coil
                that is not at rest at first does not knock.
        """
        return filtered(np.concatenate([self._before(displacement, before), displacement]), self.drive_taps)

    def history(self, displacement: Array, before: Array | None, index: int) -> Array:
        """Return the displacements before one of them [m], as `volts` takes them, shape (taps - 1,)."""
        whole = np.concatenate([self._before(displacement, before), displacement])
        return whole[index : index + len(self.drive_taps) - 1].copy()

    def _before(self, displacement: Array, before: Array | None) -> Array:
        if before is not None:
            return before
        return np.full(len(self.drive_taps) - 1, displacement[0] if len(displacement) else 0.0)
