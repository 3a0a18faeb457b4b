"""CommandTrack: what a device shall do, over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .devices.spec import Channel, DeviceSpec
from .errors import DermisError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CommandTrack:
    """Command values of one device at rising times, in SI.

    Attributes:
        spec: the device.
        times: [s] from the start of the range, strictly rising, shape (n,).
        values: in the units of `spec.channels`, shape (n, channels).
        meta: what a reader of the file wants to know: finger, scene, frame range, fps, content hash ...
        limited: per channel name, how many samples a limiter changed.
    """

    spec: DeviceSpec
    times: Array
    values: Array
    meta: Mapping[str, str] = field(default_factory=dict)
    limited: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.times), len(self.spec.channels)):
            raise DermisError(
                "values do not fit times and channels", where=self.spec.name, value=self.values.shape,
                limit=f"({len(self.times)}, {len(self.spec.channels)})",
            )  # fmt: skip

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The device's channels, in the order of the columns."""
        return self.spec.channels

    def column(self, name: str) -> Array:
        """Return the values of one channel, shape (n,)."""
        for i, channel in enumerate(self.spec.channels):
            if channel.name == name:
                return self.values[:, i]
        raise DermisError("no such channel", where=self.spec.name, value=name)
