"""Addresses of devices.

    /dev/ttyACM0, COM3, serial:/dev/ttyACM0?baud=115200     a serial port; without `baud` the protocol's own
    socket://host:port                                      a TCP connection
    udp://host:port                                         datagrams
    loop://                                                 every message sent comes back
    spy://URL?file=PATH                                     any other link, with a record of the bytes
    virtual:?loss=0.01&delay=0.02                           the simulated device (see virtual/device.py)

Options after the question mark that do not belong to the link are options of the protocol.
"""

from __future__ import annotations

from urllib.parse import parse_qsl

from ...errors import DermisError


class Url:
    """A link's address, taken apart.

    Attributes:
        scheme: 'serial', 'socket', 'udp', 'loop', 'spy' or 'virtual'. place: port, host:port or inner URL.
        options: the part after the question mark.
    """

    def __init__(self, text: str) -> None:
        self.text = text.strip()
        if not self.text:
            raise DermisError("no port is given", remedy="Enter one, or 'virtual:' for the simulated device")
        head, _, query = self.text.partition("?")
        try:
            self.options = dict(parse_qsl(query, strict_parsing=bool(query)))
        except ValueError as error:
            raise DermisError("the options are not NAME=VALUE pairs", where=self.text, value=query) from error
        scheme, colon, place = head.partition(":")
        known = ("serial", "socket", "udp", "loop", "spy", "virtual")
        if colon and scheme in known:
            self.scheme, self.place = scheme, place.removeprefix("//")
        elif "://" in head:
            raise DermisError("unknown kind of link", where=self.text, value=scheme, limit=", ".join(known))
        else:
            self.scheme, self.place = "serial", head
        if self.scheme == "spy" and not self.place:
            raise DermisError("spy:// needs the URL that it shall watch", where=self.text)

    def take(self, name: str, default: str = "") -> str:
        """Remove and return an option."""
        return self.options.pop(name, default)

    def host_port(self) -> tuple[str, int]:
        """Read the place as host and port.

        Raises:
            DermisError: the place is not HOST:PORT.
        """
        host, _, port = self.place.rstrip("/").rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise DermisError("not HOST:PORT", where=self.text, value=self.place)
        return host.strip("[]"), int(port)


def unnamed(url: str, message: str) -> str:
    """Return a URL to add to a message about its link.

    It is '' if the message names the link already.
    """
    place = url.partition("?")[0].removeprefix("spy://").removeprefix("serial:").removesuffix(":")
    return "" if place in message else url
