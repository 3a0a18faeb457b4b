"""The simulated device, for every protocol and with faults.

It serves a link of this process, or is a program of its own. Options of the URL: `loss`, `delay`, `jitter`, `corrupt`,
`slow` (see faults.py), `stuck` (index of an actuator that does not move), `skew`, `freeze`, `jump` (faults of its
clock), `finger` (1: a finger draws circles on its touch panel), `seed`. Settings of a simulated Maestro: `board_crc`,
`board_number`, `board_timeout`. Settings of simulated servos: `board_first` (id of the first), `board_twin` (id of an
additional servo), `board_model`, `board_fast`, `board_mode` (Dynamixel), `board_scs` (Feetech).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any, Protocol

from ... import clock
from ...errors import DermisError
from ..links.url import Url
from ..protocols.wire import Wire
from . import faults as faults_module
from .faults import Faults, FaultyClock

DEVICES = {
    "native": ("native", "NativeDevice"),
    "native-wifi": ("native_wifi", "NativeWifiDevice"),
    "maestro": ("maestro", "MaestroDevice"),
    "servo-animation": ("servo_animation", "ServoAnimationDevice"),
    "dynamixel": ("servo_bus", "DynamixelDevice"),
    "feetech": ("servo_bus", "FeetechDevice"),
    "torque": ("torque", "TorqueDevice"),
    "osc": ("osc", "OscDevice"),
}
SERVO_BOARDS = {"dynamixel": ("first", "twin", "model", "fast", "mode"), "feetech": ("first", "twin", "scs")}
IDLE = 0.001  # [s] longest wait for data, after which the clock is read again
FINGER_HZ = 100.0  # [Hz] reports of the finger


class Device(Protocol):
    """The interface of all virtual devices."""

    datagrams: bool

    def feed(self, data: bytes, now: float) -> list[bytes]: ...  # noqa: D102
    def tick(self, now: float) -> list[bytes]: ...  # noqa: D102
    def report(self) -> dict[str, object]: ...  # noqa: D102


def make(protocol: str, wire: Wire, options: dict[str, float]) -> Device:
    """Make a simulated device of a protocol.

    Raises:
        DermisError: no such protocol, or no such actuator for `stuck`.
    """
    stuck = int(options.get("stuck", -1))
    if not -1 <= stuck < wire.count:
        raise DermisError("no such actuator", where="stuck", value=stuck, limit=f"0 to {wire.count - 1}")
    if protocol not in DEVICES:
        raise DermisError("no such protocol", value=protocol, limit=", ".join(DEVICES))
    module, name = DEVICES[protocol]
    faulty = FaultyClock(*(options.get(key, 0.0) for key in ("skew", "freeze", "jump")))
    # Only the devices of these protocols have a clock.
    more: dict[str, Any] = {"clock": faulty} if protocol in ("native", "native-wifi") else {}
    if protocol == "maestro":
        crc, number, timeout = (
            options.get(f"board_{key}", d) for key, d in (("crc", 0), ("number", 12), ("timeout", 0))
        )
        more = {"crc": bool(crc), "number": int(number), "timeout": timeout}
    if protocol in SERVO_BOARDS:
        names = [name for name in SERVO_BOARDS[protocol] if f"board_{name}" in options]
        more = {name: int(options[f"board_{name}"]) for name in names}
    return getattr(import_module(f".{module}", __package__), name)(wire, stuck=stuck, **more)


def options_of(url: Url) -> dict[str, float]:
    """Remove the options of the simulated device from a URL, and return them.

    Raises:
        DermisError: an option is not a number, or outside its limits.
    """
    out = {}
    for name in faults_module.NAMES:
        if name in url.options:
            out[name] = faults_module.number_of(name, url.take(name))
    return out


class Server:
    """Runs a simulated device at the other end of a link.

    Args:
        device: the simulated device.
        read: returns the data that arrive within a time [s]; [] for none, None if the link is closed.
        write: sends one message. options: faults, see the module.
    """

    def __init__(
        self,
        device: Device,
        read: Callable[[float], list[bytes] | None],
        write: Callable[[bytes], None],
        options: dict[str, float],
    ) -> None:
        self.device = device
        self._read, self._write = read, write
        loss, delay, jitter, corrupt = (options.get(name, 0.0) for name in ("loss", "delay", "jitter", "corrupt"))
        seed = int(options.get("seed", 1))
        self._in, self._out = (Faults(loss, delay, jitter, corrupt, seed=seed + k) for k in (0, 1))
        self._slow = options.get("slow", 0.0)
        self._finger = bool(options.get("finger", 0.0))
        self._touch_at = 0.0
        self._credit, self._credited = 0.0, clock.now()

    def step(self) -> bool:
        """Process arrived data and due work; return False if the link is closed."""
        wait = IDLE
        now = clock.now()
        if self._slow:
            self._credit = min(self._credit + (now - self._credited) * self._slow, max(self._slow * 0.02, 1.0))
            self._credited = now
            if self._credit < 1:
                time.sleep(IDLE)
                self._serve(clock.now(), [])
                return True
        messages = self._read(wait)
        if messages is None:
            return False
        self._credit -= sum(map(len, messages))
        self._serve(clock.now(), messages)
        return True

    def _serve(self, now: float, messages: list[bytes]) -> None:
        for message in messages:
            self._in.put(message, now)
        for message in self._in.get(now):
            for answer in self.device.feed(message, now):
                self._out.put(answer, now)
        for answer in self.device.tick(now):
            self._out.put(answer, now)
        if self._finger and now >= self._touch_at:
            self._touch_at = now + 1.0 / FINGER_HZ
            x, y = 0.03 * math.cos(2 * now), 0.03 * math.sin(2 * now)
            touched = getattr(self.device, "touched", None)
            if touched is not None:
                self._out.put(touched(True, x, y, now), now)
        for answer in self._out.get(now):
            self._write(answer)

    @property
    def delayed(self) -> int:
        """Number of messages to the device that are still delayed."""
        return len(self._in)

    @property
    def read_most(self) -> int:
        """Largest number of bytes to read at once, small for a slow reader."""
        return max(int(self._credit), 1) if self._slow else 65536
