"""Arguments of the verbs that read command tracks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..track.formats import FORMATS
from .arguments import PRESETS, TRACK, add_verb, argument, settings_of, switch


def add_tracks(verbs: Any) -> None:
    """Add the verbs that read command tracks to a command line."""
    add_verb(
        verbs,
        "export",
        argument("tracks", type=Path, nargs="+", metavar="TRACK", help="command tracks: CSV, JSON or binary"),
        argument("--format", required=True, choices=list(FORMATS), help="what to write"),
        argument("--out", type=Path, metavar="DIR", help="folder; beside each track if left out"),
        argument("--range", type=float, nargs=2, metavar=("FROM", "TO"), help="part of the track [s]"),
        argument("--rate", type=float, metavar="HZ", help="resample"),
        switch("--limit", "apply the limits of the device; changes are counted"),
        switch("--force", "write in spite of errors, with a note in the header"),
        *settings_of("wav"),
        help="write tracks in another format, or a range of them",
        description="Write command tracks in another format, or a range of them.",
        run="command_line.tracks.export",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "check",
        TRACK,
        switch("--json", "the report as JSON"),
        PRESETS,
        help="check a track against its device's limits",
        description="Check a track against the limits of its device preset.",
        run="command_line.tracks.check",
    )
