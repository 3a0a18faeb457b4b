"""Serial ports, by pyserial, opened for this process alone."""

from __future__ import annotations

import contextlib
import math
import os
import select
from pathlib import Path
from typing import Any

from ...errors import DermisError
from .transport import Gone, Stream, cannot_open

DEVICES = Path("/sys/bus/usb-serial/devices")  # Linux: settings of USB serial chips
INSTALL = "Run 'pip install pyserial' with the Python that runs Dermis"
MAX_QUEUED = 0.02  # bytes may wait in a serial driver for this long [s]; then a newer value is better than an older


class Serial(Stream):
    """A serial port, opened for this process alone."""

    def __init__(self, place: str, baud: int) -> None:
        try:
            import serial
        except ImportError as error:
            raise DermisError("serial ports need pyserial", where=place, remedy=INSTALL) from error
        super().__init__(place)
        self._serial = serial_number(place)
        try:
            self._port = serial.Serial(None, baud, timeout=0, write_timeout=0, exclusive=True)
            self._port.port = place
            self._port.open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise cannot_open(place, error) from error
        self.keeps = latency_timer(place)
        self.baud, self.carries = baud, baud / 10  # eight bits, a start and a stop
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
        """Close the port; bytes still in the driver are thrown away, or the system would wait for them, up to 30 s.

        Who has something to lose asks `pending` first: a pseudo terminal does not tell, and loses it by a reset.
        """
        with contextlib.suppress(OSError, AttributeError):
            if self._queued():
                self._port.reset_output_buffer()
        with contextlib.suppress(OSError):
            self._port.close()


def latency_timer(place: str, devices: Path = DEVICES) -> float:
    """Return how long the port's chip may keep received bytes [s]; NaN where the system does not tell.

    Linux tells it of FTDI chips, which keep it for 16 ms unless they are told otherwise.
    """
    try:
        return int((devices / Path(os.path.realpath(place)).name / "latency_timer").read_text(encoding="ascii")) / 1e3
    except (OSError, ValueError):
        return math.nan


def slow_chip(place: str, keeps: float) -> str:
    """Say that a port's chip keeps answers for too long, and name the remedy."""
    name = Path(os.path.realpath(place)).name
    return (
        f"The chip of this port keeps answers for up to {1e3 * keeps:.0f} ms (its latency timer), and commands wait "
        f"for them. Set it to 1 ms: echo 1 | sudo tee {DEVICES / name / 'latency_timer'}, then connect again"
    )


def ports() -> list[tuple[str, str]]:
    """Return the serial ports of this computer: name, and other known details. Takes milliseconds to seconds."""
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
