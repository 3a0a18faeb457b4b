"""The checks of a built device, one after the other: what is done, what the person is asked, what is measured."""

from __future__ import annotations

import random
import signal
from collections.abc import Callable, Iterator

import numpy as np

from ... import clock
from ..protocols.packets import DeviceState, Reach
from .bench import FLOODS, SAFE_MS, Bench
from .mover import Mover, fastest_over
from .person import Person
from .player import play_and_end
from .report import Check, judged

STOP_MS = 20.0  # by then a stop has arrived at the board [ms]
ROUND_TRIP_MS = 20.0  # a link slower than this cannot stop in time [ms]
RATE_SECONDS, RATE_LOSS = 5.0, 1e-3
SPEED_WINDOW = 0.01  # a speed is taken over at least this long [s] ...
SPEED_SLACK = 1.5  # ... and may seem this much faster, since a pose's age is known to a few milliseconds only
MOTORS = 8  # that a person is asked about one by one


class Walk:
    """All checks of one device.

    Args:
        bench: that the device is connected to. person: at the bench. play: arguments of `stream play` for this device.
    """

    def __init__(self, bench: Bench, person: Person, play: list[str]) -> None:
        self.bench, self.person, self.play = bench, person, play
        wire = bench.wire
        self.mover = Mover(bench)
        self._home = "in its retracted pose" if wire.spec.worn else "in its safe state (no force, no voltage)"
        self._manner = "at once" if wire.reach == Reach.AT_ONCE else "at an even speed"

    def checks(self) -> dict[str, Callable[[], Iterator[Check]]]:
        """Return every check by its name, in the order in which they are tried."""
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
        """How soon the board answers."""
        native = self.bench.native
        what = "a hundred questions and answers"
        if native is None:
            yield Check("link", what, "not tried", limit="this protocol has no answers")
            return
        trips: list[float] = []

        def note() -> bool:
            if np.isfinite(native.round_trip) and (not trips or native.round_trip != trips[-1]):
                trips.append(native.round_trip)
            return len(trips) >= 100

        self.bench.until(note, 5.0)
        if not trips:
            yield Check("link", what, "failed", "measured", "no answer")
            return
        median, most = 1e3 * float(np.median(trips)), 1e3 * float(np.percentile(trips, 95))
        yield Check(
            "link",
            what,
            *judged(None, {"round trip": most <= ROUND_TRIP_MS}),
            f"{median:.1f} ms, p95 {most:.1f} ms",
            f"p95 {ROUND_TRIP_MS:g} ms",
        )

    def first_arm(self) -> Iterator[Check]:
        """The first pulses, and the ramp to the retracted pose."""
        connection, spec = self.bench.streamer.connection, self.bench.wire.spec
        if connection is not None:
            for said in filter(None, (connection.adapter.caution, connection.adapter.notice)):
                self.person.tell(said)
        if not spec.worn:
            self.person.tell("What cannot be seen, as a voltage, is measured at the output: have a meter there.")
        self.person.tell(f"Arming: it will be {self._home}. A board that knows no pose may jump there.")
        self.bench.arm()
        seen = self.person.ask(f"Is every motor or output {self._home}, and does it hold still?")
        pose = self.bench.pose()
        yield Check(
            "first-arm", "armed; to the retracted pose", *judged(seen, self.mover.measured(pose)), self.mover.text(pose)
        )

    def motors(self) -> Iterator[Check]:
        """Whether each channel moves its own motor, and the right way."""
        wire = self.bench.wire
        shown = range(wire.count) if wire.count <= MOTORS else (0, wire.count // 2, wire.count - 1)
        for k in shown:
            self.mover.ready()
            self.person.tell(f"{wire.names[k]} moves there and back.")
            at, there = self.mover.there_and_back(k)
            way = "up" if self.mover.away[k] > wire.safe[k] else "down"
            seen = self.person.ask(
                f"Did {wire.names[k]} move ({way}wards in its values), alone and smoothly, and back?"
            )
            yield Check(
                f"motor {wire.names[k]}",
                "moved by itself and back",
                *judged(seen, None if at is None else {"pose": at}),
                self.mover.text(there),
            )
        if others := [k for k in range(wire.count) if k not in shown]:
            self.mover.ready()
            self.person.tell(f"All others move in their turn: {wire.names[others[0]]} to {wire.names[others[-1]]}.")
            poses = {wire.names[k]: self.mover.there_and_back(k)[0] for k in others}
            seen = self.person.ask("Did each of them move in its turn, alone, and back?")
            measured = {name: at for name, at in poses.items() if at is not None}
            bad = [name for name, at in measured.items() if not at]
            yield Check(
                "all other motors",
                f"{len(others)} moved in their turn",
                *judged(seen, measured),
                f"not where it was sent: {', '.join(bad[:8])}" if bad else "",
            )

    def speed(self) -> Iterator[Check]:
        """Whether the board itself limits the speed, whatever it is told."""
        wire, what = self.bench.wire, "one command far away, past this program's limiter"
        if not np.isfinite(wire.slew).any():
            yield Check("speed", what, "does not apply", limit="the preset declares no speed")
            return
        if not self.bench.answers:
            yield Check("speed", what, "not tried", limit="this board does not report a pose")
            return
        self.mover.ready()
        poses = list(self.bench.past_the_limiter(self.mover.away, self.mover.seconds + 0.1))
        fastest = fastest_over(poses, SPEED_WINDOW) if poses else np.zeros(wire.count)
        slew = np.where(np.isfinite(wire.slew), wire.slew, np.inf)
        allowed = slew * SPEED_SLACK
        measured = {"speed": bool((fastest <= allowed).all()), "moved": bool(fastest.max() > 0)}
        k = int(np.argmax(fastest / slew))
        self.bench.stop()
        self.bench.run(self.mover.seconds + 0.3)
        unit = f"{wire.units[k]}/s"
        limit = f"{slew[k]:.3g} {unit} declared, {SPEED_SLACK:g} times that for the poses' age"
        yield Check("speed", what, *judged(None, measured), f"{wire.names[k]} {fastest[k]:.3g} {unit}", limit)

    def stop(self) -> Iterator[Check]:
        """Stop, from a pose away from the safe one."""
        self.mover.move_away()
        native = self.bench.native
        began = clock.now()
        self.bench.stop()
        told = self.bench.until(lambda: native is not None and native.state == DeviceState.SAFE, 0.5)
        pose = self.mover.settle()
        reached = clock.now() - began
        seen = self.person.ask(f"Did it go back by itself, {self._manner}, and is it {self._home}?")
        soon = {"stopped": told is not None and 1e3 * told <= STOP_MS + ROUND_TRIP_MS} if native is not None else {}
        figure = "" if told is None else f"board safe after {1e3 * told:.0f} ms, its pose after {1e3 * reached:.0f} ms"
        yield Check(
            "stop",
            "Stop while moved away",
            *judged(seen, soon | self.mover.measured(pose)),
            figure,
            f"{STOP_MS + ROUND_TRIP_MS:g} ms",
        )

    def silence(self) -> Iterator[Check]:
        """When the board's own watchdog acts: the shortest silence after which it is safe, found by halving."""
        what = "nothing is sent while armed and moved away"
        if not self.bench.answers:
            self.mover.move_away()
            self.person.tell("This program is silent until you have answered.")
            with self.bench.silent():
                seen = self.person.ask(f"Is it {self._home}, or has it let go, since the blink of an eye?")
            if seen:
                self.bench.believe(self.bench.wire.safe)  # or the next command would bring it back at full speed
            yield Check("silence", what, *judged(seen), limit=f"{SAFE_MS:g} ms")
            return
        low, high = 0.0, SAFE_MS  # still armed after low, safe after high [ms]
        self.mover.move_away()
        first = self.bench.silence(high / 1e3)
        if first == DeviceState.SAFE:
            while high - low > 8.0:
                self.mover.move_away()
                middle = 0.5 * (low + high)
                if self.bench.silence(middle / 1e3) == DeviceState.SAFE:
                    high = middle
                else:
                    low = middle
        seen = self.person.ask(f"Did it go back by itself, each time, {self._manner}, and is it {self._home}?")
        figure = f"between {low:.0f} and {high:.0f} ms" if first == DeviceState.SAFE else f"not within {SAFE_MS:g} ms"
        yield Check("silence", what, *judged(seen, {"safe": first == DeviceState.SAFE}), figure, f"{SAFE_MS:g} ms")

    def flood(self) -> Iterator[Check]:
        """Whether rubbish on the line keeps the watchdog from acting."""
        what = f"{len(FLOODS)} kinds of rubbish for {SAFE_MS:g} ms each"
        if not self.bench.answers:  # it may be a position far beyond what the mechanism can bear
            yield Check("flood", what, "not tried", limit="without a check sum a board takes rubbish for commands")
            return
        safe = {}
        self.person.tell(f"{len(FLOODS)} times: moved away, then rubbish on the line instead of commands.")
        for k, (name, pattern) in enumerate(FLOODS.items()):
            self.mover.move_away()
            state = self.bench.silence(SAFE_MS / 1e3, pattern(random.Random(k)))
            safe[name] = state == DeviceState.SAFE
            self.mover.settle()
        seen = self.person.ask(f"Did it go back each time, {self._manner}, without a twitch, and is it {self._home}?")
        bad = [name for name, good in safe.items() if not good]
        yield Check(
            "flood", what, *judged(seen, safe), f"not safe after {', '.join(bad)}" if bad else "", f"{SAFE_MS:g} ms"
        )

    def rate(self) -> Iterator[Check]:
        """Whether the link and the board take commands as fast as they come."""
        self.mover.ready()
        streamer, native, rate = self.bench.streamer, self.bench.native, self.bench.connection.output.rate
        before, damaged = dict(streamer.counters), self._at_device()
        self.person.tell(f"It moves slowly to and fro for {RATE_SECONDS:g} s.")
        began = clock.now()  # a board that is told the same again and again is told next to nothing
        while (through := clock.now() - began) < RATE_SECONDS and streamer.armed:
            self.bench.head_for(self.mover.part(0.5 - 0.5 * np.cos(2 * np.pi * through / RATE_SECONDS)))
            self.bench.run(0.01)
        stayed = streamer.armed
        sent, full, slept = (streamer.counters[n] - before.get(n, 0) for n in ("sent", "dropped", "skipped"))
        bad = self._at_device() - damaged
        figure = f"{sent} sent, {full} that the link had no room for"
        figure += f", {bad} lost or damaged at the board" if native else ""
        figure += "" if stayed else f"; it did not stay armed: {streamer.message}"
        figure += f"; {slept} left out by this computer, which is not judged" if slept else ""
        yield Check(
            "rate",
            f"{RATE_SECONDS:g} s at {rate:g} Hz",
            *judged(None, {"rate": stayed and sent > 0 and full + bad <= RATE_LOSS * sent}),
            figure,
            "1 in 1000",
        )

    def exits(self) -> Iterator[Check]:
        """Every way in which the program that plays may end."""
        ways = {"Ctrl-C": "SIGINT", "the terminal closed": "SIGHUP", "asked to end": "SIGTERM", "killed": "SIGKILL"}
        for name, number in ways.items():
            if not hasattr(signal, number):
                yield Check(f"exit, {name}", "the playing program ends", "not tried", limit="not on this system")
                continue
            self.person.tell(f"Another program plays a slow movement and is ended: {name}.")
            with self.bench.apart():
                said = play_and_end(self.bench, self.mover.away, self.play, getattr(signal, number), self.mover.seconds)
            seen = self.person.ask(f"Is it {self._home} now, or has it let go, if that is its safe state?")
            self.bench.bring_home()
            pose = self.bench.pose()  # a board that is reset when its port is opened has forgotten it
            yield Check(
                f"exit, {name}",
                "the playing program ends",
                *judged(seen, {"played": not said} | self.mover.measured(pose)),
                said or self.mover.text(pose),
            )

    def unplug(self) -> Iterator[Check]:
        """The cable, pulled while armed."""
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
        """The switch in the actuators' supply."""
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
        """Move away and ask for something to be done; False: skipped."""
        self.mover.move_away()
        return self.person.wait(request)

    def _at_device(self) -> int:
        """Return how many packets the board says to have lost or found damaged."""
        connection = self.bench.streamer.connection
        counters = connection.adapter.counters if connection is not None else {}
        return sum(int(counters.get(f"{name} at the device", 0)) for name in ("lost", "damaged"))
