"""Arguments of the verbs of `python -m core thimble`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..parameters.skin import DEFAULT_SKIN
from .arguments import LEVEL, QUIET, SCENE, THIMBLE, TISSUE, WORKERS, add_verb, argument


def add_thimbles(commands: Any) -> None:
    """Add the verbs of `thimble` to a command line."""
    verbs = commands.add_parser(
        "thimble",
        help="adapt, plot and measure a thimble",
        description="Adapt a thimble to a finger, draw the stimulus plot, print the reach. To follow recordings, use "
        "the verb 'follow'.",
    ).add_subparsers(required=True, metavar="WHAT")
    add_verb(
        verbs,
        "adapt",
        *THIMBLE,
        argument("--skin", default=[DEFAULT_SKIN], nargs="+", metavar="PRESET", help="skin presets, one per finger"),
        LEVEL,
        TISSUE,
        argument("--out", type=Path, required=True, metavar="DIR", help="folder for the surrogates, two files each"),
        argument("--movements", type=int, metavar="N", help="random movements to learn from; 2400 if left out"),
        *WORKERS,
        QUIET,
        help="learn network and polynomial for fingers",
        description="Learn network and polynomial for fingers. Neo-Hookean tissue is learned by its law, which takes "
        "about four times as long as linear tissue.",
        run="command_line.adapt.run",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "plot",
        *THIMBLE,
        SCENE,
        argument("--finger", type=int, default=0, metavar="I", help="which finger"),
        argument("--out", type=Path, required=True, metavar="FILE", help="the picture, .png or .svg"),
        help="draw a sampled scene's stimuli in three components",
        run="command_line.thimble.plot",
        writes={"out": False},
    )
    add_verb(verbs, "reach", *THIMBLE, help="print the range of the platform", run="command_line.thimble.reach")
