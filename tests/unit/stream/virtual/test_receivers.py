"""One script of packets against all receivers: the sketch, emulated and on the host, and the virtual device."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from core.stream.protocols import adapters, packets, sealed
from core.stream.protocols.native_wifi import NativeWifi
from core.stream.protocols.packets import DeviceState, Kind, Nack, Reach
from core.stream.virtual import native
from core.stream.virtual.native_wifi import NativeWifiDevice
from tests.unit.stream.firmware_board import BAUD, ROOT, SKETCH, Chip
from tests.unit.stream.firmware_host import WifiBoard, every_chip
from tests.unit.stream.firmware_receivers import (
    HELLO,
    OTHER,
    OWN,
    QUEUE,
    SAFE,
    SLEW,
    WIRE,
    Near,
    Receiver,
    Sketch,
    Virtual,
    configuration,
)

Script = Callable[[Receiver], list[Any]]


def begin(r: Receiver, *, armed: bool = True, reach: int = Reach.RAMP) -> list[Any]:
    kinds = [(Kind.HELLO, HELLO), (Kind.CONFIGURE, configuration(reach=reach))] + [(Kind.ARM, b"")] * armed
    return [r.say(kind, body) for kind, body in kinds]


def strangers(r: Receiver) -> list[Any]:
    """Before any HELLO, and HELLOs that are none."""
    out = [r.say(kind) for kind in (Kind.SYNC, Kind.ARM, Kind.SAFE)]
    out += [r.say(Kind.HELLO, HELLO, session=0), r.say(Kind.HELLO, HELLO + b"!"), r.hear(b"\0\1\2\3\0")]
    return [*out, r.say(Kind.HELLO, HELLO), r.say(Kind.SYNC, b"abcd")]


def order(r: Receiver) -> list[Any]:
    """HELLO, CONFIGURE, ARM, in every wrong order; bodies that do not fit."""
    out = [r.say(Kind.HELLO, HELLO), r.say(Kind.ARM), r.command(1, 2), r.say(Kind.SAFE)]
    for body in (
        configuration(9),
        configuration(81),
        configuration(reach=3),
        configuration(slew=[250, 0]),
        b"",
        configuration(slew=[250] * 3, safe=[0] * 3),
        configuration()[:-1],
    ):
        out.append(r.say(Kind.CONFIGURE, body))
    out += [r.say(Kind.CONFIGURE, configuration()), r.command(1, 2), r.say(Kind.ARM, b"?"), r.say(Kind.ARM)]
    out += [r.say(Kind.ARM), r.command(1), r.command(1, 2, 3), r.say(Kind.SYNC, b"abc"), r.say(0x42), r.say(0x85)]
    return [*out, r.say(Kind.HELLO), r.say(Kind.SYNC, b"abcd"), r.say(Kind.SAFE, b"?"), r.say(Kind.ARM)]


def armed(r: Receiver) -> list[Any]:
    """Others are refused, and nobody changes what is safe under way."""
    out = [*begin(r), r.say(Kind.HELLO, HELLO, session=OTHER), r.command(5, 5, session=OTHER)]
    out += [r.say(Kind.CONFIGURE, configuration(safe=[60_000, 60_000])), r.say(Kind.HELLO, HELLO)]
    out += [r.say(Kind.SAFE), r.hear(b"", 0.1), r.say(Kind.HELLO, HELLO)]
    return out


def numbers(r: Receiver) -> list[Any]:
    """Copies, overtaken packets, gaps, and packets out of another time; the numbers run over."""
    r.sequence = 65_530
    out = begin(r)
    for ahead in (0, -1, -3, -40_000, 1025, 20_000, 2, 1, 5, 1024):
        out.append(r.say(Kind.SYNC, b"abcd", ahead=ahead))
    return [*out, r.say(Kind.HELLO, HELLO, ahead=0), r.say(Kind.HELLO, HELLO, ahead=-5), r.say(Kind.SYNC, b"abcd")]


def queue(r: Receiver) -> list[Any]:
    """Timed commands wait; a late or an untimed one empties the queue; a full queue refuses."""
    out = begin(r)
    out += [r.command(10_100, 20_000, soon=0.5), r.command(10_200, 20_000, soon=0.6), r.say(Kind.SYNC, b"abcd")]
    out += [r.command(10_300, 20_000, soon=-0.05), r.say(Kind.SYNC, b"abcd")]
    out += [r.command(10_400, 20_000, soon=0.5), r.command(10_500, 20_000), r.say(Kind.SYNC, b"abcd")]
    for k in range(QUEUE + 3):
        body = packets.command(r.soon(0.9), np.array([10_000 + k, 20_000], np.uint16), timed=True)
        r.sequence += 1
        out.append(r.hear(packets.pack(Kind.COMMAND, OWN, r.sequence, body), 0.006))
    out += [r.say(Kind.SYNC, b"abcd"), r.say(Kind.SAFE), r.say(Kind.SYNC, b"abcd"), r.command(1, 1)]
    return out


def refusals(r: Receiver) -> list[Any]:
    """A flood of refused packets gets one answer in 5 ms; the numbers of the others stay used."""
    out = begin(r)
    frames = [packets.pack(Kind.COMMAND, OTHER, k, b"") for k in range(8)]
    return [*out, r.hear(b"".join(frames), 0.004), r.say(Kind.SYNC, b"abcd")]


def silence(frame: Callable[[Receiver], bytes], asks: int = OWN) -> Script:
    """Nothing of this feeds the watchdog; at the end a session asks for state and counters."""

    def script(r: Receiver) -> list[Any]:
        out, heard = begin(r), []
        for _ in range(14):
            heard += r.hear(frame(r), 0.01)
        ended = [a for a in r.say(Kind.SYNC, b"abcd", session=asks, ahead=2) if a[0] == "SYNCED"]
        return [*out, [a for a in heard if a[0] != "NACK"], ended[0][4:]]

    return script


def frame(kind: Kind, body: bytes, *, session: int = OWN, ahead: int = 1) -> Callable[[Receiver], bytes]:
    return lambda r: packets.pack(kind, session, r.sequence + ahead, body)


def taken_over(r: Receiver) -> list[Any]:
    """Another sender begins while the device is on its way to safety: neither HELLO nor CONFIGURE stop it there."""
    out = [*begin(r), r.command(60_000, 60_000)]
    for _ in range(25):
        out.append(r.say(Kind.SYNC, b"abcd"))
    out.append(r.say(Kind.SAFE))
    r.hear(packets.pack(Kind.HELLO, OTHER, 1, HELLO), 0.02)
    r.hear(packets.pack(Kind.CONFIGURE, OTHER, 2, configuration(safe=[40_000, 40_000])), 0.4)
    return [
        *out,
        r.hear(packets.pack(Kind.HELLO, OTHER, 3, HELLO)),
        r.hear(packets.pack(Kind.ARM, OTHER, 4)),
        r.hear(packets.pack(Kind.HELLO, OTHER, 5, HELLO)),
        r.say(Kind.SYNC, b"abcd"),
    ]


def released(r: Receiver) -> list[Any]:
    """Who has let go does not know where it is."""
    out = [*begin(r, reach=Reach.RELEASE), r.say(Kind.HELLO, HELLO), r.say(Kind.SAFE), r.say(Kind.HELLO, HELLO)]
    return [*out, r.say(Kind.CONFIGURE, configuration()), r.say(Kind.ARM), r.say(Kind.HELLO, HELLO)]


FAR = [60_000, 50_000]  # counts
ELSEWHERE = [40_000, 65_000]


def way_kept(slew: int, reach: int, *, safe: bool, session: int = OTHER) -> Script:
    """A way to safety meets HELLO and CONFIGURE, and may meet SAFE, of a session with a mind of its own.

    Ends with that session's own way, for which its configuration holds.
    """

    def script(r: Receiver) -> list[Any]:
        out = [*begin(r), r.command(*FAR)]
        out += [r.say(Kind.SYNC, b"abcd") for _ in range(25)]
        out.append(r.say(Kind.SAFE))
        number, other = r.sequence if session == OWN else 0, configuration(80, reach, [slew, slew], ELSEWHERE)

        def say(kind: Kind, body: bytes = b"") -> list[Any]:
            nonlocal number
            number += 1
            return r.hear(packets.pack(kind, session, number, body))

        for _ in range(3):
            out += [say(Kind.CONFIGURE, other)] if session == OWN else [say(Kind.HELLO, HELLO)[1:]]
            out += [say(Kind.CONFIGURE, other)]
            out += [say(Kind.SAFE)] if safe else []
            welcome = say(Kind.HELLO, HELLO)[0]
            out += [welcome[:-1], Near(welcome[-1], int(SLEW[0]))]
        r.hear(b"", 0.25)
        out += [say(Kind.HELLO, HELLO), say(Kind.CONFIGURE, configuration(80, reach, SLEW, ELSEWHERE)), say(Kind.SAFE)]
        r.hear(b"", 0.25)
        return [*out, say(Kind.HELLO, HELLO)]

    return script


def at_once(r: Receiver) -> list[Any]:
    out = [*begin(r, reach=Reach.AT_ONCE), r.command(60_000, 60_000), r.say(Kind.SYNC, b"abcd")]
    return [*out, r.say(Kind.SAFE), r.say(Kind.HELLO, HELLO)]


def monsters(r: Receiver) -> list[Any]:
    """Frames longer than any packet, without end, and the next packet after them."""
    out = begin(r)
    for rubbish in (bytes(range(1, 200)) + b"\0", b"\1" * 100 + b"\0", b"\xff" * 300 + b"\0", b"\0\0\0", b"\2\0"):
        out += [r.hear(rubbish), r.say(Kind.SYNC, b"abcd")]
    return out


SCRIPTS: dict[str, Script] = {
    "strangers": strangers,
    "order": order,
    "armed": armed,
    "numbers": numbers,
    "queue": queue,
    "refusals": refusals,
    "taken over": taken_over,
    "released": released,
    **{
        f"way kept: {reach.name.lower()}, {slew} counts a ms{', with SAFE' * safe}": way_kept(slew, reach, safe=safe)
        for reach, slew in ((Reach.RAMP, 1), (Reach.RAMP, 65_535), (Reach.AT_ONCE, 250), (Reach.RELEASE, 250))
        for safe in (False, True)
    },
    "way kept: its own session": way_kept(1, Reach.RELEASE, safe=True, session=OWN),
    "at once": at_once,
    "monsters": monsters,
    "silence": silence(lambda r: b""),
    "silence: rubbish": silence(lambda r: b"\0\1\0\1\0"),
    "silence: another session": silence(frame(Kind.SYNC, b"abcd", session=OTHER)),
    "silence: another HELLO": silence(frame(Kind.HELLO, HELLO, session=OTHER), OTHER),
    "silence: old commands": silence(frame(Kind.COMMAND, packets.command(0, SAFE, timed=False), ahead=-2)),
    "silence: an old HELLO": silence(frame(Kind.HELLO, HELLO, ahead=-2)),
    "silence: the last packet again": silence(frame(Kind.SYNC, b"abcd", ahead=0)),
    "silence: far ahead": silence(frame(Kind.SYNC, b"abcd", ahead=3000)),
}


@pytest.mark.one_line("3.11", "bytes of a seeded draw; the rest of this file runs on both lines")
@every_chip
@pytest.mark.parametrize("name", SCRIPTS)
def test_all_receivers_say_the_same(chip: Chip, name: str) -> None:
    receiver = Virtual()
    if chip is WifiBoard:
        receiver.device.watchdogs_allowed = NativeWifiDevice.watchdogs_allowed
    virtual = SCRIPTS[name](receiver)
    with chip("-DDERMIS_CHANNELS=2") as board:
        sketch = SCRIPTS[name](Sketch(board))
    for number, (ours, theirs) in enumerate(zip(sketch, virtual, strict=True)):
        assert ours == theirs, f"step {number}: the sketch said {ours}, the virtual device {theirs}"
    if name.startswith("silence"):
        assert sketch[-1][0] == (DeviceState.IDLE if "another HELLO" in name else DeviceState.SAFE)
        assert sketch[-1][-1] == 1, "the watchdog has acted"


def test_a_way_to_safety_goes_on_under_another_sender() -> None:
    """What the sketch does is compared above; this is what both must do."""
    answers = taken_over(Virtual())
    assert answers[-4][0][-1] == SAFE.tolist(), "not stopped half way, and not sent to the new sender's safe pose"
    assert answers[-2][0][-1] == SAFE.tolist(), "nor moved by arming"


@pytest.mark.parametrize("name", [name for name in SCRIPTS if name.startswith("way kept")])
def test_a_way_to_safety_keeps_its_speed_its_reach_and_its_end(name: str) -> None:
    """What the sketch does is compared above; this is what both must do."""
    answers = SCRIPTS[name](Virtual())
    poses = [a.pose for a in answers if isinstance(a, Near)]
    for earlier, later in zip(poses, poses[1:], strict=False):
        assert earlier[0] - later[0] >= 30 * SLEW[0], "three packets of 12 ms and more, at the speed of its start"
    assert answers[-4][0][-1] == SAFE.tolist(), "not stopped half way, and not sent elsewhere"
    assert answers[-1][0][-1] == (None if "release" in name or "own session" in name else ELSEWHERE)


def test_a_session_number_that_the_device_has_heard_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sender that draws it by chance is taken for an old one, hears nothing, and draws again."""
    r, drawn = Virtual(), iter([OWN, OTHER])
    begin(r, armed=False)
    for _ in range(20):
        r.say(Kind.SYNC, b"abcd")
    monkeypatch.setattr(os, "urandom", lambda n: bytes([next(drawn)]))
    sender = adapters.make("native", WIRE, {})
    sender.opened(r.now)
    for _ in range(800):
        sender.receive(r.feed(b"".join(sender.poll(r.now))) + r.pass_time(0.001), r.now)
    assert sender.ready, sender.fault


def test_refusals_are_named_by_the_page() -> None:
    """Reasons that the scripts above have met, so that none is left out."""
    met = set()
    for script in SCRIPTS.values():
        for step in script(Virtual()):
            answers = step if isinstance(step, list) else []
            met |= {int(a[3].split()[2], 16) for a in answers if isinstance(a, tuple) and a[0] == "NACK"}
    assert met == {int(reason) for reason in Nack}


def test_page_sketch_and_virtual_device_state_the_same_limits() -> None:
    page = (ROOT / "presets" / "streaming_protocol.md").read_text("utf-8")
    sketch = "".join(SKETCH.with_name(name).read_text("utf-8") for name in ("native.h", "movement.h", "line.h"))
    told = {name: int(value) for name, value in re.findall(r"static const uint\d+_t (\w+) = (\d+);", sketch)}
    assert told["NACK_EVERY"] == native.NACK_EVERY * 1e3 and "One NACK in 5 ms" in page
    assert told["MOST_STEPS"] == native.MAX_STEP and "no more than 5 ms of elapsed time" in page
    assert told["WINDOW"] == native.WINDOW and "1 to 1024 ahead" in page
    assert told["VERSION"] == packets.VERSION and f"version {packets.VERSION}" in page
    least, most = native.WATCHDOGS[0], native.WATCHDOGS[-1]
    assert (told["LEAST_WATCHDOG"], told["MOST_WATCHDOG"]) == (least, most)
    wifi = SKETCH.with_name("line_wifi.h").read_text("utf-8")
    longest = NativeWifiDevice.watchdogs_allowed[-1]
    assert f"MOST_WATCHDOG = {longest};" in wifi and NativeWifi.WATCHDOGS[-1] == longest
    assert f"FRESH_MS = {sealed.FRESH_MS};" in SKETCH.with_name("sealed.h").read_text("utf-8")
    assert f"a watchdog outside {least} to {most} ms" in page.replace("\n", " ").replace("  ", " ")
    assert f"#define DERMIS_BAUD {BAUD}" in SKETCH.read_text("utf-8") and f"{BAUD:,} baud" in page
