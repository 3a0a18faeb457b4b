"""Pairing over USB, with the sketch at the other end of the port; and the file that the keys are kept in."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from core.__main__ import main
from core.errors import DermisError
from core.steps import drain
from core.stream.links.transport import Transport
from core.stream.pair_command import pair_at, pair_over
from core.stream.protocols import adapters, pairs
from core.stream.protocols.sealed import KEY, HostSeals
from tests.unit.stream.firmware_board import Board, servos
from tests.unit.stream.firmware_host import HostBoard, WifiBoard, hosted

pytestmark = pytest.mark.shared_tests("the board is simulated; senders that end run on both lines")


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "deep" / "pairs.json"
    monkeypatch.setenv(pairs.FILE, str(path))
    return path


class Port(Transport):
    """A board's USB port; time passes in `wait`."""

    name = "port"

    def __init__(self, board: Board) -> None:
        self.board, self.now, self.came = board, 0.0, [b"ets Jul 29 2019 rst:0x1 \xff\xfe\r\n"]

    def send(self, message: bytes) -> bool:
        Board.send(self.board, message)
        return True

    def receive(self) -> list[bytes]:
        out, self.came = self.came, []
        return out

    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.came.append(Board.run(self.board, seconds))

    def clock(self) -> float:
        return self.now


@pytest.fixture
def port() -> Iterator[Port]:
    with HostBoard("-DDERMIS_WIFI", "-DDERMIS_CHANNELS=2", baud=115_200) as board:
        yield Port(board)


@hosted
def test_a_board_is_paired_and_its_key_opens_a_session(port: Port, file: Path) -> None:
    board, address = drain(pair_over(port, "Lab", "a secret that is long", port.clock, port.wait))
    assert (board, address) == ("DERMISU1", "udp://127.0.0.1:3947?board=DERMISU1")
    key = pairs.key_of(board)
    assert len(key) == KEY and key != pairs.VIRTUAL_KEY
    assert adapters.make("native-wifi", servos(2), {"board": board}).seals.key == key  # type: ignore[attr-defined]
    assert pairs.addresses() == {board: address}
    again, _ = drain(pair_over(port, "Lab", "", port.clock, port.wait))
    assert again == board and pairs.key_of(board) != key, "a key is drawn each time"


@hosted
def test_the_file_is_its_users_alone(port: Port, file: Path) -> None:
    drain(pair_over(port, "Lab", "", port.clock, port.wait))
    assert stat.S_IMODE(file.stat().st_mode) == 0o600 and stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert [p.name for p in file.parent.iterdir()] == [file.name]


@pytest.mark.parametrize(
    ("network", "password"), [("", "12345678"), ("x" * 33, ""), ("ä" * 17, ""), ("Lab", "1234567"), ("Lab", "x" * 64)]
)
def test_what_no_wi_fi_has_is_refused_before_anything_is_said(network: str, password: str) -> None:
    with pytest.raises(DermisError, match="no Wi-Fi has such"):
        drain(pair_over(Transport(), network, password, lambda: 0.0, lambda s: None))
    with pytest.raises(DermisError, match="no Wi-Fi has such"):
        drain(pair_at("/dev/null", network, password))


def test_a_port_is_looked_for_before_a_password_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    monkeypatch.setattr("getpass.getpass", lambda _: pytest.fail("a password was asked for"))
    assert main(["stream", "pair", "--url", str(tmp_path / "no port"), "--network", "Lab"]) == 2
    assert "there is no such port" in capsys.readouterr().err
    assert main(["stream", "pair", "--url", "udp://a:1", "--network", "Lab"]) == 2
    assert "paired over USB" in capsys.readouterr().err


@hosted
def test_a_board_that_speaks_something_else_is_told(file: Path) -> None:
    with HostBoard("-DDERMIS_CHANNELS=2", baud=500_000) as board:
        port = Port(board)
        with pytest.raises(DermisError, match="did not answer within 8 s.*DERMIS_WIFI"):
            drain(pair_over(port, "Lab", "", port.clock, port.wait))
    assert not file.exists()


@hosted
def test_a_board_that_moves_is_not_paired(file: Path) -> None:
    from tests.unit.stream.firmware_board import Sender

    with WifiBoard("-DDERMIS_CHANNELS=2") as board:
        Sender(board, servos(2)).arm()
        port = Port(board)
        with pytest.raises(DermisError, match="was not paired.*moving.*reset it"):
            drain(pair_over(port, "Lab", "", port.clock, port.wait))
        assert HostSeals(board.key) and not file.exists()


def test_a_board_that_nobody_has_paired_is_named_with_the_remedy(file: Path) -> None:
    with pytest.raises(DermisError, match="NOBODY01.*none is paired.*stream pair"):
        adapters.make("native-wifi", servos(2), {"board": "NOBODY01"})
    pairs.keep("DERMISU1", os.urandom(KEY))
    with pytest.raises(DermisError, match="NOBODY01.*DERMISU1"):
        adapters.make("native-wifi", servos(2), {"board": "NOBODY01"})
    with pytest.raises(DermisError, match="simulated one's name"):
        pairs.keep(pairs.VIRTUAL, os.urandom(KEY))


@pytest.mark.parametrize(
    "text",
    [
        '{"a": {"key": "' + "00" * 32 + '"}}',
        '{"a": {"key": "' + "00" * 32 + '", "address": 3}}',
        '{"a": {"key": "00", "address": ""}}',
        "",
        "[]",
        "3",
        '{"a": 3}',
        '{"a": "00"}',
        '{"a": "' + "0g" * 32 + '"}',
        "{",
        "null",
        "[" * 100_000,
    ],
)
def test_a_file_that_holds_no_keys_is_refused_and_not_overwritten(text: str, file: Path) -> None:
    file.parent.mkdir()
    file.write_text(text)
    with pytest.raises(DermisError, match="pairs.json"):
        pairs.key_of("DERMISU1")
    with pytest.raises(DermisError, match="pairs.json"):
        pairs.keep("DERMISU1", bytes(KEY))
    assert file.read_text() == text


def test_a_file_of_keys_alone_is_read(file: Path) -> None:
    key = os.urandom(KEY)
    file.parent.mkdir()
    file.write_text(json.dumps({"BOARD001": key.hex()}))
    pairs.keep("BOARD002", bytes(KEY), "udp://h:1?board=BOARD002")
    assert pairs.key_of("BOARD001") == key and pairs.addresses() == {"BOARD002": "udp://h:1?board=BOARD002"}


def test_keys_of_other_boards_stay(file: Path) -> None:
    one, two = os.urandom(KEY), os.urandom(KEY)
    pairs.keep("BOARD001", one)
    pairs.keep("BOARD002", two)
    assert pairs.key_of("BOARD001") == one and pairs.key_of("BOARD002") == two
    assert set(json.loads(file.read_text())) == {"BOARD001", "BOARD002"}
