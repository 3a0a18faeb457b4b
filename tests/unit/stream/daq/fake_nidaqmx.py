"""A fake of the calls of `nidaqmx` that Dermis uses: it is no NI device, and none was at hand.

It keeps what the maker's documentation says of them: a task's clock, a buffer that is written with a time-out, no
regeneration, an output that holds its last voltage when its task ends, inputs on the output's clock. Its time passes by
what is written, not by a clock. `Device` holds what a real device would: limits, the voltage at its output, its faults.
"""

from __future__ import annotations

from enum import Enum
from types import SimpleNamespace
from typing import Any

import numpy as np


class Error(Exception):
    """Of the package; alone: there is no driver."""


class DaqError(Error):
    """As the package's own."""


class Device:
    """One simulated device, 'Dev1', and the module that stands for `nidaqmx` (`package`).

    Attributes:
        given: all voltages that its output gave. at: the one that it holds. load: voltages of its inputs for an output.
        fastest: [Hz]. gone_after, dry_after: samples after which it answers no more, or has run dry.
        refuses_rest: a single value is refused. coerces: the rate that it makes of another.
        started_at: samples that it had given when a task began last.
    """

    def __init__(self, inputs: int = 6) -> None:
        self.given: list[float] = []
        self.at = 0.0
        self.inputs = inputs
        self.offset, self.slope = np.arange(inputs) * 0.01 + 0.1, np.linspace(0.1, 0.6, inputs)
        self.fastest, self.gone_after = 250_000.0, 10**12
        self.coerces: dict[float, float] = {}
        self.dry_after = 10**12
        self.refuses_rest = False
        self.tasks: list[Task] = []
        self.started_at = 0
        self.package = SimpleNamespace(
            Task=lambda *_: Task(self),
            errors=SimpleNamespace(DaqError=DaqError, Error=Error),
            constants=SimpleNamespace(AcquisitionType=AcquisitionType, RegenerationMode=RegenerationMode),
        )


class AcquisitionType(Enum):
    """As the package's own."""

    CONTINUOUS = 10123


class RegenerationMode(Enum):
    """As the package's own."""

    DONT_ALLOW_REGENERATION = 10158


class Channels:
    """Channels of a task, of one direction."""

    def __init__(self, task: Task, kind: str) -> None:
        self._task, self._kind, self.names = task, kind, list[str]()

    def __len__(self) -> int:
        return len(self.names)

    def _add(self, physical_channel: str, min_val: float, max_val: float) -> None:
        first, _, last = physical_channel.partition(":")
        start = first.rpartition(f"/{self._kind}")
        if start[0].strip("/") != "Dev1" or not start[2].isdigit():
            raise DaqError(f"Physical channel specified does not exist on this device.\n{physical_channel}")
        numbers = range(int(start[2]), int(last or start[2]) + 1)
        if numbers[-1] >= (2 if self._kind == "ao" else self._task.device.inputs):
            raise DaqError("Physical channel specified does not exist on this device.")
        self.names += [f"Dev1/{self._kind}{n}" for n in numbers]
        self._task.range = max_val
        assert min_val == -max_val

    def add_ao_voltage_chan(self, physical_channel: str, *, min_val: float = -10.0, max_val: float = 10.0) -> None:
        self._add(physical_channel, min_val, max_val)

    def add_ai_voltage_chan(self, physical_channel: str, *, min_val: float = -5.0, max_val: float = 5.0) -> None:
        self._add(physical_channel, min_val, max_val)


class Task:
    """A task of the device; see the module."""

    def __init__(self, device: Device) -> None:
        self.device, self.range = device, 10.0
        self.ao_channels, self.ai_channels = Channels(self, "ao"), Channels(self, "ai")
        self.timing = SimpleNamespace(cfg_samp_clk_timing=self._clock, samp_clk_rate=0.0)
        self.out_stream = SimpleNamespace(output_buf_size=0, regen_mode=None)
        self.buffer: list[float] = []
        self.source, self.started, self.closed, self.read_so_far = "", False, False, 0
        device.tasks.append(self)

    @property
    def in_stream(self) -> Any:
        return SimpleNamespace(avail_samp_per_chan=len(self.device.given) - self.read_so_far)

    def _clock(
        self, rate: float, *, source: str = "", sample_mode: AcquisitionType, samps_per_chan: int = 1000
    ) -> None:
        assert sample_mode is AcquisitionType.CONTINUOUS and samps_per_chan > 0
        if rate > self.device.fastest:
            raise DaqError(f"Requested value is not supported: {rate}")
        self.source, self.timing.samp_clk_rate = source, self.device.coerces.get(rate, rate)

    def start(self) -> None:
        self.started, self.read_so_far = True, len(self.device.given)
        self.device.started_at = self.read_so_far

    def stop(self) -> None:
        self.started = False
        self.buffer.clear()

    def close(self) -> None:
        self.closed = True

    def __enter__(self) -> Task:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, data: Any, auto_start: bool = False, timeout: float = 10.0) -> int:
        device = self.device
        values = np.atleast_1d(np.asarray(data, float)).tolist()
        if any(abs(v) > self.range for v in values):
            raise DaqError("Requested value is outside the range of the channel.")
        if len(device.given) >= device.gone_after:
            raise DaqError("Device identifier is invalid.")
        if auto_start and device.refuses_rest:
            raise DaqError("The resource is reserved.")
        if auto_start:
            device.at = values[-1]
            return 1
        assert self.out_stream.regen_mode is RegenerationMode.DONT_ALLOW_REGENERATION
        self.buffer += values
        over = len(self.buffer) - self.out_stream.output_buf_size
        if self.started and over > 0:  # so much time has passed while it waited for room
            self._give(over)
            if len(device.given) >= device.dry_after:
                self.started = False
                raise DaqError("The generation has stopped to prevent the regeneration of old samples.")
        return len(values)

    def _give(self, count: int) -> None:
        out, self.buffer = self.buffer[:count], self.buffer[count:]
        self.device.given += out
        self.device.at = out[-1]

    def read(self, number_of_samples_per_channel: int, timeout: float = 10.0) -> Any:
        start, device = self.read_so_far, self.device
        out = np.array(device.given[start : start + number_of_samples_per_channel])
        self.read_so_far += len(out)
        rows = device.offset[:, None] + device.slope[:, None] * out[None, :]
        return rows.tolist() if len(rows) > 1 else rows[0].tolist()
