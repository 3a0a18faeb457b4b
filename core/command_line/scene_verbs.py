"""Arguments of the verbs that read sampled scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..track.formats import FORMATS
from .arguments import MAPS, PRESETS, QUIET, SCENE, SCENES, THIMBLE, WORKERS, add_verb, angle, argument, share, switch


def add_scenes(verbs: Any) -> None:
    """Add the verbs that read sampled scenes to a command line."""
    add_verb(
        verbs,
        "render",
        SCENES,
        argument(
            "--out",
            type=Path,
            required=True,
            metavar="DIR",
            help="folder for the tracks, made if needed; with several scenes or --scheduler, each scene gets a folder "
            "in it",
        ),
        switch("--plots", "also write a picture of each track"),
        MAPS,
        PRESETS,
        argument(
            "--format",
            action="append",
            default=[],
            choices=[name for name in FORMATS if name != "csv"],
            help="also write this format; may be repeated",
        ),
        switch("--force", "write these formats even if the track has errors"),
        *WORKERS,
        QUIET,
        help="render sampled scenes to one CSV track per finger and device",
        description="Render sampled scenes to one CSV track per finger and device. The fingers of one scene, or "
        "several scenes, are computed in parallel (--workers).",
        run="command_line.scenes.render",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "curve",
        SCENE,
        argument("--out", type=Path, required=True, metavar="FILE", help="the new scene, NAME.npz"),
        argument(
            "--object", action="append", default=[], metavar="NAME", help="change only this object; may be repeated"
        ),
        argument(
            "--sharp",
            type=angle,
            default=30.0,
            metavar="DEGREES",
            help="edges between faces that meet at a larger angle stay sharp (30)",
        ),
        help="curve the faces of a sampled scene's objects",
        description="Write a sampled scene in which the curved surfaces of smooth shading replace flat faces.",
        run="command_line.scenes.curve",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "compare",
        SCENE,
        argument(
            "--finer",
            default="",
            choices=["", "fine", "reference"],
            metavar="LEVEL",
            help="also evaluate the commands on a finer mesh: fine or reference",
        ),
        argument(
            "--out",
            type=Path,
            metavar="DIR",
            help="compare devices instead of methods, for one finger's touch; folder for the table (CSV) and the page "
            "(HTML)",
        ),
        argument("--finger", type=int, default=0, metavar="I", help="index of the finger, for --out (0)"),
        switch(
            "--floor",
            "for --out: also compute the smallest error of any pose of a device, which takes about a minute, "
            "and minutes for a long touch",
        ),
        PRESETS,
        QUIET,
        help="errors of each matching method of a pin array, or of each device",
        description="Print the error of each matching method of a pin array for a sampled scene; with --out, the error "
        "of each device.",
        run="command_line.scenes.compare",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "trust",
        SCENE,
        argument("--out", type=Path, metavar="DIR", help="folder for values and changes of every channel (CSV)"),
        switch("--plots", "for --out: also write a picture of each track with its band"),
        PRESETS,
        QUIET,
        help="how much forces and commands change under tiny changes of the scene",
        description="Render a sampled scene again, shifted by 0.1 um, at twice the sample rate, and mirrored; print "
        "how much its forces and commands change. A finding warns if a channel changes by more than 5 % of its "
        "peak.",
        run="command_line.scenes.trust",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "migrate-report",
        SCENE,
        argument(
            "tracks", type=Path, nargs="+", metavar="TRACK", help="stored tracks of the same scene, or folders of them"
        ),
        argument("--out", type=Path, metavar="FILE", help="also write every changed command, frame by frame (CSV)"),
        argument(
            "--allow",
            type=share,
            default=1e-3,
            metavar="SHARE",
            help="a finding where a command changed by more than this share of its channel's range (default .001)",
        ),
        PRESETS,
        QUIET,
        help="how commands differ from tracks that an earlier engine made",
        description="Render a sampled scene and compare its commands with stored tracks of it, by finger, device and "
        "frame. Tracks name the engine that made them.",
        run="command_line.scenes.migrate_report",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "floor",
        SCENE,
        *THIMBLE,
        argument("--finger", type=int, default=0, metavar="I", help="index of the finger (0)"),
        argument("--out", type=Path, metavar="FILE.json", help="also write the figures to this file"),
        QUIET,
        help="smallest error of any pose of a device for a touch",
        description="Find the best pose of a thimble or six-leg platform at every sample of a scene's touch, and "
        "report three errors: of the device, of the best pose found, and of the best pose of a device that could also "
        "shift along the pad.",
        run="command_line.floor.floor",
        writes={"out": False},
    )
