"""Settings of tracks as WAV files.

Blender's panel and the command `export --format wav` have the same settings.
"""

from __future__ import annotations

from .parameter import SWITCH, Parameter, table

WAVE = table(
    Parameter(
        name="rate",
        unit="Hz",
        label="Rate",
        text="Samples per second of the WAV file",
        default=48_000,
        low=48_000,
        high=192_000,
        whole=True,
        source="chosen: what sound cards play",
    ),
    Parameter(
        name="full_scale",
        unit="V",
        label="Full Scale",
        text="Peak voltage of the sound card for the largest sample that the format holds; with 0, that sample stands "
        "for the limit of the device's channel, measured behind the amplifier",
        default=0.0,
        low=0.0,
        high=1e6,
    ),
    Parameter(
        name="gain",
        unit="1",
        label="Gain",
        text="Voltage gain of the amplifier between sound card and device; a larger gain makes the samples smaller, so "
        "the voltage at the device stays the same; with a full scale of 0 the samples do not depend on it",
        default=1.0,
        above=0.0,
        low=1e-6,
        high=1e6,
        soft=(1.0, 1000.0),
        digits=3,
    ),
    Parameter(
        name="carrier",
        unit="Hz",
        label="Carrier",
        text="Frequency of the voltage; with 0, the track's own carrier",
        default=0.0,
        low=0.0,
        high=24_000.0,
    ),
    Parameter(
        name="offset",
        unit="V",
        label="Offset",
        text="Constant voltage at the device, added to the alternating one; most sound cards cannot hold it",
        default=0.0,
        low=-1e6,
        high=1e6,
    ),
    Parameter(
        name="clip",
        unit=SWITCH,
        label="Clip",
        text="Clip samples beyond full scale, and count them; otherwise such a track is refused",
        default=False,
    ),
)
