"""`python -m core design`: the number of motors that given touches need."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..design import task
from ..design.interactions import NAMES, NOISE, interaction
from ..design.report import as_json, as_text
from ..design.synergies import RULES
from ..design.trial import exceptions, trial
from ..devices.coupling import refuse_coupled
from ..devices.safe_state import safe_findings
from ..devices.spec import from_preset
from ..errors import DermisError
from ..parameters.skin import DEFAULT_SKIN, SKIN_CONTACT, TISSUE
from ..presets import Library, read
from ..scene import scene_file
from ..scene.tactile_scene import TactileScene
from ..skin.finger_skin import of_tissue
from ..skin.model import skin_from_parameters
from ..skin.shape import shape_from_parameters
from ..steps import in_words
from .messages import drain_shown
from .workers import executor_of, tell_unlike


def run(options: argparse.Namespace) -> int:
    """Find the number of motors that the touches need, and report it.

    The table of the device is computed or read first. Then the touches are sensed, or read from recordings. Return the
    exit status.
    """
    library = Library(options.presets)
    spec = library.device(options.device)
    refuse_coupled(spec)
    _refuse_nonsense(options, len(spec.channels))
    recordings, scenes = _read(options)
    parameters, tissue = _skin(options, library, scenes), _tissue(options, scenes)
    if "mesh" in parameters and options.table is None:
        raise DermisError(
            "tables are simulated on the built-in fingertip, not on a mesh of your own",
            where="skin",
            remedy="Give a table with --table, or a skin preset of a size with --skin",
        )
    rows = task.ROWS if options.rows is None else options.rows or None
    folder = (options.out or Path.cwd()) / "collection"
    material = {k: float(v) for k, v in parameters.items() if k in TISSUE}
    lengths = {k: v for k, v in parameters.items() if k not in material and k != "mesh"}
    shape = shape_from_parameters(lengths if "mesh" not in parameters else {}, where="skin")
    if options.table is not None:
        table = task.load_table(spec, options.table, options.rest_rows)
    else:
        with executor_of(options) as executor:
            steps = task.table_for(
                spec,
                shape,
                folder,
                level=options.level,
                rows=rows,
                executor=executor,
                material=material,
                tissue=tissue,
                adaptive=options.adaptive,
                noise=NOISE if options.noise is None or recordings else options.noise,
            )
            table = drain_shown(steps, quiet=options.quiet)
            tell_unlike(executor)
    if options.save_table is not None:
        table.save(options.save_table)
        print(options.save_table, file=sys.stderr)  # standard output is the report, which may be JSON
    simulated = bool(scenes) or options.trial is not None or any(touch in NAMES for touch in options.touches)
    skin = None
    if simulated or options.table is None:
        skin = of_tissue(skin_from_parameters(parameters, level=options.level), tissue)
    if options.trial is not None:
        assert skin is not None
        return _trial(options, table, skin)
    if not options.touches:
        return 0
    noise = NOISE if options.noise is None else options.noise
    sensed: dict[str, Any] = {}
    for i, touch in enumerate(options.touches):
        if touch in recordings:
            sensed.update(recordings[touch])
            continue
        assert skin is not None
        scene = scenes[touch] if touch in scenes else interaction(touch, skin.positions, seed=options.seed)
        name = Path(touch).stem if touch in scenes else touch
        seed = 100 * options.seed + i
        reading = task.sense_scene(scene, skin, options.finger, noise=noise, seed=seed)
        sensed[name] = drain_shown(reading, quiet=options.quiet)
    answer = task.answer(
        spec,
        table,
        sensed,
        noise=noise,
        recorded_noise=options.noise,
        skin=skin,
        spread=options.table is None and options.out is not None,
    )
    found = drain_shown(answer, quiet=options.quiet)
    for finding in found.findings:
        print(finding, file=sys.stderr)
    shown = (
        json.dumps(as_json(found), indent=1, ensure_ascii=False, allow_nan=False) if options.json else as_text(found)
    )
    print(shown, end="")
    if options.out is not None:
        paths = task.write(found, options.out, rule=options.rule or "touch", motors=options.motors)
        made = [from_preset(path.stem, read(path)) for path in paths[3:]]
        for line in (*paths, *(finding for spec_made in made for finding in safe_findings(spec_made))):
            print(line, file=sys.stderr)
    return 0


def _refuse_nonsense(options: argparse.Namespace, motors: int) -> None:
    """Refuse values of options that are out of range or contradict each other.

    Args:
        options: the options.
        motors: number of motors of the device.
    """
    if not options.touches and options.trial is None and options.save_table is None:
        raise DermisError("nothing to do", where="design", limit="a touch, --trial or --save-table")
    for name, least in (("rows", 0), ("seed", 0), ("trial", 1), ("finger", 0), ("motors", 1)):
        value = getattr(options, name)
        if value is not None and value < least:
            raise DermisError("too small", where=f"--{name}", value=value, limit=f">= {least}")
    if options.adaptive and (options.rows == 0 or options.table is not None):
        raise DermisError(
            "--adaptive needs a table that is simulated, with a number of rows", where="--adaptive", limit="--rows N"
        )
    if options.adaptive and (options.workers or options.scheduler):
        where = "--scheduler" if options.scheduler else "--workers"
        raise DermisError("an adaptive table is computed in this process only, round by round", where=where)
    if options.save_table is not None and options.save_table.suffix.lower() != ".npz":
        what = "a collected table is kept as .npz"
        raise DermisError(what, where="--save-table", value=options.save_table.name, limit="NAME.npz")
    if options.motors is not None and options.motors > motors:
        raise DermisError(
            "more motors than the device has", where="--motors", value=options.motors, limit=f"1 to {motors}"
        )
    if options.noise is not None and not 0.0 <= options.noise < float("inf"):
        raise DermisError("not a standard deviation", where="--noise", value=options.noise, limit=">= 0")
    if options.out is None and (options.motors is not None or options.rule is not None):
        raise DermisError(
            "--motors and --rule only apply to the preset that --out writes",
            where="design",
            remedy="Give --out, or leave them out",
        )


def _read(options: argparse.Namespace) -> tuple[dict[str, dict[str, Any]], dict[str, TactileScene]]:
    """Return the recordings and the scenes of the touches that are files.

    Both are keyed by the touches' names on the command line.

    Raises:
        DermisError: a file cannot be read, or two touches have the same name.
    """
    recordings: dict[str, dict[str, Any]] = {}
    scenes: dict[str, TactileScene] = {}
    for touch in options.touches:
        path = Path(touch)
        if touch in NAMES:
            continue
        if path.suffix.lower() == ".csv":
            recordings[touch] = dict(task.read_sensed([path], options.rest))
        else:
            scenes[touch] = scene_file.load(path)
    names = [Path(t).stem if t not in NAMES else t for t in options.touches]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise DermisError("two touches have one name", where="design", value=twice)
    return recordings, scenes


def _tissue(options: argparse.Namespace, scenes: Mapping[str, TactileScene]) -> str:
    """Return the tissue of the skin.

    It is that of --tissue, else that of the scenes, else linear. The tissue of a scene is that of the finger --finger.

    Raises:
        DermisError: the tissue of a finger is unknown, or differs from --tissue or from that of another scene.
    """
    row = SKIN_CONTACT["tissue"]
    chosen, whose = options.tissue, "--tissue"
    for touch, scene in scenes.items():
        if not 0 <= options.finger < len(scene.fingers):
            continue  # `task.sense_scene` reports the wrong finger later
        where = f"scene '{touch}'"
        own = str(row.of(scene.fingers[options.finger].parameters, where))
        if chosen is not None and own != chosen:
            raise DermisError(
                f"its finger has another tissue than {whose} says",
                where=where,
                value=own,
                limit=chosen,
                remedy="Leave --tissue out, or run the scenes one by one",
            )
        chosen, whose = own, where
    return str(row.default) if chosen is None else str(chosen)


def _skin(options: argparse.Namespace, library: Any, scenes: Mapping[str, TactileScene]) -> dict[str, Any]:
    """Return the parameters of the skin.

    They are those of --skin, else those of the scenes, else those of the default skin. The skin of a scene is that of
    the finger --finger.

    Raises:
        DermisError: the skin of a finger differs from --skin or from that of another scene.
    """
    wanted = None if options.skin is None else dict(library.skin(options.skin))
    chosen, whose = wanted, "--skin"
    for touch, scene in scenes.items():
        if not 0 <= options.finger < len(scene.fingers):
            continue  # `task.sense_scene` reports the wrong finger later
        own = scene.fingers[options.finger].parameters.get("skin")
        if not own:
            continue
        if chosen is not None and dict(own) != chosen:
            raise DermisError(
                f"its finger has another skin than {whose} says",
                where=f"scene '{touch}'",
                remedy="Leave --skin out, or run the scenes one by one",
            )
        chosen, whose = dict(own), f"scene '{touch}'"
    return chosen if chosen is not None else dict(library.skin(DEFAULT_SKIN))


def _trial(options: argparse.Namespace, table: Any, skin: Any) -> int:
    """Evaluate the six interactions for several seeds; print every exception.

    Args:
        options: the options; `trial` is the number of seeds.
        table: the look-up table of the device.
        skin: model of the skin.
    """
    steps = trial([table], skin, range(options.trial))
    (verdicts,) = drain_shown(in_words(steps, lambda step: task.Step("trial", *step)), quiet=options.quiet)
    for name in NAMES:
        own = [v for v in verdicts if v.name == name]
        for i, rule in enumerate(RULES):
            found = [v.found[i] for v in own]
            counts = ", ".join(f"{k}: {found.count(k)}" for k in sorted(set(found)))
            mean = [sum(v.percent[i][k] for v in own) / len(own) for k in range(len(own[0].percent[i]))]
            shown = ", ".join(f"{p:.1f}" for p in mean)
            error, touch = (sum(values) / len(own) for values in zip(*((v.error, v.touch) for v in own), strict=True))
            print(
                f"{name:8s} by {rule:5s} expected {own[0].expected}, found {{{counts}}}, mean [%] {shown}, "
                f"error {error:.1f} of {touch:.1f} counts"
            )
    for line in exceptions(verdicts):
        print("exception:", line)
    return 0
