"""`python -m core render | curve | compare`: what verbs make of sampled scenes."""

from __future__ import annotations

import argparse
import sys

import numpy as np

from ..comparison import device_comparison, report
from ..errors import DermisError
from ..matching import pin_report
from ..pipeline import outputs
from ..pipeline import render as pipeline
from ..pipeline.skipping import told
from ..presets import Library
from ..scene import scene_file
from ..scene.tactile_scene import TactileScene
from ..surface.curved_scene import curved_scene
from ..track.export import format_of
from ..track.file_names import FileNames
from ..work.processes import ProcessExecutor, cores
from .findings import FAILED, tell
from .progress import drain_shown
from .tracks import write


def render(options: argparse.Namespace) -> int:
    """Render a sampled scene and write its tracks."""
    scene, library = scene_file.load(options.scene), Library(options.presets)
    if options.workers < 0:
        raise DermisError("too small", where="--workers", value=options.workers, limit=">= 0")
    with ProcessExecutor(options.workers or cores()) as executor:
        bake = drain_shown(pipeline.render(scene, library, executor=executor), quiet=options.quiet)
    try:
        written = outputs.export(bake, options.out, plots=options.plots)
    except DermisError:
        tell(bake.all_findings, sys.stderr)  # why there is nothing to write
        raise
    if options.maps:
        written += outputs.export_screen_maps(scene, library, options.out)
    for path in written:
        print(path)
    refused, names = 0, FileNames()
    for form in dict.fromkeys(options.format):
        for stem, output in zip(outputs.file_names(bake), bake.outputs, strict=True):
            try:
                path = options.out / names.take(stem, format_of(form).suffix)
                print(write(output.track, path, form, options.force))
            except DermisError as error:  # one finger's track does not take the others down
                print(f"error: {output.finger}, {output.device}, {form}: {error}", file=sys.stderr)
                refused += 1
    for part, words in () if options.quiet else told(bake.skipped):
        print(f"skipped, {part}: {words}", file=sys.stderr)
    return max(tell(bake.all_findings, sys.stderr), FAILED if refused else 0)


def curve(options: argparse.Namespace) -> int:
    """Write a sampled scene with its objects' faces curved."""
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
    """Say how far each matching method of a pin array would miss for a sampled scene, or compare all devices."""
    scene, library = scene_file.load(options.scene), Library(options.presets)
    if options.out is not None:
        return _devices(options, scene, library)
    compared = pin_report.compare_scene(scene, library, finer=options.finer)
    for name, reports in compared.reports.items():
        print(name)
        print(pin_report.table(reports))
    return tell(compared.findings, sys.stderr)


def _devices(options: argparse.Namespace, scene: TactileScene, library: Library) -> int:
    """Send a finger's touch through every device that fits; write the table and the page."""
    if options.finer:
        raise DermisError("a finer mesh judges methods, not devices", value=options.finer, remedy="Leave out --finer")
    found = drain_shown(
        device_comparison.compare_devices(scene, library, options.finger, floors=options.floor), quiet=options.quiet
    )
    print(report.text(found))
    for path in report.write(found, options.out):
        print(path)
    return 0
