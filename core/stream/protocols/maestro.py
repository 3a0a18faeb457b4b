"""Pololu Maestro servo controllers: commands and answers.

Targets and positions are quarter microseconds of pulse. Source: Pololu Maestro Servo Controller User's Guide, sections
4.b and 5.e. Answers carry no check sum: two bytes each, in the order of the questions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import DermisError
from . import maestro_findings as findings
from .adapter import Adapter
from .maestro_commands import CHANNELS, GET_ERRORS, GET_POSITION, packet, target
from .packets import Reach
from .silence import Does
from .wire import Wire

HIGHEST = 4 * 4080  # longest pulse of the board [us / 4]
REFRESH = 0.03  # [s] targets that do not change are repeated this often: well within the board's time-out of 0.1 s
READ_EVERY = 0.1  # [s] an armed board is asked for errors and positions this often
ANSWER = 0.2  # [s] an answer that takes longer is missing: 50 bytes at 9600 baud take 52 ms
MISSES = 3  # after this many missing answers in a row the board counts as gone
SLACK = 0.02  # [s] Connect is silent for this much longer than declared: the board's time-out has steps of 10 ms
LONGEST = 2.0  # [s] longest silence that Connect waits for: its handshake may take 3 s


class Step(Enum):
    """Steps of Connect."""

    ASK = "ask for errors, which clears them"
    TRY_CRC = "nobody answered: ask again, with a CRC if there was none, else without"
    BE_SILENT = "send nothing until the board's time-out must be over"
    LOOK = "ask for errors and positions"
    DONE = "the board was recognised or refused"


class Maestro(Adapter):
    """Pololu Maestro. Channel k of the device is channel `first` + k of the board.

    Options: `device`: its device number, for several boards on one line. `crc=1`: commands end with a CRC-7. `reads=1`:
    errors and positions are read back, and Connect checks the serial time-out; on by default with `device` or `crc=1`.
    """

    name, title = "maestro", "Pololu Maestro"
    hushed = True
    caution = (
        "This board keeps its last pulses when the computer falls silent. In the Maestro Control Center set 'Serial "
        "timeout' to 0.1 s, and choose what each servo does on error; or keep a switch at hand."
    )
    OPTIONS = ("first", "pulse_low_us", "pulse_high_us", "silence", "silence_ms", "device", "crc", "reads")

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        wire.need_ranges(self.title)
        if wire.count > CHANNELS:
            raise DermisError(
                "more channels than a Maestro has", where=wire.spec.name, value=wire.count, limit=str(CHANNELS)
            )
        self.first = self.whole("first", 0, 0, CHANNELS - wire.count)
        self.device_number = self.whole("device", 12, 0, 127) if "device" in options else None
        self.crc = bool(self.whole("crc", 0, 0, 1))
        self.reads = bool(self.whole("reads", int(self.crc or "device" in options), 0, 1))
        self.caution += "" if self.reads else " Add reads=1 to the address, and Connect checks the serial timeout."
        self.tells_pose = self.reads
        self.command_bytes = wire.count * len(self._packet(target(0, 0)))  # if all channels change
        self.other_bytes = len(self._question(positions=True)) / READ_EVERY if self.reads else 0.0
        self.low, self.high = (4 * self.number(f"pulse_{n}_us", d) for n, d in (("low", 1000), ("high", 2000)))
        if not 4 * 64 <= self.low < self.high <= HIGHEST:
            raise DermisError(
                "pulse widths out of range",
                where=self.title,
                value=f"{self.low / 4:g} to {self.high / 4:g} us",
                limit="64 to 4080 us, low below high",
            )
        self._sent, self._when = np.full(wire.count, -1), -1.0
        self._step = Step.ASK
        self._awaited, self._answer = 0, b""  # bytes of the answers to the last questions, and those that have come
        self._asked = self._heard = self._commanded = self._silent_since = 0.0
        self._due = -math.inf
        self._misses = 0
        self._asks = self._wants_arm = self._asked_to_arm = False

    def opened(self, now: float) -> None:
        """Begin; without `reads` the board is ready at once, because it never answers."""
        self.ready = not self.reads

    def poll(self, now: float) -> list[bytes]:
        """Return the questions of Connect, and those for errors and positions while the board is armed.

        A board that is not armed is asked nothing, so that its own time-out acts.
        """
        if self.armed and now - self._commanded > self.silence.after:
            # the sender itself was silent for too long, and ends the stream: awaited answers no longer count
            self._asks, self._awaited = False, 0
        if missing := self._awaited > 0 and now - self._asked > ANSWER:
            self._awaited = 0
        if not self.ready:
            return self._connect(now, missing)
        if missing:
            self._miss()
        if self._awaited or not self._asks or not (self.armed or self._wants_arm) or now < self._due:
            return []
        self._due, self._asked_to_arm = now + READ_EVERY, self._wants_arm
        return [self._ask(now, positions=True)]

    def receive(self, data: bytes, now: float) -> None:
        """Take answers; impossible ones are dropped and counted."""
        if not self._awaited:
            self.counters["answers out of turn"] += self.reads
            if self._step is Step.BE_SILENT:
                self._refuse(findings.TWO)
            return
        self._answer += data
        if len(self._answer) < self._awaited:
            return
        errors, *positions = np.frombuffer(self._answer[: self._awaited], "<u2").tolist()
        surplus, self._awaited = len(self._answer) > self._awaited, 0
        if surplus or errors >> len(findings.ERRORS) or max(positions, default=0) > HIGHEST:
            self._miss()
            if not self.ready:
                self._refuse(findings.TWO if surplus else findings.RUBBISH)
            return
        self._misses, self._heard, self.round_trip = 0, now, now - self._asked
        if self.ready:
            self._take(errors, positions, now)
        elif self._step is Step.ASK:
            self._silent_since, self._step = self._asked, Step.BE_SILENT
        elif self._step is Step.TRY_CRC:
            self._refuse(findings.other_crc(self.crc))
        elif self._step is Step.LOOK:
            self._judge(errors, positions, now)

    def arm(self) -> None:
        """Take commands at once; if `reads` is set, only after the board has answered with its positions."""
        self.armed = not self.reads
        self._wants_arm = self._asks = self.reads
        self._misses, self._due = 0, -math.inf

    def forget(self) -> None:
        """Send every position with the next command, changed or not.

        A full link delays answers, so the count of missing answers starts again at 0.
        """
        self._sent[:], self._misses = -1, 0

    def sign_of_life(self, values: Array, now: float) -> list[bytes]:
        """Return every target again."""
        self._when = -math.inf
        return self.command(values, now, None)

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return one Set Target for each channel that changed; all of them now and then."""
        targets, self._commanded = self._targets(values), now
        if now - self._when > REFRESH:
            changed, self._when = np.arange(len(targets)), now
        else:
            changed = np.flatnonzero(targets != self._sent)
        self._sent = targets
        message = b"".join(self._packet(target(self.first + int(i), int(targets[i]))) for i in changed)
        return [message] if message else []

    def carried(self, values: Array) -> Array:
        """Return the values that the board receives, in the channels' units.

        Each pulse is clipped to its limits and rounded to a quarter microsecond.
        """
        return self._values(self._targets(values))

    def safe(self) -> list[bytes]:
        """Return commands that end all pulses if the safe state is `release`.

        Otherwise none: the sender has already driven the servos to the safe pose.
        """
        super().safe()
        self._sent[:], self._wants_arm = -1, False
        if self.wire.reach == Reach.RELEASE or not self.silence.holds:
            self.pose = None  # from now on the board is not asked, and it may let go
        none = b"".join(self._packet(target(self.first + i, 0)) for i in range(self.wire.count))
        return [none] if self.wire.reach == Reach.RELEASE else []

    def _targets(self, values: Array) -> NDArray[np.int_]:
        part = (values - self.wire.range_low) / (self.wire.range_high - self.wire.range_low)
        return np.rint(self.low + (self.high - self.low) * np.clip(part, 0, 1)).astype(int)

    def _values(self, targets: NDArray[np.int_]) -> Array:
        part = (targets - self.low) / (self.high - self.low)
        return self.wire.range_low + (self.wire.range_high - self.wire.range_low) * part

    def _packet(self, command: bytes, *, other_crc: bool = False) -> bytes:
        return packet(command, self.device_number, crc=self.crc != other_crc)

    def _question(self, *, positions: bool, other_crc: bool = False) -> bytes:
        channels = range(self.first, self.first + self.wire.count if positions else self.first)
        asked = (bytes((GET_ERRORS,)), *(bytes((GET_POSITION, channel)) for channel in channels))
        return b"".join(self._packet(one, other_crc=other_crc) for one in asked)

    def _ask(self, now: float, *, positions: bool, other_crc: bool = False) -> bytes:
        self._awaited, self._answer, self._asked = 2 * (1 + positions * self.wire.count), b"", now
        return self._question(positions=positions, other_crc=other_crc)

    def _connect(self, now: float, missing: bool) -> list[bytes]:
        """Return the next question of Connect."""
        if self._step is Step.ASK and missing:
            self._step = Step.TRY_CRC
            return [self._ask(now, positions=False, other_crc=True)]
        if missing and self._step is not Step.DONE:
            self._refuse(findings.no_answer(self.device_number, self.crc))
        elif self._step is Step.ASK and not self._awaited:
            return [self._ask(now, positions=False)]
        elif self._step is Step.BE_SILENT and now - self._heard > min(self.silence.after + SLACK, LONGEST):
            self._step = Step.LOOK
            return [self._ask(now, positions=True)]
        return []

    def _judge(self, errors: int, positions: list[int], now: float) -> None:
        """Recognise or refuse the board by its answers after the silence."""
        if errors & findings.MISREAD:
            self._refuse(findings.misread(errors, self.crc))
            return
        safe = None if self.silence.does is not Does.RETRACTS else self._targets(self.wire.safe).tolist()
        whole = self.silence.after + SLACK <= LONGEST
        found = findings.timeout(self.silence, errors, now - self._silent_since, positions, safe, whole=whole)
        if found.fault:
            self._refuse(found.fault)
            return
        self.caution = found.caution
        self._step, self.ready = Step.DONE, True
        self._show(positions, now)

    def _take(self, errors: int, positions: list[int], now: float) -> None:
        """Take errors and positions of a board that is armed or shall be."""
        if self._wants_arm and self._asked_to_arm:
            # errors in this first answer are ignored: they come from the silence before arming
            self._wants_arm, self.armed = False, True
            self._commanded = now
        elif not self.armed:
            return
        elif errors:
            self.counters.update(f"board: {name}" for name in findings.names(errors))
            self.fault = self.fault or findings.went_home(errors)
        self._show(positions, now)

    def _show(self, positions: list[int], now: float) -> None:
        self.pose, self.pose_at = (self._values(np.array(positions)) if all(positions) else None), now

    def _miss(self) -> None:
        self._misses += 1
        self.counters["answers missing or damaged"] += 1
        if self.ready and self._misses >= MISSES:
            self._misses = 0
            self.fault = self.fault or findings.GONE

    def _refuse(self, why: str) -> None:
        self._step, self.fault = Step.DONE, self.fault or why
