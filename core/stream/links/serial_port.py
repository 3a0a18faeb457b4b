"""Serial ports, by pyserial, opened for this process alone."""

from __future__ import annotations

import contextlib
import os
import select
from typing import Any

from ...errors import DermisError
from .transport import Gone, Stream, cannot_open

MAX_QUEUED = 0.02  # bytes may wait in a serial driver for this long [s]; then a newer value is better than an older


class Serial(Stream):
    """A serial port, opened for this process alone."""

    def __init__(self, place: str, baud: int) -> None:
        try:
            import serial
        except ImportError as error:
            raise DermisError("serial ports need pyserial", where=place, remedy="Install pyserial") from error
        super().__init__(place)
        self._serial = serial_number(place)
        try:
            self._port = serial.Serial(None, baud, timeout=0, write_timeout=0, exclusive=True)
            self._port.port = place
            self._port.open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise cannot_open(place, error) from error
        self.carries = baud / 10  # eight bits, a start and a stop
        self._budget = max(int(self.carries * MAX_QUEUED), 64)
        self._fd = self._port.fileno() if hasattr(select, "poll") else -1
        self._poll: Any = None
        if self._fd >= 0:
            self._poll = select.poll()
            self._poll.register(self._fd, select.POLLIN)

    def _has_room(self, size: int) -> bool:
        return self._queued() <= self._budget

    def _queued(self) -> int:
        with contextlib.suppress(OSError, AttributeError):  # not every driver tells
            return int(self._port.out_waiting)
        return 0

    def _write(self, data: bytes) -> int:
        try:
            if self._fd >= 0:  # pyserial spins where a port without time-out is full
                return os.write(self._fd, data)
            return int(self._port.write(data) or 0)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise Gone("the device is gone", where=self.name, value=error.strerror or str(error)) from error

    def receive(self) -> list[bytes]:
        try:
            if self._fd < 0:
                waiting = self._port.in_waiting
                return [self._port.read(waiting)] if waiting else []
            events = self._poll.poll(0)
            if not events:
                return []
            data = os.read(self._fd, 65536)
        except BlockingIOError:
            return []
        except OSError as error:
            raise Gone("the device is gone", where=self.name, value=error.strerror or str(error)) from error
        if not data:  # readable, and nothing to read: unplugged
            raise Gone("the device is gone", where=self.name)
        return [data]

    def report(self) -> dict[str, Any]:
        """Return the serial number that the USB port's maker gave it, where there is one."""
        return {"usb_serial": self._serial} if self._serial else {}

    def close(self) -> None:
        """Close the port; what the driver still holds is thrown away, or the system would wait for it, up to 30 s.

        Who has something to lose asks `pending` first: a pseudo terminal does not tell, and loses it by a reset.
        """
        with contextlib.suppress(OSError, AttributeError):
            if self._queued():
                self._port.reset_output_buffer()
        with contextlib.suppress(OSError):
            self._port.close()


def ports() -> list[tuple[str, str]]:
    """Return the serial ports of this computer: name, and what else is known of it. Takes milliseconds to seconds."""
    from serial.tools import list_ports

    return sorted((port.device, _more(port.device, port.description or "")) for port in list_ports.comports())


def _more(name: str, description: str) -> str:
    """Return a description without the port's name; '' where it says no more."""
    short = name.rpartition("/")[2]
    text = description.replace(f"({short})", "").replace(name, "").strip(" -")
    return "" if text in ("n/a", short) else text


def serial_number(place: str) -> str:
    """Return the USB serial number of a port, '' where it has none. Takes milliseconds to seconds."""
    from serial.tools import list_ports

    same = {place, os.path.realpath(place)}  # /dev/serial/by-id/... is another name of a port
    return next((str(p.serial_number) for p in list_ports.comports() if p.device in same and p.serial_number), "")
