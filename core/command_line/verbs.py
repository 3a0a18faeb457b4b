"""All verbs of `python -m core`; `run` is the dotted name below `core` of what one does, loaded when it is chosen."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..design.interactions import NAMES, NOISE
from ..parameters.skin import DEFAULT_SKIN
from ..stream.acceptance.person import INTRODUCTION
from ..stream.acceptance.report import CHECKS
from ..track.formats import FORMATS
from ..version import version
from .arguments import (
    LEVEL,
    LINK,
    LOG,
    MAPS,
    PRESETS,
    QUIET,
    SCENE,
    SCENES,
    SKIN,
    SPEAKS,
    THIMBLE,
    TISSUE,
    TRACK,
    WORKERS,
    add_verb,
    angle,
    argument,
    device,
    seconds,
    setting,
    switch,
)
from .study_verbs import add_studies


def parser(program: str) -> argparse.ArgumentParser:
    """Return the command line of a program."""
    made = argparse.ArgumentParser(
        prog=program,
        description="Dermis without Blender: render sampled scenes, check command tracks.",
        epilog="Exit status: 0; 1 where a finding has the severity error; 2 where nothing could be done. "
        "With --json a refusal is an object 'error' on standard output; programs compare its 'code'.",
    )
    made.add_argument("--version", action="version", version=f"dermis {version()}")
    verbs = made.add_subparsers(required=True, metavar="COMMAND")
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
        "export",
        argument("tracks", type=Path, nargs="+", metavar="TRACK", help="command tracks: CSV, JSON or binary"),
        argument("--format", required=True, choices=list(FORMATS), help="what to write"),
        argument("--out", type=Path, metavar="DIR", help="folder; beside each track if left out"),
        argument("--range", type=float, nargs=2, metavar=("FROM", "TO"), help="part of the track [s]"),
        argument("--rate", type=float, metavar="HZ", help="resample"),
        switch("--limit", "limit to what the device can do; changes are counted"),
        switch("--force", "write in spite of errors, with a note in the header"),
        help="write tracks in another format, or a range of them",
        description="Write command tracks in another format, or a range of them.",
        run="command_line.tracks.export",
        writes={"out": True},
    )
    _add_stream(verbs)
    _add_design(verbs)
    _add_thimble(verbs)
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
    add_studies(verbs)
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
        "say what the device leaves of the touch, what the best pose found leaves, and what axes along the pad would.",
        run="command_line.floor.floor",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "check",
        TRACK,
        switch("--json", "the report as JSON"),
        PRESETS,
        help="check a track against its device's limits",
        description="Check a track against the limits of its device preset.",
        run="command_line.tracks.check",
    )
    add_verb(
        verbs,
        "work",
        help="take jobs from a parent process (not for people)",
        description="Take jobs as JSON lines from standard input.",
        run="command_line.work.run",
    )
    return made


def _add_stream(commands: Any) -> None:
    verbs = commands.add_parser(
        "stream",
        help="play a track to a device, or run a virtual device",
        description="Live streaming. Read the safety page before a finger goes in.",
    ).add_subparsers(required=True, metavar="WHAT")
    add_verb(
        verbs,
        "play",
        TRACK,
        *device("the track's own"),
        *LINK,
        *LOG,
        setting("look_ahead"),
        setting("ramp"),
        switch("--yes", "arm without asking; its warnings are printed"),
        help="play a track to a device, once",
        description="Play a track to a device, once. Exit status: 0; 1 where the device refused more than 1 % of the "
        "commands or took them too late, or where the log is not whole; 2 where it was not played to its end; 128 and "
        "a signal's number.",
        run="stream.play_command.play",
    )
    add_verb(
        verbs,
        "panel",
        *device("electrovibration"),
        argument("map", type=Path, metavar="MAP", help="a screen's map: NAME.map.npz, as exported"),
        *LINK,
        *LOG,
        argument(
            "--touch",
            default="device",
            metavar="FROM",
            help="who tells where the finger is: the device's own panel ('device', if left out), osc://:PORT or "
            "osc://HOST:PORT to listen at, serial:PORT?baud=RATE, '-' for standard input, 'mouse' in a window",
        ),
        argument(
            "--unit",
            default="mm",
            choices=("m", "mm"),
            help="of x and y in lines 'x y [down]', from the screen's centre (mm)",
        ),
        switch("--yes", "arm without asking"),
        help="answer a finger on a touch screen, until Ctrl-C",
        description="Answer a real finger from a screen's map, without Blender.",
        run="command_line.stream.panel",
    )
    add_verb(
        verbs,
        "send",
        argument("--state", type=Path, required=True, metavar="FILE", help="the shared state"),
        help="serve a shared state (not for people)",
        run="command_line.stream.send",
    )
    add_verb(
        verbs,
        "write",
        argument("--ring", type=Path, required=True, metavar="FILE", help="the ring"),
        help="write a log from a ring (not for people)",
        run="stream.log.writer.serve",
    )
    add_verb(
        verbs,
        "log",
        argument(
            "files", type=Path, nargs="+", metavar="FILE", help="binary logs (.dlog): one, or all files of one log"
        ),
        argument("--out", type=Path, metavar="FILE.csv", help="the CSV to write; without it, the log is summed up"),
        help="sum a binary log up, or make CSV of it",
        run="command_line.stream_log.run",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "virtual",
        *device("haptip"),
        argument("--at", default="pty", choices=("pty", "tcp", "udp"), help="where it can be reached (pty)"),
        argument("--every", type=seconds, default=0.0, metavar="S", help="print a report this often"),
        argument(
            "--fault",
            action="append",
            default=[],
            metavar="NAME=VALUE",
            help="loss, delay, jitter, corrupt, slow, stuck, skew, freeze, jump, seed; more than once",
        ),
        help="run a virtual device until its input ends",
        run="command_line.stream.virtual",
    )
    add_verb(
        verbs,
        "accept",
        argument("--device", required=True, default="", metavar="KEY", help="device preset"),
        *SPEAKS,
        *LINK,
        argument(
            "--only",
            action="append",
            choices=CHECKS,
            metavar="CHECK",
            help=f"one check, more than once: {', '.join(CHECKS)}",
        ),
        argument("--out", type=Path, metavar="FILE", help="report (acceptance_DEVICE_DATE.md in this folder)"),
        help="try a built device on the bench, and write a dated report",
        description=INTRODUCTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        run="stream.acceptance.command.run",
        writes={"out": False},
    )
    add_verb(verbs, "ports", help="list the serial ports", run="command_line.stream.ports")


def _add_design(commands: Any) -> None:
    add_verb(
        commands,
        "design",
        argument(
            "touches", nargs="*", metavar="TOUCH", help=f"sampled scene, recording, or one of: {', '.join(NAMES)}"
        ),
        argument("--device", default="cable_platform", metavar="PRESET", help="the device preset"),
        argument("--table", type=Path, metavar="FILE", help="a collected table (.npz) or a recorded one (.csv)"),
        argument("--rows", type=int, metavar="N", help="size of the table to collect; 0 for the preset's own"),
        argument("--save-table", type=Path, metavar="FILE", help="keep the collected table"),
        *WORKERS,
        argument("--skin", metavar="PRESET", help="the skin preset; as in the scene if left out"),
        LEVEL,
        argument("--noise", type=float, default=NOISE, metavar="COUNTS", help="of the virtual sensor"),
        argument("--seed", type=int, default=0, help="of noise and of the six interactions' wobble"),
        argument("--finger", type=int, default=0, metavar="I", help="which finger of a scene"),
        argument(
            "--rule",
            choices=("touch", "paper"),
            help="how many motors the preset gets: less than the limit of the touch lost, or the paper's",
        ),
        argument("--motors", type=int, metavar="K", help="of the preset; as the rule says if left out"),
        argument("--out", type=Path, metavar="DIR", help="write text, JSON, picture and preset there"),
        PRESETS,
        switch("--json", "print the report as JSON"),
        argument(
            "--trial",
            type=int,
            metavar="SEEDS",
            help="judge the six interactions for so many seeds, and list every exception",
        ),
        QUIET,
        help="how many motors a device needs for given touches",
        description="Find the fewest motors, and their coupling, with which a platform device renders given touches: "
        "sampled scenes (.npz), recordings of a 20-channel sensor (.csv), or the six interactions of [S2].",
        run="command_line.design.run",
        writes={"out": True, "save_table": False},
    )


def _add_thimble(commands: Any) -> None:
    verbs = commands.add_parser(
        "thimble",
        help="adapt, render recordings, plot and measure a thimble",
        description="Adapt a thimble to a finger, render a recorded sequence of stimuli, draw the stimulus plot, "
        "tell the reach.",
    ).add_subparsers(required=True, metavar="WHAT")
    add_verb(
        verbs,
        "adapt",
        *THIMBLE,
        argument("--skin", default=[DEFAULT_SKIN], nargs="+", metavar="PRESET", help="skin presets, a finger each"),
        LEVEL,
        TISSUE,
        argument("--out", type=Path, required=True, metavar="DIR", help="folder for the surrogates' two files each"),
        argument("--movements", type=int, metavar="N", help="random movements to learn from; 2400 if left out"),
        *WORKERS,
        QUIET,
        help="learn network and polynomial for fingers",
        run="command_line.adapt.run",
        writes={"out": True},
    )
    add_verb(
        verbs,
        "follow",
        *THIMBLE,
        *SKIN,
        argument("stimuli", type=Path, metavar="FILE", help="times and channels: .csv, or .npz (times, stimuli)"),
        argument(
            "--table",
            type=Path,
            metavar="FILE",
            help="recorded x (pitch, roll [rad], distance [m]) and channels to learn from, in any unit of their own: "
            ".npz, or .csv with x in the first three columns; the virtual 19 electrodes if left out",
        ),
        argument(
            "--noise",
            type=float,
            metavar="SIGMA",
            help="standard deviation of one channel's noise, in the recording's unit; measured on it if left out",
        ),
        argument("--out", type=Path, required=True, metavar="FILE.csv", help="the command track to write"),
        help="render a recorded sequence of sensor readings",
        run="command_line.thimble.follow",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "plot",
        *THIMBLE,
        SCENE,
        argument("--finger", type=int, default=0, metavar="I", help="which finger"),
        argument("--out", type=Path, required=True, metavar="FILE", help="the picture, .png or .svg"),
        help="draw a sampled scene's stimuli in three components",
        run="command_line.thimble.plot",
        writes={"out": False},
    )
    add_verb(verbs, "reach", *THIMBLE, help="tell where the platform can go", run="command_line.thimble.reach")
