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
        argument("--finger", type=int, default=0, metavar="I", help="index of the finger (0)"),
        argument("--out", type=Path, metavar="DIR", help="write the table (CSV) there"),
        PRESETS,
        QUIET,
        help="discriminability of a scene's touches, by device and method",
        description="Compute how often an ideal observer tells a finger's touches apart, in pairs: the real touches, "
        "and the same touches rendered by each device and method that presses on skin. A touch ends when the "
        "finger lifts for a tenth of a second.",
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
        argument("--method", action="append", default=[], choices=METHODS, help="only this method; may be repeated"),
        argument("--depth", type=number, nargs="+", default=[0.5, 1.0, 1.5, 2.0], metavar="MM", help="depths [mm]"),
        argument(
            "--friction",
            type=number,
            nargs="+",
            default=[0.0, 0.2, 0.4, 0.6],
            metavar="MU",
            help="coefficients of friction",
        ),
        argument(
            "--direction",
            type=number,
            nargs="+",
            default=[0.0],
            metavar="DEG",
            help="directions of the slide, from +X [deg]",
        ),
        argument("--slide", type=number, default=2.0, metavar="S", help="duration of the slide [s] (2)"),
        argument("--skin", default=DEFAULT_SKIN, metavar="PRESET", help="the skin preset"),
        LEVEL,
        OUT,
        PRESETS,
        QUIET,
        *WORKERS,
        help="a table of variants over scenes; or errors of matching methods under a sliding plane",
        description="With SPEC.toml: evaluate every combination of its devices, dimensions, skins, materials, methods "
        "or seeds over its scenes, and write one table into --out. An interrupted run continues its table. "
        "Without SPEC.toml: press a plane into the pad and slide it, as in [S1], for every combination of "
        "depth, friction and direction, and match it by every method.",
        run="command_line.studies.sweep",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "bump",
        argument("--device", default="electrovibration", metavar="PRESET", help="a friction screen's preset"),
        argument("--height", type=number, default=1.0, metavar="MM", help="height of the bump (1)"),
        argument("--width", type=number, default=8.0, metavar="MM", help="standard deviation of the bump (8)"),
        argument("--speed", type=number, default=100.0, metavar="MM/S", help="speed of the finger (100)"),
        OUT,
        PRESETS,
        help="friction and volts along a Gaussian bump, by profile",
        description="Move a finger over a Gaussian bump on a friction screen, as in [S4], with each profile.",
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
