"""Resampling a long track of many channels, beside numpy's interpolation column by column."""

from __future__ import annotations

import numpy as np

from core.devices.spec import Channel, DeviceSpec
from core.track.command_track import CommandTrack

from . import Result, benchmark, measure

CHANNELS = 50


def _track(seconds: float, rate: float) -> CommandTrack:
    spec = DeviceSpec("pins", "Pins", "pin_array", rate, tuple(Channel(f"pin_{i}", "N") for i in range(CHANNELS)))
    times = np.arange(int(seconds * rate) + 1) / rate
    values = np.sin(times[:, None] * np.arange(1, CHANNELS + 1))
    return CommandTrack(spec, times, values)


@benchmark("resample_10s_50ch_ms", limit=5.0, quick=True)
def resample_10s_50ch() -> Result:
    """10 s of 50 channels, from 240 Hz to 1 kHz, linear."""
    track = _track(10.0, 240.0)
    at = np.arange(10_001) / 1000

    def peer() -> None:
        np.stack([np.interp(at, track.times, column) for column in track.values.T], axis=1)

    ours, theirs = measure(lambda: track.resampled(1000.0), 41), measure(peer, 41)
    return Result("resample_10s_50ch_ms", ours.median, "ms", ours.p95, {"np.interp": theirs.median})
