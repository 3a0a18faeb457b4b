"""`python -m core stream`: play a track to a device, the sender that Blender starts, a virtual device, the ports."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import DermisError
from .adapter import NAMES

LoadScreen = Callable[[Path], Any]


def add_parser(commands: Any, load_screen: LoadScreen) -> None:
    """Add the verb `stream` to the command line."""
    one = commands.add_parser("stream", help="play a track to a device, or run a virtual device",
                              description="Live streaming. Read the safety page before a finger goes in.")  # fmt: skip
    verbs = one.add_subparsers(required=True, metavar="WHAT")

    play = verbs.add_parser("play", help="play a track to a device, once")
    play.add_argument("track", type=Path, metavar="TRACK", help="a command track: CSV, JSON or binary")
    _device_options(play)
    play.add_argument("--url", required=True, help="port or URL of the device, 'virtual:' for the one in the box")
    play.add_argument("--calibration", type=Path, metavar="FILE", help="calibration of this device")
    play.add_argument("--look-ahead", type=_setting("look_ahead"), default=0.1, metavar="S",
                      help="send this far ahead (0.1 s)")  # fmt: skip
    play.add_argument("--ramp", type=_setting("ramp"), default=1.0, metavar="S",
                      help="ramp from where the device is (1 s)")  # fmt: skip
    play.add_argument("--yes", action="store_true", help="arm without asking")
    play.set_defaults(run=_play)

    send = verbs.add_parser("send", help="serve a notice board (not for people)")
    send.add_argument("--board", type=Path, required=True)
    send.set_defaults(run=lambda options: _send(options, load_screen))

    virtual = verbs.add_parser("virtual", help="run a virtual device until its input ends")
    _device_options(virtual)
    virtual.add_argument("--at", default="pty", choices=("pty", "tcp", "udp"), help="where it can be reached (pty)")
    virtual.add_argument("--every", type=_seconds, default=0.0, metavar="S", help="print a report this often")
    virtual.add_argument("--fault", action="append", default=[], metavar="NAME=VALUE",
                         help="loss, delay, jitter, corrupt, slow, stuck, skew, seed; more than once")  # fmt: skip
    virtual.set_defaults(run=_virtual)

    ports = verbs.add_parser("ports", help="list the serial ports")
    ports.set_defaults(run=_ports)


def _setting(name: str) -> Callable[[str], float]:
    """Return a reader of a setting that has limits."""
    from .wish import check_number

    def read(text: str) -> float:
        value = _number(text)
        try:
            check_number(name, value)
        except DermisError as error:
            raise argparse.ArgumentTypeError(f"{text} is not allowed: {error.limit}") from error
        return value

    return read


def _seconds(text: str) -> float:
    value = _number(text)
    if not 0.0 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: 0 to 1e6 s")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error


def _device_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", default="", metavar="KEY", help="device preset; the track's own if left out")
    parser.add_argument("--protocol", default="native", choices=sorted(NAMES), help="what the device speaks (native)")
    parser.add_argument("--presets", type=Path, metavar="DIR", help="folder with presets of your own")


def _send(options: argparse.Namespace, load_screen: LoadScreen) -> int:
    from .sender import run

    return run(options.board, load_screen)


def _ports(_options: argparse.Namespace) -> int:
    from .serial_port import ports

    found = ports()
    for name, description in found:
        print(f"{name}\t{description}")
    if not found:
        print("no serial ports", file=sys.stderr)
    return 0


def _virtual(options: argparse.Namespace) -> int:
    from ..presets import Library
    from .faults import NAMES as FAULTS
    from .faults import number_of
    from .virtual_program import serve
    from .wire import Wire

    faults = {}
    for text in options.fault:
        name, _, value = text.partition("=")
        if name not in FAULTS:
            raise DermisError("not a fault", where="--fault", value=text, limit=", ".join(FAULTS))
        faults[name] = number_of(name, value)
    wire = Wire.of(Library(options.presets).device(options.device or "haptip"))
    return serve(options.protocol, wire, options.at, faults, every=options.every)


def _play(options: argparse.Namespace) -> int:
    from ..calibration import Calibration
    from ..formats import export
    from ..formats.check import preset_findings
    from ..presets import Library
    from .board import Beat
    from .streamer import Streamer
    from .virtual_link import open_link
    from .wish import Wish

    track = export.read(options.track)
    key = options.device or track.spec.key
    for finding in preset_findings(track, Library(options.presets), key):
        print(finding, file=sys.stderr)
    preset = Library(options.presets).load("devices", key)
    calibration = Calibration.load(options.calibration).dumps() if options.calibration else ""
    wish = Wish(
        connect=True, url=options.url, protocol=options.protocol, device={"key": key, "preset": preset},
        calibration=calibration, track=str(options.track), look_ahead=options.look_ahead,
        ramp=options.ramp, play_on=True,
    )  # fmt: skip
    streamer, clock = Streamer(open_link), time.perf_counter
    number, started = 0, 0.0

    def run(until: Callable[[], bool], playing: bool) -> None:
        nonlocal number
        while not until():
            now = clock()
            number += 1
            streamer.beat(Beat(number, 0, playing, now - started if playing else 0.0, ()), now)
            due = streamer.tick(now)
            time.sleep(max(due - clock(), 0.0))

    try:
        streamer.apply(wish, clock())
        run(lambda: streamer.state in ("ready", "fault") or (streamer.link is None and bool(streamer.words)), False)
        if streamer.state != "ready":
            raise DermisError(streamer.words.rstrip(".") or "the device cannot be reached", where=options.url)
        if streamer.adapter is not None and streamer.adapter.caution:
            print(streamer.adapter.caution, file=sys.stderr)
        if not options.yes:
            print(f"{track.spec.name} at {options.url} is about to move. Enter: arm; Ctrl-C: stop.", file=sys.stderr)
            if not sys.stdin.readline():  # an end of input is nobody's finger on a key
                raise DermisError("not armed: standard input ended before anybody pressed Enter", where=options.url,
                                  remedy="Run it in a terminal, or pass --yes")  # fmt: skip
            run(lambda: True, False)
        wish.arm = 1
        streamer.beat(Beat(number + 1, 0, False, 0.0, ()), clock())
        streamer.apply(wish, clock())
        end = clock() + options.ramp + 0.2 + options.look_ahead
        run(lambda: clock() > end or not streamer.armed, False)
        if streamer.armed:
            started = clock()
            run(lambda: clock() > started + track.duration + options.look_ahead or not streamer.armed, True)
        if not streamer.armed:
            raise DermisError(streamer.words.rstrip(".") or "the device disarmed itself", where=options.url)
    finally:
        streamer.shut(clock())
        end = clock() + 0.2
        while not streamer.finished and clock() < end:
            streamer.tick(clock())
            time.sleep(0.001)
    counters = {k: v for k, v in {**streamer.counters, **(streamer.gate.limited if streamer.gate else {})}.items() if v}
    print(", ".join(f"{name} {count}" for name, count in sorted(counters.items())))
    return 0
