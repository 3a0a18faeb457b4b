"""An open link to one device, with its protocol and waiting messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import DermisError
from .device_output import DeviceOutput, plain
from .links import capacity
from .links.serial_port import slow_chip
from .links.transport import Transport
from .log.row import Phase
from .outbox import Outbox
from .protocols.adapter import Adapter
from .recorder import Recorder

HANDSHAKE = 3.0  # [s] A device that has not been recognised within this time is given up.


class Connection:
    """One device, with its link and its protocol.

    Args:
        clock: read again just before a command leaves, see `Outbox`.

    Attributes:
        link: to the device. adapter: its protocol. outbox: commands on their way into the link. output: its values.
        recorder: logs the values sent, if a person asked for a log.

    Raises:
        DermisError: the protocol needs datagrams and this link has none, or the link cannot carry the commands.
    """

    def __init__(
        self,
        link: Transport,
        adapter: Adapter,
        output: DeviceOutput,
        counters: Counter[str],
        now: float,
        clock: Callable[[], float] | None = None,
    ) -> None:
        if adapter.datagrams and not link.datagrams:
            raise DermisError(f"{adapter.title} goes over udp://", where=link.name)
        capacity.check(adapter, link, output.rate)
        self.link, self.adapter, self.output = link, adapter, output
        self.outbox = Outbox(link, adapter, counters, capacity.bucket(adapter, link, output.rate), clock)
        self.recorder = Recorder()
        self._opened = now
        self._counters, self._refused = counters, 0
        self._slow = slow_chip(link.name, link.keeps) if link.keeps > adapter.bears else ""
        adapter.carries = link.carries
        adapter.opened(now)

    def receive(self, now: float) -> None:
        """Take the messages that have arrived.

        Raises:
            Gone: the link is closed.
        """
        for data in self.link.receive():
            self.adapter.receive(data, now)
        if self.adapter.refused > self._refused:
            self._counters["refused"] += self.adapter.refused - self._refused
            self._refused = self.adapter.refused

    def poll(self, now: float) -> bool:
        """Send the protocol's own messages.

        Returns whether the device has been recognised.

        Raises:
            DermisError: the device cannot be used, or has not answered.
            Gone: the link is closed.
        """
        if fault := self.take_fault():
            raise DermisError(fault, where=self.link.name)
        self.outbox.poll(now)
        if not self.adapter.ready and now - self._opened > HANDSHAKE:
            remedies = self.adapter.unanswered, self.adapter.at_baud if self.link.baud is not None else ""
            raise DermisError(
                f"no answer came within {HANDSHAKE:g} s", where=self.link.name, remedy=". ".join(filter(None, remedies))
            )
        return self.adapter.ready

    def take_fault(self) -> str:
        """Return the reason why the device cannot be used, and clear it.

        It is '' if there is none.
        """
        fault, self.adapter.fault = self.adapter.fault, ""
        return fault

    def note(self, now: float, play: float | None, sent: bool, phase: Phase) -> None:
        """Log the sample of the limiter's last step; see `Recorder.note`."""
        self.recorder.note(self.output, self.adapter, now, play, phase, sent=sent)

    @property
    def output_hz(self) -> float:
        """Values a second that reach the actuators [Hz].

        That is the rate of the commands, or the rate that the device states if it is lower.
        """
        stated = self.adapter.output_hz
        return min(stated, self.output.rate) if stated else self.output.rate

    @property
    def ramp_period(self) -> float:
        """Time between two commands of a ramp to the safe state [s]."""
        return capacity.ramp_period(self.adapter, self.link, self.output.rate, self.output.wire.spec.rate)

    def status(self) -> dict[str, Any]:
        """Return the reports of link and device, as JSON values."""
        adapter = self.adapter
        return {
            "device": adapter.device,
            "silence": {
                "does": adapter.silence.does.value,
                "after_ms": plain(1e3 * adapter.silence.after),
                "by": adapter.silence.by,
                "text": str(adapter.silence),
            },
            "caution": adapter.caution,
            "output_hz": adapter.output_hz,
            "notice": ". ".join(filter(None, (adapter.notice, self._slow))),
            "round_trip_ms": plain(adapter.round_trip * 1e3),
            "protocol": dict(adapter.counters),
            "link": self.link.name,
            "received": self.link.report(),
            "reported": self._reported(),
            "sensed": self._sensed(),
        }

    def _sensed(self) -> dict[str, dict[str, float | None]]:
        """Return the actuators' measurements other than their pose.

        The keys are the name and unit of a measurement, and then the channel.
        """
        names = self.output.wire.names
        return {
            what: {name: plain(value) for name, value in zip(names, values.tolist(), strict=True)}
            for what, values in self.adapter.sensed.items()
        }

    def _reported(self) -> dict[str, float]:
        """Return the pose that the device reports, by channel [units].

        The device reports driven values. They are returned as the commands that drive them, because a track, the
        mechanism and its twin do not know the calibration. The result is empty if the device reports no pose.
        """
        wire, driven = self.output.wire, self.link.report().get("values")
        if driven is not None:
            at = np.array([driven[name] for name in wire.names])
        elif self.adapter.pose is not None:
            at = self.adapter.pose
        else:
            return {}
        return wire.named(wire.commanded(at))
