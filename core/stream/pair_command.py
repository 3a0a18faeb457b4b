"""`stream pair`: a board with Wi-Fi is paired with this computer over USB; then it answers this computer alone."""

from __future__ import annotations

import argparse
import getpass
import os
import re
import time
from collections.abc import Callable

from ..errors import DermisError
from .links.open_link import open_link
from .links.transport import Transport
from .links.url import Url
from .local_stream import say
from .protocols import pairs
from .protocols.sealed import KEY, pairing_check

BAUD = 115_200
STARTS = 8.0  # opening the port may reset the board, which then prints its boot text [s]
ANSWERS = 5.0  # writing into its flash takes it a moment [s]
JOINS = 25.0  # a network may take so long to give an address [s]
AGAIN = 0.5  # [s]
NETWORK, PASSWORD = range(1, 33), range(8, 64)  # bytes


def pair(options: argparse.Namespace) -> int:
    """Pair a board, and print its address.

    Raises:
        DermisError: no such port, a network's name or password of an impossible length, or a board that does not do it.
    """
    password = "" if options.open else getpass.getpass(f"Password of '{options.network}': ")
    link = open_link(Url(f"serial:{options.url}?baud={BAUD}"), _no_virtual)
    try:
        board, address = pair_over(link, options.network, password, time.monotonic, time.sleep)
    finally:
        link.close()
    if not address:
        raise DermisError(
            "the board is paired, and has no address in the network",
            where=options.network,
            remedy="Check name and password (2.4 GHz alone), and pair again",
        )
    say(f"'{board}' is paired with this computer alone; the key is in {pairs.path()}.")
    print(address)
    return 0


def pair_over(
    link: Transport, network: str, password: str, clock: Callable[[], float], wait: Callable[[float], None]
) -> tuple[str, str]:
    """Pair the board at the other end of a serial port; return its name and its address, '' while it has none.

    Args:
        network, password: of the Wi-Fi; an empty password means none. clock, wait: [s].

    Raises:
        DermisError: a name or password of an impossible length, or a board that does not do it.
    """
    name, secret = network.encode(), password.encode()
    if len(name) not in NETWORK or (secret and len(secret) not in PASSWORD):
        raise DermisError(
            "no Wi-Fi has such a name or password",
            value=f"{len(name)} and {len(secret)} bytes",
            limit="1 to 32 bytes, and 8 to 63 or none",
        )
    talk = _Talk(link, clock, wait)
    board = talk.ask("where", r"(?:unpaired|at) (\S{8})(?: [0-9a-f]{8} [0-9a-f]{4})?", STARTS, again=AGAIN)[1]
    key = os.urandom(KEY)
    said = talk.ask(
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
    found, until = "", clock() + JOINS
    while not found and clock() < until:
        at = talk.ask("where", rf"at {re.escape(board)} ([0-9a-f]{{8}}) ([0-9a-f]{{4}})", STARTS, again=AGAIN)
        four, port = bytes.fromhex(at[1]), int(at[2], 16)
        if any(four):
            found = f"udp://{'.'.join(map(str, four))}:{port}?board={board}"
        else:
            wait(AGAIN)
    return board, found


class _Talk:
    """Questions to a board in lines of text, among whatever else comes."""

    def __init__(self, link: Transport, clock: Callable[[], float], wait: Callable[[float], None]) -> None:
        self._link, self._clock, self._wait, self._text = link, clock, wait, ""

    def ask(self, line: str, answer: str, seconds: float, *, again: float = 1e9) -> re.Match[str]:
        """Say a line, `again` and again where that does no harm; return the line that answers it.

        Raises:
            DermisError: nobody answers.
        """
        until, due = self._clock() + seconds, self._clock()
        while self._clock() < until:
            if self._clock() >= due:
                self._link.send(f"\n{line}\n".encode())
                due = self._clock() + again
            self._text += b"".join(self._link.receive()).decode("ascii", "replace")
            *lines, self._text = self._text.split("\n")
            for text in lines:
                if found := re.fullmatch(answer, text.strip()):
                    return found
            self._wait(0.01)
        raise DermisError(
            f"the board did not answer within {seconds:g} s",
            where=self._link.name,
            remedy="Flash dermis_servos with DERMIS_WIFI, close every serial monitor, and check port and cable",
        )


def _no_virtual(url: Url) -> Transport:
    raise DermisError("the simulated board needs no pairing", where=url.text)
