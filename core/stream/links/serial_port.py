"""Serial ports, opened by pyserial for exclusive use."""

from __future__ import annotations

import contextlib
import math
import os
import select
from pathlib import Path
from typing import Any

from ...errors import DermisError
from .transport import Gone, Stream, cannot_open

DEVICES = Path("/sys/bus/usb-serial/devices")  # folder of Linux with the settings of USB serial chips
INSTALL = "Run 'pip install pyserial' with the Python that runs Dermis"
# [s] time that the bytes in a serial driver may take to send. Beyond it no message is added, because a newer value sent
# later is better than an older one that waits.
MAX_QUEUED = 0.02


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
        self.baud, self.carries = baud, baud / 10  # a byte takes ten bits: a start bit, eight bits and a stop bit
        self._budget = max(int(self.carries * MAX_QUEUED), 64)
        self._fd = self._port.fileno() if hasattr(select, "poll") else -1
        self._poll: Any = None
        if self._fd >= 0:
            self._poll = select.poll()
            self._poll.register(self._fd, select.POLLIN)

    def _has_room(self, size: int) -> bool:
        return self._queued() <= self._budget

    def _queued(self) -> int:
        with contextlib.suppress(OSError, AttributeError):  # not every driver reports it
            return int(self._port.out_waiting)
        return 0

    def _write(self, data: bytes) -> int:
        try:
            if self._fd >= 0:  # os.write, since pyserial waits in a loop if a port with time-out 0 is full
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
        if not data:  # a port that is readable without data was unplugged
            raise Gone("the device is gone", where=self.name)
        return [data]

    def report(self) -> dict[str, Any]:
        """Return the USB serial number of the port, if it has one."""
        return {"usb_serial": self._serial} if self._serial else {}

    def close(self) -> None:
        """Close the port; bytes that are still in the driver are discarded.

        Otherwise the system would wait until they are sent, for up to 30 s. A caller that must not lose them waits
        until `pending` is 0. A pseudo-terminal reports an empty queue, so its buffer is not reset: a reset would
        discard bytes that the device has yet to read.
        """
        with contextlib.suppress(OSError, AttributeError):
            if self._queued():
                self._port.reset_output_buffer()
        with contextlib.suppress(OSError):
            self._port.close()


def latency_timer(place: str, devices: Path = DEVICES) -> float:
    """Return how long the port's chip may hold received bytes back [s].

    NaN: the system does not report it. Linux reports it for FTDI chips, whose default is 16 ms.
    """
    try:
        return int((devices / Path(os.path.realpath(place)).name / "latency_timer").read_text(encoding="ascii")) / 1e3
    except (OSError, ValueError):
        return math.nan


def slow_chip(place: str, keeps: float) -> str:
    """Return the message that a port's chip holds answers back, with its remedy."""
    name = Path(os.path.realpath(place)).name
    return (
        f"The chip of this port keeps answers for up to {1e3 * keeps:.0f} ms (its latency timer), and commands wait "
        f"for them. Set it to 1 ms: echo 1 | sudo tee {DEVICES / name / 'latency_timer'}, then connect again"
    )


def ports() -> list[tuple[str, str]]:
    """Return name and description of the serial ports of this computer.

    The call takes milliseconds to seconds.
    """
    from serial.tools import list_ports

    return sorted((port.device, _more(port.device, port.description or "")) for port in list_ports.comports())


def _more(name: str, description: str) -> str:
    """Return a description without the port's name; '' if nothing is left."""
    short = name.rpartition("/")[2]
    text = description.replace(f"({short})", "").replace(name, "").strip(" -")
    return "" if text in ("n/a", short) else text


def serial_number(place: str) -> str:
    """Return the USB serial number of a port; '' if it has none.

    The call takes milliseconds to seconds.
    """
    from serial.tools import list_ports

    same = {place, os.path.realpath(place)}  # /dev/serial/by-id/... is another name of a port
    return next((str(p.serial_number) for p in list_ports.comports() if p.device in same and p.serial_number), "")
