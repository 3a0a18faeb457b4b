"""A sender that was silent for longer than its board allows commands nothing more, until a person arms again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.presets import Library
from core.stream.protocols import adapters
from core.stream.protocols.silence import Does, Silence
from core.stream.protocols.wire import Wire
from core.stream.shared_state import Heartbeat
from core.stream.state import State
from tests.unit.stream.stream_lab import TICK, Lab
from tests.unit.stream.test_safe_ramp import FAR, PERIOD, QUANTUM, SAFE, SPEED

DRIVEN = ["maestro", "servo-animation", "osc"]  # the sender leads these to their safe state
STEP = SPEED * 2 * PERIOD + QUANTUM


def driven(protocol: str, silence: str = "", **request: Any) -> Lab:
    """Give a cable platform far from its safe pose, whose board is declared to do this in silence."""
    url = f"lab?silence={silence}" if silence else "lab"
    lab = Lab(protocol, "cable_platform", mode="jog", jog=FAR, ramp=0.0, url=url, **request)
    lab.begin(0.6)
    assert np.allclose(lab.at, list(FAR.values()), atol=QUANTUM)
    del lab.sent[:]
    return lab


def told(lab: Lab, seconds: float) -> np.ndarray:
    """Let time pass; return where the device was told to be at every tick."""
    path = [lab.at]
    lab.run(seconds, lambda: path.append(lab.at))
    return np.array(path)


@pytest.mark.parametrize("protocol", DRIVEN)
@pytest.mark.parametrize("silence", ["", "unknown", "lets-go"])
def test_where_the_pose_is_not_known_nothing_is_sent_until_a_person_arms(protocol: str, silence: str) -> None:
    lab = driven(protocol, silence)
    lab.now += 3.0
    lab.run(2.0)
    assert not lab.sent, "not one message"
    status = lab.streamer.status()
    assert status["state"] == State.STALLED and not status["armed"] and not status["pose_known"]
    assert "No command has left for 3 s" in status["message"].capitalize() and "arm again" in status["message"]
    assert "Switch its supply off" in status["message"]
    assert status["counters"]["silences"] == 1
    assert status["counters"].get("safe states not confirmed", 0) == (silence != "lets-go")
    lab.arm()
    first = told(lab, 2 * TICK)
    assert np.allclose(first[-1], SAFE, atol=SPEED * 2 * PERIOD + QUANTUM), "from the safe pose, with fingers out"


@pytest.mark.parametrize("protocol", DRIVEN)
@pytest.mark.parametrize("silence", ["keeps", "stops"])
def test_a_board_that_holds_on_is_led_from_its_last_command(protocol: str, silence: str) -> None:
    lab = driven(protocol, silence)
    lab.now += 3.0
    path = told(lab, 0.6)
    assert np.abs(np.diff(path, axis=0)).max() <= STEP and np.allclose(path[-1], SAFE, atol=QUANTUM)
    assert lab.streamer.state == State.STALLED and not lab.streamer.armed
    del lab.sent[:]
    lab.run(1.0)
    assert not lab.sent, "it streams on only after a person has armed"


@pytest.mark.parametrize("protocol", DRIVEN)
def test_a_board_that_retracted_is_never_told_to_go_back(protocol: str) -> None:
    lab = driven(protocol, "retracts")
    lab.now += 3.0
    path = told(lab, 0.6)[1:]
    assert lab.sent and np.allclose(path, SAFE, atol=QUANTUM), "the safe pose with the first message, and only that"
    assert lab.streamer.state == State.STALLED and not lab.streamer.armed


@pytest.mark.parametrize("silence", ["", "retracts", "keeps"])
def test_a_sleep_on_the_way_to_safety(silence: str) -> None:
    lab = driven("maestro", silence)
    lab.stops += 1
    before = told(lab, 0.05)
    del lab.sent[:]
    lab.now += 3.0
    path = told(lab, 0.6)
    if silence == "":
        assert not lab.sent and "Switch its supply off" in lab.streamer.message
    elif silence == "retracts":
        assert np.allclose(path[2:], SAFE, atol=QUANTUM), "where the board has gone, not where the ramp was"
    else:
        assert np.abs(np.diff([*before, *path], axis=0)).max() <= STEP and np.allclose(path[-1], SAFE, atol=QUANTUM)


@pytest.mark.parametrize("protocol", DRIVEN)
@pytest.mark.parametrize("how", ["stop", "disconnect", "end"])
def test_whatever_ends_a_stream_after_a_sleep_knows_of_it(protocol: str, how: str) -> None:
    """The word to stop is read before the next tick, and must not begin a ramp from a pose that has gone."""
    lab = driven(protocol)
    lab.now += 3.0
    if how == "stop":
        lab.stops += 1
    elif how == "disconnect":
        lab.set(connect=False)
    else:
        lab.streamer.shut(lab.now)
    lab.run(0.6)
    assert not lab.sent and not lab.streamer.armed
    assert lab.streamer.counters["safe states not confirmed"] == 1


@pytest.mark.parametrize(("protocol", "key"), [("native", "cable_platform"), ("torque", "haptip")])
def test_a_device_that_knows_its_safe_state_is_told_to_go_there(protocol: str, key: str) -> None:
    jog = FAR if key == "cable_platform" else {"pulley_1": 0.3}
    lab = Lab(protocol, key, mode="jog", jog=jog, ramp=0.0)
    lab.begin(0.6)
    lab.now += 3.0
    lab.run(0.6)
    assert not lab.streamer.armed and lab.streamer.state in (State.STALLED, State.FAULT)
    if protocol == "native":
        assert np.allclose(lab.at, SAFE, atol=2 * QUANTUM)
    else:
        assert not lab.device.torque.any()
    assert lab.streamer.counters["safe states not confirmed"] == 0


@pytest.mark.parametrize("protocol", DRIVEN)
def test_a_screen_is_switched_off_whatever_its_board_does(protocol: str) -> None:
    """A safe state that is reached at once is no way that could be jumped."""
    lab = Lab(protocol, "electrovibration", mode="jog", jog={"amplitude": 100.0}, ramp=0.0)
    lab.begin(0.3)
    assert lab.at[0] == pytest.approx(100.0, abs=0.3)
    lab.now += 3.0
    lab.run(0.1)
    assert lab.at[0] == pytest.approx(0.0, abs=1e-9) and not lab.streamer.armed


@pytest.mark.parametrize("protocol", DRIVEN)
def test_a_gap_within_the_declared_silence_goes_on(protocol: str) -> None:
    lab = driven(protocol)
    lab.now += 0.05  # a position that does not change is said again every 33 ms
    path = told(lab, 0.5)
    assert lab.streamer.armed and np.allclose(path[1:], list(FAR.values()), atol=QUANTUM)
    assert lab.streamer.counters["silences"] == 0


@pytest.mark.parametrize("protocol", DRIVEN)
def test_few_commands_are_no_silence(protocol: str) -> None:
    """At a command a second the last one is repeated, or the board would count its sender as gone."""
    lab = Lab(protocol, mode="jog", jog={"pulley_1": 0.2}, rate=1.0)
    lab.begin(3.0)
    del lab.sent[:]
    lab.run(3.0)
    moments = np.array([moment for moment, _ in lab.sent])
    assert lab.streamer.armed and np.diff(moments).max() <= 0.1 / 3 + 0.005
    assert lab.streamer.counters["silences"] == 0


@pytest.mark.parametrize("protocol", DRIVEN)
def test_a_command_that_was_held_up_before_its_write_does_not_leave(protocol: str) -> None:
    """A process that is stopped between looking at the clock and writing wakes up with a message in its hands."""
    lab = driven(protocol)
    slept = [0.0]
    outbox = lab.streamer.connection.outbox  # type: ignore[union-attr]
    outbox._clock = lambda: lab.now + slept[0]
    lab.run(0.05)
    assert lab.sent
    del lab.sent[:]
    slept[0] = 3.0
    lab.run(0.004)
    lab.now, slept[0] = lab.now + 3.0, 0.0
    lab.run(0.5)
    assert not lab.sent and not lab.streamer.armed


@pytest.mark.parametrize("protocol", DRIVEN)
def test_two_short_sleeps_in_a_row_are_one_silence(protocol: str) -> None:
    """The first ends before the tick, the second lies between the tick's look at the clock and its write."""
    lab = driven(protocol, "retracts")
    slept = [0.0]
    outbox = lab.streamer.connection.outbox  # type: ignore[union-attr]
    outbox._clock = lambda: lab.now + slept[0]
    lab.run(0.05)
    lab.now = outbox.left_at + 0.085
    slept[0] = 0.09
    del lab.sent[:]
    lab.run(TICK)
    assert not lab.sent, "the board heard nothing for 175 ms, and is on its way home"
    lab.now, slept[0] = lab.now + 0.09, 0.0
    path = told(lab, 0.5)
    assert np.allclose(path[-1], SAFE, atol=QUANTUM) and not lab.streamer.armed
    assert len(np.unique(path.round(3), axis=0)) == 2, "from the last command to the safe pose, and nothing between"
    assert lab.streamer.counters["silences"] == 1
    assert "because this computer was busy or asleep, or the link took nothing: arm again" in lab.streamer.message


def test_arming_that_was_slept_through_is_given_up() -> None:
    lab = Lab("maestro", mode="jog", jog={"pulley_1": 0.4}, ramp=0.0)
    lab.run(0.1)
    lab.arm()
    lab.now += 3.0
    lab.run(0.5)
    assert not lab.streamer.armed and "did not arm within 1 s" in lab.streamer.message


# -- faults on the way


@pytest.mark.parametrize("protocol", DRIVEN)
def test_a_fault_that_repeats_does_not_cut_the_ramp(protocol: str) -> None:
    """A servo bus may repeat its error with every answer; the way to safety goes on as far as the link carries it."""
    lab = driven(protocol, "keeps")

    def fail() -> None:
        if lab.streamer.connection is not None:
            lab.streamer.connection.adapter.fault = "hardware error 0x20"

    path = [lab.at]
    device = lab.device
    lab.run(1.0, lambda: (fail(), path.append(np.array(list(device.report()["values"].values())))))
    assert np.abs(np.diff(np.array(path), axis=0)).max() <= STEP
    assert np.allclose(path[-1], SAFE, atol=QUANTUM), "it arrives"
    assert lab.streamer.message.count("hardware error 0x20") == 1, "said once"
    assert lab.streamer.state in (State.FAULT, State.DISCONNECTED)


# -- the declaration


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, Silence(Does.UNKNOWN, 0.1, "sender")),
        ({"silence": "keeps"}, Silence(Does.KEEPS, 0.1, "sender")),
        ({"silence": "retracts", "silence_ms": "250"}, Silence(Does.RETRACTS, 0.25, "board")),
        ({"silence": "lets-go", "silence_ms": "500"}, Silence(Does.LETS_GO, 0.5, "board")),
        ({"silence": "stops"}, Silence(Does.STOPS, 0.1, "board")),
    ],
)
def test_an_address_declares_what_a_board_does(options: dict[str, str], expected: Silence) -> None:
    wire = Wire.of(Library().device("haptip"))
    for protocol in (*DRIVEN, "torque"):
        made = adapters.make(protocol, wire, options)
        assert made.silence == expected
        assert "Nothing has checked that" in made.caution if options else made.caution


def test_native_devices_declare_their_watchdog() -> None:
    wire = Wire.of(Library().device("cable_platform"))
    assert adapters.make("native", wire, {}).silence == Silence(Does.RETRACTS, 0.05, "board")
    assert adapters.make("native", wire, {"watchdog_ms": "20"}).silence.after == 0.02
    assert adapters.make("native", wire, {"reach": "release"}).silence.does is Does.LETS_GO


@pytest.mark.parametrize(
    "options",
    [{"silence": "dances"}, {"silence": "retracts", "silence_ms": "0"}, {"silence": "stops", "silence_ms": "x"}],
)
def test_an_impossible_declaration_is_refused(options: dict[str, str]) -> None:
    with pytest.raises(DermisError) as refused:
        adapters.make("maestro", Wire.of(Library().device("haptip")), options)
    assert "silence" in str(refused.value)


@pytest.mark.parametrize("ramping", [False, True])
def test_a_board_that_has_only_begun_to_retract_is_left_to_it(ramping: bool) -> None:
    """One millisecond more than declared: the safe state is said once the board's own way must be over."""
    lab = driven("maestro", "retracts")
    if ramping:
        lab.stops += 1
        lab.run(0.05)
    outbox = lab.streamer.connection.outbox  # type: ignore[union-attr]
    own_way = 0.1 + lab.streamer.output.wire.safe_seconds  # type: ignore[union-attr]
    quiet_since = outbox.left_at
    lab.now = quiet_since + 0.101
    del lab.sent[:]
    lab.run(0.6)
    assert lab.sent and lab.sent[0][0] - quiet_since >= own_way - TICK
    assert np.allclose(lab.at, SAFE, atol=QUANTUM) and not lab.streamer.armed


def test_a_word_that_finds_no_room_is_said_again() -> None:
    """A device that goes home by itself, and whose protocol confirms nothing, must hear of it."""
    for seconds, heard in ((0.3, True), (5.0, False)):
        lab = driven("maestro", "keeps")
        adapter_, link = lab.streamer.connection.adapter, lab.streamer.connection.link  # type: ignore[union-attr]
        adapter_.retract = lambda: [b"\x84\x00\x00\x00"]  # type: ignore[method-assign]
        send, until = link.send, lab.now + seconds

        def sending(message: bytes, send: Any = send, until: float = until, lab: Lab = lab) -> bool:
            return lab.now > until and bool(send(message))

        link.send = sending  # type: ignore[method-assign]
        lab.stops += 1
        lab.run(2.0)
        assert bool(lab.device.targets[0] == 0) is heard
        assert ("Switch its supply off" in lab.streamer.message) is not heard


def test_an_arm_that_was_pressed_before_a_sleep_is_not_carried_out_after_it() -> None:
    lab = Lab("maestro", mode="jog", jog={"pulley_1": 0.4}, ramp=0.0)
    lab.run(0.1)
    pressed = lab.now
    lab.now += 15.0
    lab.run(TICK)
    lab.set(arm_id=1, arm_at=pressed, stops=0)
    lab.run(0.5)
    assert not lab.streamer.armed and "Arm was pressed 15.0 s ago" in lab.streamer.message


def test_a_sign_of_life_counts_from_when_it_was_given() -> None:
    lab = Lab("maestro", mode="jog", jog={"pulley_1": 0.4}, ramp=0.0)
    lab.run(0.1)
    lab.heartbeats = False
    lab.now += 15.0
    lab.streamer.heartbeat(Heartbeat(1000, 0, False, 0.0, (), lab.now - 15.0), lab.now)
    lab.set(arm_id=1, arm_at=lab.now, stops=0)
    lab.run(0.1)
    assert not lab.streamer.armed and "no sign of life" in lab.streamer.message


def test_a_device_that_does_not_obey_is_left_to_its_own_watchdog_and_that_is_said() -> None:
    """It answers that it is armed all the time; questions for its clock would keep its watchdog quiet for ever."""
    lab = Lab(mode="jog", jog={"pulley_1": 0.3}, ramp=0.0)
    lab.begin(0.3)
    lab.device._go_safe = lambda: None
    lab.stops += 1
    lab.run(1.5)
    assert "does not confirm its safe state" in lab.streamer.message and "Switch its supply off" in lab.streamer.message
    assert lab.streamer.counters["safe states not confirmed"] == 1
    del lab.sent[:]
    lab.run(0.5)
    assert not lab.sent, "silent, so that its own watchdog acts"


@pytest.mark.parametrize("protocol", DRIVEN)
def test_a_gap_of_a_tenth_of_a_second_in_the_line_does_not_lose_the_safe_state(protocol: str) -> None:
    lab = driven(protocol)
    lab.stops += 1
    lab.run(0.2)
    link = lab.streamer.connection.link  # type: ignore[union-attr]
    send, began = link.send, lab.now

    def lossy(message: bytes) -> bool:
        return True if lab.now < began + 0.13 else bool(send(message))

    link.send = lossy  # type: ignore[method-assign]
    lab.run(0.6)
    assert np.allclose(lab.at, SAFE, atol=QUANTUM) and lab.streamer.state == State.READY
