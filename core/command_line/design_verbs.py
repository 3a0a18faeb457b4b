"""Arguments of the verb `design`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..design.interactions import NAMES, NOISE
from ..parameters.skin import SKIN_CONTACT
from .arguments import LEVEL, PRESETS, QUIET, REST, WORKERS, add_verb, argument, switch


def add_designs(verbs: Any) -> None:
    """Add the verb `design` to a command line."""
    add_verb(
        verbs,
        "design",
        argument(
            "touches", nargs="*", metavar="TOUCH", help=f"sampled scene, recording, or one of: {', '.join(NAMES)}"
        ),
        argument("--device", default="cable_platform", metavar="PRESET", help="the device preset"),
        argument("--table", type=Path, metavar="FILE", help="a collected table (.npz) or a recorded one (.csv)"),
        argument("--rows", type=int, metavar="N", help="size of the table to collect; 0 for the preset's own"),
        switch(
            "--adaptive",
            "spend the table's rows where the device touches and its readings bend: half as many are as good",
        ),
        argument("--save-table", type=Path, metavar="FILE", help="keep the collected table"),
        *WORKERS,
        argument("--skin", metavar="PRESET", help="the skin preset; as in the scene if left out"),
        LEVEL,
        argument(
            "--tissue", choices=SKIN_CONTACT["tissue"].keys, help="of the skin; as in the scene, or linear, if left out"
        ),
        argument(
            "--noise",
            type=float,
            metavar="SIGMA",
            help="standard deviation of one channel's noise: of recordings in their own unit, measured on each if left "
            f"out; of the virtual sensor in counts ({NOISE:g})",
        ),
        *REST,
        argument("--seed", type=int, default=0, help="of noise and of the six interactions' wobble"),
        argument("--finger", type=int, default=0, metavar="I", help="which finger of a scene"),
        argument(
            "--rule",
            choices=("touch", "paper"),
            help="how many motors the preset gets: less than the limit of the touch lost, or the paper's",
        ),
        argument("--motors", type=int, metavar="K", help="of the preset; as the rule says if left out"),
        argument("--out", type=Path, metavar="DIR", help="write text, JSON, picture and preset there"),
        PRESETS,
        switch("--json", "print the report as JSON"),
        argument(
            "--trial",
            type=int,
            metavar="SEEDS",
            help="judge the six interactions for so many seeds, and list every exception",
        ),
        QUIET,
        help="how many motors a device needs for given touches",
        description="Find the fewest motors, and their coupling, with which a platform device renders given touches: "
        "sampled scenes (.npz), recordings of a sensor of any number of channels (.csv), or the six interactions of "
        "[S2].",
        run="command_line.design.run",
        writes={"out": True, "save_table": False},
    )
