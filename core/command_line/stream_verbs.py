"""Arguments of the verbs of `python -m core stream`, for live devices."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..stream.acceptance.person import INTRODUCTION, QUESTIONS
from ..stream.acceptance.report import CHECKS
from ..stream.virtual.faults import NAMES
from .arguments import LINK, LOG, REST, SPEAKS, TRACK, add_verb, argument, device, seconds, setting, settings_of, switch

CARD = argument(
    "--card",
    required=True,
    metavar="NAME",
    help="a sound card's whole name, see 'stream cards'; 'virtual:' is simulated",
)

# Help texts for settings of the format 'wav' in `stream sound` (TO_A_CARD) and `stream daq` (TO_AN_OUTPUT), where their
# meaning differs from that in a file.
TO_A_CARD = {
    "full_scale": "required: peak voltage of the sound card for the largest sample: 1.414 times the RMS voltage that a "
    "meter shows for a full-scale tone",
    "gain": "required: voltage gain of the amplifier between sound card and device; 1 without one",
}
TO_AN_OUTPUT = {
    "rate": "samples per second of the output (48000 Hz)",
    "full_scale": "largest voltage of the output, in both directions; if left out, the limit of the haptic device's "
    "channel divided by the gain",
    "gain": "required: voltage gain of the amplifier between output and device; 1 without one",
    "offset": "constant voltage at the device, added to the track's (0 V)",
}


def add_streams(commands: Any) -> None:
    """Add the verbs of `stream` to a command line."""
    verbs = commands.add_parser(
        "stream",
        help="play a track to a device, or run a virtual device",
        description="Live streaming. Read presets/streaming_safety.md before a finger goes in.",
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
        description="Play a track to a device, once. Exit status: 0; 1 if the device refused more than 1 % of the "
        "commands or took them too late, or if the log is not whole; 2 if it was not played to its end; 128 plus "
        "a signal's number if a signal ended it.",
        run="stream.play_command.play",
    )
    add_verb(
        verbs,
        "sound",
        TRACK,
        CARD,
        argument(
            "--measured", type=Path, required=True, metavar="FILE", help="measurement of the card by 'stream loopback'"
        ),
        *settings_of("wav", TO_A_CARD),
        switch("--yes", "play without asking"),
        help="play a voice coil's or a screen's track through a sound card, once",
        description="Play the voltage of a track through a sound card that no other program uses. Exit status: 0; 1 if "
        "the card ran out of samples; 128 plus a signal's number.",
        run="stream.sound.play.sound",
    )
    add_verb(
        verbs,
        "loopback",
        CARD,
        argument("--rate", type=int, default=48_000, metavar="HZ", help="samples per second (48000)"),
        argument("--out", type=Path, metavar="FILE", help="write the measurement, for 'stream sound'"),
        help="measure a sound card with a cable from its output to its input",
        description="Measure gain, latency, jitter, corner and clipping of a sound card with a cable from out to in, "
        "no amplifier connected.",
        run="stream.sound.loopback.loopback",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "daq",
        TRACK,
        argument("--output", required=True, metavar="CHANNEL", help="an NI device's analog output: Dev1/ao0"),
        argument("--inputs", default="", metavar="CHANNELS", help="its analog inputs with a force sensor: Dev1/ai0:5"),
        argument("--sensor", type=Path, metavar="FILE", help="the force sensor's calibration matrix (JSON)"),
        argument("--forces", type=Path, metavar="FILE", help="write the measured forces and torques (CSV)"),
        *settings_of("wav", TO_AN_OUTPUT),
        switch("--yes", "play without asking"),
        help="play a voice coil's or a screen's track through an NI device, once, and measure forces",
        description="Play the voltage of a track through an analog output of an NI device, clocked by the device, and "
        "log a force sensor at its inputs meanwhile. Exit status: 0; 2 if it was not played to its end; 128 plus a "
        "signal's number if a signal ended it.",
        run="stream.daq.play.daq",
        writes={"forces": False},
    )
    add_verb(
        verbs,
        "cards",
        help="list the sound cards that may drive an amplifier",
        description="List the sound cards that may drive an amplifier: exclusive to one program, and not the system's "
        "default.",
        run="command_line.stream.cards",
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
            help="source of the finger's position: the device's own panel ('device', the default), osc://:PORT or "
            "osc://HOST:PORT to listen at, serial:PORT?baud=RATE, '-' for standard input, 'mouse' in a window",
        ),
        argument(
            "--unit",
            default="mm",
            choices=("m", "mm"),
            help="unit of x and y in lines 'x y [down]', measured from the screen's centre (mm)",
        ),
        switch("--yes", "arm without asking"),
        help="answer a finger on a touch screen, until Ctrl-C",
        description="Answer a real finger from a screen's map, without Blender.",
        run="command_line.stream.panel",
    )
    add_verb(
        verbs,
        "follow",
        *device("cable_platform", "cable_platform"),
        argument(
            "--table",
            type=Path,
            required=True,
            metavar="FILE",
            help="recorded motor commands and the sensor's channels (.csv), or a collected table (.npz)",
        ),
        argument(
            "--sensor",
            required=True,
            metavar="FROM",
            help="source of the sensor's readings: osc://:PORT or osc://HOST:PORT to listen at for '/dermis/sensor', "
            "socket://HOST:PORT, serial:PORT?baud=RATE or '-' (standard input) for lines with one number per "
            "channel",
        ),
        *LINK,
        *LOG,
        setting("ramp"),
        argument(
            "--rest-for",
            type=seconds,
            default=1.0,
            metavar="S",
            help="time before arming in which rest and noise of the untouched sensor are measured; 0: "
            "those of the table (1)",
        ),
        argument(
            "--noise", type=float, metavar="SIGMA", help="standard deviation of one channel; measured if left out"
        ),
        REST[1],
        switch("--yes", "arm without asking"),
        help="let a device follow a sensor live, until Ctrl-C",
        description="Look every reading of a sensor up in a table of the device, and send the result, with the "
        "sender's ramp, limits and safe state. Without readings the device goes to its safe state. Prints the latency.",
        run="command_line.follow.live",
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
        argument("--out", type=Path, metavar="FILE.csv", help="the CSV to write; without it, a summary is printed"),
        help="summarize a binary log, or convert it to CSV",
        run="command_line.stream_log.run",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "pair",
        argument("--url", required=True, metavar="PORT", help="the board's serial port, see 'stream ports'"),
        argument("--network", required=True, metavar="NAME", help="name of the 2.4 GHz Wi-Fi that the board joins"),
        switch("--open", "the Wi-Fi has no password; otherwise it is asked for, and not shown"),
        help="pair an ESP32 with this computer over USB, for its Wi-Fi",
        description="Pair an ESP32 with this computer over USB: it keeps a random key, joins the Wi-Fi, and then "
        "answers this computer alone. Prints the address to connect to.",
        run="stream.pair_command.pair",
    )
    add_verb(
        verbs,
        "virtual",
        *device("haptip"),
        argument(
            "--at", choices=("pty", "tcp", "udp"), help="kind of its address (pty; udp for a protocol of datagrams)"
        ),
        argument("--every", type=seconds, default=0.0, metavar="S", help="print a report this often"),
        argument(
            "--fault", action="append", default=[], metavar="NAME=VALUE", help=f"may be repeated: {', '.join(NAMES)}"
        ),
        help="run a virtual device until its input ends",
        description="Run a virtual device, and print its address. It ends when its standard input ends: press "
        "Ctrl-D in a terminal. With an empty standard input (`< /dev/null`) it ends at once.",
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
            help=f"one check; may be repeated: {', '.join(CHECKS)}",
        ),
        argument("--out", type=Path, metavar="FILE", help="report (acceptance_DEVICE_DATE.md in this folder)"),
        help="try a built device on the bench, and write a dated report",
        description=f"Try a built device on the bench, and write a dated report.\n{INTRODUCTION}\n{QUESTIONS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        run="stream.acceptance.command.run",
        writes={"out": False},
    )
    add_verb(
        verbs,
        "measure",
        argument("--device", required=True, default="", metavar="KEY", help="device preset"),
        *SPEAKS,
        *LINK,
        argument("--channel", required=True, metavar="NAME", help="channel to measure"),
        argument("--points", type=int, default=11, metavar="N", help="stops in each direction, up and down (11)"),
        argument(
            "--valid-days",
            type=int,
            default=30,
            metavar="N",
            help="days after which Connect reports the calibration as old; 0: never",
        ),
        argument("--out", type=Path, metavar="FILE", help="calibration (calibration_DEVICE_CHANNEL_DATE.json)"),
        help="measure what an actuator reaches on the bench, and write its calibration",
        description="Drive one actuator from stop to stop, ask what it reaches, and write its calibration.\n"
        f"{INTRODUCTION}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        run="stream.acceptance.curve_walk.run",
        writes={"out": False},
    )
    add_verb(verbs, "ports", help="list the serial ports", run="command_line.stream.ports")
