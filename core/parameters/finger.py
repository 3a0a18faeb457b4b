"""Settings of a fingertip: the parameters of a `Finger`.

The settings of its skin are in `skin.py`, and those of its devices are in `device.py`.
"""

from __future__ import annotations

from .parameter import SWITCH, TEXT, Parameter, table

FINGER = table(
    Parameter(
        name="touch_distance",
        unit="m",
        label="Touch Gap",
        text="The pad touches a surface if the distance to its centre is at most this",
        default=0.5e-3,
        low=0.0,
        high=1.0,
        saved="touch_distance_mm",
        window_unit="mm",
        soft=(None, 5e-3),
        digits=3,
        keyed=True,
    ),
    Parameter(
        name="pattern",
        unit=TEXT,
        label="Pattern",
        text="Direction pattern that this finger's tactor plays",
        default="none",
        choices=(
            ("none", "None", "No pattern"),
            ("orientation", "Orientation", "The tactor rubs along a line ([S3] eq. 7)"),
            ("direction", "Direction", "The tactor moves along a direction and returns ([S3] eq. 8)"),
        ),
    ),
    Parameter(
        name="pattern_play",
        unit=SWITCH,
        label="Play",
        text="Each change from off to on starts the pattern; animate it with keys",
        default=False,
        keyed=True,
    ),
    Parameter(
        name="pattern_angle",
        unit="rad",
        label="Angle",
        text="Direction of the pattern in the pad's plane, clockwise as in the paper",
        default=0.0,
        low=-1e4,
        high=1e4,
        soft=(-6.2832, 6.2832),
        keyed=True,
    ),
    Parameter(
        name="pattern_frequency",
        unit="Hz",
        label="Frequency",
        text="Number of repetitions per second",
        default=2.0,
        low=0.01,
        high=500.0,
        soft=(None, 20.0),
        keyed=True,
    ),
    Parameter(
        name="pattern_amplitude",
        unit="1",
        label="Amplitude",
        text="Share of the device's range",
        default=1.0,
        low=0.0,
        high=1.0,
        keyed=True,
    ),
    Parameter(
        name="pattern_repeat",
        unit=SWITCH,
        label="Repeat",
        text="Repeat the pattern while Play is on, instead of playing it once",
        default=False,
    ),
)
