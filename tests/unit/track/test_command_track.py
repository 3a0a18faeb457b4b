"""Command tracks: resampling, limiting and checking, against values worked out by hand."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.interpolate import grid, interpolate
from core.track.command_track import CommandTrack

ROOT = Path(__file__).resolve().parents[3]
FIXED = settings(derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def device(*channels: Channel, rate: float = 1000.0, **fields: object) -> DeviceSpec:
    return DeviceSpec("dev", "A device", "test", rate, channels or (Channel("x", "m"),), **fields)  # type: ignore[arg-type]


def track(values: object, *channels: Channel, rate: float = 1000.0, **fields: object) -> CommandTrack:
    table = np.asarray(values, dtype=float)
    table = table[:, None] if table.ndim == 1 else table
    return CommandTrack(device(*channels, rate=rate, **fields), np.arange(len(table)) / rate, table)


def codes(of: CommandTrack) -> list[str]:
    return [f.code for f in of.check()]


def test_values_must_fit_times_and_channels() -> None:
    with pytest.raises(DermisError) as caught:
        CommandTrack(device(), np.zeros(3), np.zeros((3, 2)))
    assert (caught.value.value, caught.value.limit) == ((3, 2), "(3, 1)")


def test_column_by_name() -> None:
    both = track([[1, 2], [3, 4]], Channel("a", "m"), Channel("b", "m"))
    assert both.column("b").tolist() == [2, 4]
    with pytest.raises(DermisError, match=r"no such channel \(found 'c'; allowed: a, b\)"):
        both.column("c")


# -- resampling


def test_grid_ends_at_or_just_before_the_last_time() -> None:
    assert len(grid(0.0, 1.0, 1000.0)) == 1001
    assert grid(0.0, 0.9999, 1000.0)[-1] == 0.999
    assert len(grid(0.0, 10 / 3, 240.0)) == 801  # 10/3 s are 800 steps exactly, though no float says so
    assert grid(2.0, 2.0, 7.0).tolist() == [2.0]
    assert grid(0.0, 1e-9, 1000.0).tolist() == [0.0]


def test_linear_resampling_of_a_line_is_the_line() -> None:
    line = track(
        np.stack([3 * np.arange(25) / 240, 1 - np.arange(25) / 240], axis=1),
        Channel("a", "m"),
        Channel("b", "m"),
        rate=240.0,
    )
    fine = line.resampled(1000.0)
    assert len(fine.times) == 101 and fine.spec.rate == 1000.0 and fine.spec.hash == line.spec.hash
    np.testing.assert_allclose(fine.values[:, 0], 3 * fine.times, rtol=0, atol=1e-16)
    np.testing.assert_allclose(fine.values[:, 1], 1 - fine.times, rtol=0, atol=3e-16)


def test_resampling_to_its_own_rate_changes_no_bit() -> None:
    some = track(np.random.default_rng(1).normal(size=500))
    for method in ("linear", "pchip"):
        np.testing.assert_array_equal(some.resampled(1000.0, method).values, some.values)  # type: ignore[arg-type]


def test_pchip_of_four_points_worked_out_by_hand() -> None:
    # t = 0, 1, 3, 4; y = 0, 1, 2, 6. Secants 1, 1/2, 4.
    # d1 = (5 + 4) / (5/1 + 4/(1/2)) with w = 2*2+1, 2+2*1; d2 = 9 / (4/(1/2) + 5/4).
    d1 = Fraction(9) / (Fraction(5) + Fraction(4) * 2)
    d2 = Fraction(9) / (Fraction(4) * 2 + Fraction(5) / 4)
    times, values = np.array([0.0, 1.0, 3.0, 4.0]), np.array([[0.0], [1.0], [2.0], [6.0]])
    # the middle of [1, 3], by the Hermite form: (y1 + y2) / 2 + h (d1 - d2) / 8
    middle = Fraction(3, 2) + Fraction(2) * (d1 - d2) / 8
    found = interpolate(times, values, np.array([-1.0, 0.0, 2.0, 3.0, 9.0]), "pchip")[:, 0]
    assert found[2] == pytest.approx(float(middle), rel=1e-15)
    assert found[[0, 1, 3, 4]].tolist() == [0.0, 0.0, 2.0, 6.0], "to the bit at samples, held outside"


def test_pchip_refuses_what_has_no_slope() -> None:
    with pytest.raises(DermisError, match="cannot be interpolated.*finite"):
        interpolate(np.arange(3.0), np.array([[0.0], [np.nan], [1.0]]), np.array([0.5]), "pchip")


def test_only_pchip_loads_scipy() -> None:
    code = "import sys; from core.interpolate import interpolate; import numpy as np; t = np.arange(3.0)\n"
    for method, loads in (("linear", False), ("pchip", True)):
        line = f"interpolate(t, t[:, None], t, {method!r}); sys.exit(('scipy' in sys.modules) != {loads})"
        assert subprocess.run([sys.executable, "-c", code + line], cwd=ROOT).returncode == 0, method


@FIXED
@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=30), st.sampled_from(["linear", "pchip"]))
def test_nothing_overshoots(samples: list[float], method: str) -> None:
    values = np.array(samples)
    fine = track(values, rate=10.0).resampled(73.0, method)  # type: ignore[arg-type]
    i = np.minimum((fine.times * 10 + 1e-9).astype(int), len(values) - 2)
    low, high = np.minimum(values[i], values[i + 1]), np.maximum(values[i], values[i + 1])
    slack = 4e-16 * np.maximum(abs(low), abs(high))
    assert (fine.values[:, 0] >= low - slack).all() and (fine.values[:, 0] <= high + slack).all()


def test_resampling_one_sample() -> None:
    assert track([5.0]).resampled(10.0).values.tolist() == [[5.0]]


@pytest.mark.parametrize(
    ("rate", "method", "message"),
    [
        (0.0, "linear", r"the rate must be a positive number \(found 0.0; allowed: > 0 Hz\)"),
        (float("nan"), "linear", r"found nan"),
        (10.0, "cubic", r"unknown method of interpolation \(found 'cubic'; allowed: linear, pchip\)"),
    ],
)
def test_resampling_refuses(rate: float, method: str, message: str) -> None:
    with pytest.raises(DermisError, match=message):
        track([1.0, 2.0]).resampled(rate, method)  # type: ignore[arg-type]


def test_resampling_refuses_times_that_do_not_rise() -> None:
    bad = replace(track([1.0, 2.0, 3.0]), times=np.array([0.0, 0.5, 0.5]))
    with pytest.raises(DermisError, match=r"dev, sample 2: times do not rise \(found '0.5 s'; allowed: > 0.5 s\)"):
        bad.resampled(10.0)
    with pytest.raises(DermisError, match="the track is empty"):
        track(np.empty((0, 1))).resampled(10.0)


# -- limiting


def test_range_limit_counts_every_changed_sample() -> None:
    raw = track([-3.0, -2.0, 0.0, 2.0, 2.5], Channel("x", "m", -2.0, 2.0))
    held = raw.within_limits()
    assert held.values[:, 0].tolist() == [-2.0, -2.0, 0.0, 2.0, 2.0]
    assert held.limited == {"x.range": 2}
    assert codes(raw) == ["out-of-range"] and codes(held) == ["limited-range"]
    assert held.check()[0].count == 2


def test_one_sided_range() -> None:
    held = track([-9.0, 9.0], Channel("x", "m", low=0.0)).within_limits()
    assert held.values[:, 0].tolist() == [0.0, 9.0] and held.limited == {"x.range": 1}


def test_slew_limit_of_a_step_is_a_ramp_that_ends_exactly() -> None:
    # 8 units at 2 a step of 1 s: 2, 4, 6, then 8 itself, unchanged
    held = track([0, 8, 8, 8, 8, 8], Channel("x", "m", slew=2.0), rate=1.0).within_limits()
    assert held.values[:, 0].tolist() == [0, 2, 4, 6, 8, 8]
    assert held.limited == {"x.slew": 3}


def test_slew_limit_chases_a_moving_target_and_is_left_behind_twice() -> None:
    raw = [0, 5, 1, 1, 1, 9, 9, -9, 3, 3, 3]
    held = track(raw, Channel("x", "m", slew=3.0), rate=1.0).within_limits()
    assert held.values[:, 0].tolist() == [0, 3, 1, 1, 1, 4, 7, 4, 3, 3, 3]
    assert held.limited["x.slew"] == 4


def test_slew_from_rest() -> None:
    raw = track([4, 4, 4, 4], Channel("x", "m", slew=3.0, rest=1.0), rate=1.0)
    assert raw.within_limits().values[:, 0].tolist() == [4, 4, 4, 4]
    held = raw.within_limits(start_at_rest=True)
    assert held.values[:, 0].tolist() == [1, 4, 4, 4] and held.limited == {"x.slew": 1}


def test_slew_uses_each_interval() -> None:
    raw = replace(track([0, 10, 10], Channel("x", "m", slew=2.0)), times=np.array([0.0, 0.5, 3.0]))
    assert raw.within_limits().values[:, 0].tolist() == [0, 1, 6]


def test_a_step_of_just_the_limit_is_no_change() -> None:
    # 0.15 m/s at 1 kHz: steps of 0.15 mm whose sums and times carry rounding
    ramp = np.cumsum(np.full(14, 0.00015)) - 0.00015
    raw = track(ramp, Channel("x", "m", -0.002, 0.002, 0.15))
    assert raw.within_limits().limited == {"x.range": 0, "x.slew": 0} and codes(raw) == []


def test_round_range_pulls_back_along_the_radius() -> None:
    spec = device(
        Channel("x", "m"), Channel("y", "m"), rate=1.0, parameters={"range_disc": ["x", "y"], "range_disc_radius": 5.0}
    )
    raw = CommandTrack(spec, np.arange(3.0), np.array([[6.0, 8.0], [3.0, 4.0], [0.0, -7.0]]))
    held = raw.within_limits()
    np.testing.assert_allclose(held.values, [[3, 4], [3, 4], [0, -5]], rtol=1e-15)
    assert held.limited == {"x.disc": 1, "y.disc": 2}
    assert codes(raw) == ["out-of-range"] and set(codes(held)) == {"limited-disc"}


def test_round_range_slews_on_a_straight_line() -> None:
    spec = device(
        Channel("x", "m", slew=3.0),
        Channel("y", "m", slew=1.0),
        parameters={"range_disc": ["x", "y"], "range_disc_radius": 5.0},
    )
    held = CommandTrack(spec, np.arange(4.0), np.array([[0, 0], [3, 4], [3, 4], [3, 4]], dtype=float)).within_limits()
    np.testing.assert_allclose(held.values, [[0, 0], [0.75, 1], [1.5, 2], [2.25, 3]], rtol=1e-15)


def test_what_is_not_finite_is_held_counted_and_an_error() -> None:
    raw = track([np.nan, 1.0, np.inf, np.nan, 2.0], Channel("x", "m", 0.0, 5.0, rest=0.5))
    held = raw.within_limits()
    assert held.values[:, 0].tolist() == [0.5, 1.0, 1.0, 1.0, 2.0]
    assert held.limited == {"x.not_finite": 3, "x.range": 0}
    finding = held.check()[0]
    assert (finding.severity, finding.code, finding.count) == ("error", "limited-not-finite", 3)


def test_ramps_blend_with_rest() -> None:
    # smooth step 3p^2 - 2p^3 at p = 0, 1/4, 1/2, 3/4: 0, 5/32, 1/2, 27/32
    held = track([3.0] * 9, Channel("x", "m", rest=1.0), rate=1.0).within_limits(ramp_in=4.0, ramp_out=2.0)
    expected = [1 + 2 * w for w in (0, 5 / 32, 1 / 2, 27 / 32, 1, 1, 1, 1 / 2, 0)]
    np.testing.assert_allclose(held.values[:, 0], expected, rtol=1e-15)
    assert held.limited == {"x.ramp": 6}


def test_counts_add_up_over_two_passes() -> None:
    once = track([9.0, 0.0], Channel("x", "m", high=5.0)).within_limits()
    assert replace(once, values=np.array([[7.0], [6.0]])).within_limits().limited == {"x.range": 3}


@pytest.mark.parametrize(("name", "value"), [("ramp_in", -1.0), ("ramp_out", float("nan"))])
def test_ramps_refuse(name: str, value: float) -> None:
    with pytest.raises(DermisError, match=rf"dev: {name} must not be negative \(found {value}; allowed: >= 0 s\)"):
        track([1.0]).within_limits(**{name: value})  # type: ignore[arg-type]


@settings(FIXED, max_examples=200)
@given(
    st.lists(st.tuples(*[st.one_of(st.floats(-5, 5), st.sampled_from([np.nan, np.inf]))] * 3), min_size=1, max_size=40),
    st.booleans(),
)
def test_limited_tracks_pass_their_own_check(rows: list[tuple[float, ...]], start_at_rest: bool) -> None:
    channels = (Channel("a", "m", -1.0, 1.0, 300.0), Channel("x", "m", -2.0, 2.0, 500.0), Channel("y", "m", slew=70.0))
    raw = track(np.array(rows), *channels, parameters={"range_disc": ["x", "y"], "range_disc_radius": 1.5})
    held = raw.within_limits(start_at_rest=start_at_rest)
    assert {c for c in codes(held) if not c.startswith("limited-")} == set()
    again = held.within_limits()
    np.testing.assert_allclose(again.values, held.values, rtol=1e-12, atol=1e-12)


@FIXED
@given(st.lists(st.floats(-100, 100), min_size=2, max_size=60), st.floats(0.5, 50))
def test_slew_limit_is_the_plain_recursion(samples: list[float], slew: float) -> None:
    """The limiter skips ahead to where it is needed; the recursion it stands for goes sample by sample."""
    held = track(samples, Channel("x", "m", slew=slew), rate=1.0).within_limits().values[:, 0]
    value, expected = samples[0], [samples[0]]
    for goal in samples[1:]:
        value = goal if abs(goal - value) <= slew else value + np.copysign(slew, goal - value)
        expected.append(value)
    np.testing.assert_allclose(held, expected, rtol=0, atol=1e-6)


# -- checks


def test_a_good_track_has_no_findings() -> None:
    assert track([0.0, 1.0], Channel("x", "m", -1, 1, 1000.0, actuator="a")).check() == ()


def test_out_of_range_says_where_which_worst_and_which_frame() -> None:
    bad = replace(
        track([0.0, 1.5, -9.0], Channel("x", "m", -1.0, 1.0)),
        meta={"finger": "Index", "frame_range": "10 20", "fps": "24/1"},
    )
    (finding,) = bad.check()
    assert finding.where == "finger 'Index', dev, x, first at 0.001 s"
    assert (finding.value, finding.limit, finding.count) == (-9.0, "-1 to 1 m", 2)
    assert finding.frame == pytest.approx(10.024)


def test_frame_follows_the_exact_fraction() -> None:
    values = np.zeros(30031)
    values[30030] = 2.0  # at 30.03 s, which is frame 900 of 29.97 fps
    bad = replace(track(values, Channel("x", "m", high=1.0)), meta={"frame_range": "1 901", "fps": "30000/1001"})
    assert bad.check()[0].frame == pytest.approx(901.0, abs=1e-6)


def test_too_fast() -> None:
    bad = track([0.0, 0.001, 0.003, 0.003], Channel("x", "m", slew=1.5))
    (finding,) = bad.check()
    assert finding.code == "too-fast" and finding.count == 1 and finding.limit == "1.5 m/s"
    assert finding.value == pytest.approx(2.0, rel=1e-12)


def test_not_finite_empty_and_not_rising() -> None:
    assert codes(track([0.0, np.nan])) == ["not-finite"]
    assert codes(track(np.empty((0, 1)))) == ["empty"]
    back = replace(track([0.0, 1.0, 2.0]), times=np.array([0.0, 2.0, 1.0]))
    assert codes(back) == ["times-not-rising"] and back.check()[0].limit == "> 2 s"
    assert codes(replace(back, times=np.array([0.0, 1.0, np.nan]))) == ["not-finite"]


def test_two_channels_of_one_actuator() -> None:
    bad = track([[0.0, 0.0]], Channel("a", "m", actuator="servo 1"), Channel("b", "m", actuator="servo 1"))
    (finding,) = bad.check()
    assert finding.code == "duplicate-actuator" and finding.value == "servo 1" and "a and b" in finding.where
    assert track([[0.0, 0.0]], Channel("a", "m"), Channel("b", "m")).check() == ()  # neither drives anything


def test_wire_budget_is_exact() -> None:
    # (40 + 2 * 16) bits at 1 kHz are 72,000 bit/s; the channel without actuator does not travel
    channels = (Channel("a", "m", actuator="1"), Channel("b", "m", actuator="2"), Channel("info", "m"))

    def wire(bandwidth: float) -> list[str]:
        cost = {"bandwidth": bandwidth, "bits_per_sample": 40.0, "bits_per_channel": 16.0}
        return codes(track(np.zeros((11, 3)), *channels, link_budget=cost))

    assert wire(72000.0) == [] and wire(71999.0) == ["wire-budget"] and wire(0.0) == []
    loud = track(
        np.zeros((11, 3)),
        *channels,
        link_budget={"bandwidth": 36000.0, "bits_per_sample": 40.0, "bits_per_channel": 16.0},
    ).check()[0]
    assert (loud.value, loud.limit) == ("72000 bit/s", "36000 bit/s") and "500 Hz" in loud.remedy


@pytest.mark.parametrize(
    ("rate", "times", "found"),
    [
        (50.0, np.arange(200) / 1000, True),  # twenty times too slow
        (1000.0, np.arange(200) / 50, True),
        (1000.0, np.arange(200) / 1020, True),
        (1000.0, np.arange(200) / 1001, False),
        (1000.0, np.arange(200) / 1000 + 5.0, False),
        (1000.0, np.r_[np.arange(100), np.arange(150, 200)] / 1000, False),  # rows taken out
        (1000.0, np.arange(0, 200, 2) / 1000, True),  # every other one
        (1000.0, np.array([0.003]), False),
        (1000.0, np.zeros(0), False),
    ],
)
def test_a_rate_that_the_times_contradict_is_an_error(rate: float, times: np.ndarray, found: bool) -> None:
    one = CommandTrack(device(Channel("x", "m"), rate=rate), times, np.zeros((len(times), 1)))
    wrong = [f for f in one.check() if f.code == "rate"]
    assert bool(wrong) == found
    for finding in wrong:
        assert finding.severity == "error" and f"{rate:g} Hz" in str(finding)
        assert "rate" not in codes(one.resampled(rate))


@pytest.mark.parametrize("rate", [1e12, 1e300])
def test_a_rate_beyond_memory_is_refused_with_the_limit(rate: float) -> None:
    one = track(np.zeros(101), rate=100.0)
    with pytest.raises(DermisError, match=r"more samples .*allowed: 1.34218e\+08 Hz, 134217728 values in all"):
        one.resampled(rate)
    assert len(one.resampled(1e5).times) == 100001


@pytest.mark.parametrize("time", [np.nan, np.inf])
def test_times_that_are_no_numbers_cannot_be_resampled(time: float) -> None:
    one = CommandTrack(device(Channel("x", "m")), np.array([0.0, 0.01, time]), np.zeros((3, 1)))
    with pytest.raises(DermisError, match="a time is not a finite number"):
        one.resampled(50.0)
