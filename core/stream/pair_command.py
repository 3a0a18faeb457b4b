"""`stream pair`: pairs a Wi-Fi board with this computer over USB.

After that the board answers this computer alone.
"""

from __future__ import annotations

import argparse
import getpass
import os
import re
import time
from collections.abc import Callable, Generator
from contextlib import closing
from typing import NamedTuple

from ..errors import DermisError
from ..steps import drain
from .links.serial_port import Serial
from .links.transport import Transport
from .links.url import Url
from .local_stream import say
from .protocols import pairs
from .protocols.sealed import KEY, pairing_check

BAUD = 115_200
STARTS = 8.0  # [s] wait for a first answer: opening the port may reset the board, which then prints its boot text
ANSWERS = 5.0  # [s] wait for the answer to a pairing: the board needs a moment to write into its flash
JOINS = 25.0  # [s] wait for an address: a network may take so long to give one
AGAIN = 0.5  # [s] between two repeats of a question
NETWORK, PASSWORD = range(1, 33), range(8, 64)  # [bytes] length of a network's name, length of a password
NO_ADDRESS = "Check the network's name and password (2.4 GHz alone), and pair again"


class Paired(NamedTuple):
    """A paired board.

    Attributes:
        board: its name. address: its address in the network, '' while it has none.
    """

    board: str
    address: str


class Wait(NamedTuple):
    """A report from within a step of pairing, which waits for the board.

    Attributes:
        stage: the step, for people. done: time passed [0.1 s]. total: longest time that the step may take [0.1 s].
    """

    stage: str
    done: int
    total: int


def pair(options: argparse.Namespace) -> int:
    """Pair a board, and print its address.

    Raises:
        DermisError: the port cannot be opened, the network's name or password has an impossible length, or the board
            is not paired or has not joined the network.
    """
    _check(options.network.encode(), b"")
    with closing(open_port(options.url)) as link:  # opened before anybody types a password
        password = "" if options.open else getpass.getpass(f"Password of '{options.network}': ")
        board, address = drain(_joined(link, options.network, password))
    say(f"'{board}' is paired with this computer alone; the key is in {pairs.path()}.")
    say(f"In a shell, quote its address: --url '{address}'")
    print(address)
    return 0


def pair_at(port: str, network: str, password: str) -> Generator[Wait, None, Paired]:
    """Open a serial port, and pair the board at its other end.

    The port is closed at the end, and also if the generator is closed before.

    Args:
        port: name of the port. network, password: of the Wi-Fi; an empty password means none.

    Raises:
        DermisError: the port cannot be opened, the network's name or password has an impossible length, or the board
            is not paired or has not joined the network.
    """
    _check(network.encode(), password.encode())
    with closing(open_port(port)) as link:
        return (yield from _joined(link, network, password))


def open_port(port: str) -> Serial:
    """Open the serial port of a board that is to be paired.

    Raises:
        DermisError: the name is empty or that of no serial port, or the port cannot be opened.
    """
    if not port.strip():
        raise DermisError("no port is given", remedy="Plug the board in by USB, and name its serial port")
    url = Url(port)
    if url.scheme != "serial":
        raise DermisError(
            "a board is paired over USB", where="port", value=port, limit="a serial port, as /dev/ttyUSB0 or COM3"
        )
    return Serial(url.place, BAUD)


def _joined(link: Transport, network: str, password: str) -> Generator[Wait, None, Paired]:
    """Pair the board at an open port.

    Raises:
        DermisError: the board is not paired, or has not joined the network.
    """
    paired = yield from pair_over(link, network, password, time.monotonic, time.sleep)
    if not paired.address:
        raise DermisError(
            f"the board '{paired.board}' is paired, and has not joined the network within {JOINS:g} s",
            where=network,
            remedy=NO_ADDRESS,
        )
    return paired


def pair_over(
    link: Transport, network: str, password: str, clock: Callable[[], float], wait: Callable[[float], None]
) -> Generator[Wait, None, Paired]:
    """Pair the board at the other end of a serial port.

    Args:
        network, password: of the Wi-Fi; an empty password means none.
        clock, wait: return the time, and wait for a time [s].

    Raises:
        DermisError: the name or password has an impossible length, or the board refuses or does not answer.
    """
    name, secret = network.encode(), password.encode()
    _check(name, secret)
    talk = _Talk(link, clock, wait)
    where = r"(?:unpaired|at) (\S{8})(?: [0-9a-f]{8} [0-9a-f]{4})?"
    board = (yield from talk.ask("waiting for the board", "where", where, STARTS, again=AGAIN))[1]
    key = os.urandom(KEY)
    said = yield from talk.ask(
        "giving it a key",
        f"pair {key.hex()} {name.hex()} {secret.hex() or '-'}",
        rf"(?:paired {re.escape(board)} ([0-9a-f]{{16}})|refused (\w+))",
        ANSWERS,
    )
    if said[1] != pairing_check(key).hex():
        why = {
            "moving": "Let it stand still first: reset it",
            "flash": "Its flash cannot be written: take another board",
        }
        raise DermisError(
            "the board was not paired",
            where=link.name,
            value=said[2] or "it has kept another key",
            remedy=why.get(said[2] or "", "Try again with a better cable"),
        )
    pairs.keep(board, key)
    at = rf"at {re.escape(board)} ([0-9a-f]{{8}}) ([0-9a-f]{{4}})"
    found, begun = "", clock()
    while not found and (passed := clock() - begun) < JOINS:
        answer = yield from talk.ask("waiting for the board", "where", at, STARTS, again=AGAIN)
        four, port = bytes.fromhex(answer[1]), int(answer[2], 16)
        if any(four):
            found = f"udp://{'.'.join(map(str, four))}:{port}?board={board}"
            pairs.keep(board, key, found)
        else:
            yield Wait("joining the network", round(10 * passed), round(10 * JOINS))
            wait(AGAIN)
    return Paired(board, found)


def _check(name: bytes, secret: bytes) -> None:
    """Refuse a network's name or password of an impossible length."""
    if len(name) not in NETWORK or (secret and len(secret) not in PASSWORD):
        raise DermisError(
            "no Wi-Fi has such a name or password",
            value=f"{len(name)} and {len(secret)} bytes",
            limit="1 to 32 bytes, and 8 to 63 or none",
        )


class _Talk:
    """Questions to a board in lines of text, among its other output."""

    def __init__(self, link: Transport, clock: Callable[[], float], wait: Callable[[float], None]) -> None:
        self._link, self._clock, self._wait, self._text = link, clock, wait, ""

    def ask(
        self, stage: str, line: str, answer: str, seconds: float, *, again: float = 1e9
    ) -> Generator[Wait, None, re.Match[str]]:
        """Send a line, and return the line that answers it.

        Args:
            stage: the step, for people. line: the question. answer: pattern of the answer.
            seconds: longest wait [s]. again: the question is repeated after this time [s]; by default it is sent once.

        Raises:
            DermisError: nobody answers in that time.
        """
        begun = due = self._clock()
        while (passed := self._clock() - begun) < seconds:
            if self._clock() >= due:
                self._link.send(f"\n{line}\n".encode())
                due = self._clock() + again
            self._text += b"".join(self._link.receive()).decode("ascii", "replace")
            *lines, self._text = self._text.split("\n")
            for text in lines:
                if found := re.fullmatch(answer, text.strip()):
                    return found
            yield Wait(stage, round(10 * passed), round(10 * seconds))
            self._wait(0.01)
        raise DermisError(
            f"the board did not answer within {seconds:g} s",
            where=self._link.name,
            remedy="Flash dermis_servos with DERMIS_WIFI, close every serial monitor, and check port and cable",
        )
