"""Arguments of the verbs that repeat studies of the papers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..parameters.skin import DEFAULT_SKIN
from .arguments import LEVEL, PRESETS, QUIET, SCENE, WORKERS, add_verb, argument, number

OUT = argument("--out", type=Path, metavar="DIR", help="write the table (CSV) and the picture (PNG) there")
METHODS = ("DM2", "DM1", "DM0", "FM2", "FM1", "FM0")


def add_studies(verbs: Any) -> None:
    """Add the verbs that repeat studies to a command line."""
    add_verb(
        verbs,
        "tell-apart",
        SCENE,
        argument("--finger", type=int, default=0, metavar="I", help="which finger"),
        argument("--out", type=Path, metavar="DIR", help="write the table (CSV) there"),
        PRESETS,
        QUIET,
        help="which touches of a scene a finger could tell apart, by device and method",
        description="Let an ideal observer tell a finger's touches apart, in pairs: the real ones, and those of each "
        "device and method that presses on skin makes of them. Where it lifts for a tenth of a second, a touch ends.",
        run="command_line.studies.tell_apart",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "sweep",
        argument(
            "spec", type=Path, nargs="?", metavar="SPEC.toml", help="a table of variants instead; see presets/scale.md"
        ),
        argument("--device", default="pin_array_128", metavar="PRESET", help="a pin array's preset"),
        argument("--method", action="append", default=[], choices=METHODS, help="only this one; more than once"),
        argument("--depth", type=number, nargs="+", default=[0.5, 1.0, 1.5, 2.0], metavar="MM", help="depths [mm]"),
        argument("--friction", type=number, nargs="+", default=[0.0, 0.2, 0.4, 0.6], metavar="MU", help="coefficients"),
        argument(
            "--direction", type=number, nargs="+", default=[0.0], metavar="DEG", help="of the movement, from +X [deg]"
        ),
        argument("--slide", type=number, default=2.0, metavar="S", help="length of the movement [s] (2)"),
        argument("--skin", default=DEFAULT_SKIN, metavar="PRESET", help="the skin preset"),
        LEVEL,
        OUT,
        PRESETS,
        QUIET,
        *WORKERS,
        help="a table of variants over scenes; or how far methods miss over a sliding plane's stimuli",
        description="With SPEC.toml: every combination of devices, dimensions, skins, materials, methods or seeds that "
        "it names, over its scenes, as one table in --out, which a run that was ended goes on with. Without: press a "
        "plane into the pad and draw it along, as [S1] does, for every combination of depth, friction and direction, "
        "and match it by every method.",
        run="command_line.studies.sweep",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "bump",
        argument("--device", default="electrovibration", metavar="PRESET", help="a friction screen's preset"),
        argument("--height", type=number, default=1.0, metavar="MM", help="of the bump (1)"),
        argument("--width", type=number, default=8.0, metavar="MM", help="its standard deviation (8)"),
        argument("--speed", type=number, default=100.0, metavar="MM/S", help="of the finger (100)"),
        OUT,
        PRESETS,
        help="friction and volts along a Gaussian bump, by profile",
        description="Let a finger go over a Gaussian bump on a friction screen, as in [S4], by each of its profiles.",
        run="command_line.studies.bump",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "weakest-force",
        argument("--device", default="haptip", metavar="PRESET", help="a shear tactor's preset"),
        PRESETS,
        help="how strong a shear tactor is in its weakest direction",
        run="command_line.studies.weakest_force",
    )
