"""`python -m core migrate-report`: how commands differ from stored tracks, which an earlier engine made."""

from __future__ import annotations

import argparse
import sys

from ..comparison import migration
from ..files import write_bytes
from ..pipeline.render import render
from ..presets import Library
from ..scene import scene_file
from .findings import tell
from .progress import drain_shown


def migrate_report(options: argparse.Namespace) -> int:
    """Say how the commands of a scene differ from stored tracks of it."""
    scene, library = scene_file.load(options.scene), Library(options.presets)
    stored, unread = migration.stored_tracks(options.tracks)
    bake = drain_shown(render(scene, library), quiet=options.quiet)
    found, doubts = migration.migrations(bake, stored)
    print(migration.table(found))
    if options.out is not None:
        write_bytes(options.out, migration.text(found).encode())
        print(options.out)
    changed = [one.finding(options.allow) for one in found]
    return tell([*unread, *doubts, *(finding for finding in changed if finding is not None)], sys.stderr)
