"""A real finger on a screen: held at rest, still under jitter, followed when it moves; the same volts as a bake."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from core.effects.heading import REST_RADIUS, STILL_SPEED, Heading
from core.effects.slide import directions
from core.matching.screen_map import ScreenMap
from core.presets import Library
from core.stream.protocols.adapter import Touch
from core.stream.protocols.wire import Wire
from core.stream.touch_panel_source import PanelSource
from tests.unit.stream import stream_lab
from tests.unit.stream.stream_lab import Lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

SPEC = Library().device("electrovibration")
WIRE = Wire.of(SPEC)
WINDOW = 0.02
SPEED = 0.1  # of a finger that explores [m/s]
FULL = 10 ** (1.05 / 1.24) * 60 ** (1 / 1.24)  # [V] of friction 60: log10 f = 1.24 log10 V - 1.05

Path = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def ramp(maps: int = 1, **more: Any) -> ScreenMap:
    """Return the ramp of these tests, with their window for the direction."""
    return stream_lab.ramp(maps, direction_window=WINDOW, **more)


def felt(panel: PanelSource, times: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the volts after each report of a finger that stays down."""
    volts = []
    for t, at_x, at_y in zip(times.tolist(), x.tolist(), y.tolist(), strict=True):
        panel.touched(Touch(True, at_x, at_y, t), t)
        volts.append(float(panel.values_at(t, t)[0]))
    return np.array(volts)


def stroke(rate: float, *legs: tuple[float, float], start: float = -0.03) -> tuple[np.ndarray, np.ndarray]:
    """Return times and x of legs of (seconds, speed), reported at a rate."""
    ends = np.cumsum([0.0] + [seconds for seconds, _ in legs])
    corners = start + np.cumsum([0.0] + [seconds * speed for seconds, speed in legs])
    times = np.arange(round(ends[-1] * rate) + 1) / rate
    return times, np.interp(times, ends, corners)


@pytest.mark.parametrize("rate", [30.0, 60.0, 240.0, 1000.0])
def test_the_voltage_stays_while_the_finger_rests(rate: float) -> None:
    times, x = stroke(rate, (0.3, SPEED), (5.0, 0.0))
    volts = felt(PanelSource(WIRE, ramp()), times, x, 0 * x)
    assert volts[times > 0.1] == pytest.approx(FULL, rel=1e-3), "[S4]: the direction is held"


def test_a_resting_finger_keeps_its_voltage_through_the_sender() -> None:
    lab = Lab("native", "electrovibration", mode="panel", screen="map", ramp=0.0, load_screen=lambda path: ramp())
    lab.run(0.1)
    lab.arm()
    lab.run(0.1)
    for x in [*np.linspace(-0.03, 0.0, 30), *np.zeros(100)]:
        lab._answers.append(lab.device.touched(True, float(x), 0.0, lab.now))
        lab.run(0.01)
    assert lab.at[0] == pytest.approx(FULL, rel=1e-3), "a second after the finger stopped"


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("kind", ["uniform", "normal"])
@pytest.mark.parametrize("size", [1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("rate", [60.0, 120.0, 240.0])
def test_jitter_of_a_resting_finger_switches_nothing(rate: float, size: float, kind: str) -> None:
    """`size` [m] is half the range of the uniform jitter on each axis, the standard deviation of the normal one."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        noise = rng.normal(0, size, (2, 5000)) if kind == "normal" else rng.uniform(-size, size, (2, 5000))
        times, x = stroke(rate, (0.3, SPEED), (6.0, 0.0))
        volts = felt(PanelSource(WIRE, ramp()), times, x + noise[0, : len(x)], noise[1, : len(x)])
        assert volts[times > 0.1].min() > 0.95 * FULL, f"seed {seed}: neither moving nor at rest"
        assert np.ptp(volts[times > 0.5]) == 0.0, f"seed {seed}: on an even slope nothing changes at all"


@pytest.mark.parametrize("size", [1e-6, 1e-5, 1e-4])
def test_jitter_before_the_first_movement_is_none(size: float) -> None:
    rng = np.random.default_rng(7)
    panel = PanelSource(WIRE, ramp())
    volts = felt(panel, np.arange(2400) / 240, *rng.normal(0, size, (2, 2400)))
    assert not volts.any(), "0 V, as in a bake, until the finger moves"


@pytest.mark.parametrize("rate", [60.0, 120.0, 240.0])
@pytest.mark.parametrize("speed", [0.02, 0.1, 0.4])
def test_start_reversal_and_lifting_are_followed(speed: float, rate: float) -> None:
    """At the latest after two radii of way, two reports and the window: 53 ms at 0.1 m/s and 120 reports a second."""
    legs = 0.03 / speed
    times, x = stroke(rate, (0.5, 0.0), (legs, speed), (legs, -speed), (legs, speed), start=-0.015)
    panel = PanelSource(WIRE, ramp())
    volts = felt(panel, times, x, 0 * x)
    limit = 2 * REST_RADIUS / speed + WINDOW + 2 / rate
    for begin, wanted in ((0.5, FULL), (0.5 + legs, 0.0), (0.5 + 2 * legs, FULL)):
        span = (times >= begin + limit) & (times <= begin + legs)
        assert volts[span] == pytest.approx(wanted, abs=1e-3 * FULL)
    panel.touched(Touch(False, 0.0, 0.0, times[-1] + 0.01), times[-1] + 0.01)
    assert panel.values_at(0.0, times[-1] + 0.01)[0] == 0.0
    begin = times[-1] + 0.02
    panel.touched(Touch(True, 0.0, 0.0, begin), begin)
    assert panel.values_at(0.0, begin)[0] == 0.0, "a new touch has no direction yet"


def test_slow_motion_counts_and_drift_does_not() -> None:
    times, x = stroke(120.0, (4.0, 0.003), start=0.0)  # 3 mm/s
    assert felt(PanelSource(WIRE, ramp()), times, x, 0 * x)[-1] == pytest.approx(FULL, rel=1e-3)
    times, x = stroke(120.0, (60.0, 0.9 * STILL_SPEED), start=0.0)  # 5 mm in a minute
    assert not felt(PanelSource(WIRE, ramp()), times, x, 0 * x).any()


def wave(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 0.03 * np.sin(2.1 * t), 0.02 * np.sin(3.3 * t + 0.5)


def strokes(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """To and fro, with rests of half a second at the ends and a second in the middle."""
    x = np.interp(t, [0.0, 0.5, 1.0, 1.2, 2.2, 2.6, 3.1, 3.6], [-0.03, 0.02, 0.02, 0.0, 0.0, -0.03, -0.03, 0.03])
    return x, 0.2 * x


@pytest.mark.parametrize("rate", [60.0, 120.0, 240.0, 1000.0])
@pytest.mark.parametrize("path", [wave, strokes])
def test_a_live_panel_and_a_bake_agree(path: Path, rate: float) -> None:
    """The same path, baked at 1 kHz and reported at a panel's own rate.

    What the panel's volts say of friction lies, within 1 of 100, among what the bake has said over the last window, two
    reports and two radii of way before.
    """
    screen = ramp()
    fine = np.arange(3600) / 1000
    bx, by = path(fine)
    direction = directions(bx, by, np.ones(len(fine), bool), 1000.0, WINDOW)
    baked = screen.relief(bx, by, direction).friction
    times = np.arange(int(3.59 * rate)) / rate
    live = np.asarray(screen.device.law.friction(felt(PanelSource(WIRE, screen), times, *path(times))))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(bx), np.diff(by)))])
    for time, friction in zip(times, live, strict=True):
        at, before = round(time * 1000), max(round((time - WINDOW - 2 / rate) * 1000), 0)
        span = baked[np.searchsorted(way, way[before] - 2 * REST_RADIUS) : at + 2]
        assert span.min() - 1 < friction < span.max() + 1, f"at {time:g} s"
    at = np.rint(times * 1000).astype(int)
    assert np.median(np.abs(live - baked[at])) < 2.0 and baked.max() > 50


def test_with_jitter_a_bake_that_bears_it_is_the_panel_exactly() -> None:
    rng = np.random.default_rng(3)
    times = np.arange(1000) / 240
    x, y = np.array(strokes(times)) + rng.normal(0, 1e-4, (2, 1000))
    screen = dataclasses.replace(ramp(), profile="slope", downhill="absolute")
    direction = directions(x, y, np.ones(1000, bool), 240.0, WINDOW, radius=REST_RADIUS)
    baked = screen.device.law.volts(screen.relief(x, y, direction).friction)
    np.testing.assert_allclose(felt(PanelSource(WIRE, screen), times, x, y), baked, atol=1e-9)


def test_a_heading_averages_over_time_whatever_the_rate() -> None:
    """A quarter circle at constant speed: the average lags by half the window, at every rate."""
    for rate in (50.0, 100.0, 1000.0):
        heading = Heading(0.04)
        for k in range(int(rate) + 1):
            angle = 1.5 * k / rate
            dx, dy = heading.move(k / rate, np.cos(angle), np.sin(angle))
        assert np.arctan2(dy, dx) == pytest.approx(np.pi / 2 + 1.5 * (1.0 - 0.02), abs=1e-3)


def test_a_heading_weighs_movements_by_their_time_and_not_by_their_number() -> None:
    """10 ms along x in fifty reports, then 10 ms along y in five: half way between the two."""
    heading, x, y = Heading(0.04), 0.0, 0.0
    heading.move(0.0, x, y)
    for k in range(1, 51):
        heading.move(2e-4 * k, x := x + 1e-4, y)
    for k in range(1, 6):
        found = heading.move(0.01 + 2e-3 * k, x, y := y + 1e-3)
    assert found == pytest.approx((np.sqrt(0.5), np.sqrt(0.5)), abs=1e-12)


# -- the time of a map


def test_the_maps_time_is_that_of_blenders_track() -> None:
    screen = ramp(5, maps_per_second=2.0, start=1.0)
    lab = Lab("native", "electrovibration", mode="panel", screen="map", ramp=0.0, load_screen=lambda path: screen)
    lab.run(0.1)
    lab.arm()

    def slide() -> None:
        for x in np.linspace(-0.03, 0.03, 20):
            lab._answers.append(lab.device.touched(True, float(x), 0.0, lab.now))
            lab.run(0.01)

    def volts(time: float) -> float:
        part = min(max((time - screen.start) * screen.maps_per_second, 0.0), 4.0) / 4.0
        return float(screen.device.law.volts(60.0 * part))

    lab.time = 0.0
    slide()
    assert lab.at[0] == 0.0, "the first map is flat, and Blender shows the first frame"
    lab.time = 2.0
    slide()
    assert lab.at[0] == pytest.approx(volts(2.0), abs=0.1)
    lab.time = 2.5
    lab.run(0.02)
    assert lab.at[0] == pytest.approx(volts(2.5), abs=0.1), "a finger that rests feels the map change"
    lab.playing = True
    slide()
    assert lab.at[0] == pytest.approx(volts(lab.time), abs=2.0)
    lab.playing, lab.time = False, 60.0
    slide()
    assert lab.at[0] == pytest.approx(FULL, rel=1e-3), "the last map is held"


def test_without_blender_the_maps_time_starts_at_arming() -> None:
    screen = ramp(3, maps_per_second=2.0)
    panel = PanelSource(WIRE, screen)
    for start in (5000.0, 7000.0):  # a second arming starts anew
        panel.begin(start)
        times, x = stroke(100.0, (0.05, 1.0), (1.5, 0.0), start=0.0)
        volts = felt(panel, times + start, x, 0 * x)
        wanted = screen.device.law.volts(60.0 * np.minimum(times, 1.0))
        assert volts[5:] == pytest.approx(wanted[5:], abs=0.5)
        assert np.count_nonzero(np.diff(volts)) > 90


def test_arming_begins_at_0_v_with_a_finger_that_is_already_there() -> None:
    panel = PanelSource(WIRE, ramp())
    panel.begin(10.0)
    times, x = stroke(100.0, (0.3, SPEED))
    assert felt(panel, times + 10.0, x, 0 * x)[-1] > 100
    panel.begin(10.35)
    assert panel.values_at(10.35, 10.35)[0] == 0.0
    panel.touched(Touch(True, 0.0, 0.0, 10.36), 10.36)
    assert panel.values_at(10.36, 10.36)[0] == 0.0, "and no direction from before"
