"""The interface of every protocol to a sender. The sender knows no protocol, and a protocol knows no sender."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from ...arrays import Array
from ...errors import DermisError
from .packets import DeviceState
from .silence import SENDER_AFTER, SIGNS, Does, Silence
from .wire import Wire


@dataclass(frozen=True)
class Touch:
    """A finger on a touch panel [m from the screen's centre]; `at`: when this was heard [s], None for just now."""

    down: bool
    x: float
    y: float
    at: float | None = None


class Adapter:
    """One protocol, one device: from values to messages, and back.

    Class attributes:
        name: in URLs and menus. title: for people.
        tells_pose: the device reports its pose; None as `pose` then means that it does not know it.
        hushed: nothing is asked while nothing is armed, so that the board's own time-out acts: no safe state is
            confirmed then, and no pose reported.
        limp: in the safe state the actuators have no power, whatever the preset says.
        timed: commands may carry their play-out time.
        bears: longest delay of answers in a port's chip that commands are not hindered by [s].
        datagrams: messages go as datagrams, never as a stream.
        baud: baud rate of a serial port whose URL states none.
        unanswered: advice where nobody answers. at_baud: more of it where the link has a baud rate. faster: advice
            where the link is too slow, '' for none. unarmed: advice where it answers, and does not arm; '' for none.
        OPTIONS: names of the options that a URL may set.
        SENSES: name and unit of what the actuators measure beside their pose.

    Attributes:
        silence: the board's declared behaviour when no more commands reach it.
        caution: warning for a person who is about to put a finger in; '' for none.
        state: state that the device reports of itself, None where its protocol does not report one.
        broken: its last command could not be made, because of a defect.
        ready: the device has been recognised. armed: it takes commands. fault: why it cannot be used, in words.
        device: its identifier in hex digits; '' where it has none to tell.
        pose: where the device says it is, as driven [units], or None. pose_at: when it said so [s], or NaN.
        follows_pose: the device is asked for its pose while it is driven, too, where it has to be asked.
        touch: the last touch of a panel. counters: counts of faults and changes, by name.
        round_trip: the last one [s], or NaN. congested: answers stay away, so the link holds more than it carries.
        busy: an answer is on a line that carries commands too: they wait for it.
        carries: bytes a second of the link, None where that is not known.
        sensed: those measurements, taken with `pose`: 'temperature [degC]' -> a value each, NaN where one has none.
            Empty before the first, else one for each of SENSES, in that order.
        prompt: the last answer came as soon as any, or there are none: nothing waits on the way.
        queue: commands that the device can hold for later; 0: not known.
        output_hz: how often the actuators can take a new value [Hz]; 0: not known, or at every command.
        notice: advice for a person on the device that has been recognised, in words.
        least_rate: commands or their repetitions a second that keep the board from counting its sender as silent [Hz].
        refused: commands that the device says it did not take, or took too late.
        command_bytes: the most that one command takes. other_bytes: the most that goes beside commands, a second.
    """

    name = ""
    title = ""
    tells_pose = False
    hushed = False
    limp = False
    timed = False
    bears = math.inf
    datagrams = False
    baud = 115_200
    caution = ""
    unanswered = "Check address, protocol and power"
    at_baud = "Check the baud rate, too"
    faster = unarmed = ""
    command_bytes = 0
    other_bytes = 0.0
    OPTIONS: tuple[str, ...] = ()
    SENSES: tuple[tuple[str, str], ...] = ()

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        unknown = sorted(set(options) - set(self.OPTIONS))
        if unknown:
            raise DermisError(
                "unknown option",
                where=f"protocol '{self.name}'",
                value=", ".join(unknown),
                limit=", ".join(self.OPTIONS) or "none",
            )
        self.wire = wire
        self.options = options
        self.silence = self._declared_silence()
        self.least_rate = SIGNS / self.silence.after
        self.state: DeviceState | None = None
        self.ready = self.armed = self.broken = False
        self.fault = ""
        self.pose: Array | None = None
        self.pose_at = math.nan
        self.follows_pose = False
        self.touch: Touch | None = None
        self.counters: Counter[str] = Counter()
        self.round_trip = float("nan")
        self.device = ""
        self.queue = 0
        self.output_hz = 0.0
        self.notice = ""
        self.congested = self.busy = False
        self.carries: float | None = None
        self.sensed: dict[str, Array] = {}
        self.prompt = True
        self.refused = 0

    def opened(self, now: float) -> None:
        """Begin: the link has just been opened."""
        self.ready = True

    def receive(self, data: bytes, now: float) -> None:
        """Take received data: any portion of a stream, or one datagram."""

    def poll(self, now: float) -> list[bytes]:
        """Return messages that are due by themselves: handshake, clock, sign of life."""
        return []

    def arm(self) -> None:
        """Ask the device to take commands; `armed` tells when it does."""
        self.armed = True

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return the messages for values [units]; `play`: when they count, None for at once."""
        raise NotImplementedError

    def carried(self, values: Array) -> Array:
        """Return the values that the protocol's numbers stand for, for values [units], shape (..., channels)."""
        return values

    def forget(self) -> None:
        """Forget the last command: it did not leave, or must not be relied on; the next one says everything again."""

    def ask_pose(self) -> list[bytes]:
        """Return messages that ask the device for its state and pose; none where the protocol has no question."""
        return []

    def sign_of_life(self, values: Array, now: float) -> list[bytes]:
        """Return messages that keep the board from counting its sender as silent, and move nothing.

        `values`: the last ones commanded [units]. Only asked for where commands are far apart.
        """
        self.forget()
        return self.command(values, now, None)

    def retract(self) -> list[bytes] | None:
        """Return messages upon which the device goes to its safe state by itself; None: the sender leads it there."""
        return None

    def safe(self) -> list[bytes]:
        """Return the last messages after the way to the safe state, such as those that let actuators go."""
        self.armed = False
        return []

    @property
    def settled(self) -> bool:
        """Return whether the device has confirmed the last `safe`; True where its protocol confirms nothing."""
        return True

    def _declared_silence(self) -> Silence:
        """Read the behaviour in silence that the URL declares; unknown where it declares none.

        Raises:
            DermisError: no such behaviour, or an impossible time.
        """
        given = self.options.get("silence", "")
        if not given:
            return Silence()
        if given not in {does.value for does in Does}:
            raise DermisError(
                "no such behaviour in silence",
                where=f"protocol '{self.name}', silence",
                value=given,
                limit=", ".join(does.value for does in Does),
            )
        does = Does(given)
        if does in (Does.KEEPS, Does.UNKNOWN):
            silence = Silence(does)
        else:
            silence = Silence(does, self.whole("silence_ms", round(1e3 * SENDER_AFTER), 10, 60_000) / 1e3, "board")
        self.caution = f"The address declares that {silence}. Nothing has checked that: try it before a finger goes in."
        return silence

    def number(self, name: str, default: float) -> float:
        """Read an option as a number.

        Raises:
            DermisError: it is none, or not finite.
        """
        try:
            number = float(self.options.get(name, default))
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise DermisError(
                "an option is no number",
                where=f"protocol '{self.name}', {name}",
                value=self.options.get(name, default),
                limit="a finite number",
            )
        return number

    def whole(self, name: str, default: int, least: int, most: int) -> int:
        """Read an option as a whole number within its limits.

        Raises:
            DermisError: it is none, or outside of them.
        """
        text = self.options.get(name, str(default))
        number = int(text) if text.strip().isdecimal() else -1
        if not least <= number <= most:
            raise DermisError(
                "an option is no whole number within its limits",
                where=f"protocol '{self.name}', {name}",
                value=text,
                limit=f"{least} to {most}",
            )
        return number
