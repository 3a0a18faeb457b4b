"""The phases of one connected device, from arming to its safe state.

While the link works, the end of a stream brings the device to its safe state first, at the device's own speed. The
messages that still wait in the link then get some time to leave. Only after that is the link closed. After a stop, a
stall or a fault no samples are sent until a person arms again.

The sender watches its own silence. If nothing has left for longer than the board's declared silence, for example
because the computer was suspended, the board may have moved by itself. The stream then ends. The way to the safe state
begins at the pose that the board's declaration names. If it names none, nothing is sent, except to a device that has an
order for its safe state or is safe at once.
"""

from __future__ import annotations

import math
from collections import Counter
from enum import Enum

from ..arrays import Array
from ..devices.calibration import Calibration
from .connection import Connection
from .drain import Drain
from .links.transport import Gone
from .log.row import Phase as Logged
from .outbox import SendResult
from .protocols.packets import Reach
from .protocols.silence import Does
from .protocols.wire import SAFE_SWEEP
from .request import StreamRequest
from .safe_ramp import STUBBORN, SafeRamp
from .state import State
from .touch_panel_source import PanelSource
from .track_source import TrackSource

ARMING = 1.0  # [s] A device that has not armed within this time is given up.
SWITCH_OFF = "Switch its supply off"
APART = 0.05  # [s] between repeats of a safe state: a disturbed line or network loses messages that leave together
REPEAT = 3  # [1] how often the safe state is written at the end of a ramp: most devices on a ramp do not confirm it


class Phase(Enum):
    """The current task with the device."""

    IDLE = "nothing"
    ARMING = "it was asked to arm"
    LIVE = "it gets samples"
    SAFING = "it is led to its safe state"
    DRAINING = "the last messages leave, and the link is closed"


class Drive:
    """Drives one device over one connection, a tick at a time.

    Attributes:
        request: Blender's latest request. phase: the current task. message: the last error, or the awaited event.
        leaving: the link is to be closed, after the way to the safe state. drained: the link can be closed now.
        driven: this link has sent the device a command, so the device should be at the limiter's last values; False
            again once its pose is no longer known.
    """

    def __init__(self, connection: Connection, request: StreamRequest, counters: Counter[str], message: str) -> None:
        self.connection, self.output = connection, connection.output
        self.request, self.message = request, message
        self.phase = Phase.IDLE
        self.leaving = self.drained = self.driven = False
        self._counters = counters
        self._since = 0.0  # when arming began [s]
        self._told_at = 0.0  # when messages that order the safe state were written last [s]
        self._stalled = False
        self._ramp: SafeRamp | None = None
        self._unsaid: list[bytes] = []  # messages that order the safe state; the link had no room for them yet
        self._drain: Drain | None = None

    # -- requests

    def arm(self, now: float, *, alive: bool) -> None:
        """Begin to arm, or let the message say why not.

        Args:
            alive: Blender gives signs of life, or the stream does not need them.
        """
        adapter = self.connection.adapter
        if not adapter.ready or self.leaving:
            self.message = "not connected, so nothing was armed"
        elif self.phase is Phase.LIVE:
            pass  # It is armed already. To arm it again could begin at an old reported pose, and lead it back there.
        elif self.phase is Phase.SAFING:
            self.message = "not armed before the safe state is reached; arm again then"
        elif self.output.source is None:
            pass  # the message says already why there is no source
        elif not alive:
            self.message = "Blender gives no sign of life, so nothing was armed"
        else:
            self.phase, self._since, self._stalled, self.message = Phase.ARMING, now, False, ""
            adapter.arm()

    def stop(self, now: float, message: str) -> None:
        """Go to the safe state.

        A device whose protocol has an order for the safe state gets the order even if it is not armed.
        """
        adapter = self.connection.adapter
        if self.armed:
            self.give_up(now, message)
        elif self.phase is Phase.IDLE and adapter.ready and (messages := adapter.retract()) is not None:
            self.connection.outbox.send(messages, now)
            self._told_at = now

    def give_up(self, now: float, message: str) -> None:
        """Set the message, and go to the safe state if the device is armed."""
        self.message = message
        if self.armed:
            self._to_safe(now)

    def leave(self, now: float, message: str) -> None:
        """Begin to end the link: go to the safe state, then drain the link.

        `drained` then says that the link can be closed.
        """
        self.leaving = True
        self.give_up(now, message)
        if self.phase is Phase.IDLE:
            self._begin_draining(now)

    def recalibrate(self, calibration: Calibration | None) -> None:
        """Take another calibration.

        A device that gets samples blends over to the new values.

        Raises:
            DermisError: the calibration does not fit the device or the track that plays.
        """
        moved, adapter = self.output.recalibrate(calibration), self.connection.adapter
        adapter.wire = self.output.wire  # the safe pose may have changed
        self.blend()
        if moved and self.armed and adapter.silence.watched:
            self.message = "Until you stop and arm again, the device's own safe pose is that of the calibration before"

    def blend(self) -> None:
        """Blend over to changed values; has no effect unless samples are sent."""
        if self.phase is Phase.LIVE:
            self.output.blend()

    # -- time passes

    def poll(self, now: float) -> bool:
        """Exchange the protocol's own messages; return whether to call `tick`.

        True once the device is recognised. While the link is being ended: True until it drains, False from then on.

        Raises:
            DermisError: the device cannot be used, or has not answered.
            Gone: the link is closed.
        """
        self.connection.receive(now)
        if self._drain is not None:
            self._note_fault()
            self.drained = self._drain.done(now)
            self.message = "; ".join(filter(None, (self.message, self._drain.message)))
            return False
        if not self.leaving:
            return self.connection.poll(now)
        self._note_fault()
        self.connection.outbox.poll(now)
        return True

    def _note_fault(self) -> None:
        """Count a new fault, and add it to the message.

        The way to the safe state goes on as far as the link carries it.
        """
        fault = self.connection.take_fault()
        if fault and fault not in self.message:
            self._counters["faults"] += 1
            self.message = "; ".join(filter(None, (self.message.rstrip("."), fault)))

    def tick(self, now: float, *, alive: bool) -> None:
        """Do the due work.

        Args:
            alive: Blender gives signs of life, or the stream does not need them.

        Raises:
            Gone: the link is closed, has stood still for too long, or the device does not confirm its safe state.
        """
        if self.phase is Phase.ARMING:
            self._await_armed(now)
        if self.phase in (Phase.LIVE, Phase.SAFING) and self.connection.outbox.was_silent(now):
            self._stalled |= self.phase is Phase.LIVE
            self._after_silence(now)
        if self.phase is Phase.LIVE:
            self._live(now, alive)
        if self.phase is Phase.SAFING:
            self._safing(now)
        if self.phase is Phase.LIVE:
            self._stay_alive(now)
        if self.phase is Phase.IDLE and not self.connection.adapter.settled and now - self._told_at > STUBBORN:
            self._counters["safe states not confirmed"] += 1
            raise Gone(  # Gone closes the link. Nothing is sent from now on, so that the device's watchdog can act.
                "the device does not confirm its safe state", where=self.connection.link.name, remedy=SWITCH_OFF
            )

    def next(self, now: float) -> float:
        """Return when `tick` is due next [s].

        That is within 4 ms, so that a stop comes soon however slow the device is.
        """
        if self.phase is not Phase.LIVE:
            return now + 0.002
        wait = 0.001 if self.connection.outbox.blocked else 0.004
        return min(max(self.output.sample_clock.next - self.horizon, now), now + wait)

    # -- how it stands

    @property
    def state(self) -> State:
        """The state of the link, for people."""
        if self.phase in (Phase.SAFING, Phase.DRAINING):
            return State.STALLED if self._stalled else State.STOPPING
        if not self.connection.adapter.ready:
            return State.CONNECTING
        if self.armed:
            return State.STREAMING if self.phase is Phase.LIVE and self.output.moving else State.ARMED
        return State.STALLED if self._stalled else State.READY

    @property
    def armed(self) -> bool:
        """Whether the device is arming or gets samples, so that it may move.

        False on the way to the safe state, although the device may move then, too.
        """
        return self.phase in (Phase.ARMING, Phase.LIVE)

    @property
    def pose_known(self) -> bool:
        """Whether the device's pose is known.

        It is known if the device reports it. It is also known if this link drove the device and one of two conditions
        holds. Either the device is arming or gets samples. Or its pose in silence is known: the board declares one, its
        protocol never reports poses, and its safe state does not release the actuators.
        """
        adapter = self.connection.adapter
        held = adapter.silence.holds and not adapter.tells_pose and self.output.wire.reach != Reach.RELEASE
        return adapter.pose is not None or (self.driven and (self.armed or held))

    @property
    def astray(self) -> bool:
        """Whether a link lost now may leave the device out of its safe state."""
        watched = self.connection.adapter.silence.watched  # the board itself ends the movement if samples stop
        open_ways = (Phase.SAFING, Phase.DRAINING) if watched else (Phase.SAFING, Phase.DRAINING, Phase.LIVE)
        return self.driven and self.phase in open_ways

    @property
    def going(self) -> str:
        """The remaining step to safety or to a closed link, for people.

        It is '' if there is none.
        """
        if self._ramp is not None:
            return f"going to the safe state, {self._ramp.seconds:.1f} s"
        return "making sure of the safe state" if self.phase is Phase.DRAINING else ""

    @property
    def horizon(self) -> float:
        """How far ahead of their time samples are sent now [s].

        It is 0 unless a track plays on a device that takes play-out times. It is at most the request's look-ahead,
        and at most the time that the device's queue holds, less two commands.
        While nothing moves, no future values are needed. Samples sent ahead before a pause play out first.
        """
        adapter = self.connection.adapter
        if not (adapter.timed and isinstance(self.output.source, TrackSource) and self.output.moving):
            return 0.0
        held = max(adapter.queue - 2, 0) / self.output.rate if adapter.queue else self.request.look_ahead
        return min(self.request.look_ahead, held)

    # -- arming and streaming

    def _await_armed(self, now: float) -> None:
        adapter, output = self.connection.adapter, self.output
        if now - self._since > ARMING:
            late = f"the device did not arm within {ARMING:g} s"
            self.give_up(now, ". ".join(filter(None, (late, adapter.unarmed))))
            return
        if not adapter.armed:
            return
        pose = adapter.pose
        if pose is None:  # The last command, if this link drove a device that never reports poses. Else the safe pose.
            pose = output.limiter.last if self.driven and not adapter.tells_pose else output.wire.safe
        output.begin(pose, now, self.horizon, self.request.ramp)
        self.phase = Phase.LIVE
        self.connection.outbox.begin(now)

    def _live(self, now: float, alive: bool) -> None:
        """Send the samples that are due, after the one that still waits."""
        adapter, output, outbox = self.connection.adapter, self.output, self.connection.outbox
        source, clock = output.source, output.sample_clock
        assert source is not None
        if not adapter.armed:
            self.give_up(now, "the device disarmed itself")
            return
        if not alive:
            self._stalled = True
            self._counters["stalls"] += 1
            self.give_up(now, f"Blender gave no sign of life for {self.request.stall:g} s; arm again")
            return
        if isinstance(source, PanelSource):
            source.touched(adapter.touch, now)
        horizon = self.horizon
        if outbox.unsent is not None:
            if not self._send(*outbox.unsent, now):
                return
            clock.sent(now, horizon)
        for moment in clock.due(now, horizon):
            output.wanted = source.values_at(moment if horizon else now + self.request.look_ahead, now)
            if not self._send(output.limiter.step(output.wanted, moment), moment if horizon else None, now):
                break
        self._counters["skipped"] = clock.skipped
        if isinstance(source, PanelSource):
            self._counters["touches grown old"] = source.aged

    def _send(self, values: Array, play: float | None, now: float) -> bool:
        """Send one command; return whether another may follow.

        False means that this command still waits to be sent.
        """
        result = self.connection.outbox.command(values, play, now, 2 * self.output.sample_clock.period)
        if result is not SendResult.UNSENT:
            self.connection.note(now, play, result is SendResult.SENT, Logged.LIVE)
        if result is SendResult.DROPPED:
            self.output.limiter.undo()  # takes back this command's step: the limiter has made none after it
        self.driven |= result is SendResult.SENT
        return result is not SendResult.UNSENT

    # -- the safe state

    def _to_safe(self, now: float) -> None:
        """Begin the way to the safe state.

        A device whose protocol has an order for the safe state gets the order. A device that was still arming gets only
        the protocol's last messages. Any other device is led there by a ramp; if the sender was silent,
        `_after_silence` decides.
        """
        adapter = self.connection.adapter
        live, self.phase = self.phase is Phase.LIVE, Phase.SAFING
        self._drop_unsent(now)
        retracting = adapter.retract()
        if retracting is not None or not live:
            self._send_safe(adapter.safe() if retracting is None else retracting, now)
        elif self.connection.outbox.was_silent(now):
            self.phase = Phase.LIVE
            self._after_silence(now)
        else:
            self._begin_ramp(now)

    def _send_safe(self, messages: list[bytes], now: float) -> None:
        """Send the messages that order the safe state.

        If the link has no room for all of them, later ticks send them again. After `STUBBORN` seconds of that the way
        to the safe state is given up.
        """
        output, adapter = self.output, self.connection.adapter
        left = self.connection.outbox.send(messages, now)
        self._told_at = now
        output.wanted = output.wire.safe_command
        self.connection.note(now, None, left, Logged.SAFE)
        if left or not adapter.settled:  # an adapter that waits for an answer repeats the messages by itself
            output.limiter.last = output.wire.safe.copy()
            self._unsaid = []
            self._finish_safing(now)
        elif not self._unsaid:
            self._unsaid, self._since = messages, now
        elif now - self._since > STUBBORN:
            self._unsaid = []
            self._give_up_safing(now)

    def _give_up_safing(self, now: float) -> None:
        """Give up the way to the safe state, because the device takes nothing."""
        self.driven = False
        self._counters["safe states not confirmed"] += 1
        self.message = "The device takes nothing, so its safe state could not be sent. Switch its supply off"
        self._finish_safing(now)

    def _drop_unsent(self, now: float) -> None:
        """Forget the sample that waits to be sent, and log it as not sent."""
        outbox = self.connection.outbox
        if outbox.unsent is not None:
            self.connection.note(now, outbox.unsent[1], False, Logged.LIVE)
        outbox.unsent = None

    def _begin_ramp(self, now: float, wait: float = 0.0) -> None:
        """Begin a ramp to the safe state, after a wait [s].

        The ramp starts at the limiter's last values.
        """
        self.phase = Phase.SAFING
        self.connection.outbox.begin(now)
        self.output.wanted = self.output.wire.safe_command
        self._ramp = SafeRamp(self.output.limiter, self.connection.ramp_period, now + wait)
        self._safing(now)

    # -- the sender's own silence

    def _stay_alive(self, now: float) -> None:
        """Send a sign of life if nothing has left for 1 / `least_rate`.

        Otherwise the board would count the sender as silent soon after.
        """
        adapter, outbox = self.connection.adapter, self.connection.outbox
        if (now - outbox.left_at) * adapter.least_rate > 1.0 and not adapter.busy:
            messages = adapter.sign_of_life(self.output.limiter.last, now)
            outbox.send(messages, now, moves=True, count=False)

    def _after_silence(self, now: float) -> None:
        """End the stream after the sender was silent, and go to the safe state.

        A way to the safe state goes on if the device stays at its last command in silence or is safe at once, if the
        order to go there still waits for room, or if the ramp has reached its end. In all other cases:

        - A device whose protocol has an order for the safe state gets the order.
        - A device that stops, or keeps its last command, is led there from its last command. A device that is safe at
          once gets its safe values.
        - A device that retracts in silence is taken to be at its safe pose. It gets no command before its own way there
          must be over.
        - The pose of any other device is not known, so nothing is sent to it.

        Raises:
            Gone: the link has stood still for so long that the commands in it are old.
        """
        adapter, output, outbox = self.connection.adapter, self.output, self.connection.outbox
        silence, safing = adapter.silence, self.phase is Phase.SAFING
        at_last_command = silence.does in (Does.STOPS, Does.KEEPS) or output.wire.reach == Reach.AT_ONCE
        if waiting := outbox.stale(now):  # old commands, which the device would play in a burst
            raise Gone(f"the link stands still with {waiting} bytes in it", where=self.connection.link.name)
        if safing and (at_last_command or self._unsaid or (self._ramp is not None and self._ramp.there)):
            outbox.begin(now)  # the way to the safe state goes on from where it was, or has reached its end
            return
        quiet = f"no command has left for {outbox.silence:.2g} s, and the board's limit is {silence.after:.2g} s"
        quiet += ", because this computer was busy or asleep, or the link took nothing"
        self.message = "; ".join(filter(None, (self.message.rstrip(".") if safing else "", f"{quiet}: arm again")))
        self._counters["silences"] += 1
        self._drop_unsent(now)
        retracting = adapter.retract()
        if retracting is not None:
            self._send_safe(retracting, now)
        elif at_last_command:
            self._begin_ramp(now)
        elif silence.does is Does.RETRACTS:
            output.limiter.last = output.wire.safe.copy()
            # The sender stays silent until the board's own way must be over.
            # Its first command is the safe pose: a board still on its way would jump there.
            way = output.wire.safe_seconds
            own_way = silence.after + (way if math.isfinite(way) else SAFE_SWEEP)
            self._begin_ramp(now, max(own_way - outbox.silence, 0.0))
        else:
            adapter.safe()  # called only to end arming: the messages that it returns are commands, and are not sent
            adapter.forget()
            self.driven = False
            self._counters["safe states not confirmed"] += silence.does is Does.UNKNOWN
            self.message += f". Nothing is sent, because {silence}, so its pose is not known. Switch its supply off"
            self._finish_safing(now)

    def _safing(self, now: float) -> None:
        """Do the due work on the way to the safe state.

        Messages that found no room are sent again. Otherwise the ramp's next step is sent. At the end of the ramp the
        safe state is written `REPEAT` times, `APART` seconds or more from each other.
        """
        adapter, ramp, send = self.connection.adapter, self._ramp, self.connection.outbox.send
        if self._unsaid:
            self._send_safe(self._unsaid, now)
            return
        assert ramp is not None
        if ramp.waits(now):
            return
        if adapter.busy:  # the line is not free for a command
            if ramp.stuck(now):
                self._give_up_safing(now)
            return
        if ramp.due(now) and not ramp.said:  # The safe state may release actuators. A step after it would power them.
            left = send(adapter.command(ramp.step(now), now, None), now, moves=True)
            self.connection.note(now, None, left, Logged.RAMP)
            if left:
                ramp.sent(now)
            else:
                adapter.forget()
                ramp.undo()
        if ramp.there and ramp.said < REPEAT and now >= ramp.say_at:
            adapter.forget()  # so that the safe state is written in full
            if send(adapter.safe() or adapter.command(self.output.wire.safe, now, None), now, moves=True):
                self.connection.note(now, None, True, Logged.SAFE)
                ramp.said, ramp.say_at, self._told_at = ramp.said + 1, now + APART, now
        if ramp.said == REPEAT:
            self._finish_safing(now)
        elif ramp.stuck(now):
            self._give_up_safing(now)

    def _finish_safing(self, now: float) -> None:
        self.phase, self._ramp = Phase.IDLE, None
        if self.leaving:
            self._begin_draining(now)

    def _begin_draining(self, now: float) -> None:
        connection, self.phase = self.connection, Phase.DRAINING
        self._drain = Drain(connection.link, connection.adapter, connection.outbox, self._counters, now)
