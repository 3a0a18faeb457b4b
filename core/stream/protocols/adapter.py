"""The interface between a sender and the protocols.

The sender depends on no protocol, and no protocol depends on the sender.
"""

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
    """A report of a touch panel.

    Attributes:
        down: whether a finger touches the panel. x, y: position from the screen's centre [m].
        at: time at which the report arrived [s]; None for just now.
    """

    down: bool
    x: float
    y: float
    at: float | None = None


class Adapter:
    """One protocol for one device: makes messages from values, and reads answers.

    Class attributes:
        name: name in URLs and menus. title: name for people.
        tells_pose: the device reports its pose. If `pose` is None nevertheless, the device does not know its pose.
        hushed: the sender asks nothing while the device is not armed, so that the board's own time-out can act. No safe
            state is confirmed and no pose is reported meanwhile.
        limp: in the safe state the actuators have no power, whatever the preset says.
        timed: commands may carry their play-out time.
        bears: longest time for which a port's chip may hold answers back without delaying commands [s].
        datagrams: messages go as datagrams, never as a stream.
        baud: baud rate of a serial port whose URL states none.
        unanswered: advice if nobody answers. at_baud: further advice if the link has a baud rate. faster: advice
            if the link is too slow, '' for none. unarmed: advice if the device answers but does not arm, '' for none.
        OPTIONS: names of the options that a URL may set.
        SENSES: names and units of the quantities that the actuators measure beside their pose.

    Attributes:
        silence: the board's declared behaviour when no more commands reach it.
        caution: warning for a person who is about to put a finger in; '' for none.
        state: state that the device reports; None if its protocol reports none.
        broken: the last command could not be made, because of a defect of the adapter.
        ready: the device has been recognised. armed: it takes commands. fault: why it cannot be used, in words.
        device: the device's identifier in hex digits; '' if it reports none.
        pose: last reported pose, in driven values [units], or None. pose_at: time of that report [s], or NaN.
        follows_pose: a device that has to be asked for its pose is asked while it is driven, too.
        touch: last touch of a panel. counters: counts of faults and changes, by name.
        round_trip: last round trip [s], or NaN. congested: answers are late, so commands queue on the link.
        busy: an answer is expected on a line that also carries commands; commands wait for it.
        carries: capacity of the link [bytes/s]; None if it is not known.
        sensed: measurements taken with `pose`, such as 'temperature [degC]' -> array of shape (channels,), NaN for an
            actuator without a value. Empty before the first measurement; then it has every one of SENSES, in order.
        prompt: the last answer was not delayed, or the protocol has no answers: nothing queues on the link.
        queue: number of commands that the device can hold for later; 0: not known.
        output_hz: rate at which the actuators can take new values [Hz]; 0: not known, or at every command.
        notice: advice for a person on the device that has been recognised, in words.
        least_rate: rate of commands or their repetitions at which the board does not yet count its sender as
            silent [Hz].
        refused: number of commands that the device reports as refused or late.
        command_bytes: largest size of one command [bytes].
        other_bytes: largest traffic on the link beside commands [bytes/s].
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
        """Begin on a link that has just been opened."""
        self.ready = True

    def receive(self, data: bytes, now: float) -> None:
        """Process received data: any portion of a stream, or one datagram."""

    def poll(self, now: float) -> list[bytes]:
        """Return due messages other than commands.

        They are handshakes, questions for the clock, and signs of life.
        """
        return []

    def arm(self) -> None:
        """Ask the device to take commands; `armed` is set once it does."""
        self.armed = True

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return the messages of one command.

        Args:
            values: driven values [units], shape (channels,). now: time [s]. play: play-out time [s], None for at once.
        """
        raise NotImplementedError

    def carried(self, values: Array) -> Array:
        """Return values [units] rounded as the protocol sends them.

        The shape is (..., channels).
        """
        return values

    def forget(self) -> None:
        """Forget the last command: it was not sent, or may be lost.

        The next command repeats every value.
        """

    def ask_pose(self) -> list[bytes]:
        """Return messages that ask the device for its state and pose.

        There are none if the protocol has no such question.
        """
        return []

    def sign_of_life(self, values: Array, now: float) -> list[bytes]:
        """Return messages that show the board a live sender, and move nothing.

        They are needed only if commands are far apart.

        Args:
            values: last commanded values [units], shape (channels,). now: time [s].
        """
        self.forget()
        return self.command(values, now, None)

    def retract(self) -> list[bytes] | None:
        """Return messages that make the device go to its safe state by itself.

        None: the sender leads the device there by commands.
        """
        return None

    def safe(self) -> list[bytes]:
        """Return the last messages once the safe values have been commanded.

        Some protocols let the actuators go with them.
        """
        self.armed = False
        return []

    @property
    def settled(self) -> bool:
        """Return whether the device has confirmed the last `safe`.

        True if its protocol confirms nothing.
        """
        return True

    def _declared_silence(self) -> Silence:
        """Read the board's behaviour in silence from the URL.

        It is unknown if the URL declares none.

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
            DermisError: the option is not a finite number.
        """
        try:
            number = float(self.options.get(name, default))
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise DermisError(
                "an option is not a number",
                where=f"protocol '{self.name}', {name}",
                value=self.options.get(name, default),
                limit="a finite number",
            )
        return number

    def whole(self, name: str, default: int, least: int, most: int) -> int:
        """Read an option as a whole number within its limits.

        Raises:
            DermisError: the option is no whole number, or outside its limits.
        """
        text = self.options.get(name, str(default))
        number = int(text) if text.strip().isdecimal() else -1
        if not least <= number <= most:
            raise DermisError(
                "an option is not a whole number within its limits",
                where=f"protocol '{self.name}', {name}",
                value=text,
                limit=f"{least} to {most}",
            )
        return number
