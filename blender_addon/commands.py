"""Command line of the add-on, for Blender without a window.

The commands are `blender --command dermis render scene.blend --out DIR`, and `sample`.

The exit status is 0 if all went well, 1 if there is a finding of severity error or a defect, and 2 if the work was
refused or the command line was not understood. `python -m core` uses the same numbers.
"""

from __future__ import annotations

import argparse
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from . import baking, identity, preferences, scene_time
from ._core import DermisError, core, worst
from .results import export_parts, store
from .sampling import frames, height_maps, participants, scene_sweep

LAST_FRAME = 1048574  # Blender's last frame; its first one is the negative of this


def main(arguments: Sequence[str]) -> int:
    """Run one command line, without the program's name; return the exit status."""
    try:
        options = _parser().parse_args(_joined(arguments))
    except SystemExit as stop:  # argparse has printed the error or the help
        return stop.code if isinstance(stop.code, int) else 2
    try:
        if getattr(options, "presets", None) is not None:
            core.files.check_folder(options.presets)
        return int(options.run(options))
    except DermisError as error:
        print(f"error: {error}", file=sys.stderr)
        return core.command_line.messages.REFUSED
    except Exception:
        # If the error were passed on, Blender would exit with status 0.
        traceback.print_exc()
        return 1


def render(options: argparse.Namespace) -> int:
    """Render one scene of a file or all, and write a file per finger, device and part."""
    scene = _open(options)
    if not options.all_scenes:
        return _render(options, scene, Path(options.out))
    names = [s.name for s in bpy.data.scenes if any(o.dermis.role == "FINGER" for o in s.objects)]
    if not names:
        raise DermisError("no scene has a finger", where=options.blend, remedy="Make an object a finger")
    file_names = core.track.file_names
    taken = file_names.FileNames()
    folders = {name: taken.take(file_names.safe(bpy.path.clean_name(name))) for name in names}
    return max(_render(options, bpy.data.scenes[name], Path(options.out) / folder) for name, folder in folders.items())


def _render(options: argparse.Namespace, scene: bpy.types.Scene, folder: Path) -> int:
    outputs = core.pipeline.outputs
    _settle_maps(options, scene)
    made = _drained(baking.bake(scene, _library(options), span=_span(options)), options)
    if options.format or options.finger or options.part != "all":
        written, found = _parts(options, scene, made, folder)
    else:
        written, found = list(outputs.export(made, folder, plots=options.plots)), []
    if options.maps:
        now = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get())
        written += outputs.export_screen_maps(now, _library(options), folder)
    for path in written:
        print(path)
    return _status((*made.all_findings, *outputs.name_findings(made), *found))


def _parts(
    options: argparse.Namespace, scene: bpy.types.Scene, made: Any, folder: Path
) -> tuple[list[Path], list[Any]]:
    span = _span(options) or frames.frame_range(scene)
    result = store.Result(made, scene_time.clock(scene, span[0]), None, ())
    active = identity.named(scene, options.finger) if options.finger else scene.view_layers[0].objects.active
    if options.finger and active is None:
        raise DermisError(
            "no such finger",
            where=scene.name,
            value=options.finger,
            limit=", ".join(dict.fromkeys(o.finger for o in made.outputs)),
        )
    written: list[Path] = []
    found: list[Any] = []
    for form in dict.fromkeys(options.format or ["csv"]):
        paths, more = export_parts.write(
            scene,
            result,
            folder,
            form,
            options.part.upper(),
            active=active,
            finger=options.finger or None,
            force=options.force,
        )
        written += paths
        found += more
    return written, found


def sample(options: argparse.Namespace) -> int:
    """Sample a file's scene and write it for `python -m core render`."""
    scene_file = core.scene.scene_file
    scene = _open(options)
    _settle_maps(options, scene)
    tactile = scene_sweep.sample(scene, span=_span(options))
    try:
        scene_file.save(tactile, Path(options.out))
    finally:
        tactile.chunks.close()
    print(options.out)
    return _status((*tactile.findings, *tactile.chunks.findings))


def _parser() -> argparse.ArgumentParser:
    arguments = core.command_line.arguments
    argument, switch, add_verb = arguments.argument, arguments.switch, arguments.add_verb
    parser = argparse.ArgumentParser(
        prog="blender --command dermis", description="Tactile tracks from animated scenes, without a window."
    )
    verbs = parser.add_subparsers(required=True, metavar="COMMAND")
    scene = (
        argument("blend", help="the .blend file"),
        argument("--scene", default="", help="name of the scene; the file's active one if left out"),
        argument(
            "--range",
            default="",
            metavar="FIRST:LAST",
            dest="span",
            help="frames to bake, both included; the scene's own if left out",
        ),
        argument(
            "--no-data",
            action="append",
            default=[],
            metavar="[SCREEN=]VALUE",
            help="stored number of height maps that stands for 'nothing measured', or 'none' for no other: of one "
            "touch screen, or of all that leave it open; once for each number",
        ),
        arguments.QUIET,
    )
    add_verb(
        verbs,
        "render",
        *scene,
        argument("--out", required=True, metavar="DIR", help="folder for the tracks; it is made if missing"),
        switch("--plots", "write a PNG plot beside each track"),
        argument(
            "--format",
            action="append",
            default=[],
            choices=list(core.track.formats.FORMATS),
            help="write this format instead of CSV; more than once",
        ),
        argument(
            "--part",
            default="all",
            choices=("all", "preview", "markers", "action"),
            help="the preview range, a file from each marker to the next, or the frames of an action: "
            "the finger's, or else the active object's",
        ),
        argument("--finger", default="", metavar="NAME", help="this finger only"),
        switch("--all-scenes", "every scene with a finger, a folder each"),
        switch("--force", "write tracks with errors as they are, with a note inside"),
        arguments.MAPS,
        argument("--presets", metavar="DIR", type=Path, help="folder of your own presets, instead of the extension's"),
        help="write a CSV track per finger and device",
        run=render,
    )
    add_verb(
        verbs,
        "sample",
        *scene,
        argument("--out", required=True, metavar="FILE", help="the scene file to write, such as scene.npz"),
        help="write the sampled scene for 'python -m core render'",
        run=sample,
    )
    return parser


def _joined(arguments: Sequence[str]) -> list[str]:
    """Join `--range` and a range that begins with a minus to one argument.

    The parser would take such a range for another option.
    """
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--range" and re.fullmatch(r"-\d+:.*", argument):
            joined[-1] = f"--range={argument}"
        else:
            joined.append(argument)
    return joined


def _open(options: argparse.Namespace) -> bpy.types.Scene:
    path = Path(options.blend).absolute()
    if not path.is_file():
        raise DermisError("no such file", where=str(path), remedy="Give the path of a .blend file")
    try:
        # Blender's own options -y and -Y and its preferences decide whether the file's scripts may run.
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    except RuntimeError as error:
        raise DermisError("Blender cannot open the file", where=str(path), value=str(error).strip()) from error
    if not options.scene:
        return bpy.context.scene
    scene = bpy.data.scenes.get(options.scene)
    if scene is None:
        raise DermisError(
            "no such scene", where=str(path), value=options.scene, limit=", ".join(s.name for s in bpy.data.scenes)
        )
    return scene


def _settle_maps(options: argparse.Namespace, scene: bpy.types.Scene) -> None:
    """Apply `--no-data` to the scene's height maps, and refuse undecided maps.

    Without a window nobody can answer a question about a map.

    Raises:
        DermisError: there is no such screen, or a map has a number that likely stands for 'no data' and neither the
            file nor `--no-data` decides whether it does.
    """
    layer = bpy.context.view_layer if scene == bpy.context.scene else scene.view_layers[0]
    screens = [o for o in participants.taking_part(scene, layer, []) if o.dermis.role == "SCREEN"]
    given: dict[str, list[str]] = {}
    for text in options.no_data:
        name, _, value = text.rpartition("=")
        given.setdefault(name, []).append(value)
        core.effects.map_repair.no_data_of(value, "--no-data")
        if name and all(obj.name != name for obj in screens):
            known = ", ".join(obj.name for obj in screens)
            raise DermisError("no such touch screen", where="--no-data", value=name, limit=known)
    for obj in screens:
        if obj.name in given:
            obj.dermis.screen.no_data = "; ".join(given[obj.name])
        try:
            if "" in given and (not height_maps.said_no_data(obj) or height_maps.unanswered(obj)):
                height_maps.say_no_data(obj, *given[""])
            open_ = height_maps.unanswered(obj)
        except DermisError:  # sampling the scene reports it, with all other errors
            continue
        if open_:
            raise DermisError(
                open_[0].what, where=open_[0].where, value=open_[0].value, remedy=open_[0].remedy, code=open_[0].code
            )


def _span(options: argparse.Namespace) -> tuple[int, int] | None:
    if not options.span:
        return None
    try:
        first, last = (int(part) for part in options.span.split(":"))
    except ValueError:
        raise DermisError(
            "the range is not understood", where="--range", value=options.span, limit="FIRST:LAST, such as 1:250"
        ) from None
    if max(abs(first), abs(last)) > LAST_FRAME:
        raise DermisError(
            "Blender has no such frame", where="--range", value=options.span, limit=f"{-LAST_FRAME} to {LAST_FRAME}"
        )
    return first, last


def _library(options: argparse.Namespace) -> Any:
    if options.presets:
        return core.presets.Library(options.presets)
    return preferences.library()


def _drained(steps: Any, options: argparse.Namespace) -> Any:
    """Run some work, and print its progress on one line.

    Nothing is printed with `--quiet`, or if stderr is not a terminal.
    """
    if options.quiet or not sys.stderr.isatty():
        return core.steps.drain(steps)
    shown = ""

    def tell(progress: Any) -> None:
        nonlocal shown
        text = f"{progress.stage}: {100 * progress.done // max(progress.total, 1)} %"
        if text != shown:
            shown = text
            print(f"\r{text:<40}", end="", file=sys.stderr, flush=True)

    made = core.steps.drain(steps, tell)
    print(file=sys.stderr)
    return made


def _status(findings: Sequence[Any]) -> int:
    for finding in findings:
        print(finding, file=sys.stderr)
    return 1 if worst(findings) == "error" else 0
