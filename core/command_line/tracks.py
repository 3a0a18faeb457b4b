"""`python -m core export | check`, which read command tracks."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import DermisError, worst
from ..presets import Library
from ..track import check as checks
from ..track import export as formats
from ..track.command_track import CommandTrack
from ..track.file_names import FileNames
from ..track.formats import FORMATS
from .messages import FAILED, REFUSED, tell


def export(options: argparse.Namespace) -> int:
    """Write tracks, or a time range of them, in another format.

    Return the exit status.
    """
    failed, names, settings = 0, FileNames(), _settings(options)
    for path in options.tracks:  # no track that is still to be read may be overwritten
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
            print(write(track, target, options.format, options.force, settings))
        except DermisError as error:  # the other tracks are still written
            print(f"error: {error}", file=sys.stderr)
            failed += 1
    return REFUSED if failed else 0


def check(options: argparse.Namespace) -> int:
    """Check a track and print its findings; return the exit status."""
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
    status = tell(findings, sys.stdout)
    if not findings:
        print("no findings")
    return status


def write(
    track: CommandTrack, path: Path, form: str, force: bool, settings: Mapping[str, Any] = formats.NO_SETTINGS
) -> Path:
    """Write one track and print the findings of its check; return its path.

    Args:
        track: the track.
        path: path to write.
        form: name of the format.
        force: True to write the file in spite of errors.
        settings: settings of the format, by name.
    """
    tell(formats.write(track, path, form, force=force, settings=settings), sys.stderr)
    return path


def _settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return the given settings of the chosen format, by name.

    Raises:
        DermisError: a setting of another format was given.
    """
    given: dict[str, Any] = {}
    for form, entry in FORMATS.items():
        for name in entry.settings:
            value = getattr(options, f"{form}_{name}")
            if value is None:
                continue
            if form != options.format:
                option = f"--{form}-{name.replace('_', '-')}"
                raise DermisError("this option belongs to another format", value=option, limit=f"with --format {form}")
            given[name] = value
    return given
