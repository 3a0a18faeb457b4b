"""All verbs of `python -m core`.

`run` of a verb is the dotted name, below `core`, of its function. The module of the function is imported only when the
verb is chosen.
"""

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

# Verbs that were renamed: the old words -> the new words, with the options that keep the old meaning.
OLD_VERBS = {("thimble", "follow"): ("follow", "--device", "thimble_3rrs")}


def parser(program: str) -> argparse.ArgumentParser:
    """Return the parser of the command line.

    Args:
        program: name of the program in usage and errors.
    """
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
    """Return a command line in which an old name of its verb is replaced.

    A replacement is reported on standard error.

    Args:
        arguments: arguments of the command line.
    """
    for old, new in OLD_VERBS.items():
        if tuple(arguments[: len(old)]) == old:
            print(f"'{' '.join(old)}' is '{' '.join(new)}' now", file=sys.stderr)
            return [*new, *arguments[len(old) :]]
    return list(arguments)
