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
            "place more of the table's rows where the device touches and the readings are nonlinear; half as many "
            "are then as accurate",
        ),
        argument("--save-table", type=Path, metavar="FILE", help="write the collected table to this file"),
        *WORKERS,
        argument("--skin", metavar="PRESET", help="the skin preset; that of the scene if left out"),
        LEVEL,
        argument(
            "--tissue",
            choices=SKIN_CONTACT["tissue"].keys,
            help="tissue of the skin; that of the scene, or linear, if left out",
        ),
        argument(
            "--noise",
            type=float,
            metavar="SIGMA",
            help="standard deviation of one channel's noise: of recordings in their own unit, measured on each if left "
            f"out; of the virtual sensor in counts ({NOISE:g})",
        ),
        *REST,
        argument("--seed", type=int, default=0, help="seed of the noise and of the six interactions' tremor"),
        argument("--finger", type=int, default=0, metavar="I", help="index of the finger in each scene (0)"),
        argument(
            "--rule",
            choices=("touch", "paper"),
            help="rule for the number of motors of the preset: 'touch' keeps the additional error below a tenth of the "
            "touch's strength, 'paper' the error below 110 %% of that with all motors",
        ),
        argument(
            "--motors", type=int, metavar="K", help="number of motors of the preset; that of the rule if left out"
        ),
        argument("--out", type=Path, metavar="DIR", help="write text, JSON, picture and preset there"),
        PRESETS,
        switch("--json", "print the report as JSON"),
        argument(
            "--trial",
            type=int,
            metavar="SEEDS",
            help="evaluate the six interactions for this many seeds, and list every exception",
        ),
        QUIET,
        help="number of motors that a device needs for given touches",
        description="Find the fewest motors, and their coupling, with which a platform device renders given touches: "
        "sampled scenes (.npz), recordings of a sensor of any number of channels (.csv), or the six interactions of "
        "[S2].",
        run="command_line.design.run",
        writes={"out": True, "save_table": False},
    )
