"""All verbs of `python -m core`; `run` is the dotted name below `core` of a verb's function, which loads on choice."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from ..version import version
from .arguments import add_verb
from .design_verbs import add_designs
from .scene_verbs import add_scenes
from .sensor_verbs import add_sensors
from .stream_verbs import add_streams
from .study_verbs import add_studies
from .thimble_verbs import add_thimbles
from .track_verbs import add_tracks

# Verbs that were renamed: as they were written -> what they mean now.
OLD_VERBS = {("thimble", "follow"): ("follow", "--device", "thimble_3rrs")}


def parser(program: str) -> argparse.ArgumentParser:
    """Return the command line of a program."""
    made = argparse.ArgumentParser(
        prog=program,
        description="Dermis without Blender: render sampled scenes, check command tracks.",
        epilog="Exit status: 0; 1 where a finding has the severity error; 2 where nothing could be done. "
        "With --json a refusal is an object 'error' on standard output; programs compare its 'code'.",
    )
    made.add_argument("--version", action="version", version=f"dermis {version()}")
    verbs = made.add_subparsers(required=True, metavar="COMMAND")
    for add in (add_scenes, add_tracks, add_streams, add_designs, add_sensors, add_thimbles, add_studies):
        add(verbs)
    add_verb(
        verbs,
        "work",
        help="take jobs from a parent process (not for people)",
        description="Take jobs as JSON lines from standard input.",
        run="command_line.workers.work",
    )
    return made


def renamed(arguments: Sequence[str]) -> list[str]:
    """Return a command line with the new name of its verb; say so on standard error where it had an old one."""
    for old, new in OLD_VERBS.items():
        if tuple(arguments[: len(old)]) == old:
            print(f"'{' '.join(old)}' is '{' '.join(new)}' now", file=sys.stderr)
            return [*new, *arguments[len(old) :]]
    return list(arguments)
