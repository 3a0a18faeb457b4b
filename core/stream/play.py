"""`stream play`: a track to a device, once; and whatever ends it, the safe state first."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import DermisError
from .links.url import unnamed
from .request import StreamRequest
from .shared_state import Heartbeat
from .streamer import Streamer
from .virtual.link import open_link

UNKNOWN_POSE = """The device does not say where it is: with the first pulse it may jump to its safe pose, at its own
full speed. Take the finger out before you arm; put it in when the device stands still."""


class Interrupted(BaseException):
    """A signal asked for the end while nothing could look after it."""


class Signals:
    """Ctrl-C, TERM and HUP: noted, so that no message is cut in the middle; during a prompt they end that.

    Ctrl-Z and Ctrl-\\ end a stream too: a program that sleeps, or dies at once, leaves a board without a watchdog where
    it is.

    Attributes:
        number: of the signal that came, 0 before.
    """

    NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")

    def __init__(self) -> None:
        self.number = 0
        self._prompting = False

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Remember signals instead of dying of them."""
        numbers = [getattr(signal, name) for name in self.NAMES if hasattr(signal, name)]
        numbers = [n for n in numbers if n == signal.SIGINT or signal.getsignal(n) != signal.SIG_IGN]  # nohup
        before = [(number, signal.signal(number, self._note)) for number in numbers]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)

    def line(self) -> str:
        """Wait for a line of standard input; '' at its end.

        Raises:
            Interrupted: a signal came first.
        """
        self._prompting = True
        try:
            if self.number:
                raise Interrupted
            return sys.stdin.readline()
        finally:
            self._prompting = False

    def _note(self, number: int, _frame: object) -> None:
        self.number = self.number or number
        if self._prompting:
            raise Interrupted


def play(options: argparse.Namespace) -> int:
    """Play a track once; return 0, or 128 and the number of the signal that ended it.

    Raises:
        DermisError: the device could not be reached, disarmed itself, or its safe state could not be made sure of.
    """
    signals = Signals()
    player = _Player(options, signals)
    with signals.caught():
        try:
            player.run()
        except Interrupted:
            pass
        finally:
            player.finish()
    player.tell()
    return 128 + signals.number if signals.number else 0


class _Player:
    """A streamer in this process, and the heartbeats that Blender would give."""

    def __init__(self, options: argparse.Namespace, signals: Signals) -> None:
        from ..devices.calibration import Calibration
        from ..presets import Library
        from ..track import export
        from ..track.check import preset_findings

        self._options, self._signals = options, signals
        self._track = export.read(options.track)
        key = options.device or self._track.spec.key
        library = Library(options.presets)
        for finding in preset_findings(self._track, library, key):
            _say(str(finding))
        preset = library.load("devices", key)
        calibration = Calibration.load(options.calibration).dumps() if options.calibration else ""
        self._request = StreamRequest(
            connect=True,
            url=options.url,
            protocol=options.protocol,
            device={"key": key, "preset": preset},
            calibration=calibration,
            track=str(options.track),
            look_ahead=options.look_ahead,
            ramp=options.ramp,
            rate=options.rate,
            play_on=True,
        )
        self._streamer, self._number = Streamer(open_link), 0

    def run(self) -> None:
        """Connect, ask, arm, ramp, play."""
        options, streamer, track = self._options, self._streamer, self._track
        streamer.apply(self._request, time.perf_counter())
        self._until(lambda: streamer.state in ("ready", "fault") or (streamer.link is None and bool(streamer.message)))
        if self._signals.number:
            return
        if streamer.state != "ready":
            raise self._refusal("the device cannot be reached")
        if streamer.adapter is not None:
            for said in filter(None, (streamer.adapter.caution, streamer.adapter.notice)):
                _say(said)
        if not streamer.pose_known:
            _say(UNKNOWN_POSE)
        if not options.yes:
            _say(f"{track.spec.name} at {options.url} is about to move. Enter: arm; Ctrl-C: stop.")
            if not self._signals.line():  # an end of input is nobody's finger on a key
                raise DermisError(
                    "not armed: standard input ended before anybody pressed Enter",
                    where=options.url,
                    remedy="Run it in a terminal, or pass --yes",
                )
        self._request.arm_id = 1
        self._heartbeat(None)
        streamer.apply(self._request, time.perf_counter())
        end = time.perf_counter() + options.ramp + 0.2 + options.look_ahead
        self._until(lambda: time.perf_counter() > end or not streamer.armed)
        started = time.perf_counter()
        end = started + track.duration + options.look_ahead
        self._until(lambda: time.perf_counter() > end or not streamer.armed, started)
        if not streamer.armed:
            raise self._refusal("the device disarmed itself")

    def finish(self) -> None:
        """Bring the device to its safe state however long its ramp takes, and let the link go; no signal ends that."""
        streamer = self._streamer
        before = dict(streamer.counters)
        self.lost = str(streamer.status()["not_rendered"])
        streamer.shut(time.perf_counter())
        if streamer.going:
            _say(streamer.going)
        while not streamer.finished:
            due = streamer.tick(time.perf_counter())
            time.sleep(max(due - time.perf_counter(), 0.0))
        self.unsure = streamer.counters["safe states not confirmed"] > before.get("safe states not confirmed", 0)

    def tell(self) -> None:
        """Print what was counted.

        Raises:
            DermisError: the safe state could not be made sure of.
        """
        streamer = self._streamer
        counted = {**streamer.counters, **(streamer.limiter.limited if streamer.limiter else {})}
        text = ", ".join(f"{name} {count}" for name, count in sorted(counted.items()) if count)
        if self._signals.number:
            _say(text)  # standard output may have gone with its terminal
        else:
            print("\n".join(filter(None, (text, self.lost))))
        if self.unsure:
            raise self._refusal("the safe state could not be made sure of")

    def _until(self, done: Callable[[], bool], playing_since: float | None = None) -> None:
        """Let time pass until something holds or a signal comes."""
        while not self._signals.number and not done():
            now = time.perf_counter()
            self._heartbeat(playing_since)
            due = self._streamer.tick(now)
            time.sleep(max(due - time.perf_counter(), 0.0))

    def _heartbeat(self, playing_since: float | None) -> None:
        """Give a sign of life, as Blender does."""
        now, playing = time.perf_counter(), playing_since is not None
        self._number += 1
        self._streamer.heartbeat(
            Heartbeat(self._number, 0, playing, now - playing_since if playing_since else 0.0, ()), now
        )

    def _refusal(self, otherwise: str) -> DermisError:
        message = self._streamer.message.rstrip(".")
        return DermisError(message or otherwise, where=unnamed(self._options.url, message))


def _say(text: str) -> None:
    with contextlib.suppress(OSError):  # a terminal that was closed takes nothing; the device still has to be safe
        print(text, file=sys.stderr, flush=True)
