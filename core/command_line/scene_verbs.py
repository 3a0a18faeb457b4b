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
            help="folder for the tracks, made if needed; of several scenes, and with --scheduler, for a folder each",
        ),
        switch("--plots", "also write a picture of each track"),
        MAPS,
        PRESETS,
        argument(
            "--format",
            action="append",
            default=[],
            choices=[name for name in FORMATS if name != "csv"],
            help="also write this format; more than once",
        ),
        switch("--force", "write those formats in spite of errors"),
        *WORKERS,
        QUIET,
        help="render sampled scenes to one CSV track per finger and device",
        description="Render sampled scenes to one CSV track per finger and device: the fingers of one, or several "
        "scenes, side by side.",
        run="command_line.scenes.render",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "curve",
        SCENE,
        argument("--out", type=Path, required=True, metavar="FILE", help="the new scene, NAME.npz"),
        argument("--object", action="append", default=[], metavar="NAME", help="only this one; more than once"),
        argument(
            "--sharp", type=angle, default=30.0, metavar="DEGREES", help="faces that meet at more keep their edge (30)"
        ),
        help="curve the faces of a sampled scene's objects",
        description="Write a sampled scene in which objects have the curved surfaces that their faces stand for.",
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
            help="also judge the commands on a finer mesh: fine or reference",
        ),
        argument(
            "--out",
            type=Path,
            metavar="DIR",
            help="send one finger's touch through every device instead; folder for the table (CSV) and page (HTML)",
        ),
        argument("--finger", type=int, default=0, metavar="I", help="which finger's touch, for --out"),
        switch("--floor", "for --out: also find how good any pose of a device could be, which takes minutes"),
        PRESETS,
        QUIET,
        help="how far each matching method of a pin array, or each device, would miss",
        description="Say how far each matching method of a pin array would miss for a sampled scene; with --out, how "
        "far each device would.",
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
        help="how much forces and commands change where the scene hardly does",
        description="Render a sampled scene again, shifted by 0.1 um, with half the step, and mirrored; say how much "
        "its forces and commands change. A finding warns where that is more than 5 % of a channel's peak.",
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
        argument("--finger", type=int, default=0, metavar="I", help="which finger's touch"),
        argument("--out", type=Path, metavar="FILE.json", help="also write the figures to this file"),
        QUIET,
        help="how good any pose of a device could be for a touch",
        description="Find the best pose of a thimble or six-leg platform at every sample of a scene's touch, and "
        "report the error of the device, of the best pose found, and with additional axes along the pad.",
        run="command_line.floor.floor",
        writes={"out": False},
    )
