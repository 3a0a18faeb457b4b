"""An NI device: on a fake of its documented calls, which are held against the maker's package where that is there."""

from __future__ import annotations

import argparse
import importlib
import inspect
import io
import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.parameters.wave import WAVE
from core.presets import Library
from core.stream.daq import ni, play
from core.stream.daq.force_sensor import SCHEMA, ForceSensor
from core.stream.daq.ni import AHEAD, CHUNK, Daq
from core.stream.signals import Signals
from core.track import export
from core.track.command_track import CommandTrack
from tests.unit.stream.daq import fake_nidaqmx
from tests.unit.stream.daq.fake_nidaqmx import Device

COIL = Library().device("voice_coil")
RATE = 48_000
MATRIX = np.random.default_rng(1).normal(size=(3, 6))
SENSOR = ForceSensor("a sensor", ("Fx", "Fz", "Tz"), ("N", "N", "N m"), 10.0, tuple(map(tuple, MATRIX.tolist())))


def track(folder: Path, seconds: float = 0.5) -> Path:
    t = np.arange(round(8000 * seconds) + 1) / 8000.0
    path = folder / "coil.csv"
    wave = CommandTrack(COIL, t, np.column_stack([0 * t, 2.0 * np.sin(2 * np.pi * 250.0 * t)]))
    export.write(wave, path)
    return path


def options(folder: Path, **more: Any) -> argparse.Namespace:
    plain = {f"wav_{name}": None for name in WAVE}
    given = {"track": track(folder), "output": "Dev1/ao0", "inputs": "", "sensor": None, "forces": None, "yes": True}
    return argparse.Namespace(**{**plain, "wav_gain": 1.0, **given, **more})


def sensing(folder: Path) -> dict[str, Any]:
    SENSOR.save(folder / "sensor.json")
    return {"inputs": "Dev1/ai0:5", "sensor": folder / "sensor.json", "forces": folder / "forces.csv"}


def test_every_sample_is_given_once_between_zeros(tmp_path: Path) -> None:
    device = Device()
    assert play.run(options(tmp_path), device.package, Signals()) == 0
    wanted, wave = play.volts_of(export.read(tmp_path / "coil.csv"), {})
    given = np.array(device.given)
    lead = (AHEAD - 1) * round(CHUNK * RATE)
    assert wave.rate == RATE and not given[:lead].any() and device.at == 0.0
    assert np.array_equal(given[lead : lead + len(wanted)], wanted) and not given[lead + len(wanted) :].any()
    assert all(task.closed for task in device.tasks)


def test_forces_are_the_matrix_times_volts_without_the_tare(tmp_path: Path) -> None:
    device = Device()
    assert play.run(options(tmp_path, **sensing(tmp_path)), device.package, Signals()) == 0
    lines = (tmp_path / "forces.csv").read_text("utf-8").splitlines()
    head = {name: json.loads(value) for name, _, value in (line[2:].partition(": ") for line in lines[1:4])}
    assert lines[0] == "# dermis-forces 1" and lines[4] == "t_s,Fx[N],Fz[N],Tz[N m]"
    assert head["tare_volts"] == pytest.approx(device.offset.tolist()) and head["sensor"] == "a sensor"
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[5:]])
    assert np.allclose(np.diff(rows[:, 0]), 1e-3, atol=2e-6), "a thousand a second, evenly"
    given = np.array(device.given)[device.started_at :][: 48 * len(rows)]
    force = ((given[:, None] * device.slope) @ MATRIX.T).reshape(len(rows), 48, 3).mean(axis=1)
    assert len(rows) >= 500 and np.abs(force - rows[:, 1:]).max() < 1e-6, "a row is the mean of 48 readings"


def test_inputs_are_sampled_by_the_outputs_clock() -> None:
    device = Device()
    daq = Daq(device.package, "Dev1/ao0", "Dev1/ai0:5", RATE, 5.0)
    assert daq.channels == 6 and [task.source for task in device.tasks] == ["", "/Dev1/ao/SampleClock"]
    daq.close()


@pytest.mark.parametrize("at", [0.0, 0.1, 0.3])
def test_a_signal_ends_it_at_zero_volts_within_the_buffer(at: float, tmp_path: Path) -> None:
    device, signals = Device(), Signals()

    class Late(Signals):
        @property
        def number(self) -> int:  # type: ignore[override]
            return signal.SIGTERM if len(device.given) >= at * RATE else 0

        @number.setter
        def number(self, value: int) -> None:
            pass

    signals = Late()
    assert play.run(options(tmp_path), device.package, signals) == 128 + signal.SIGTERM
    given = np.array(device.given)
    last = np.flatnonzero(given)[-1] if given.any() else 0
    assert last <= at * RATE + (AHEAD + 1) * round(CHUNK * RATE) and device.at == 0.0
    assert np.abs(np.diff(given)).max(initial=0.0) < 0.1, "no jump on the way"


@pytest.mark.parametrize("fault", ["dry_after", "gone_after"])
def test_a_device_that_stops_is_told_zero_volts_and_named(fault: str, tmp_path: Path) -> None:
    device = Device()
    setattr(device, fault, 40_000)
    with pytest.raises(DermisError, match="ran dry, or is gone.*Switch the amplifier off"):
        play.run(options(tmp_path, **sensing(tmp_path)), device.package, Signals())
    assert (device.at == 0.0) == (fault == "dry_after") and all(task.closed for task in device.tasks)


def test_a_device_that_refuses_the_last_zero_volts_is_named(tmp_path: Path) -> None:
    device = Device()
    device.refuses_rest = True
    with pytest.raises(DermisError, match="refused the final 0 V.*The resource is reserved.*Switch the amplifier off"):
        play.run(options(tmp_path), device.package, Signals())
    assert all(task.closed for task in device.tasks)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"output": "Dev2/ao0"}, r"Dev2/ao0 at 48000 Hz.*\(found '[^;]*does not exist[^;]*'\)"),
        ({"output": "Dev1/ao0:1"}, "exactly one output must be named"),
        ({"wav_rate": 192_000}, "192000"),
        ({"wav_rate": 96_000}, "cannot run at this rate.*95000"),
        ({"wav_gain": None}, "voltage at the device is not known.*found 'no --wav-gain'"),
        ({"wav_full_scale": 20.0}, "more than an NI device gives"),
        ({"inputs": "Dev1/ai0:5"}, "go together"),
    ],
)
def test_what_the_device_does_not_take_is_refused_before_anything_is_given(
    more: dict[str, Any], words: str, tmp_path: Path
) -> None:
    device = Device()
    device.fastest, device.coerces = 100_000.0, {96_000: 95_000.0}
    with pytest.raises(DermisError, match=words):
        play.run(options(tmp_path, **more), device.package, Signals())
    assert not device.given and all(task.closed for task in device.tasks)


def test_another_number_of_inputs_than_the_matrix_has(tmp_path: Path) -> None:
    more = {**sensing(tmp_path), "inputs": "Dev1/ai0:3"}
    with pytest.raises(DermisError, match="number of inputs differs"):
        play.run(options(tmp_path, **more), Device().package, Signals())


def test_the_voltage_that_is_announced_is_the_devices_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    more = {"wav_gain": 20.0, "wav_offset": 0.5, "yes": False}
    assert play.run(options(tmp_path, **more), Device().package, Signals()) == 0
    said = capsys.readouterr()
    assert "gets up to 2.5 V: Dev1/ao0 gives up to 0.125 V, times the stated gain of 20" in said.out
    assert "most sound cards" not in said.err


def test_a_full_input_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    device = Device()
    device.slope = np.full(6, 9.0)
    play.run(options(tmp_path, **sensing(tmp_path)), device.package, Signals())
    assert "at the end of its range" in capsys.readouterr().err


@pytest.mark.parametrize(
    "damage",
    [
        {"schema": "x"},
        {"matrix": []},
        {"matrix": [[1.0]] * 2},
        {"matrix": [[1.0], [1.0, 2.0], [1.0]]},
        {"matrix": [["1"]] * 3},
        {"matrix": [[True]] * 3},
        {"units": ["N", "N", "lb"]},
        {"units": ["N"]},
        {"channels": ["Fx", "Fx", "Tz"]},
        {"range": 0},
        {"range": 1e300},
        {"name": 3},
        {"more": 1},
    ],
)
def test_a_sensor_s_file_that_does_not_fit_is_refused(damage: dict[str, Any], tmp_path: Path) -> None:
    plain = {**json.loads(SENSOR.dumps()), **damage}
    path = tmp_path / "sensor.json"
    path.write_text(json.dumps(plain))
    with pytest.raises(DermisError):
        ForceSensor.load(path)
    path.write_text(SENSOR.dumps())
    assert ForceSensor.load(path) == SENSOR and SCHEMA in SENSOR.dumps()


def test_without_the_package_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ni, "find_spec", lambda name: None)
    with pytest.raises(DermisError, match="nidaqmx.*pip install nidaqmx"):
        ni.nidaqmx_package()


def test_the_fake_says_that_it_is_one_and_its_calls_are_the_maker_s() -> None:
    """Names and parameters; where the maker's package is installed."""
    assert "no NI device" in (fake_nidaqmx.__doc__ or "")
    nidaqmx = pytest.importorskip("nidaqmx", reason="nidaqmx IS NOT INSTALLED: the fake was not held against it")
    task, timing = importlib.import_module("nidaqmx.task"), importlib.import_module("nidaqmx.task._timing")
    channels = importlib.import_module("nidaqmx.task.collections")
    for made, real, names in (
        (fake_nidaqmx.Task.write, task.Task.write, ("data", "auto_start", "timeout")),
        (fake_nidaqmx.Task.read, task.Task.read, ("number_of_samples_per_channel", "timeout")),
        (fake_nidaqmx.Task.start, task.Task.start, ()),
        (fake_nidaqmx.Task.stop, task.Task.stop, ()),
        (fake_nidaqmx.Task.close, task.Task.close, ()),
        (
            fake_nidaqmx.Task._clock,
            timing.Timing.cfg_samp_clk_timing,
            ("rate", "source", "sample_mode", "samps_per_chan"),
        ),
        (
            fake_nidaqmx.Channels.add_ao_voltage_chan,
            channels.AOChannelCollection.add_ao_voltage_chan,
            ("physical_channel", "min_val", "max_val"),
        ),
        (
            fake_nidaqmx.Channels.add_ai_voltage_chan,
            channels.AIChannelCollection.add_ai_voltage_chan,
            ("physical_channel", "min_val", "max_val"),
        ),
    ):
        for name in names:
            assert name in inspect.signature(made).parameters and name in inspect.signature(real).parameters, name
    assert isinstance(timing.Timing.samp_clk_rate, property)
    for stream, names in ((task._out_stream.OutStream, ("output_buf_size", "regen_mode")),):
        assert all(isinstance(getattr(stream, name), property) for name in names)
    assert isinstance(task._in_stream.InStream.avail_samp_per_chan, property)
    for enum in (fake_nidaqmx.AcquisitionType, fake_nidaqmx.RegenerationMode):
        for member in enum:
            assert getattr(nidaqmx.constants, enum.__name__)[member.name].value == member.value
    assert issubclass(nidaqmx.errors.DaqError, nidaqmx.errors.Error)
    assert not issubclass(nidaqmx.errors.DaqNotFoundError, nidaqmx.errors.DaqError)


def test_the_package_without_its_driver_or_device_is_told_in_words() -> None:
    """By the maker's own package: most computers have neither."""
    nidaqmx = pytest.importorskip("nidaqmx", reason="nidaqmx IS NOT INSTALLED: it was not asked for its driver")
    with pytest.raises(DermisError, match="NI-DAQmx, is not installed|refused these settings"):
        ni.Daq(nidaqmx, "NoSuchDevice9/ao0", "", 1000.0, 1.0)
