"""Arguments of the verbs for a device and a sensor in it.

The verbs follow a recording of the sensor, collect a table of the device, and compare a played track with its target.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..parameters.skin import DEFAULT_SKIN
from .arguments import (
    LEVEL,
    LINK,
    LOG,
    PRESETS,
    REST,
    SKIN,
    TRACK,
    add_verb,
    argument,
    device,
    seconds,
    setting,
    switch,
)


def add_sensors(verbs: Any) -> None:
    """Add the verbs for a device and a sensor to a command line."""
    add_verb(
        verbs,
        "follow",
        argument(
            "stimuli", type=Path, metavar="RECORDING", help="times and channels: .csv; of a learned thimble also .npz"
        ),
        argument("--device", default="cable_platform", metavar="PRESET", help="the device preset (cable_platform)"),
        argument(
            "--table",
            type=Path,
            metavar="FILE",
            help="the device's effect on this sensor: recorded motor commands, or of a thimble x (pitch, roll [rad], "
            "distance [m]), and channels in any unit (.csv), or a collected table (.npz). Without a table, a learned "
            "thimble uses the simulated sensor with 19 electrodes",
        ),
        argument("--out", type=Path, required=True, metavar="FILE.csv", help="the command track to write"),
        argument("--plot", type=Path, metavar="FILE", help="also draw the track: .png or .svg"),
        argument("--motors", type=int, metavar="K", help="use only K principal components of the commands"),
        argument(
            "--method",
            default="learned",
            choices=("learned", "lookup"),
            help="for a thimble: search with a learned model, or look up the nearest rows as for platforms (learned)",
        ),
        argument(
            "--noise",
            type=float,
            metavar="SIGMA",
            help="standard deviation of one channel's noise, in the recording's unit; measured on it if left out",
        ),
        *REST,
        *SKIN,
        PRESETS,
        help="make a device's track of a recording of a sensor",
        description="Make a track that lets a device follow a recording of a sensor. A platform, and a thimble with "
        "--method lookup, use the nearest rows of a table of the device's effect on this sensor; otherwise a "
        "thimble uses a model learned from such a table. Prints the error of the table.",
        run="command_line.follow.run",
        writes={"out": False, "plot": False},
    )
    add_verb(
        verbs,
        "collect",
        *device("cable_platform", "cable_platform"),
        *LINK,
        *LOG,
        setting("ramp"),
        argument(
            "--sensor",
            required=True,
            metavar="FROM",
            help="source of the readings of the sensor in the device: osc://:PORT, socket://HOST:PORT, "
            "serial:PORT?baud=RATE, '-', or virtual: in a virtual device",
        ),
        argument(
            "--channels",
            default="20",
            metavar="NAMES",
            help="names of the sensor's channels, separated by commas, or their number (20)",
        ),
        argument("--rows", type=int, metavar="N", help="approximate number of poses; the preset's own if left out"),
        argument(
            "--skin",
            default=DEFAULT_SKIN,
            metavar="PRESET",
            help="skin preset of the sensor's size, which gives first contact",
        ),
        LEVEL,
        argument("--settle", type=seconds, default=0.1, metavar="S", help="time in a pose before it is read (0.1)"),
        argument(
            "--average",
            type=seconds,
            default=0.1,
            metavar="S",
            help="time over which the readings of a pose are averaged (0.1)",
        ),
        argument(
            "--stop-at",
            action="append",
            default=[],
            metavar="CHANNEL=CHANGE",
            help="go to the safe state and end if a channel, such as a force, differs from its rest by more than "
            "CHANGE; may be repeated",
        ),
        argument("--out", type=Path, required=True, metavar="FILE.csv", help="the table to write"),
        switch("--yes", "arm without asking"),
        help="collect a look-up table from a built device with the sensor in it",
        description="Move a device through its poses, each from rest, and read the sensor in it. Every 50th row reads "
        "an earlier one again, which gives the drift. After a break, the same command continues.",
        run="command_line.collect.run",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "validate",
        TRACK,
        argument("recording", type=Path, metavar="RECORDING", help="readings of the sensor while the track was played"),
        argument(
            "--table",
            type=Path,
            required=True,
            metavar="FILE",
            help="table of this device and this sensor: .csv or .npz",
        ),
        argument("--target", type=Path, metavar="FILE", help="the recording that the track follows"),
        argument(
            "--sync", metavar="COLUMN", help="column of RECORDING with a pulse that rises when the track is played"
        ),
        argument("--sync-at", type=seconds, default=0.0, metavar="S", help="time of the track at the pulse's edge (0)"),
        *REST,
        argument("--out", type=Path, metavar="DIR", help="write text, table (CSV) and picture there"),
        help="compare the readings of a played track with their target",
        description="Compare three readings for a track that was played with the sensor in the device: the target's, "
        "those that the table gives for its commands (estimate), and those that were measured: relative RMS, mean and "
        "standard deviation, by channel and by component. A sync pulse also gives the device's delay.",
        run="command_line.follow.validate",
        writes={"out": True},
    )
