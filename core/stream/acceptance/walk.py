"""The acceptance checks of a built device.

A check moves the device, measures its answers, or asks a person.
"""

from __future__ import annotations

import math
import random
import signal
from collections.abc import Callable, Iterator

import numpy as np

from ... import clock
from ...arrays import Array
from ..protocols.packets import FULL, DeviceState, Reach
from .bench import FLOODS, SAFE_MS, Bench
from .host import ATTEMPTS
from .mover import Mover, fastest_over
from .person import Person
from .player import play_and_end
from .report import Check, judged

STOP_MS = 20.0  # [ms] time within which a stop arrives at the board
ROUND_TRIP_MS = 20.0  # [ms] a link with a longer round trip cannot stop in time
RATE_SECONDS, RATE_LOSS = 5.0, 1e-3  # [s] duration of the check 'rate', and [1] largest part of lost commands
RATE_LATE = 0.002  # [s] this computer is on time if it delays a command by no more than this
RATE_AFTER = 0.05  # [s] after a longer delay it catches up for this time, in which commands are not judged
RATE_LEAST = 300  # number of commands on time: fewer give no reliable estimate of one loss in a thousand
SPEED_SECONDS = 2.0  # [s] the board's speed limit is lowered until the movement takes at least this long
SPEED_WINDOW = 0.5  # [s] a speed is a mean over this time: the 20 ms between two values of a servo are 4 % of it
SPEED_SLACK = 1.1  # [1] largest tolerated speed, as a multiple of the limit
TRIALS = 16  # largest number of silences; they bisect the watchdog's time to 8 ms
MOTORS = 8  # largest number of motors about which a person is asked one by one


class Walk:
    """All checks of one device.

    Args:
        bench: bench with the device. person: person at the bench. play: arguments of `stream play` for this device.
    """

    def __init__(self, bench: Bench, person: Person, play: list[str]) -> None:
        self.bench, self.person, self.play = bench, person, play
        wire = bench.wire
        self.mover = Mover(bench)
        self._home = "in its safe pose" if wire.spec.worn else "in its safe state (no force, no voltage)"
        self._manner = "at once" if wire.reach == Reach.AT_ONCE else "at an even speed"

    def checks(self) -> dict[str, Callable[[], Iterator[Check]]]:
        """Return every check by its name, in the order of execution."""
        return {
            "link": self.link,
            "first-arm": self.first_arm,
            "motors": self.motors,
            "speed": self.speed,
            "stop": self.stop,
            "silence": self.silence,
            "flood": self.flood,
            "rate": self.rate,
            "exits": self.exits,
            "unplug": self.unplug,
            "switch": self.switch,
        }

    def link(self) -> Iterator[Check]:
        """Measure the round trips of the link."""
        what = "a hundred questions and answers"
        if not self.bench.tells_pose:
            yield Check("link", what, "not tried", limit="this protocol has no answers")
            return
        if self.bench.hushed:
            yield Check("link", what, "not tried", limit="this protocol asks nothing while the board is not armed")
            return
        figure = ""

        def attempt() -> bool | None:
            nonlocal figure
            trips = self._round_trips()
            if not trips:
                figure = "no answer"
                return False
            median, most = (1e3 * float(np.percentile([trip for trip, _ in trips], part)) for part in (50, 95))
            board = 1e3 * float(np.percentile([trip - late for trip, late in trips], 95))
            figure = f"{median:.1f} ms, p95 {most:.1f} ms"
            return _within(most, board, ROUND_TRIP_MS)

        good, busy = self._fairly(attempt)
        outcome = judged(None, {"round trip": good is not False}, busy=good is None)
        yield Check("link", what, *outcome, f"{figure}{busy}", f"p95 {ROUND_TRIP_MS:g} ms")

    def _round_trips(self) -> list[tuple[float, float]]:
        """Return pairs of a round trip and this computer's own delay in it [s]."""
        adapter, host = self.bench.connection.adapter, self.bench.host
        trips: list[tuple[float, float]] = []
        last = adapter.round_trip

        def note() -> bool:
            nonlocal last
            if np.isfinite(adapter.round_trip) and adapter.round_trip != last:
                last = adapter.round_trip
                trips.append((last, min(host.lost(clock.now() - last), last)))
            return len(trips) >= 100

        self.bench.until(note, 5.0)
        return trips

    def first_arm(self) -> Iterator[Check]:
        """Check the first pulses, and the ramp to the safe pose."""
        connection, spec = self.bench.streamer.connection, self.bench.wire.spec
        if connection is not None:
            for said in filter(None, (connection.adapter.caution, connection.adapter.notice)):
                self.person.tell(said)
        if not spec.worn:
            self.person.tell("What cannot be seen, as a voltage, is measured at the output: have a meter there.")
        self.person.tell(f"Arming: it will be {self._home}. A board that knows no pose may jump there.")
        self.bench.arm()
        pose = self.mover.settle()
        yield from self._stuck(pose, self.bench.wire.safe)
        self.mover.ready()
        seen = self.person.ask(f"Is every motor or output {self._home}, and does it hold still?{self._without()}")
        yield Check(
            "first-arm", "armed; to the safe pose", *judged(seen, self.mover.measured(pose)), self.mover.text(pose)
        )

    def motors(self) -> Iterator[Check]:
        """Check that each channel moves its own motor, in the right direction."""
        wire = self.bench.wire
        shown = range(wire.count) if wire.count <= MOTORS else (0, wire.count // 2, wire.count - 1)
        for k in shown:
            if k in self.mover.stuck:
                continue  # its failure has been reported already
            self.mover.ready()
            self.person.tell(f"{wire.names[k]} moves there and back.")
            there, goal = self.mover.there_and_back(k), self.mover.alone(k)
            yield from self._stuck(there, goal)
            if k in self.mover.stuck:
                continue
            way = "up" if self.mover.away[k] > wire.safe[k] else "down"
            seen = self.person.ask(
                f"Did {wire.names[k]} move ({way}wards in its values), alone and smoothly, and back?"
            )
            measured = None if there is None else {"pose": not self.mover.off(there, goal)}
            yield Check(
                f"motor {wire.names[k]}", "moved by itself and back", *judged(seen, measured), self.mover.text(there)
            )
        if others := [k for k in range(wire.count) if k not in shown and k not in self.mover.stuck]:
            self.mover.ready()
            self.person.tell(f"All others move in their turn: {wire.names[others[0]]} to {wire.names[others[-1]]}.")
            bad = []
            for k in others:
                there, goal = self.mover.there_and_back(k), self.mover.alone(k)
                yield from self._stuck(there, goal)
                bad += [wire.names[k]] if self.mover.off(there, goal) else []
            seen = self.person.ask(f"Did each of them move in its turn, alone, and back?{self._without()}")
            measured = {"pose": not bad} if self.bench.tells_pose else None
            yield Check(
                "all other motors",
                f"{len(others)} moved in their turn",
                *judged(seen, measured),
                f"not where it was sent: {', '.join(bad[:8])}" if bad else "",
            )

    def _stuck(self, pose: Array | None, goal: Array) -> Iterator[Check]:
        """Report each channel that is off its goal because it does not move.

        A channel is reported once.
        """
        wire = self.bench.wire
        for k in self.mover.off(pose, goal):
            if not self.mover.follows(k):
                assert pose is not None
                figure = f"it stays at {pose[k]:.4g} {wire.units[k]}, whatever it is told"
                yield Check(f"motor {wire.names[k]}", "moved by itself and back", "failed", "measured", figure)

    def _without(self) -> str:
        """Return an addition to a question that excludes the stuck motors."""
        names = ", ".join(self.bench.wire.names[k] for k in sorted(self.mover.stuck))
        return f" (Leave out {names}: known not to move.)" if names else ""

    def speed(self) -> Iterator[Check]:
        """Check that the board itself limits the speed of a command far away."""
        wire, what = self.bench.wire, "one command far away, past this program's limiter"
        if not np.isfinite(wire.slew).any():
            yield Check("speed", what, "does not apply", limit="the preset declares no speed")
            return
        if not self.bench.answers:
            yield Check("speed", what, "not tried", limit="this protocol gives the board no speed limit")
            return
        declared = wire.slew_counts()
        way = np.abs(wire.counts(self.mover.away).astype(float) - wire.counts(wire.safe))
        told = np.minimum(np.maximum(np.floor(way / (1e3 * SPEED_SECONDS)), 1.0), declared)
        slew = told * 1e3 * (wire.range_high - wire.range_low) / FULL
        seconds = float((way / (1e3 * told)).max()) + 0.2
        figure, unit = "", ""
        k = 0

        def attempt() -> bool | None:
            nonlocal figure, unit, k
            with self.bench.slower(slew * (1.0 + 1e-9)):  # the slack makes rounding down give the same whole counts
                if self.bench.streamer.armed:
                    self.bench.stop()
                    self.bench.run(seconds)
                self.mover.ready()
            poses = list(self.bench.past_the_limiter(self.mover.away, seconds))
            self.bench.stop()
            self.bench.run(seconds)
            least, most = fastest_over(poses, SPEED_WINDOW)
            if not len(least):
                return None
            moving = np.array([j not in self.mover.stuck and way[j] > 0 for j in range(wire.count)])
            k = int(np.argmax(np.where(moving, most / slew, 0.0)))
            unit = f"{wire.units[k]}/s"
            figure = f"{wire.names[k]} {least[k]:.3g} to {most[k]:.3g} {unit}"
            if self.mover.off(poses[-1][2], self.mover.away):
                figure += ", and it did not arrive"
                return False
            slowest, quickest = (float((speed / slew)[moving].max()) for speed in (least, most))
            return _within(quickest, slowest, SPEED_SLACK)

        good, busy = self._fairly(attempt)
        limit = f"{SPEED_SLACK:g} times {slew[k]:.3g} {unit}, as it was told; {wire.slew[k]:.3g} declared"
        outcome = judged(None, {"speed": good is not False}, busy=good is None)
        yield Check("speed", what, *outcome, f"{figure}{busy}", limit)

    def stop(self) -> Iterator[Check]:
        """Check Stop from a pose away from the safe one."""
        figure = ""
        pose: Array | None = None

        def attempt() -> bool | None:
            nonlocal figure, pose
            self.mover.move_away()
            began = clock.now()
            self.bench.stop()
            told = self.bench.until(lambda: bool(self.bench.confirmed), 0.5)
            lost = self.bench.host.lost(began)
            pose = self.mover.settle()
            if self.bench.confirmed is None:
                return True
            if told is None:
                figure = "not confirmed by the board within 0.5 s"
                return self._blamed(began)
            figure = f"board safe after {1e3 * told:.0f} ms, its pose after {1e3 * (clock.now() - began):.0f} ms"
            return _within(1e3 * told, 1e3 * (told - lost), STOP_MS + ROUND_TRIP_MS)

        good, busy = self._fairly(attempt)
        asked = self.bench.confirmed is not None
        yield from self._stuck_at_home(pose)
        seen = self.person.ask(f"Did it go back by itself, {self._manner}, and is it {self._home}?{self._without()}")
        measured = self._at_home(pose) | ({"stopped": good is not False} if asked else {})
        yield Check(
            "stop",
            "Stop while moved away",
            *judged(seen, measured, busy=good is None),
            f"{figure}{busy}",
            f"{STOP_MS + ROUND_TRIP_MS:g} ms",
        )

    def _at_home(self, pose: Array | None) -> dict[str, bool]:
        """Return whether a pose [units] after a stop is the safe one, by name.

        The result is empty if the device does not hold its safe pose.
        """
        return self.mover.measured(pose) if self.bench.holds_safe else {}

    def _stuck_at_home(self, pose: Array | None) -> Iterator[Check]:
        """Report each channel that is off its safe pose because it does not move."""
        if self.bench.holds_safe:
            yield from self._stuck(pose, self.bench.wire.safe)

    def silence(self) -> Iterator[Check]:
        """Measure the time of the board's own watchdog.

        Bisection finds the shortest silence after which the board is in its safe state.
        """
        what = "nothing is sent while armed and moved away"
        if not self.bench.answers:
            self.mover.move_away()
            self.person.tell("This program is silent until you have answered.")
            with self.bench.silent():
                seen = self.person.ask(f"Is it {self._home}, or has it let go, since the blink of an eye?")
            if seen:
                self.bench.believe(self.bench.wire.safe)  # otherwise the next command brings it back at full speed
            elif seen is False:
                self.bench.hold()
            yield Check("silence", what, *judged(seen), limit=f"{SAFE_MS:g} ms")
            return
        low, high = 0.0, math.inf  # bounds of the silence after which the board is safe [ms]

        def attempt() -> bool | None:
            nonlocal low, high
            low, high, began = 0.0, math.inf, clock.now()
            for _ in range(TRIALS):
                self.mover.move_away()
                heard = self.bench.silence((0.5 * (low + high) if high < math.inf else SAFE_MS) / 1e3)
                if heard is None:
                    return self._blamed(began)
                if heard.state == DeviceState.SAFE:
                    high = min(high, 1e3 * heard.most)
                else:
                    low = max(low, 1e3 * heard.least)
                if low >= SAFE_MS:
                    return self._blamed(began)
                if high - low <= 8.0:
                    break
            return True if high <= SAFE_MS else None

        good, busy = self._fairly(attempt)
        seen = self.person.ask(
            f"Did it go back by itself, each time, {self._manner}, and is it {self._home}?{self._without()}"
        )
        low, high = min(low, high), max(low, high)  # the bounds can cross if the board checks its clock only at times
        figure = f"between {low:.0f} and {high:.0f} ms" if good is not False else f"not within {SAFE_MS:g} ms"
        outcome = judged(seen, {"safe": good is not False}, busy=good is None)
        yield Check("silence", what, *outcome, f"{figure}{busy}", f"{SAFE_MS:g} ms")

    def flood(self) -> Iterator[Check]:
        """Check that noise on the line does not keep the watchdog from acting."""
        what = f"{len(FLOODS)} kinds of rubbish for {SAFE_MS:g} ms each"
        if not self.bench.answers:  # the noise may be read as a position that damages the mechanism
            yield Check("flood", what, "not tried", limit="without a check sum a board takes rubbish for commands")
            return
        safe = {}
        self.person.tell(f"{len(FLOODS)} times: moved away, then rubbish on the line instead of commands.")
        busy, undecided = "", False
        for k, (name, pattern) in enumerate(FLOODS.items()):

            def attempt(k: int = k, pattern: Callable[[random.Random], bytes] = pattern) -> bool | None:
                self.mover.move_away()
                began = clock.now()
                heard = self.bench.silence(SAFE_MS / 1e3, pattern(random.Random(k)))
                self.mover.settle()
                return True if heard is not None and heard.state == DeviceState.SAFE else self._blamed(began)

            good, words = self._fairly(attempt)
            safe[name] = good is not False
            busy, undecided = words or busy, undecided or good is None
        seen = self.person.ask(
            f"Did it go back each time, {self._manner}, without a twitch, and is it {self._home}?{self._without()}"
        )
        bad = [name for name, good in safe.items() if not good]
        figure = f"not safe after {', '.join(bad)}" if bad else ""
        outcome = judged(seen, safe, busy=undecided)
        yield Check("flood", what, *outcome, f"{figure}{busy}", f"{SAFE_MS:g} ms")

    def rate(self) -> Iterator[Check]:
        """Check that the link and the board keep up with the command rate."""
        rate, figure = self.bench.connection.output.rate, ""
        self.person.tell(f"It moves slowly to and fro for {RATE_SECONDS:g} s.")

        def attempt() -> bool | None:
            nonlocal figure
            self.mover.ready()
            streamer, host = self.bench.streamer, self.bench.host
            began = clock.now()
            before, bad = dict(streamer.counters), self._at_device()
            # Commands while this computer was on time: sent ones, and those for which the link had no room.
            sent = full = 0
            # The target keeps moving, because a repeated command may need far fewer bytes.
            while (through := clock.now() - began) < RATE_SECONDS and streamer.armed:
                self.bench.head_for(self.mover.part(0.5 - 0.5 * np.cos(2 * np.pi * through / RATE_SECONDS)))
                left, dropped = streamer.counters["sent"], streamer.counters["dropped"]
                self.bench.run(0.01)
                if host.worst(clock.now() - RATE_AFTER) <= RATE_LATE:
                    sent += streamer.counters["sent"] - left
                    full += streamer.counters["dropped"] - dropped
            all_sent = streamer.counters["sent"] - before.get("sent", 0)
            bad = self._at_device() - bad
            figure = f"{all_sent} sent, {full} of {sent} that were on time found no room in the link"
            figure += f", {bad} lost, damaged or refused at the board" if self.bench.answers else ""
            if not streamer.armed:
                figure += f"; it did not stay armed: {streamer.message}"
                return self._blamed(began)
            if bad > RATE_LOSS * all_sent:
                return False
            if full > RATE_LOSS * max(sent, RATE_LEAST):
                return self._blamed(began)
            return True if sent >= min(RATE_LEAST, 0.5 * rate * RATE_SECONDS) else None

        good, busy = self._fairly(attempt)
        outcome = judged(None, {"rate": good is not False}, busy=good is None)
        yield Check("rate", f"{RATE_SECONDS:g} s at {rate:g} Hz", *outcome, f"{figure}{busy}", "1 in 1000")

    def exits(self) -> Iterator[Check]:
        """Check the safe state after every way in which a playing program can end."""
        ways = {"Ctrl-C": "SIGINT", "the terminal closed": "SIGHUP", "asked to end": "SIGTERM", "killed": "SIGKILL"}
        for name, number in ways.items():
            if not hasattr(signal, number):
                yield Check(f"exit, {name}", "the playing program ends", "not tried", limit="not on this system")
                continue
            self.person.tell(f"Another program plays a slow movement and is ended: {name}.")
            with self.bench.apart():
                said = play_and_end(self.bench, self.mover.away, self.play, getattr(signal, number), self.mover.seconds)
            seen = self.person.ask(
                f"Is it {self._home} now, or has it let go, if that is its safe state?{self._without()}"
            )
            self.bench.bring_home()
            pose = self.bench.pose()  # None from a board that was reset when its port was opened
            yield from self._stuck_at_home(pose)
            yield Check(
                f"exit, {name}",
                "the playing program ends",
                *judged(seen, {"played": not said} | self._at_home(pose)),
                said or self.mover.text(pose),
            )

    def unplug(self) -> Iterator[Check]:
        """Check the safe state after the cable is pulled while armed."""
        what = "the cable to the computer pulled while armed and moved away"
        if not self._moved_away_and("Pull the cable to the COMPUTER now (not the supply's), look, then press Enter."):
            yield Check("unplug", what, "not tried")
            return
        noticed = self.bench.until(lambda: not self.bench.streamer.armed, 1.0) is not None
        seen = self.person.ask(f"Is it {self._home}, or has it let go?")
        if self.person.wait("Plug it in again, wait until the board has started, then press Enter."):
            self.bench.connect()
        yield Check(
            "unplug", what, *judged(seen, {"noticed": noticed}), "" if noticed else "this program did not notice"
        )

    def switch(self) -> Iterator[Check]:
        """Check the switch in the actuators' supply."""
        what = "the actuators' supply switched off while armed and moved away"
        if not self._moved_away_and("Switch the actuators' SUPPLY off now, as you would in need, then press Enter."):
            yield Check("switch", what, "not tried")
            return
        seen = self.person.ask("Did the force go at once, and can the mechanism be moved away by hand?")
        self.bench.stop()
        self.mover.settle()
        self.person.wait("Switch the supply on again, then press Enter.")
        yield Check("switch", what, *judged(seen))

    def _moved_away_and(self, request: str) -> bool:
        """Move away from the safe pose and ask the person to act; False: skipped."""
        self.mover.move_away()
        return self.person.wait(request)

    def _fairly(self, attempt: Callable[[], bool | None]) -> tuple[bool | None, str]:
        """Repeat an attempt until its result does not depend on this computer.

        Args:
            attempt: returns whether the check holds; None if this computer's own delays may be the cause of a failure.

        Returns: whether the check holds, and ''; or None if this computer was busy each time, and a note about that.
        """
        for _ in range(ATTEMPTS):
            since = clock.now()
            good = attempt()
            if good is not None:
                return good, ""
        return None, f"; {self.bench.host.words(since)}"

    def _blamed(self, since: float) -> bool | None:
        """Return False for a failure of the board.

        None: this computer stood still since the time `since` [s], so it may be the cause.
        """
        return None if self.bench.host.disturbed(since) else False

    def _at_device(self) -> int:
        """Return the board's count of lost, damaged and refused packets."""
        connection = self.bench.streamer.connection
        counters = connection.adapter.counters if connection is not None else {}
        lost = sum(int(counters.get(f"{name} at the device", 0)) for name in ("lost", "damaged"))
        return lost + (connection.adapter.refused if connection is not None else 0)


def _within(measured: float, board: float, limit: float) -> bool | None:
    """Return whether a measured figure is within its limit.

    False: the board's own part of it exceeds the limit. None: it exceeds the limit, but the board's part does not.
    """
    return True if measured <= limit else False if board > limit else None
