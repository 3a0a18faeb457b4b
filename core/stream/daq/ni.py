"""Output and inputs of an NI device on one hardware clock.

They use the maker's package `nidaqmx`, which has to be installed. Only documented calls are used; a test compares each
with the package's own signatures.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from ... import clock
from ...arrays import Array
from ...errors import DermisError

CHUNK = 0.005  # [s] time of the samples that are written at once
AHEAD = 8  # number of chunks in the device's buffer; a stop takes effect after them
PATIENCE = 0.5  # [s] longest wait for room in the buffer
HIGHEST = 10.0  # [V] largest voltage of an analog output of these devices
STEADY = 1e-4  # [1] largest relative error of the rate of the device's clock

Sink = Callable[[float, Array], None]


def nidaqmx_package() -> Any:
    """Return the maker's package.

    Raises:
        DermisError: it is not installed.
    """
    if find_spec("nidaqmx") is None:
        raise DermisError(
            "an NI device needs the Python package 'nidaqmx', which is not installed",
            where="NI device",
            remedy="Install NI-DAQmx, and run 'pip install nidaqmx' with the Python that runs Dermis",
        )
    import nidaqmx
    import nidaqmx.constants

    return nidaqmx


class Daq:
    """One output of a device and, with `inputs`, some of its inputs.

    The output's clock samples the inputs.

    Args:
        package: `nidaqmx`. output, inputs: physical channels, 'Dev1/ao0', 'Dev1/ai0:5'; '' for no inputs.
        rate: sampling rate of output and inputs [Hz]. volts: range of the output to either side of zero [V].
        sensed: range of the inputs to either side of zero [V].

    Attributes:
        output, rate: as above.
        channels: number of inputs.

    Raises:
        DermisError: the driver or the device is missing, or the device does not support a channel, range or rate.
    """

    def __init__(self, package: Any, output: str, inputs: str, rate: float, volts: float, sensed: float = 10.0) -> None:
        if not 0.0 < volts <= HIGHEST:
            raise DermisError(
                "the voltage is out of the range of these devices", where=output, value=f"{volts:g} V", limit="10 V"
            )
        self.output, self.rate = output, rate
        self._package, self._inputs = package, inputs
        self._out = self._in = None
        self._chunk = max(round(CHUNK * rate), 1)
        constants = package.constants
        device = output.strip("/").partition("/")[0]
        try:
            self._out = package.Task()
            self._out.ao_channels.add_ao_voltage_chan(output, min_val=-volts, max_val=volts)
            if len(self._out.ao_channels) != 1:
                raise self._refused("exactly one output must be named", f"{len(self._out.ao_channels)} are named")
            self._timed(self._out, "")
            self._out.out_stream.output_buf_size = AHEAD * self._chunk
            self._out.out_stream.regen_mode = constants.RegenerationMode.DONT_ALLOW_REGENERATION
            if inputs:
                self._in = package.Task()
                self._in.ai_channels.add_ai_voltage_chan(inputs, min_val=-sensed, max_val=sensed)
                self._timed(self._in, f"/{device}/ao/SampleClock")
        except package.errors.DaqError as error:
            self.close()
            raise self._refused("the NI device refused these settings", str(error)) from error
        except package.errors.Error as error:
            self.close()
            raise DermisError(
                "the driver of NI devices, NI-DAQmx, is not installed, or there is none for this system",
                where=f"NI device, {output}",
                value=str(error).splitlines()[0][:200],
                remedy="Install NI-DAQmx from ni.com: the Python package 'nidaqmx' alone is not enough",
            ) from error
        except DermisError:
            self.close()
            raise
        self.channels = len(self._in.ai_channels) if self._in is not None else 0

    def play(self, samples: Array, ended: Callable[[], bool], sink: Sink | None = None) -> int:
        """Play samples, then 0 V; return the number of samples played.

        Args:
            samples: voltages [V], shape (n,).
            ended: called before each chunk; once it returns True, the voltage falls to 0 V within a chunk.
            sink: takes readings [V], shape (n, channels), and before them the time of the first by this program's
                clock [s].

        Raises:
            DermisError: the device ran dry, is gone, or refused the final 0 V. The output is set to 0 V if the device
                still answers.
        """
        assert self._out is not None
        rest, played, stopping = samples, 0, False
        zeros, silent = np.zeros(self._chunk), 0
        try:
            for _ in range(AHEAD - 1):
                self._put(zeros)
            if self._in is not None:
                self._in.start()
            before = clock.now()
            self._out.start()
            self._began = 0.5 * (before + clock.now())
            self._read = 0
            while silent < AHEAD:
                part, rest = rest[: self._chunk], rest[self._chunk :]
                if not stopping and ended():
                    part, rest, stopping = part * np.linspace(1.0, 0.0, len(part)), rest[:0], True
                played += len(part)
                silent += not len(part)
                self._put(np.pad(part, (0, self._chunk - len(part))))
                self._take(sink)
            self._take(sink)
        except self._package.errors.DaqError as error:
            raise self._refused("the NI device has stopped by itself: it ran dry, or is gone", str(error)) from error
        finally:
            lost = self._rest()
        if lost:
            raise self._refused("the NI device refused the final 0 V: the voltage at its output is not known", lost)
        return played

    def sensed(self, seconds: float) -> Array:
        """Return readings of the inputs [V], shape (n, channels).

        They last for `seconds` [s], in which the output is at 0 V.

        Raises:
            DermisError: the device ran dry, or is gone.
        """
        found: list[Array] = []
        self.play(np.zeros(max(round(seconds * self.rate), 1)), lambda: False, lambda _time, volts: found.append(volts))
        return np.concatenate(found) if found else np.zeros((0, self.channels))

    def close(self) -> None:
        """Release the device. Safe to call twice."""
        for task in (self._out, self._in):
            if task is not None:
                task.close()
        self._out = self._in = None

    def _timed(self, task: Any, source: str) -> None:
        mode = self._package.constants.AcquisitionType.CONTINUOUS
        task.timing.cfg_samp_clk_timing(self.rate, source=source, sample_mode=mode, samps_per_chan=AHEAD * self._chunk)
        made = float(task.timing.samp_clk_rate)
        if abs(made / self.rate - 1.0) > STEADY:
            raise self._refused("the NI device's clock cannot run at this rate", f"{made:g} Hz")

    def _put(self, volts: Array) -> None:
        assert self._out is not None
        self._out.write(volts, auto_start=False, timeout=PATIENCE)

    def _take(self, sink: Sink | None) -> None:
        if self._in is None:
            return
        count = int(self._in.in_stream.avail_samp_per_chan)
        if count <= 0:
            return
        read = self._in.read(number_of_samples_per_channel=count, timeout=PATIENCE)
        volts = np.atleast_2d(np.array(read, np.float64))
        volts = volts.reshape(self.channels, -1).T
        if sink is not None:
            sink(self._began + self._read / self.rate, volts)
        self._read += len(volts)

    def _rest(self) -> str:
        """Stop both tasks, and set the output to 0 V; return the driver's words if it refuses, else ''.

        Otherwise the device would hold its last voltage after its task has ended.
        """
        for task in (self._out, self._in):
            if task is not None:
                try:
                    task.stop()
                except self._package.errors.DaqError:
                    continue  # the task has stopped by itself
        try:
            with self._package.Task() as last:
                last.ao_channels.add_ao_voltage_chan(self.output, min_val=-HIGHEST, max_val=HIGHEST)
                last.write(0.0, auto_start=True, timeout=PATIENCE)
        except self._package.errors.DaqError as error:
            return str(error) or "no reason is given"
        return ""

    def _refused(self, what: str, value: str) -> DermisError:
        return DermisError(
            what,
            where=f"NI device, {self.output} at {self.rate:g} Hz",
            value=value.splitlines()[0][:200] if value else None,
            remedy="Switch the amplifier off before you look for the cause",
        )
