"""What every protocol offers a sender. The sender knows no protocol, and a protocol knows no sender."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from ...arrays import Array
from ...errors import DermisError
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
        watchdog: the receiver goes to its safe state by itself when the sender falls silent.
        own_safe: one message makes the receiver go to its safe state; otherwise the sender moves it there.
        timed: commands may carry their play-out time.
        datagrams: messages go as datagrams, never as a stream.
        lets_go: some of its receivers let go by themselves when commands end, and cannot say so.
        baud: of a serial port whose URL names none.
        caution: what a person has to know before a finger goes in.
        silence: what to look for where nobody answers.
        OPTIONS: names of what a URL may set.

    Attributes:
        ready: the device has been recognised. armed: it takes commands. fault: why it cannot be used, in words.
        device: its identifier in hex digits; '' where it has none to tell.
        pose: where the device says it is, as driven [units], or None.
        touch: the last touch of a panel. counters: what went wrong or was changed, by name.
        round_trip: the last one [s], or NaN. congested: answers stay away, so the link holds more than it carries.
        prompt: the last answer came as soon as any, or there are none: nothing waits on the way.
        queue: commands that the device can hold for later; 0: not known.
        output_hz: how often the actuators can take a new value [Hz]; 0: not known, or at every command.
        notice: what a person should know of the device that has been recognised, in words.
        command_bytes: the most that one command takes. other_bytes: the most that goes beside commands, a second.
    """

    name = ""
    title = ""
    watchdog = False
    own_safe = False
    timed = False
    datagrams = False
    lets_go = False
    baud = 115_200
    caution = ""
    silence = "Check port, protocol, baud rate and power"
    command_bytes = 0
    other_bytes = 0.0
    OPTIONS: tuple[str, ...] = ()

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
        self.ready = False
        self.armed = False
        self.fault = ""
        self.pose: Array | None = None
        self.touch: Touch | None = None
        self.counters: Counter[str] = Counter()
        self.round_trip = float("nan")
        self.device = ""
        self.queue = 0
        self.output_hz = 0.0
        self.notice = ""
        self.congested = False
        self.prompt = True

    def opened(self, now: float) -> None:
        """Begin: the link has just been opened."""
        self.ready = True

    def receive(self, data: bytes, now: float) -> None:
        """Take what arrived: any portion of a stream, or one datagram."""

    def poll(self, now: float) -> list[bytes]:
        """Return messages that are due by themselves: handshake, clock, sign of life."""
        return []

    def arm(self) -> None:
        """Ask the device to take commands; `armed` tells when it does."""
        self.armed = True

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return the messages for values [units]; `play`: when they count, None for at once."""
        raise NotImplementedError

    def forget(self) -> None:
        """Forget the last command: it did not leave, or must not be relied on; the next one says everything again."""

    def safe(self) -> list[bytes]:
        """Return messages that make the device safe; without `own_safe`, the last ones after the way there."""
        self.armed = False
        return []

    @property
    def settled(self) -> bool:
        """Return whether the device has confirmed the last `safe`; True where its protocol confirms nothing."""
        return True

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


# protocol -> file of this folder, and class in it
NAMES: Mapping[str, tuple[str, str]] = {
    "native": ("native", "Native"),
    "maestro": ("maestro", "Maestro"),
    "servo-animation": ("servo_animation", "ServoAnimation"),
    "torque": ("torque", "Torque"),
    "osc": ("osc", "Osc"),
}


def adapter_of(protocol: str) -> type[Adapter]:
    """Return the class of a protocol's adapters.

    Raises:
        DermisError: no such protocol.
    """
    from importlib import import_module

    if protocol not in NAMES:
        raise DermisError("no such protocol", value=protocol, limit=", ".join(NAMES))
    module, name = NAMES[protocol]
    return getattr(import_module(f".{module}", __package__), name)


def make(protocol: str, wire: Wire, options: Mapping[str, str]) -> Adapter:
    """Return the adapter of a protocol for a device.

    Raises:
        DermisError: no such protocol, an unknown option, or a device that the protocol cannot carry.
    """
    return adapter_of(protocol)(wire, options)
