"""`python -m core design`: how many motors do these touches need?"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any, TypeVar

from ..errors import DermisError
from .interactions import NAMES, NOISE, interaction

T = TypeVar("T")


def add_parser(commands: Any) -> None:
    """Add the verb to the command line."""
    text = (
        "Find the fewest motors, and their coupling, with which a platform device renders given touches: sampled "
        "scenes (.npz), recordings of a 20-channel sensor (.csv), or the six interactions of [S2]."
    )
    one = commands.add_parser("design", help="how many motors a device needs for given touches", description=text)
    one.add_argument("touches", nargs="*", metavar="TOUCH",
                     help=f"sampled scene, recording, or one of: {', '.join(NAMES)}")  # fmt: skip
    one.add_argument("--device", default="cable_platform", metavar="PRESET", help="the device preset")
    one.add_argument("--table", type=Path, metavar="FILE", help="a collected table (.npz) or a recorded one (.csv)")
    one.add_argument("--rows", type=int, metavar="N", help="size of the table to collect; 0 for the preset's own")
    one.add_argument("--save-table", type=Path, metavar="FILE", help="keep the collected table")
    one.add_argument("--workers", type=int, default=0, metavar="N", help="child processes for the collection")
    one.add_argument("--skin", default="index_medium", metavar="PRESET", help="the skin preset")
    one.add_argument("--level", default="draft", choices=("draft", "standard"), help="accuracy of the skin")
    one.add_argument("--noise", type=float, default=NOISE, metavar="COUNTS", help="of the virtual sensor")
    one.add_argument("--seed", type=int, default=0, help="of noise and of the six interactions' wobble")
    one.add_argument("--finger", type=int, default=0, metavar="I", help="which finger of a scene")
    one.add_argument("--choice", default="variance", choices=("variance", "rendered"), help="components of the preset")
    one.add_argument("--motors", type=int, metavar="K", help="of the preset; as the rule says if left out")
    one.add_argument("--out", type=Path, metavar="DIR", help="write text, JSON, picture and preset there")
    one.add_argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")
    one.add_argument("--json", action="store_true", help="print the report as JSON")
    one.add_argument("--trial", type=int, metavar="SEEDS",
                     help="judge the six interactions for so many seeds, and list every exception")  # fmt: skip
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Collect or read the table, sense the touches, and report."""
    from ..devices.coupling import refuse_coupled
    from ..presets import Library
    from ..skin.model import fingertip_skin, skin_from_parameters
    from ..skin.shape import shape_from_parameters
    from . import task
    from .report import as_json, as_text

    library = Library(options.presets)
    spec = library.device(options.device)
    refuse_coupled(spec)
    parameters = library.skin(options.skin)
    material = {k: float(v) for k, v in parameters.items() if k in ("young", "poisson", "alpha")}
    lengths = {k: v for k, v in parameters.items() if k not in material}
    shape = shape_from_parameters(lengths, where=f"skin preset '{options.skin}'")
    rows = task.ROWS if options.rows is None else options.rows or None
    folder = (options.out or Path.cwd()) / "collection"
    if not options.touches and options.trial is None and options.save_table is None:
        raise DermisError("nothing to do", where="design", limit="a touch, --trial or --save-table")
    steps = task.table_for(
        spec, shape, folder, level=options.level, rows=rows, workers=options.workers, file=options.table,
        material=material,
    )  # fmt: skip
    table = _drain(steps, options.quiet)
    if options.save_table is not None:
        table.save(options.save_table)
        print(options.save_table, file=sys.stderr)  # standard output is the report, which may be JSON
    if options.trial is not None:
        return _trial(options, table, fingertip_skin(shape, level=options.level))
    if not options.touches:
        return 0
    skin = skin_from_parameters(parameters, level=options.level)
    sensed: dict[str, Any] = {}
    for i, touch in enumerate(options.touches):
        path = Path(touch)
        if touch in NAMES:
            scene = interaction(touch, skin.positions, seed=options.seed)
        elif path.suffix.lower() == ".csv":
            sensed.update(task.read_sensed([path]))
            continue
        else:
            from .. import scene_file

            scene = scene_file.load(path)
        name = touch if touch in NAMES else path.stem
        if name in sensed:
            raise DermisError("two touches have one name", where="design", value=name)
        seed = 100 * options.seed + i
        reading = task.sense_scene(scene, skin, options.finger, noise=options.noise, seed=seed)
        sensed[name] = _drain(reading, options.quiet)
    found = _drain(task.answer(spec, table, sensed, noise=options.noise), options.quiet)
    print(json.dumps(as_json(found), indent=1, ensure_ascii=False) if options.json else as_text(found), end="")
    if options.out is not None:
        extra = {"reversed_sweep_counts": task.spread(spec, shape, options.level)} if options.table is None else {}
        for path in task.write(found, options.out, choice=options.choice, motors=options.motors, extra=extra):
            print(path, file=sys.stderr)
    return 0


def _trial(options: argparse.Namespace, table: Any, skin: Any) -> int:
    """Judge the six interactions over seeds; print every exception."""
    from .synergies import CHOICES
    from .trial import exceptions, trial

    steps = trial([table], skin, range(options.trial))
    (verdicts,) = _drain(steps, options.quiet)
    for name in NAMES:
        own = [v for v in verdicts if v.name == name]
        for i, choice in enumerate(CHOICES):
            found = [v.found[i] for v in own]
            counts = ", ".join(f"{k}: {found.count(k)}" for k in sorted(set(found)))
            mean = [sum(v.percent[i][k] for v in own) / len(own) for k in range(len(own[0].percent[i]))]
            shown = ", ".join(f"{p:.1f}" for p in mean)
            error = sum(v.error for v in own) / len(own)
            print(f"{name:8s} by {choice:8s} expected {own[0].expected}, found {{{counts}}}, mean [%] {shown}, "
                  f"error {error:.1f} counts")  # fmt: skip
    for line in exceptions(verdicts):
        print("exception:", line)
    return 0


def _drain(steps: Generator[Any, None, T], quiet: bool) -> T:
    shown: tuple[Any, int] = ("", -1)
    while True:
        try:
            step = next(steps)
        except StopIteration as stop:
            result: T = stop.value
            return result
        stage, done, total = (step.stage, step.done, step.total) if hasattr(step, "stage") else ("trial", *step)
        now = (stage, 10 * done // max(total, 1))
        if now != shown and not quiet:
            print(f"{stage}: {done} of {total}", file=sys.stderr)
            shown = now
