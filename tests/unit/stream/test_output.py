"""Actuators that take fewer values a second than a track holds: low-passed, within every limit, and said in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.spec import Channel, DeviceSpec
from core.presets import Library
from core.stream.lowpass import low_passed
from core.stream.protocols.wire import Wire
from core.stream.track_source import TrackSource
from core.stream.virtual.native import NativeDevice
from core.track import csv
from core.track.command_track import CommandTrack
from tests.unit.stream.stream_lab import Lab

HAPTIP = Library().device("haptip")
OUTPUT = 50.0  # of hobby servos [Hz]


def track_of(wave: Any, t: Any, spec: DeviceSpec = HAPTIP) -> CommandTrack:
    return CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, wave, 0 * t]))


def texture(t: Any, hertz: float) -> Any:
    return 0.2 * np.sin(2 * np.pi * t) + 0.05 * np.sin(2 * np.pi * hertz * t)


def test_what_the_output_cannot_show_goes_and_the_rest_stays_in_its_time() -> None:
    t = np.arange(5001) / 1000
    _, values = low_passed(t, np.column_stack([texture(t, 100.0), texture(t, 25.0)]), OUTPUT)
    slow, inner = 0.2 * np.sin(2 * np.pi * t), slice(100, -100)
    assert np.abs(values[inner, 0] - slow[inner]).max() < 5e-4, "100 Hz is gone, 1 Hz neither delayed nor damped"
    left = values[inner, 1] - slow[inner]
    assert np.abs(left).max() == pytest.approx(0.025, rel=0.02), "half at 25 Hz, as a Hann window has it"


@pytest.mark.parametrize("rate", [100.0, 250.0, 1000.0, 1234.5])
def test_no_limit_is_exceeded_that_the_track_keeps(rate: float) -> None:
    """Jumps, full speed, full range: the mean of what is allowed is allowed."""
    t = np.arange(int(3 * rate)) / rate
    rng = np.random.default_rng(7)
    values = np.clip(np.cumsum(rng.choice([-1.0, 1.0], (len(t), 2)) * 20.0 / rate, axis=0), -0.4, 0.4)
    _, out = low_passed(t, values, OUTPUT)
    assert np.abs(out).max() <= np.abs(values).max() + 1e-12
    assert np.abs(np.diff(out, axis=0)).max() <= np.abs(np.diff(values, axis=0)).max() + 1e-12


def test_no_delay() -> None:
    t = np.arange(2001) / 1000
    ramp = np.clip(t - 0.5, 0, 0.4)
    _, out = low_passed(t, ramp[:, None], OUTPUT)
    assert np.abs(out[550:880, 0] - ramp[550:880]).max() < 1e-12, "a straight line is played as it is, at its time"
    bump = np.exp(-(((t - 1) / 0.01) ** 2))
    _, out = low_passed(t, bump[:, None], OUTPUT)
    assert int(np.argmax(out[:, 0])) == 1000 and np.allclose(out[:, 0], out[::-1, 0]), "zero phase"


def test_unevenly_spaced_samples() -> None:
    t = np.unique(np.concatenate([np.arange(0, 2, 0.01), np.random.default_rng(3).uniform(0, 2, 4000)]))
    times, out = low_passed(t, texture(t, 100.0)[:, None], OUTPUT)
    slow = 0.2 * np.sin(2 * np.pi * times)
    assert np.ptp(np.diff(times)) < 1e-9 and np.abs(out[:, 0] - slow)[20:-20].max() < 0.02


def test_a_track_that_the_output_can_show_is_played_to_the_bit() -> None:
    t = np.arange(501) / 100
    wire = Wire.of(HAPTIP)
    for output in (0.0, 100.0, 1000.0):
        play = TrackSource(wire, track_of(texture(t, 10.0), t), output_hz=output)
        assert play.loss is None and play.value(1.23)[0] == texture(1.23, 10.0)


def test_few_uneven_samples_are_played_to_the_bit() -> None:
    t = np.array([0.0, 0.5, 0.53, 2.0])
    times, values = low_passed(t, texture(t, 3.0)[:, None], OUTPUT)
    assert times is t and values[2, 0] == texture(t, 3.0)[2]


def test_three_samples_do_not_become_a_thousand_million(tmp_path: Path) -> None:
    """A file of three lines took 3 GB and then the sender's life; now the device stays safe and it is said why."""
    t = np.array([0.0, 0.0001, 1e6])
    csv.write(track_of(0 * t, t), tmp_path / "t.csv")
    lab = Lab(track=str(tmp_path / "t.csv"))
    lab.run(0.2)
    lab.arm()
    lab.run(0.2)
    assert "Sample it evenly" in lab.streamer.message and not lab.streamer.armed


def test_the_loss_is_told_by_channel_in_its_unit() -> None:
    t = np.arange(5001) / 1000
    play = TrackSource(Wire.of(HAPTIP), track_of(texture(t, 100.0), t), output_hz=OUTPUT)
    assert play.loss is not None
    assert play.loss.largest[0] == pytest.approx(0.05, rel=0.1) and play.loss.rms[0] == pytest.approx(0.0354, rel=0.02)
    assert play.loss.largest[1] == 0.0
    said = str(play.loss)
    assert "50 values a second" in said and "above 25 Hz is not rendered: pulley_1 2.9 deg (rms 2)" in said
    assert "pulley_2" not in said, "nothing is lost there"
    calm = TrackSource(Wire.of(HAPTIP), track_of(0.1 * np.sin(t), t), output_hz=OUTPUT)
    assert str(calm.loss) == ""


def test_a_device_that_states_its_output_gets_the_low_passed_track(tmp_path: Path) -> None:
    """From WELCOME to the actuators: what arrives is the low-passed track at its time, at the device's full rate."""
    t = np.arange(5001) / 1000
    track = track_of(texture(t, 100.0), t)
    csv.write(track, tmp_path / "t.csv")
    lab = Lab(track=str(tmp_path / "t.csv"), ramp=0.0, look_ahead=0.1)
    opened = lab._open

    def open_with_output(*args: Any) -> Any:
        link = opened(*args)
        lab.device = NativeDevice(Wire.of(HAPTIP), output_hz=50)
        return link

    lab.streamer._open_link = open_with_output
    lab.run(0.3)
    status = lab.streamer.status()
    assert status["output_hz"] == 50.0 and "pulley_1 2.9 deg" in status["not_rendered"]
    lab.arm()
    lab.run(0.2)
    lab.playing = True
    lab.run(0.5)
    expected, off, received = TrackSource(Wire.of(HAPTIP), track, output_hz=OUTPUT), [], lab.device.received
    lab.run(2.0, lambda: off.append(lab.at[0] - expected.value(float(lab.time or 0.0))[0]))
    assert lab.device.received - received == pytest.approx(2000, abs=25)
    assert np.abs(off).max() < 2 * np.pi * 0.2 * 1.2e-3, "no more than a command's age"
    assert not lab.streamer.output.limiter.limited  # type: ignore[union-attr]


def test_what_is_live_is_not_low_passed() -> None:
    lab = Lab(mode="jog", jog={"pulley_1": 0.1}, ramp=0.0)
    lab.run(0.2)
    assert lab.streamer.status()["not_rendered"] == ""


def test_another_offset_does_not_average_the_track_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slider is dragged while a device waits for its next command."""
    from core.stream import track_source

    made: list[float] = []
    low = track_source.low_passed
    monkeypatch.setattr(track_source, "low_passed", lambda *given: made.append(given[2]) or low(*given))
    t = np.arange(2001) / 1000
    csv.write(track_of(texture(t, 100.0), t), tmp_path / "t.csv")
    lab = Lab(track=str(tmp_path / "t.csv"), rate=100.0, ramp=0.0)
    for offset in (0.0, 0.1, 0.2):
        lab.set(offset=offset)
        lab.run(0.05)
        assert lab.streamer.output.source.offset == offset  # type: ignore[union-attr]
    assert made == [100.0]


def test_a_round_range_stays_round() -> None:
    t = np.arange(3001) / 1000
    circle = 2e-3 * np.column_stack([np.cos(2 * np.pi * 9 * t), np.sin(2 * np.pi * 9 * t)])
    _, out = low_passed(t, circle, OUTPUT)
    assert np.hypot(*out.T).max() <= 2e-3


def test_channels_without_a_range_are_judged_by_the_track() -> None:
    spec = DeviceSpec("pin", "Pin", "test", 1000.0, (Channel("a", "N", actuator="a"),))
    t = np.arange(2001) / 1000
    play = TrackSource(Wire.of(spec), CommandTrack(spec, t, texture(t, 100.0)[:, None]), output_hz=OUTPUT)
    assert "a 0.051 N" in str(play.loss)
