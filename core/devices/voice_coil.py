"""VoiceCoil: coil and magnet that shake the fingertip.

A voltage drives the coil. The wanted movement is a displacement along one axis. The voltage for it follows from the
inverse of the measured response, in the measured band.
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
# Least number of samples per period of a wave. With fewer, a wave would lose amplitude when a track is converted to
# sound (`track/upsampling.py`).
SAMPLES_A_PERIOD = 4.0


@dataclass(frozen=True)
class VoiceCoil:
    """Mechanism of a voice coil.

    Attributes:
        radius: displacement A for a rendered value of 1 [m].
        response: acceleration per volt [m/s^2/V].
        rate: commands per second [Hz].
    """

    radius: float
    response: GainCurve
    rate: float

    @classmethod
    def of(cls, spec: DeviceSpec) -> VoiceCoil:
        """Read a device preset of kind 'voice_coil'.

        Raises:
            DermisError: a channel, a limit or a parameter is missing or wrong, or the response reaches beyond a quarter
                of the rate.
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
                "the voltage needs limits on both sides",
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
        """Return the displacement per volt at frequencies [Hz], in m/V.

        It is NaN outside the measured band.
        """
        return self.response.at(frequency) / (2.0 * np.pi * np.asarray(frequency)) ** 2

    @cached_property
    def drive_taps(self) -> Array:
        """Weights from displacements [m] to the voltage [V], shape (taps,).

        The first one is that of the newest sample.
        """
        return filter_taps(lambda frequency: 1.0 / self.gain(frequency), self.response.band, self.rate)

    def volts(self, displacement: Array, before: Array | None = None) -> Array:
        """Return the voltage for displacements at the device's rate, shape (n,).

        Args:
            displacement: displacements [m], shape (n,).
            before: displacements before these [m], shape (taps - 1,). If it is None, the first displacement counts as
                held before. A coil that does not start at zero then does not knock.
        """
        return filtered(np.concatenate([self._before(displacement, before), displacement]), self.drive_taps)

    def history(self, displacement: Array, before: Array | None, index: int) -> Array:
        """Return the displacements before that of an index [m], shape (taps - 1,).

        They are the `before` of `volts` for the displacements from this index on.
        """
        whole = np.concatenate([self._before(displacement, before), displacement])
        return whole[index : index + len(self.drive_taps) - 1].copy()

    def _before(self, displacement: Array, before: Array | None) -> Array:
        if before is not None:
            return before
        return np.full(len(self.drive_taps) - 1, displacement[0] if len(displacement) else 0.0)
