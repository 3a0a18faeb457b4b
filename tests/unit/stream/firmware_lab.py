"""The sender's own mind and the sketch on its board, at the two ends of one paced line."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.presets import Library
from core.stream.links.transport import Transport
from core.stream.links.url import Url
from core.stream.protocols import packets
from core.stream.protocols.packets import Kind
from core.stream.protocols.wire import Wire
from core.stream.request import StreamRequest
from core.stream.shared_state import Heartbeat
from core.stream.streamer import Streamer
from core.stream.track_source import TrackSource
from core.track import binary
from core.track.command_track import CommandTrack
from tests.unit.stream.firmware_avr import AvrBoard
from tests.unit.stream.firmware_board import Board, Chip

TICK = 0.001
START = 100.0  # the sender's clock when the board's begins [s]
LOOK_AHEAD = 0.1


class Line(Transport):
    """The line to the board; what the board says is kept for the test as well."""

    name = "board"

    def __init__(self, board: Board) -> None:
        self.board = board
        self.arrived: list[bytes] = []
        self.synced: packets.Synced | None = None
        self._decoder = packets.Decoder()

    def send(self, message: bytes) -> bool:
        self.board.send(message)
        return True

    def receive(self) -> list[bytes]:
        out, self.arrived = self.arrived, []
        return out

    def hear(self, data: bytes) -> None:
        """Take what the board has sent."""
        self.arrived.append(data)
        for packet in self._decoder.feed(data):
            if packet.kind == Kind.SYNCED:
                self.synced = packets.Synced.read(packet.body)


class FirmwareLab:
    """A streamer that plays a track on a board; the test turns both their clocks.

    Attributes:
        play_from: when the track's time 0 is played, on the board's clock [s].
    """

    def __init__(self, board: Board, track: Path, key: str = "haptip") -> None:
        self.board, self.line = board, Line(board)
        self.request = StreamRequest(
            connect=True,
            url="lab",
            protocol="native",
            track=str(track),
            ramp=0.0,
            look_ahead=LOOK_AHEAD,
            device={"key": key, "preset": Library().load("devices", key)},
        )
        self.streamer = Streamer(self._open)
        self.number, self.playing, self.play_from = 0, False, 0.0
        self.streamer.apply(copy.deepcopy(self.request), self.now)

    def _open(self, url: Url, wire: Wire, protocol: str) -> Transport:
        return self.line

    @property
    def now(self) -> float:
        """The sender's clock [s]."""
        return START + self.board.now

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK)):
            self.number += 1
            time = self.board.now - self.play_from if self.playing else 0.0
            self.streamer.heartbeat(Heartbeat(self.number, 0, self.playing, time, ()), self.now)
            self.streamer.tick(self.now)
            self.line.hear(self.board.run(TICK))

    def arm(self) -> None:
        """Arm, as a press of the button does."""
        self.request.arm_id += 1
        self.streamer.apply(copy.deepcopy(self.request), self.now)
        self.run(0.2)
        assert self.streamer.state == "armed", self.streamer.message

    def play(self) -> None:
        """Begin the playback now."""
        self.playing, self.play_from = True, self.board.now

    def errors_us(self, since: float, until: float) -> np.ndarray:
        """Return each pulse's width less what the played track asks for at that pulse's own time [us]."""
        source, wire = self.streamer.output.source, self.streamer.output.wire
        assert isinstance(source, TrackSource) and wire is not None
        out = []
        for channel, start, width in self.board.pulses:
            time = start - self.play_from
            if since <= time <= until:
                part = (source.value(time)[channel] - wire.range_low[channel]) / (
                    wire.range_high[channel] - wire.range_low[channel]
                )
                out.append(width - (1000.0 + 1000.0 * part))
        return np.array(out)


def slow_track(path: Path, seconds: float) -> Path:
    """Write sines of 1.0 and 1.7 Hz, as far as servos at 50 pulses a second follow them well."""
    t = np.arange(round((seconds + 2) * 1000) + 1) / 1000
    one, two = 0.15 * np.sin(2 * np.pi * 1.0 * t), 0.1 * np.sin(2 * np.pi * 1.7 * t)
    binary.write(CommandTrack(Library().device("haptip"), t, np.column_stack([0 * t, 0 * t, one, two])), path)
    return path


@dataclass(frozen=True)
class Played:
    """What became of a track.

    Attributes:
        errors: of the pulses against the played track at their own time [us].
        sent: commands that left the sender. counted: of those, what it or the board said it dropped, by name.
        received: commands that the board has taken. overruns: bytes that the chip lost.
    """

    errors: np.ndarray
    sent: int
    received: int
    counted: dict[str, int]
    overruns: int


def play(track: Path, seconds: float, chip: Chip = AvrBoard) -> Played:
    """Play a track of the tactor on a board with its two servos, then stop."""
    with chip("-DDERMIS_CHANNELS=2") as board:
        lab = FirmwareLab(board, track)
        lab.run(0.3)
        lab.arm()
        lab.run(0.2)
        lab.play()
        lab.run(seconds)
        lab.streamer.stop(lab.now, "through")
        lab.run(0.2)
        counters, told = lab.streamer.counters, lab.line.synced
        assert told is not None
        counted = {name: counters[name] for name in ("dropped", "skipped")}
        counted |= {name: getattr(told, name) for name in ("lost", "damaged", "late", "watchdogs")}
        return Played(lab.errors_us(0.2, seconds), counters["sent"], told.received, counted, board.overruns)
