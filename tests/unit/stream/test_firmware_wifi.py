"""The sketch over Wi-Fi: real datagrams, simulated time; pairing, loss, silence, and who may move what."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator

import numpy as np
import pytest

from core.stream.protocols import adapters
from core.stream.protocols.packets import DeviceState
from core.stream.protocols.sealed import FRESH_MS, KEY, NONCE, SEAL, BoardSeals, HostSeals, Sealed, pairing_check, seal
from tests.unit.stream.firmware_board import Board
from tests.unit.stream.firmware_floods import ARRIVES, FRAME_US, ROUNDING_US
from tests.unit.stream.firmware_host import HostBoard, WifiBoard, compile_for_host, hosted
from tests.unit.stream.firmware_wifi import SILENCES, WIFI_FLOODS, WIRE, Host, wifi_flood

pytestmark = [hosted, pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")]
NAME = "DERMISU1"


@pytest.fixture
def board() -> Iterator[WifiBoard]:
    with WifiBoard("-DDERMIS_CHANNELS=2") as made:
        yield made


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_a_stream_goes_on_through_loss_and_is_safe_by_itself_after_a_silence(board: WifiBoard, loss: float) -> None:
    with Host(board, loss) as host:
        host.arm()
        assert host.adapter.silence.after == 0.2 and host.adapter.silence.watched
        host.run(5.0, 0.8)
        assert host.adapter.armed and not host.adapter.fault, host.adapter.fault
        lost = host.adapter.counters["lost at the device"]
        assert (lost > 50) == (loss > 0.0)
        assert abs(board.widths()[0] - 1900) <= 1.0
        host.silent, silent = True, board.now
        host.run(1.0, 0.8)
        path = np.array(board.path(0, silent))
        turned = path[path[:, 1] < 1899][0, 0] - silent
        assert 0.15 <= turned <= 0.2 + 0.025, "200 ms after the last valid one, then its next pulse"
        assert abs(path[-1, 1] - 1500) <= 1.0 and abs(board.widths()[1] - 1500) <= 1.0
        assert "has not answered for 0.2 s" in host.adapter.fault
        host.silent = False
        host.run(0.5, 0.8)
        assert abs(board.widths()[0] - 1500) <= 1.0, "it stays safe until a person arms again"


def test_the_silence_can_be_chosen_up_to_its_limit() -> None:
    made = adapters.make("native-wifi", WIRE, {"watchdog_ms": "400"})
    assert made.silence.after == 0.4
    for wrong in ("401", "59", "x"):
        with pytest.raises(adapters.DermisError, match="watchdog_ms"):
            adapters.make("native-wifi", WIRE, {"watchdog_ms": wrong})


def test_datagrams_of_every_length_are_sealed_as_the_library_seals_them(board: WifiBoard) -> None:
    """What is stale and rightly sealed is answered with the clock; what is not is not answered."""
    Board.run(board, 0.5)
    seals = board.seals
    assert seals is not None
    for size in range(257):
        stale = seals.seal(os.urandom(size))
        wrong = stale[:-1] + bytes([stale[-1] ^ 1])
        assert not board.ask(wrong) and len(board.ask(stale)) == 1, size
    assert not board.ask(seals.seal(bytes(257))), "longer than it has room for"


def test_nobody_without_the_key_moves_anything_or_hears_anything(board: WifiBoard) -> None:
    rng = np.random.default_rng(5)
    with Host(board) as host, Host(board, key=os.urandom(KEY)) as other:
        host.arm()
        host.run(0.3, 0.5)
        for k in range(300):
            own = host.sent[-1 - k % 5]
            forged = bytearray(own)
            forged[int(rng.integers(len(own)))] ^= 1 << int(rng.integers(8))
            size = int(rng.integers(0, 300))
            for data in (bytes(forged), own[: int(rng.integers(len(own)))], b"DU" + rng.bytes(size), rng.bytes(size)):
                other.socket.sendto(data, ("127.0.0.1", board.port))
            other.run(0.005)
            host.run(0.01, 0.5)
        assert host.adapter.armed and not host.adapter.fault and not other.adapter.seals.opened
        assert not board.datagrams(other.socket)
        assert abs(board.widths()[0] - 1750) <= 1.0


def test_a_recording_moves_nothing_and_opens_nothing(board: WifiBoard) -> None:
    with Host(board) as host, Host(board) as thief:
        host.arm()
        host.run(0.5, 0.8)
        recorded = [message for message in host.sent if message]
        for message in host.adapter.safe():
            host.send(message)
        host.run(0.6)
        assert abs(board.widths()[0] - 1500) <= 1.0 and host.adapter.state == DeviceState.SAFE
        board.pulses.clear()
        for by in (thief.socket, host.socket):
            for message in recorded:
                by.sendto(message, ("127.0.0.1", board.port))
                Board.run(board, 0.001)
        answers = board.datagrams(thief.socket)
        assert all(a[2] == Sealed.OFFER for a in answers), "an ASK is answered, and that opens nothing"
        assert all(abs(width - 1500) <= 1.0 for _, _, width in board.pulses)
        assert host.adapter.state == DeviceState.SAFE
        board.pulses.clear()
        usb = board.usb(f"pair {board.key.hex()} 6c6162 -\n")
        assert "refused moving" in usb, "flash is not written while pulses go out"


def test_a_recording_opens_nothing_after_a_reset_either(board: WifiBoard) -> None:
    with Host(board) as host, Host(board) as thief:
        host.arm()
        host.run(0.3, 0.8)
        board.hang()
        Board.run(board, 0.7)
        board.go_on()
        board.pulses.clear()
        Board.run(board, 0.1)
        assert not board.pulses, "the chip's watchdog has reset it"
        for message in filter(None, host.sent):
            thief.socket.sendto(message, ("127.0.0.1", board.port))
            Board.run(board, 0.001)
        Board.run(board, 0.1)
        assert not board.pulses


def test_what_somebody_holds_back_is_worth_nothing(board: WifiBoard) -> None:
    """Else one that came through each 150 ms would keep a board from its watchdog for minutes."""
    with Host(board) as host:
        host.arm()
        host.run(0.3, 0.8)
        start = len(host.sent)
        host.silent, silent = True, board.now
        host.run(0.15, 0.8)
        held = host.sent[start:]
        board.pulses.clear()
        while board.now - silent < 1.5:
            host.socket.sendto(held.pop(0) if held else b"", ("127.0.0.1", board.port))
            Board.run(board, 0.05)
            board.now += 0.0
        path = np.array(board.path(0))
        turned = path[path[:, 1] < 1899][0, 0] - silent
        assert turned <= 2 * FRESH_MS / 1e3 + 0.05 and abs(path[-1, 1] - 1500) <= 1.0


def test_copies_and_overtaken_datagrams_are_no_signs_of_life(board: WifiBoard) -> None:
    with Host(board) as host:
        host.arm()
        host.run(0.2, 0.8)
        silent = board.now
        board.pulses.clear()
        for _ in range(60):
            for message in host.sent[-20:]:
                host.socket.sendto(message, ("127.0.0.1", board.port))
            Board.run(board, 0.01)
        path = np.array(board.path(0))
        assert path[path[:, 1] < 1899][0, 0] - silent <= 0.23 and abs(path[-1, 1] - 1500) <= 1.0


def test_one_that_is_armed_cannot_be_taken_over_and_one_that_is_not_can(board: WifiBoard) -> None:
    with Host(board) as one, Host(board) as two:
        one.arm()
        for _ in range(40):
            one.run(0.05, 0.5)
            two.run(0.005)
            two.adapter.fault, fault = "", two.adapter.fault or ""
            if fault:
                break
        assert "in use by another sender" in fault and one.adapter.armed and not two.adapter.seals.opened
        Board.run(board, 1.0)
    with Host(board) as three:
        three.run(0.6)
        assert three.adapter.ready and three.adapter.state == DeviceState.IDLE


def test_answers_go_to_nobody_but_the_host_that_opened_the_session(board: WifiBoard) -> None:
    with Host(board) as host, Host(board) as thief:
        host.arm()
        host.silent = True
        host.run(0.02, 0.5)
        for message in host.sent[-4:]:
            thief.socket.sendto(message, ("127.0.0.1", board.port))
        Board.run(board, 0.02)
        assert not board.datagrams(thief.socket)


@pytest.mark.parametrize("silence_ms", SILENCES)
@pytest.mark.parametrize("name", WIFI_FLOODS)
def test_safe_in_time_whatever_is_in_the_air(name: str, silence_ms: int) -> None:
    with WifiBoard() as board:
        done = wifi_flood(board, name, silence_ms)
    late = silence_ms / 1e3 - 0.05
    assert done.begins <= 0.1 + late, f"begins after {done.begins * 1e3:.0f} ms"
    assert done.arrives <= ARRIVES + late, "and goes on to the safe pose"
    assert done.steepest <= FRAME_US + ROUNDING_US, f"{done.steepest} us from one pulse to the next"


def test_a_flood_of_questions_keeps_no_sender_from_its_board(board: WifiBoard) -> None:
    with Host(board) as host, Host(board) as thief:
        host.arm()
        asked = [m for m in host.sent if m[2:3] in (bytes([Sealed.ASK]), bytes([Sealed.OPEN]))]
        for _ in range(100):
            for message in asked * 5:
                thief.socket.sendto(message, ("127.0.0.1", board.port))
            host.run(0.005, 0.5)
        assert host.adapter.armed and abs(board.widths()[0] - 1750) <= 1.0


# -- pairing


def test_without_a_pairing_it_neither_listens_nor_says_where_it_is() -> None:
    with HostBoard("-DDERMIS_WIFI", baud=115_200) as board:
        board.send(b"where\n")
        assert board.run(0.05) == b"unpaired DERMISU1\n"
        board._command("N")
        assert board.answer == "0"


@pytest.mark.parametrize(
    "line",
    [
        "pair",
        "pair 00",
        "pair " + "00" * 31 + " 6c6162 -",
        "pair " + "00" * 33 + " 6c6162 -",
        "pair " + "0g" * 32 + " 6c6162 -",
        "pair " + "00" * 32 + " - -",
        "pair " + "00" * 32 + " " + "61" * 33 + " -",
        "pair " + "00" * 32 + " 6c6162 " + "61" * 64,
        "pair " + "00" * 32 + " 6c6162 616",
        "pair " + "00" * 32 + " 6c6162",
        "pair " + "00" * 400,
    ],
)
def test_a_malformed_pairing_changes_nothing(line: str) -> None:
    with HostBoard("-DDERMIS_WIFI", baud=115_200) as board:
        board.send(line.encode() + b"\n")
        said = board.run(0.3)
        assert said in (b"refused malformed\n", b"")
        board.send(b"where\n")
        assert board.run(0.05) == b"unpaired DERMISU1\n"


def test_a_new_pairing_replaces_the_old_one(board: WifiBoard) -> None:
    old, board.key = board.key, os.urandom(KEY)
    board.pair()
    assert not board.ask(HostSeals(old).ask()) and board.opened().opened
    assert board.usb("where\n") == f"at DERMISU1 {'7f000001'} {3947:04x}\n"


def test_it_has_no_other_protocol_and_only_chips_with_wi_fi(tmp_path: object) -> None:
    from pathlib import Path

    out = Path(str(tmp_path)) / "sketch.so"
    done = compile_for_host(out, "-DDERMIS_WIFI", "-DDERMIS_SERVO_ANIMATION")
    assert done.returncode and "DERMIS_WIFI works with the native protocol only" in done.stderr


# -- the simulated board refuses what the sketch refuses


def test_the_simulated_board_answers_as_the_sketch_does(board: WifiBoard) -> None:
    """One script of datagrams to both: which are answered, and with what kind."""
    clock = [0]
    virtual, seals = BoardSeals(board.key, lambda: clock[0]), HostSeals(board.key)
    other = HostSeals(board.key)
    assert board.seals is not None

    def both(by_sketch: bytes, by_virtual: bytes, *, held: bool = False) -> list[int]:
        answers = board.ask(by_sketch)
        _, said = virtual.take(by_virtual, held=held)
        kinds = [a[2] for a in answers]
        assert kinds == [a[2] for a in said], (kinds, said)
        for side, messages in ((other, answers), (seals, said)):
            for message in messages:
                side.unseal(message)
        return kinds

    ask_a, ask_b = other.ask(), seals.ask()
    assert both(ask_a, ask_b) == [Sealed.OFFER]
    assert both(ask_a[:-1] + b"\0", ask_b[:-1] + b"\0") in ([], [Sealed.OFFER])
    open_a, open_b = other.ask(), seals.ask()
    assert both(open_a, open_b) == [Sealed.FROM_BOARD] and other.opened and seals.opened
    assert both(open_a, open_b) == [Sealed.FROM_BOARD], "said again, as the answer may have been lost"
    data_a, data_b = other.seal(b""), seals.seal(b"")
    assert both(data_a, data_b) == [] and both(data_a, data_b) == []
    Board.run(board, 0.5)
    clock[0] += 500
    assert both(other.seal(b"\0"), seals.seal(b"\0")) == [Sealed.FROM_BOARD], "stale: the clock, and nothing else"
    assert both(other.seal(b"\0"), seals.seal(b"\0")) == []
    fresh_a, fresh_b = HostSeals(board.key), HostSeals(board.key)
    assert both(fresh_a.ask(), fresh_b.ask()) == [Sealed.OFFER]
    stolen = seal(board.key, b"DU\x03" + bytes(2 * NONCE))
    assert both(stolen, stolen) == [], "an offer that it never made"
    assert both(b"DU\x09" + bytes(40), b"DU\x09" + bytes(40)) == [] == both(b"", b"")


def test_a_host_takes_nothing_without_the_seal_and_nothing_twice() -> None:
    key = os.urandom(KEY)
    board, host = BoardSeals(key, lambda: 7), HostSeals(key)
    _, (offer,) = board.take(host.ask(), held=False)
    assert host.unseal(seal(os.urandom(KEY), offer[:-SEAL])) == b"" and host.forged == 1
    host.unseal(offer)
    _, (opened,) = board.take(host.ask(), held=False)
    host.unseal(opened)
    said = board.seal(b"hello")
    assert host.unseal(said) == b"hello" and host.unseal(said) == b"" and host.opened
    assert host.unseal(host.seal(b"back at you")) == b"" and host.forged == 2, "its own, sent back"
    assert host.unseal(struct.pack("<2sBII", b"DU", 5, 99, 0)) == b""
    _, (busy,) = board.take(HostSeals(key).ask(), held=True)
    assert host.unseal(busy) == b"" and not host.busy, "an answer to somebody else"


def test_the_check_of_a_pairing_shows_the_key_and_does_not_tell_it() -> None:
    one, two = os.urandom(KEY), os.urandom(KEY)
    assert pairing_check(one) != pairing_check(two) and len(pairing_check(one)) == 8
