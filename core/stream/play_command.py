"""`stream play`: plays a track once on a device, then goes to safety.

The device goes to its safe state whatever ends the playback.

Exit status: 0; 1 if the device refused more than `MOST` of the commands or took them too late, or if the log is not
whole; 2 if the track was not played to its end; 128 plus the number of the signal that ended it.
"""

from __future__ import annotations

import argparse

from .. import clock
from ..errors import Finding
from ..presets import Library
from ..track import export
from ..track.check import preset_findings
from .device_options import log_from, request_from
from .local_stream import LocalStream, say
from .protocols.refusals import MOST
from .shared_state import Heartbeat
from .signals import Interrupted, Signals
from .streamer import Streamer
from .virtual.link import open_any_link

UNKNOWN_POSE = """The device does not say where it is: with the first pulse it may jump to its safe pose, at its own
full speed. Take the finger out before you arm; put it in when the device stands still."""


def play(options: argparse.Namespace) -> int:
    """Play a track once; return the exit status.

    Raises:
        DermisError: the device could not be reached, disarmed itself, or its safe state could not be made sure of.
    """
    signals = Signals()
    player = _Player(options, signals)
    with signals.caught():
        try:
            player.play(ask=not options.yes)
        except Interrupted:
            pass
        finally:
            player.finish()
        status = player.tell()  # a second signal does not end this either
    return 128 + signals.number if signals.number else status or int(not player.logged)


class _Player(LocalStream):
    """A streamer in this process, and the heartbeats that Blender would give."""

    def __init__(self, options: argparse.Namespace, signals: Signals) -> None:
        self._track = export.read(options.track)
        key = options.device or self._track.spec.key
        for finding in preset_findings(self._track, Library(options.presets), key):
            say(str(finding))
        more = {"look_ahead": options.look_ahead, "ramp": options.ramp, "play_on": True, **log_from(options)}
        request = request_from(options, key, connect=True, track=str(options.track), **more)
        super().__init__(Streamer(open_any_link, clock=clock.now), request, signals)
        self._number = 0
        self._playing_since: float | None = None
        self._not_rendered = self._notice = ""

    def play(self, *, ask: bool) -> None:
        """Connect, ask for confirmation, arm, wait for the ramp, and play.

        Raises:
            DermisError: the device cannot be reached, nobody confirmed the arming, or the device disarmed itself.
            Interrupted: a signal came first.
        """
        drive, streamer = self.connect(), self.streamer
        adapter = drive.connection.adapter
        for said in (adapter.caution, "" if drive.pose_known else UNKNOWN_POSE):
            if said:
                say(said)
        self._tell_notice()
        if ask:
            self.confirm(f"{self._track.spec.name} at {self.request.url} is about to move. Enter: arm; Ctrl-C: stop.")
        self.arm()
        ramped = clock.now() + self.request.ramp + 0.2 + self.request.look_ahead
        self.run(lambda: clock.now() > ramped or not streamer.armed)
        self._playing_since = clock.now()
        end = self._playing_since + self._track.duration + self.request.look_ahead
        self.run(lambda: clock.now() > end or not streamer.armed)
        self.tick(clock.now())  # a program that slept past the end of the track finds that out here
        if not streamer.armed:
            raise self.refusal("the device disarmed itself")

    def finish(self) -> None:
        """Bring the device to its safe state, and close the link."""
        self._not_rendered = str(self.streamer.status().get("not_rendered", ""))
        self.shut()

    def tell(self) -> int:
        """Print the counters; return the exit status by the refusals.

        Raises:
            DermisError: the safe state could not be confirmed.
        """
        text = ", ".join(f"{name} {count}" for name, count in self.streamer.counted().items())
        if self.signals.number:
            say(text)  # standard output may have gone with its terminal
        else:
            print("\n".join(filter(None, (text, self._not_rendered))))
        if self.unsure:
            raise self.refusal("the safe state could not be confirmed")
        return self._tell_refusals()

    def _tell_refusals(self) -> int:
        """Print how many commands the device refused or took too late.

        Returns 1 if they are more than `MOST` of the commands sent, otherwise 0.
        """
        refused, sent = (self.streamer.counters[name] for name in ("refused", "sent"))
        if not refused:
            return 0
        many = refused > MOST * sent
        finding = Finding(
            "error" if many else "warning",
            "commands-refused",
            "the device refused commands, or took them too late" + ("" if many else f", no more than {MOST:.0%}"),
            where=self.request.url,
            value=f"{refused} of {sent}",
            limit=f"{MOST:.0%}" if many else "",
            remedy="Play it again; where that does not help, check the device's clock and queue, or set --look-ahead 0",
            count=refused,
        )
        say(str(finding))
        return int(finding.severity == "error")

    def _tell_notice(self) -> None:
        """Print new notices of the protocol."""
        connection = self.streamer.connection
        notice = connection.adapter.notice if connection is not None else self._notice
        if notice and notice != self._notice:
            say(notice.removeprefix(self._notice).removeprefix(". "))
        self._notice = notice

    def tick(self, now: float) -> float:
        """Give a sign of life, as Blender does, and do the due work."""
        since = self._playing_since
        self._number += 1
        heartbeat = Heartbeat(self._number, 0, since is not None, now - since if since is not None else 0.0, ())
        self.streamer.heartbeat(heartbeat, now)
        due = super().tick(now)
        self._tell_notice()
        return due
