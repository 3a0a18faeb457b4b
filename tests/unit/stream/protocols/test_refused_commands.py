"""Commands that a device refuses or plays late: counted, told, and what is done about its clock."""

from __future__ import annotations

import math
import subprocess
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from core.stream.play_command import _Player
from core.stream.protocols.clock import DeviceClock
from core.stream.protocols.packets import Synced
from core.stream.protocols.refusals import Refusals
from core.stream.virtual.faults import FaultyClock
from core.work.child import command, environment
from tests.unit.stream.stream_box import posix
from tests.unit.stream.stream_lab import Lab, sine_track

pytestmark = pytest.mark.shared_tests("the board is simulated; senders that end run on both lines")

EVERY, TRIP = 0.01, 0.002  # between questions, and their round trip [s]


def replies(clock: DeviceClock, device: FaultyClock, start: float, seconds: float) -> None:
    """Let a device answer questions for some time [s]."""
    for k in range(round(seconds / EVERY)):
        asked = start + k * EVERY
        clock.reply(asked, asked + TRIP, round(device.shows(asked + TRIP / 2) * 1e6) % 2**32)


def off(clock: DeviceClock, device: FaultyClock, moment: float) -> float:
    """Return how wrong a play-out time would be [s]."""
    wrong = (clock.device_us(moment) - round(device.shows(moment) * 1e6) + 2**31) % 2**32 - 2**31
    return abs(wrong) * 1e-6


@pytest.mark.parametrize("jump", [-30.0, -0.5, -0.005, 0.005, 0.5, 30.0])
def test_a_clock_that_jumps_is_synchronised_again_within_two_replies(jump: float) -> None:
    clock, device = DeviceClock(), FaultyClock(jump=jump)
    replies(clock, device, 0.5, 0.5)
    assert clock.jumps == 0 and off(clock, device, 0.99) < 1e-5
    replies(clock, device, 1.0, 2 * EVERY)
    assert clock.jumps == 1 and off(clock, device, 1.5) < 1e-5 and clock.steady(1.5)


def test_a_clock_that_stands_still_is_no_clock() -> None:
    clock, device = DeviceClock(), FaultyClock(freeze=1.0)
    replies(clock, device, 0.0, 1.0)
    assert clock.steady(1.0)
    replies(clock, device, 1.0, 0.08)
    assert not clock.steady(1.08)


@pytest.mark.parametrize("skew", [-0.09, -0.005, 0.005, 0.09])
def test_a_clock_as_wrong_as_an_oscillator_may_be_does_not_jump(skew: float) -> None:
    clock, rng = DeviceClock(), np.random.default_rng(1)
    for k in range(3000):
        asked, there, back = k * EVERY, *rng.exponential(0.003, 2)
        clock.reply(asked, asked + there + back, round((asked + there) * (1 + skew) * 1e6) % 2**32)
    assert clock.jumps == 0


def test_a_reply_that_a_busy_sender_read_too_late_is_no_jump() -> None:
    """Its time of arrival was taken before the sender was kept from running, so it seems to come out of the future."""
    clock, device = DeviceClock(), FaultyClock()
    replies(clock, device, 0.0, 1.0)
    for number in (1, 2):  # two questions, both answered meanwhile and read at once
        clock.reply(1.0 + 0.001 * number, 1.003, round(device.shows(1.05) * 1e6))
    replies(clock, device, 1.06, 0.5)
    assert clock.jumps == 0 and off(clock, device, 1.5) < 1e-5


def synced(received: int, lost: int = 0, late: int = 0) -> Synced:
    return Synced(0, 0, 2, 0, received % 65536, lost % 65536, 0, late % 65536, 0)


def test_refused_is_what_is_neither_received_nor_lost_and_what_came_late() -> None:
    found = Refusals()
    found.add(0, synced(65_530, 65_535, 7))  # a device that has run before, its counters close to their overflow
    found.add(10, synced(65_540, 65_535, 7))
    assert found.count == 0
    found.add(20, synced(65_545, 65_537, 8))  # five received, two lost on the way, one of the five late
    assert found.count == 3 + 1
    found.add(20, synced(65_545, 65_540, 8))  # lost: questions
    found.add(30, synced(65_554, 65_540, 8))
    assert found.count == 3 + 1 + 1, "what was lost before excuses nothing"


def test_a_command_that_overtook_a_question_was_not_refused() -> None:
    found = Refusals()
    for commands, received in ((0, 0), (10, 11), (20, 20), (30, 29)):
        found.add(commands, synced(received))
    assert found.count == 1


@pytest.mark.parametrize(
    ("faults", "untimed"),
    [
        ({}, False),
        ({"skew": 0.005}, False),
        ({"freeze": 0.001}, True),
        ({"freeze": 1.5}, True),
        ({"jump": -1.0}, True),
        ({"jump": -0.02}, True),
        ({"jump": 0.5}, True),
    ],
)
def test_a_device_with_a_faulty_clock_follows_its_track_and_it_is_said(
    faults: dict[str, float], untimed: bool, track_file: Path
) -> None:
    """Before, a clock that stood still had 156 of 273 commands refused, and nothing was counted or said."""
    lab = Lab(faults=faults, track=str(track_file), ramp=0.0, look_ahead=0.1)
    lab.begin()
    lab.run(0.2)
    lab.playing = True
    behind: list[float] = []

    def note() -> None:
        assert lab.time is not None
        if lab.time > 3.0:
            behind.append(abs(float(lab.at[0]) - 0.1 * math.sin(2 * math.pi * lab.time)))

    lab.run(4.0, note)
    lab.playing = False
    lab.run(0.2)
    assert lab.streamer.armed, lab.streamer.message
    report, sent, counted = lab.device.report(), lab.streamer.counters["sent"], lab.streamer.counters["refused"]
    assert counted == sent - report["received"] - report["lost"] + report["late"]
    assert counted <= 0.02 * sent, "it was noticed by then"
    notice = str(lab.streamer.status()["notice"])
    assert ("without a play-out time" in notice) == untimed and bool(notice) == bool(untimed)
    assert max(behind) < (0.1 if untimed else 0.01), "untimed, it runs ahead by the look-ahead: 0.06 rad at most"


def test_refusals_without_a_reason_are_counted_told_and_no_command_is_timed_any_more(track_file: Path) -> None:
    """A queue that is shorter than the device says."""
    lab = Lab(track=str(track_file), ramp=0.0, look_ahead=0.1)
    lab.run(0.2)
    welcome = lab.device._welcome

    def boast(body: bytes, now: float) -> bytes:
        lab.device._most = 255
        said = welcome(body, now)
        lab.device._most = 20
        return said  # type: ignore[no-any-return]

    lab.device._welcome = boast
    lab.arm()
    lab.run(0.1)
    lab.playing = True
    lab.run(1.0)
    counted = lab.streamer.counted()
    assert counted["refused"] > 0.01 * counted["sent"]
    lab.run(1.0)
    counted = lab.streamer.counted()["refused"]
    assert "More than 1% of the commands" in (notice := lab.streamer.status()["notice"]) and "still refused" in notice
    lab.run(1.0)
    assert lab.streamer.counted()["refused"] == counted


@posix
@pytest.mark.real_time
@pytest.mark.parametrize("fault", ["freeze=1.5", "jump=-1", "jump=0.5"])
def test_play_does_not_end_with_0_and_no_word(fault: str, boxes: Any, tmp_path: Path) -> None:
    """Clocks jump every second, or stand still after 1.5 s."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box, track = boxes("pty", "native", "haptip", fault), sine_track(tmp_path / "t.csv", 2.5)
    done = subprocess.run(
        command("stream", "play", str(track), "--url", box.url, "--yes"),
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "clock" in done.stderr, done
    refused = [part for part in done.stdout.replace("\n", ", ").split(", ") if part.startswith("refused ")]
    report = box.end()
    assert bool(refused) == (report["late"] > 0) or done.returncode, (done, report)
    assert done.returncode in (0, 1, 2) and "Traceback" not in done.stderr


@posix
@pytest.mark.real_time
def test_play_ends_with_1_where_commands_were_refused(boxes: Any, track_file: Path) -> None:
    """Ten late commands a jump, and three jumps before commands leave untimed: above 1 % of a short track."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box = boxes("pty", "native", "haptip", "jump=0.5", "delay=0.03")
    done = subprocess.run(
        command("stream", "play", str(track_file), "--url", box.url, "--yes", "--look-ahead", "0.05"),
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "refused " in done.stdout and "the device refused commands, or took them too late" in done.stderr, done
    assert done.returncode == 1, done


@pytest.mark.parametrize(
    ("refused", "status", "words"),
    [
        (
            1,
            0,
            "warning: lab: the device refused commands, or took them too late, no more than 1% (found '1 of 5011').",
        ),
        (90, 1, "error: lab: the device refused commands, or took them too late (found '90 of 5011'; allowed: 1%)."),
    ],
)
def test_a_limit_is_named_only_where_it_is_exceeded(
    refused: int, status: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    streamer = SimpleNamespace(counters=Counter(refused=refused, sent=5011))
    player: Any = SimpleNamespace(streamer=streamer, request=SimpleNamespace(url="lab"))
    assert _Player._tell_refusals(player) == status
    assert words in capsys.readouterr().err
