"""`python -m core render | curve | compare | trust | migrate-report`.

These verbs read sampled scenes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..comparison import device_comparison, migration, report, trust_band
from ..errors import DermisError
from ..files import write_bytes
from ..matching import pin_report
from ..pipeline import shot, shots
from ..pipeline.bake import Progress
from ..pipeline.render import render as rendering
from ..pipeline.skipping import told
from ..presets import Library
from ..scene import scene_file
from ..scene.tactile_scene import TactileScene
from ..surface.curved_scene import curved_scene
from ..work.executor import JobExecutor
from .messages import FAILED, REFUSED, drain_shown, tell
from .workers import executor_of, tell_unlike


def render(options: argparse.Namespace) -> int:
    """Render sampled scenes and write their tracks; return the exit status.

    The fingers of one scene, or several scenes, are rendered in parallel.
    """
    wanted = shot.Wanted(options.plots, options.maps, tuple(options.format), options.force)
    library = Library(options.presets)
    with executor_of(options) as executor:
        if len(options.scene) > 1 or not executor.shares_files:
            return _several(options, library, wanted, executor)
        scene = scene_file.load(options.scene[0])
        steps = shot.render_shot(scene, library, options.out, wanted, executor=executor)
        made = drain_shown(steps, quiet=options.quiet)
    return _told(made, [options.out / name for name in made.names], quiet=options.quiet)


def _several(options: argparse.Namespace, library: Library, wanted: shot.Wanted, executor: JobExecutor) -> int:
    """Render scenes in parallel, and report the result of each.

    The tracks of a scene are written to a folder with the name of its file. Return the exit status: `REFUSED` if all
    scenes were refused, and at least `FAILED` if some were.
    """
    status = refused = 0
    for step in shots.render_shots(options.scene, library, options.out, wanted, executor):
        if isinstance(step, Progress):
            if not options.quiet:
                print(f"{step.stage}: {step.done} of {step.total}", file=sys.stderr)
        elif step.shot is None:
            print(f"error: {step.scene}: {step.error}", file=sys.stderr)
            refused += 1
        else:
            if step.shot.findings and not options.quiet:
                print(f"{step.scene}:", file=sys.stderr)
            status = max(status, _told(step.shot, step.paths, quiet=options.quiet))
    tell_unlike(executor)
    return REFUSED if refused == len(options.scene) else max(status, FAILED if refused else 0)


def _told(made: shot.Shot, paths: Sequence[Path], *, quiet: bool) -> int:
    """Print written files, errors, skipped work and findings of a scene.

    Return the exit status.
    """
    for path in paths:
        print(path)
    for line in made.refused:
        print(f"error: {line}", file=sys.stderr)
    for part, words in () if quiet else told(made.skipped):
        print(f"skipped, {part}: {words}", file=sys.stderr)
    return max(tell(made.findings, sys.stderr), FAILED if made.refused else 0)


def curve(options: argparse.Namespace) -> int:
    """Write a sampled scene with curved faces; return the exit status."""
    scene = scene_file.load(options.scene)
    if options.out.resolve() == options.scene.resolve():
        raise DermisError("the scene would replace itself", where=str(options.out), remedy="Choose another file")
    if options.out.suffix.lower() != ".npz":
        raise DermisError("a scene is a file NAME.npz", where=str(options.out), remedy="Choose another name")
    made = curved_scene(scene, options.object, np.radians(options.sharp))
    scene_file.save(made, options.out)
    print(options.out)
    return tell([f for f in made.findings if f not in scene.findings], sys.stderr)


def compare(options: argparse.Namespace) -> int:
    """Print the errors of all matching methods of pin arrays for a scene.

    With --out, compare all devices for one finger instead. Return the exit status.
    """
    scene, library = scene_file.load(options.scene), Library(options.presets)
    if options.out is not None:
        return _devices(options, scene, library)
    compared = pin_report.compare_scene(scene, library, finer=options.finer)
    for name, reports in compared.reports.items():
        print(name)
        print(pin_report.table(reports))
    return tell(compared.findings, sys.stderr)


def trust(options: argparse.Namespace) -> int:
    """Print the changes of forces and commands under small changes of a scene.

    Return the exit status.
    """
    scene, library = scene_file.load(options.scene), Library(options.presets)
    _, bands = drain_shown(trust_band.trust_bands(scene, library), quiet=options.quiet)
    print(trust_band.table(bands))
    if options.out is not None:
        for path in trust_band.write(bands, options.out, plots=options.plots):
            print(path)
    return tell([band.finding for band in bands if band.finding is not None], sys.stderr)


def _devices(options: argparse.Namespace, scene: TactileScene, library: Library) -> int:
    """Compare all devices that can render a finger's touch.

    Print the comparison, write it as a table and a page, and return the exit status.
    """
    if options.finer:
        raise DermisError(
            "--finer applies to matching methods, not to devices", value=options.finer, remedy="Leave out --finer"
        )
    found = drain_shown(
        device_comparison.compare_devices(scene, library, options.finger, floors=options.floor), quiet=options.quiet
    )
    print(report.text(found))
    for path in report.write(found, options.out):
        print(path)
    return 0


def migrate_report(options: argparse.Namespace) -> int:
    """Print the differences of a scene's commands from stored tracks.

    The stored tracks are those of the same scene by an earlier engine. Return the exit status.
    """
    scene, library = scene_file.load(options.scene), Library(options.presets)
    stored, unread = migration.stored_tracks(options.tracks)
    bake = drain_shown(rendering(scene, library), quiet=options.quiet)
    found, doubts = migration.migrations(bake, stored)
    print(migration.table(found))
    if options.out is not None:
        write_bytes(options.out, migration.text(found).encode())
        print(options.out)
    changed = [one.finding(options.allow) for one in found]
    return tell([*unread, *doubts, *(finding for finding in changed if finding is not None)], sys.stderr)
