"""`python -m core tell-apart | sweep | bump | weakest-force`.

These verbs repeat studies of the papers, on scenes and devices of the user's choice. `sweep` also computes tables of
variants.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from ..comparison import told_apart, told_report
from ..errors import DermisError
from ..matching.deformation import METHODS
from ..presets import Library
from ..scene import scene_file
from ..skin.model import skin_from_parameters
from ..studies import bump as bumps
from ..studies import cap_force, method_sweep
from ..sweep.run import run_sweep
from ..sweep.spec import read
from .messages import FAILED, drain_shown
from .workers import executor_of, tell_unlike


def tell_apart(options: argparse.Namespace) -> int:
    """Print which touches of a finger can be distinguished, by device.

    Return the exit status.
    """
    scene, library = scene_file.load(options.scene), Library(options.presets)
    found = drain_shown(told_apart.tell_apart(scene, library, options.finger), quiet=options.quiet)
    print(told_report.text(found))
    if options.out is not None:
        print(told_report.write(found, options.out))
    return 0


def sweep(options: argparse.Namespace) -> int:
    """Compute a table of variants, or compare methods on a sliding plane.

    A specification (SPEC.toml) gives the table. Without one, all methods match a plane that slides over the pad, for
    all combinations of depth, friction and direction. Return the exit status.
    """
    if options.spec is not None:
        return _table(options)
    if options.scheduler is not None or options.workers:
        raise DermisError("workers can only be used for a table of variants", where="sweep", remedy="Give SPEC.toml")
    library = Library(options.presets)
    spec, skin = library.device(options.device), skin_from_parameters(library.skin(options.skin), level=options.level)
    methods = [method for method in METHODS if not options.method or method in options.method]
    steps = method_sweep.sweep_methods(
        spec,
        skin,
        [1e-3 * depth for depth in options.depth],
        options.friction,
        np.radians(options.direction).tolist(),
        methods=methods,
        slide=options.slide,
    )
    found = drain_shown(steps, quiet=options.quiet)
    print(method_sweep.text(found))
    for path in () if options.out is None else method_sweep.write(found, spec, skin, options.out):
        print(path)
    return 0


def _table(options: argparse.Namespace) -> int:
    """Compute the rows of a table of variants that are still missing.

    Return the exit status.
    """
    if options.out is None:
        raise DermisError(
            "a table needs a folder", where="--out", remedy="Give --out DIR; give the same folder to continue a table"
        )
    spec = read(options.spec)
    with executor_of(options) as executor:
        steps = run_sweep(spec, Library(options.presets), options.out, executor)
        made = drain_shown(steps, quiet=options.quiet)
        tell_unlike(executor)
    for path in made.paths:
        print(path)
    for line in made.lost:
        print(f"error: {line}", file=sys.stderr)
    counts = f"{made.done} done, {made.kept} there before, {made.refused} refused, {len(made.lost)} lost"
    print(f"{made.rows} rows: {counts}", file=sys.stderr)
    return FAILED if made.refused or made.lost else 0


def bump(options: argparse.Namespace) -> int:
    """Print the largest friction and voltage on a bump, for each profile.

    With --out, write the table and the picture of the whole path. Return the exit status.
    """
    found = bumps.bump_curve(
        Library(options.presets), options.device, 1e-3 * options.height, 1e-3 * options.width, 1e-3 * options.speed
    )
    print(bumps.text(found))
    for path in () if options.out is None else bumps.write(found, options.out):
        print(path)
    return 0


def weakest_force(options: argparse.Namespace) -> int:
    """Print the force of a shear tactor in its weakest direction.

    Return the exit status.
    """
    spec = Library(options.presets).device(options.device)
    print(cap_force.text(cap_force.cap_force(spec), spec))
    return 0
