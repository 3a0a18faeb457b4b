"""Measured curves and frequency responses in a stream: what is wanted is reached, and no limit is passed."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.devices.frequency_response import FrequencyResponse
from core.devices.response import Points, Response
from core.devices.safe_state import safe_state
from core.devices.spec import DeviceSpec
from core.errors import DermisError
from core.presets import Library
from core.stream.device_output import DeviceOutput
from core.stream.output_limiter import OutputLimiter
from core.stream.protocols.wire import Wire
from core.stream.request import StreamRequest
from core.stream.source import source_of
from core.stream.track_source import TrackSource
from core.track import csv
from core.track.command_track import CommandTrack
from tests.second_order import measured, movement
from tests.unit.stream.stream_lab import Lab, sine_track

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

HAPTIP = Library().device("haptip")


def bent(low: float, high: float, play: float, bend: float, gain: float = 1.0) -> Response:
    """Return the curve of an actuator that is bent and has play."""
    grid = np.linspace(low, high, 41)
    middle = gain * grid + bend * (high - low) * np.sin(np.pi * (grid - low) / (high - low))
    pairs = [(grid, middle - play / 2), (grid, middle + play / 2)]
    up, down = (tuple(zip(x.tolist(), y.tolist(), strict=True)) for x, y in pairs)
    return Response(up, down)


def any_curve(rng: np.random.Generator, low: float, high: float) -> Response:
    """Return a curve drawn at random, which may reach much further than the limits, or less far."""
    span = high - low
    first, last = low - rng.uniform(-0.1, 0.2) * span, high + rng.uniform(-0.1, 0.2) * span
    return bent(first, last, rng.uniform(0, 0.1) * span, rng.uniform(-0.15, 0.15), rng.uniform(0.7, 1.6))


def calibrated(spec: DeviceSpec, curve: Callable[[float, float], Response]) -> Calibration:
    made = Calibration.of(spec)
    for channel in spec.channels:
        if channel.actuator:
            assert channel.low is not None and channel.high is not None
            made = made.with_entry(channel.name, response=curve(channel.low, channel.high))
    return made


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("key", ["haptip", "cable_platform", "thimble_3rrs"])
def test_no_curve_leads_beyond_the_limits(key: str, seed: int) -> None:
    """Whatever is wanted: what is driven keeps range, round range and speed, and what is reached keeps the range."""
    spec, rng = Library().device(key), np.random.default_rng(seed)
    made = calibrated(spec, lambda low, high: any_curve(rng, low, high))
    try:
        wire = Wire.of(spec, made)
    except DermisError as refusal:
        assert "safe state lies outside" in str(refusal)
        return
    plain = Wire.of(spec)
    limiter, period = OutputLimiter(wire), 1.0 / spec.rate
    limiter.begin(wire.safe, 0.0, 0.01)
    before, most = limiter.last, wire.slew * period
    reached = wire.responses.believe(before)
    for k in range(600):
        wanted = rng.normal(scale=rng.choice([1e-6, 1.0, 1e9]), size=wire.count)
        if k % 50 == 7:
            wanted[0] = rng.choice([math.nan, math.inf, -math.inf])
        driven = limiter.step(wanted, k * period)
        if k % 9 == 0:
            limiter.undo()
            continue
        slack = 1e-9 * np.maximum(np.abs(driven), 1.0)
        assert np.isfinite(driven).all()
        assert (driven >= plain.lower_limit - slack).all() and (driven <= plain.upper_limit + slack).all()
        assert (np.abs(driven - before) <= 2.0 * most * (1 + 1e-6) + 1e-12).all()
        if wire.disc is not None:
            assert np.hypot(driven[wire.disc[0]], driven[wire.disc[1]]) <= wire.disc[2] * (1 + 1e-9)
        before, reached = driven, wire.responses.believe(driven, reached)
        if k > 20:  # from where nobody knew the way it has got to where it is asked for
            assert (reached.reached >= plain.lower_limit - slack).all()
            assert (reached.reached <= plain.upper_limit + slack).all()
    assert any(name.endswith(".range") for name in limiter.limited)


def test_a_device_reaches_what_is_wanted_through_its_curve() -> None:
    """Jogged up and down through the whole sender; the board's pose is put through the actuator's own formula."""
    curve = bent(-0.5, 0.5, 0.02, 0.05)
    made = Calibration.of(HAPTIP).with_entry("pulley_1", response=curve)
    lab = Lab(mode="jog", jog={"pulley_1": 0.0}, ramp=0.0, calibration=made.dumps())
    lab.run(0.1)
    lab.arm()
    lab.run(0.2)
    reached = curve.follow(math.nan, float(lab.at[0]))
    for wanted in (0.1, 0.2, 0.15, -0.1, -0.05):
        lab.set(jog={"pulley_1": wanted})
        for _ in range(10):
            lab.run(0.1)
            reached = curve.follow(reached, float(lab.at[0]))
        assert reached == pytest.approx(wanted, abs=1e-3 * np.ptp(curve.reach)), "a count of the wire is far below"


def test_the_safe_pose_is_reached_by_the_curve_and_refused_outside() -> None:
    spec = Library().device("cable_platform")
    values = safe_state(spec)[1]
    name = next(c.name for c in spec.channels if c.actuator and c.name in values)
    k = Wire.of(spec).names.index(name)
    channel = spec.channel(name)
    assert channel.low is not None and channel.high is not None
    curve = bent(channel.low, channel.high, 0.02 * (channel.high - channel.low), 0.03)
    wire = Wire.of(spec, Calibration.of(spec).with_entry(name, response=curve))
    assert curve.between(float(wire.safe[k])) == pytest.approx(values[name], abs=1e-3 * (channel.high - channel.low))
    assert wire.safe_command[k] == pytest.approx(values[name], abs=1e-3 * (channel.high - channel.low))
    safe, span = values[name], channel.high - channel.low
    away = (
        (channel.low, safe - 0.02 * span)
        if safe - channel.low > channel.high - safe
        else (safe + 0.02 * span, channel.high)
    )
    with pytest.raises(DermisError, match="the safe state lies outside"):
        Wire.of(spec, Calibration.of(spec).with_entry(name, response=bent(*away, 0.0, 0.0)))


@pytest.mark.parametrize("points", [((0.0, 1.0), (300.0, 310.0)), ((-1.0, -2.0), (300.0, 310.0))])
def test_no_voltage_stays_none(points: Points) -> None:
    screen = Library().device("electrovibration")
    with pytest.raises(DermisError, match="for a command at rest"):
        Wire.of(screen, Calibration.of(screen).with_entry("amplitude", response=Response(points, points)))
    good: Points = ((0.0, 0.0), (150.0, 160.0), (300.0, 290.0))
    other: Points = ((0.0, 5.0), (150.0, 170.0), (300.0, 310.0))
    with pytest.raises(DermisError, match="for a command at rest"):
        Wire.of(screen, Calibration.of(screen).with_entry("amplitude", response=Response(good, other)))
    wire = Wire.of(screen, Calibration.of(screen).with_entry("amplitude", response=Response(good, good)))
    limiter = OutputLimiter(wire)
    limiter.begin(wire.safe, 0.0, 0.0)
    assert wire.safe[0] == 0.0 and wire.safe_command[0] == 0.0 and limiter.step(wire.safe_command, 1.0)[0] == 0.0
    assert limiter.step(np.array([160.0]), 2.0)[0] == pytest.approx(150.0)


def test_readings_in_degrees_that_say_so_nowhere_are_refused() -> None:
    """A straight line through 0, and yet 57 times too wide: nobody drove it there."""
    with pytest.raises(DermisError, match="much wider than the range"):
        Wire.of(HAPTIP, Calibration.of(HAPTIP).with_entry("pulley_1", response=bent(-28.0, 28.0, 0.0, 0.0)))


def test_a_track_is_played_earlier_by_the_latency(tmp_path: Path) -> None:
    path = sine_track(tmp_path / "t.csv")
    curve = Response(((-0.5, -0.5), (0.5, 0.5)), ((-0.5, -0.5), (0.5, 0.5)), latency=0.03)
    wire = Wire.of(HAPTIP, Calibration.of(HAPTIP).with_entry("pulley_1", response=curve))
    request = StreamRequest(mode="play", track=str(path), offset=0.1)
    play = source_of(request, wire, None, ())
    assert play.offset == pytest.approx(0.13)
    assert source_of(request, wire, play, ()).offset == pytest.approx(0.13), "once, however often it is chosen"


def test_a_straight_curve_changes_nothing() -> None:
    """The same commands as without a calibration, but for rounding."""
    straight = calibrated(HAPTIP, lambda low, high: Response(((low, low), (high, high)), ((low, low), (high, high))))
    rng, limiters = np.random.default_rng(5), [OutputLimiter(Wire.of(HAPTIP, made)) for made in (None, straight)]
    for k in range(500):
        wanted = rng.uniform(-1, 1, 2)
        first, second = (limiter.step(wanted, k / HAPTIP.rate) for limiter in limiters)
        assert np.allclose(first, second, rtol=0, atol=1e-12)
    assert limiters[0].limited == limiters[1].limited


# -- frequency response -----------------------------------------------------------------------------------------------


def burst_track(path: Path, centre: float, rate: float = 2000.0) -> tuple[Path, np.ndarray, np.ndarray]:
    """Write a burst on pulley 1; return what that is to do, and what has to be driven."""
    times = np.arange(0.0, 1.0, 1.0 / rate)
    wanted, exact = (0.01 * own for own in movement(times, centre))
    still = np.zeros_like(times)
    csv.write(CommandTrack(HAPTIP, times, np.column_stack([still, still, wanted, wanted])), path)
    return path, wanted, exact


def vibrating(hertz: float = 300.0, **more: Any) -> Calibration:
    return Calibration.of(HAPTIP).with_entry(
        "pulley_1", frequency=FrequencyResponse(measured(np.arange(1.0, hertz + 1.0))), **more
    )


def test_a_track_is_driven_so_that_a_vibrating_actuator_reaches_it(tmp_path: Path) -> None:
    path, wanted, exact = burst_track(tmp_path / "a.csv", 110.0)
    wire = Wire.of(HAPTIP, vibrating())
    source = source_of(StreamRequest(mode="play", track=str(path)), wire, None, ())
    assert isinstance(source, TrackSource)
    driven = np.array([source.value(t) for t in np.arange(len(wanted)) / 2000.0])
    assert np.abs(driven[:, 0] - exact).max() < 2e-4 * np.abs(exact).max()
    np.testing.assert_allclose(driven[:, 1], wanted, atol=1e-9), "the other one has no response"
    assert np.abs(wanted - exact).max() > 0.3 * np.abs(exact).max()


def test_another_calibration_under_way_is_taken(tmp_path: Path) -> None:
    path, wanted, exact = burst_track(tmp_path / "a.csv", 110.0)
    device = {"key": "haptip", "preset": Library().load("devices", "haptip")}
    request = StreamRequest(mode="play", track=str(path), device=device)
    output = DeviceOutput(request)
    output.choose_source(request, (), None, 0.0)
    source = output.source
    assert isinstance(source, TrackSource)
    k = int(np.abs(exact - wanted).argmax())
    plain = source.value(k / 2000.0)[0]
    output.recalibrate(vibrating())
    assert source.value(k / 2000.0)[0] == pytest.approx(exact[k], abs=2e-4 * np.abs(exact).max())
    output.recalibrate(None)
    assert source.value(k / 2000.0)[0] == plain == pytest.approx(wanted[k], abs=1e-9)
    with pytest.raises(DermisError, match="moves faster"):
        output.recalibrate(vibrating(60.0))
    assert source.value(k / 2000.0)[0] == plain and not output.wire.frequency, "what was refused changed nothing"
    again = replace(request, calibration=vibrating().dumps())
    later = DeviceOutput(again, source)  # connected anew, with the calibration
    later.choose_source(again, (), None, 0.0)
    assert isinstance(later.source, TrackSource)
    assert later.source.value(k / 2000.0)[0] == pytest.approx(exact[k], abs=2e-4 * np.abs(exact).max())


def test_a_track_that_is_faster_than_what_was_measured_is_refused(tmp_path: Path) -> None:
    path, _, _ = burst_track(tmp_path / "a.csv", 150.0)
    wire = Wire.of(HAPTIP, vibrating(100.0))
    with pytest.raises(DermisError, match=r"pulley_1.*100 Hz|moves faster.*pulley_1") as refused:
        source_of(StreamRequest(mode="play", track=str(path)), wire, None, ())
    assert "beyond 100 Hz" in str(refused.value) and "5 %" in str(refused.value)
    uneven = CommandTrack(HAPTIP, np.array([0.0, 0.1, 0.15]), np.zeros((3, 4)) + [[0.0], [0.01], [0.0]])
    csv.write(uneven, tmp_path / "b.csv")
    with pytest.raises(DermisError, match="evenly spaced"):
        source_of(StreamRequest(mode="play", track=str(tmp_path / "b.csv")), wire, None, ())


def test_a_latency_beside_a_frequency_response_is_refused_and_that_of_another_actuator_kept(tmp_path: Path) -> None:
    line = ((-0.5, -0.5), (0.5, 0.5))
    with pytest.raises(DermisError, match="already contains the latency"):
        vibrating(response=Response(line, line, latency=0.01))
    path, wanted, exact = burst_track(tmp_path / "a.csv", 110.0)
    wire = Wire.of(HAPTIP, vibrating().with_entry("pulley_2", response=Response(line, line, latency=0.01)))
    source = source_of(StreamRequest(mode="play", track=str(path)), wire, None, ())
    assert isinstance(source, TrackSource) and source.offset == pytest.approx(0.01)
    at = np.arange(len(wanted) - 20) / 2000.0 + source.offset
    driven = np.array([source.value(t) for t in at])
    assert np.abs(driven[:, 0] - exact[:-20]).max() < 2e-4 * np.abs(exact).max(), "it is in time"


def test_connect_tells_what_was_measured_and_live_movement_stays(tmp_path: Path) -> None:
    made = vibrating()
    (told,) = made.findings(HAPTIP, date(2026, 11, 27))
    assert (told.code, told.severity) == ("frequency-response", "info")
    assert "1 to 300 Hz" in str(told) and "live movement is not" in str(told)
    lab = Lab(mode="jog", jog={"pulley_1": 0.1}, ramp=0.0, calibration=made.dumps())
    lab.run(0.1)
    lab.arm()
    lab.run(0.5)
    assert lab.at[0] == pytest.approx(0.1, abs=1e-3)
    assert Calibration.loads(made.dumps()) == made
    older = made.dumps().replace("calibration 4", "calibration 3")
    with pytest.raises(DermisError, match="missing or unknown"):
        Calibration.loads(older)
    plain = json.loads(made.dumps())
    plain["schema"] = "dermis-calibration 3"
    del plain["actuators"]["pulley_1"]["frequency"]
    assert Calibration.loads(json.dumps(plain)).entries["pulley_1"].frequency is None, "files of version 3 are read"
