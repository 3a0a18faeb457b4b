"""The command line: `python -m core render | check | export | stream | work`, for sampled scenes and their tracks."""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

if __name__ == "__main__":  # before numpy loads; see skin/blas.py
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from .errors import SEVERITIES, DermisError, Finding, worst
from .files import check_folder, check_writable
from .version import version

if TYPE_CHECKING:
    from .matching.screen_map import ScreenMap
    from .track.command_track import CommandTrack

# What the extension brings along, and another Python may lack: module -> the name to install it by.
LIBRARIES = {
    "scipy": "scipy",
    "threadpoolctl": "threadpoolctl",
    "onnxruntime": "onnxruntime",
    "serial": "pyserial",
    "PIL": "pillow",
}

FAILED, REFUSED = 1, 2  # findings of severity error; nothing could be done


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status: 0, 1 for findings of severity error, 2 for a refusal."""
    options = _parser().parse_args(arguments)
    for stream in (sys.stdout, sys.stderr):  # a name may hold what the terminal has no sign for
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        if getattr(options, "presets", None) is not None:  # of whatever verb
            check_folder(options.presets)
        for name, is_folder in getattr(options, "writes", {}).items():  # judged before any work is done for it
            if getattr(options, name) is not None:
                check_writable(getattr(options, name), folder=is_folder)
        return int(options.run(options))
    except DermisError as error:
        if getattr(options, "json", False):
            print(json.dumps({"error": error.as_dict()}, indent=1, ensure_ascii=False))
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    except ModuleNotFoundError as error:
        package = LIBRARIES.get(str(error.name).partition(".")[0])
        if package is None:
            raise
        print(
            f"error: this needs {error.name}, which this Python ({sys.executable}) does not have; "
            f"install it: {sys.executable} -m pip install {package}",
            file=sys.stderr,
        )
        return REFUSED
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return REFUSED


def render(options: argparse.Namespace) -> int:
    """Render a sampled scene and write its tracks."""
    from .command_line.progress import drain_shown
    from .pipeline import outputs
    from .pipeline import render as pipeline
    from .presets import Library
    from .scene import scene_file
    from .track import export as formats
    from .track.file_names import FileNames

    scene, library = scene_file.load(options.scene), Library(options.presets)
    bake = drain_shown(pipeline.render(scene, library), quiet=options.quiet)
    try:
        written = outputs.export(bake, options.out, plots=options.plots)
    except DermisError:
        _tell(bake.all_findings, sys.stderr)  # why there is nothing to write
        raise
    if options.maps:
        written += outputs.export_screen_maps(scene, library, options.out)
    for path in written:
        print(path)
    refused, names = 0, FileNames()
    for form in dict.fromkeys(options.format):
        for stem, output in zip(outputs.file_names(bake), bake.outputs, strict=True):
            try:
                path = options.out / names.take(stem, formats.format_of(form).suffix)
                print(_export(output.track, path, form, options.force))
            except DermisError as error:  # one finger's track does not take the others down
                print(f"error: {output.finger}, {output.device}, {form}: {error}", file=sys.stderr)
                refused += 1
    for name in sorted(bake.skipped):
        if bake.skipped[name] and not options.quiet:
            print(f"skipped: {bake.skipped[name]} {name}", file=sys.stderr)
    return max(_tell(bake.all_findings, sys.stderr), FAILED if refused else 0)


def export(options: argparse.Namespace) -> int:
    """Write tracks in other formats, whole or a range of them."""
    from .track import export as formats
    from .track.file_names import FileNames

    failed, names = 0, FileNames()
    for path in options.tracks:  # a track that is still to be read is none to write over
        names.reserve(path)
    for path in options.tracks:
        stem, suffix = path.name.removesuffix(path.suffix), formats.format_of(options.format).suffix
        folder = options.out or path.parent
        try:
            if (folder / (stem + suffix)).resolve() == path.resolve():
                raise DermisError("the file would replace itself", where=str(path), remedy="Choose another folder")
            target = folder / names.take(stem, suffix, folder)
            track = formats.read(path)
            if options.limit:
                track = track.within_limits()
            if options.rate:
                track = track.resampled(options.rate)
            if options.range:
                track = formats.cut(track, *options.range)
            print(_export(track, target, options.format, options.force))
        except DermisError as error:  # one bad file does not take the others down
            print(f"error: {error}", file=sys.stderr)
            failed += 1
    return REFUSED if failed else 0


def _export(track: CommandTrack, path: Path, form: str, force: bool) -> Path:
    """Write one track; tell what its check found."""
    from .track import export as formats

    _tell(formats.write(track, path, form, force=force), sys.stderr)
    return path


def compare(options: argparse.Namespace) -> int:
    """Say how far each matching method of a pin array would miss for a sampled scene."""
    from .matching import pin_report
    from .presets import Library
    from .scene import scene_file

    scene, library = scene_file.load(options.scene), Library(options.presets)
    compared = pin_report.compare_scene(scene, library, finer=options.finer)
    for name, reports in compared.reports.items():
        print(name)
        print(pin_report.table(reports))
    return _tell(compared.findings, sys.stderr)


def check(options: argparse.Namespace) -> int:
    """Check a track and say what is wrong with it."""
    from .presets import Library
    from .track import check as checks
    from .track import export as formats

    track, library = formats.read(options.track), Library(options.presets)
    findings = (*checks.preset_findings(track, library), *checks.findings_of(checks.by_preset(track, library)))
    if options.json:
        report = {
            "file": str(options.track),
            "device": track.spec.key,
            "samples": len(track.times),
            "duration_s": track.duration,
            "rate_hz": track.spec.rate,
            "worst": worst(findings),
            "findings": [f.as_dict() for f in findings],
        }
        print(json.dumps(report, indent=1, ensure_ascii=False, default=str))
        return FAILED if worst(findings) == "error" else 0
    print(
        f"{options.track}: {track.spec.name}, {len(track.channels)} channels, {len(track.times)} samples, "
        f"{track.duration:.6g} s at {track.spec.rate:g} Hz"
    )
    status = _tell(findings, sys.stdout)
    if not findings:
        print("no findings")
    return status


def work(options: argparse.Namespace) -> int:
    """Take jobs from standard input."""
    from .work.processes import serve

    return serve()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"python -m {__package__}",
        description="Dermis without Blender: render sampled scenes, check command tracks.",
        epilog="Exit status: 0; 1 where a finding has the severity error; 2 where nothing could be done. "
        "With --json a refusal is an object 'error' on standard output; programs compare its 'code'.",
    )
    parser.add_argument("--version", action="version", version=f"dermis {version()}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    one = commands.add_parser(
        "render",
        help="render a sampled scene to one CSV track per finger and device",
        description="Render a sampled scene to one CSV track per finger and device.",
    )
    one.add_argument("scene", type=Path, metavar="FILE", help="a scene sampled to a file (.npz)")
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the tracks; made if needed")
    one.add_argument("--plots", action="store_true", help="also write a picture of each track")
    one.add_argument("--maps", action="store_true", help="also write the maps of touch screens, for real fingers")
    one.add_argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")
    one.add_argument(
        "--format",
        action="append",
        default=[],
        choices=("json", "binary", "c"),
        help="also write this format; more than once",
    )
    one.add_argument("--force", action="store_true", help="write those formats in spite of errors")
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.set_defaults(run=render, writes={"out": True})

    one = commands.add_parser(
        "export",
        help="write tracks in another format, or a range of them",
        description="Write command tracks in another format, or a range of them.",
    )
    one.add_argument("tracks", type=Path, nargs="+", metavar="TRACK", help="command tracks: CSV, JSON or binary")
    one.add_argument("--format", required=True, choices=("csv", "json", "binary", "c"), help="what to write")
    one.add_argument("--out", type=Path, metavar="DIR", help="folder; beside each track if left out")
    one.add_argument("--range", type=float, nargs=2, metavar=("FROM", "TO"), help="part of the track [s]")
    one.add_argument("--rate", type=float, metavar="HZ", help="resample")
    one.add_argument("--limit", action="store_true", help="limit to what the device can do; changes are counted")
    one.add_argument("--force", action="store_true", help="write in spite of errors, with a note in the header")
    one.set_defaults(run=export, writes={"out": True})

    from .command_line.stream import add_parser

    add_parser(commands, _load_screen)

    from .command_line.design import add_parser as add_design

    add_design(commands)

    from .command_line.thimble import add_parser as add_thimble

    add_thimble(commands)

    text = "Say how far each matching method of a pin array would miss for a sampled scene."
    one = commands.add_parser(
        "compare", help="how far each matching method of a pin array would miss", description=text
    )
    one.add_argument("scene", type=Path, metavar="FILE", help="a scene sampled to a file (.npz)")
    one.add_argument(
        "--finer",
        default="",
        choices=["", "fine", "reference"],
        metavar="LEVEL",
        help="also judge the commands on a finer mesh: fine or reference",
    )
    one.add_argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")
    one.set_defaults(run=compare)

    one = commands.add_parser(
        "check",
        help="check a track against its device's limits",
        description="Check a track against the limits of its device preset.",
    )
    one.add_argument("track", type=Path, metavar="TRACK", help="a command track: CSV, JSON or binary")
    one.add_argument("--json", action="store_true", help="the report as JSON")
    one.add_argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")
    one.set_defaults(run=check)

    one = commands.add_parser(
        "work",
        help="take jobs from a parent process (not for people)",
        description="Take jobs as JSON lines from standard input.",
    )
    one.set_defaults(run=work)
    return parser


def _load_screen(path: Path) -> ScreenMap:
    """Read a screen map, for a sender that follows a touch panel."""
    from .matching.screen_map import ScreenMap

    return ScreenMap.load(path)


def _tell(findings: Sequence[Finding], stream: TextIO) -> int:
    """Print findings, the worst first; return the exit status that they ask for."""
    for finding in sorted(findings, key=lambda f: -SEVERITIES.index(f.severity)):
        print(finding, file=stream)
    return FAILED if worst(findings) == "error" else 0


if __name__ == "__main__":
    sys.exit(main())
