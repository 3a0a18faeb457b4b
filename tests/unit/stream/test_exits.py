"""Whatever ends a stream, the last command that a receiver gets is the safe state, and no step on the way is a jump."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests import exits
from tests.exits import AHEAD, PROTOCOLS, Receiver
from tests.unit.stream.stream_box import posix

pytestmark = [pytest.mark.real_time, posix]

serial = pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")


def is_safe(receiver: Receiver) -> None:
    found = receiver.judgement()
    assert found["safe"], found
    assert found["ahead"] <= AHEAD, "no step larger than the declared speed allows"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_closing_a_sender_leaves_the_safe_state_at_the_receiver(protocol: str) -> None:
    with Receiver(protocol) as receiver:
        exits.by_close(receiver)
        is_safe(receiver)


@pytest.mark.parametrize("protocol", exits.WATCHED)
def test_a_silence_of_a_second_leaves_a_board_with_a_watchdog_safe(protocol: str) -> None:
    with Receiver(protocol) as receiver:
        exits.by_silence(receiver)
        is_safe(receiver)


@pytest.mark.parametrize("protocol", ["maestro", "native"])
def test_the_ramp_outlives_the_process_that_started_it(protocol: str) -> None:
    with Receiver(protocol) as receiver:
        exits.by_quit(receiver)
        is_safe(receiver)


@pytest.mark.parametrize("how", [exits.by_stop, exits.by_disconnect])
def test_stop_and_disconnect_go_there_at_the_declared_speed(how: object) -> None:
    with Receiver("servo-animation") as receiver:
        how(receiver)  # type: ignore[operator]
        is_safe(receiver)


@pytest.mark.parametrize("name", sorted(exits.SIGNALS))
def test_a_sender_that_is_told_to_end_finishes_first(name: str) -> None:
    with Receiver("maestro") as receiver:
        exits.by_signal(receiver, name)
        is_safe(receiver)


@pytest.mark.parametrize("name", sorted(exits.SIGNALS))
@pytest.mark.parametrize("protocol", ["maestro", "native"])
def test_stream_play_ends_orderly_on_a_signal(name: str, protocol: str, tmp_path: Path) -> None:
    with Receiver(protocol) as receiver:
        status, said = exits.by_signal_to_play(receiver, name, tmp_path)
        assert status == 128 + exits.SIGNALS[name] and "Traceback" not in said, said
        is_safe(receiver)
        if protocol == "maestro":
            assert "going to the safe state, 0." in said
            assert "does not say where it is" in said and "finger out" in said


@pytest.mark.parametrize("name", ["Ctrl-Z", "TERM"])
def test_signals_that_go_on_until_it_has_ended_change_nothing(name: str, tmp_path: Path) -> None:
    """A second Ctrl-Z stopped a program that was about to end, for good."""
    with Receiver("maestro") as receiver, exits.player(receiver, tmp_path) as process:
        end = time.monotonic() + 20.0
        while process.poll() is None and time.monotonic() < end:
            process.send_signal(exits.SIGNALS[name])
            time.sleep(0.001)
        assert process.returncode == 128 + exits.SIGNALS[name]
        is_safe(receiver)
