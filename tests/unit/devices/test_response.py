"""Measured curves of an actuator: inverted exactly, made of readings, refused where they are none."""

from __future__ import annotations

import json
import math
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from core.devices.response import Response, Responses
from core.devices.response_readings import of_readings, read_csv
from core.errors import DermisError
from tests.bent_actuator import Actuator, commands, measured, worst_error


@pytest.mark.parametrize("play", [0.0, 0.01, 0.04, 0.15])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_wanted_is_reached(play: float, seed: int) -> None:
    """On a bent curve with play, to a thousandth of the range; without the curve it is off by the bend and the play."""
    actuator = Actuator(play)
    curve = measured(actuator)
    assert curve.play == pytest.approx(play, abs=2e-3)
    wanted = commands(seed, curve.reach[0] * 0.97, curve.reach[1] * 0.97)
    assert worst_error(actuator, curve, wanted) <= 1e-3
    plain = max(abs(actuator.drive(float(v)) - v) for v in wanted) / np.ptp(curve.reach)
    assert plain > 0.03


def test_noise_does_not_make_an_actuator_jump_by_its_play() -> None:
    actuator = Actuator(0.1)
    curve = measured(actuator)
    responses = Responses({0: curve}, np.array([-2.0]), np.array([2.0]))
    last = np.array([0.2])
    now, rng, driven = responses.believe(last, responses.believe(np.array([-1.0]))), np.random.default_rng(1), []
    held = float(now.reached[0])
    for _ in range(200):
        last, _ = responses.driven(np.array([held + 2e-4 * rng.uniform(-1, 1)]), now, last)
        now = responses.believe(last, now)
        driven.append(float(last[0]))
    assert np.ptp(driven) < 2e-3 and float(np.ptp(driven)) < actuator.play / 20


def test_a_slow_way_is_followed_without_steps() -> None:
    """The threshold is for turning round alone: on its way an actuator follows however little it is asked for."""
    actuator = Actuator(0.1)
    curve = measured(actuator)
    wanted = 0.2 + 1e-5 * np.arange(300)
    responses = Responses({0: curve}, np.array([-2.0]), np.array([2.0]))
    last = np.array([curve.drives(0.1)])
    now = responses.believe(last, responses.believe(np.array([-1.0])))
    driven = []
    for value in wanted:
        last, _ = responses.driven(np.array([value]), now, last)
        now = responses.believe(last, now)
        driven.append(float(last[0]))
    assert (np.diff(driven[1:]) > 0).all()


def test_limits_hold_for_what_is_driven_and_for_what_is_reached() -> None:
    """An actuator that goes further than it is told would pass the limit; one that goes less far is not overdriven."""
    for factor in (1.5, 0.7):
        curve = of_readings([-1.0, 0.0, 1.0], [-factor, 0.0, factor])
        responses = Responses({0: curve}, np.array([-0.8]), np.array([0.8]))
        for value in (5.0, 0.79, -5.0, 1e300):
            driven, limited = responses.driven(np.array([value]), None, np.zeros(1))
            reached = factor * float(driven[0])
            assert abs(reached) <= 0.8 + 1e-12 and abs(driven[0]) <= 1.0
            assert limited[0] == pytest.approx(max(abs(value) - min(0.8, factor), 0.0))


def test_a_passing_through_the_file_keeps_it(tmp_path: Path) -> None:
    curve = measured(Actuator())
    assert Response.of(json.loads(json.dumps(curve.plain()))) == curve
    assert curve.age(date(2027, 1, 6)) == 40 and Response(curve.rising, curve.falling).age(date(2027, 1, 6)) is None


@pytest.mark.parametrize(
    ("driven", "reached", "what"),
    [
        ([0, 1, 2], [0, 1, 0.5], "does not rise"),
        ([0, 1, 2], [2, 1, 0], "gain of -1"),
        ([0, 1, 2, 3], [0, 1, 1.01, 2], "slope is too small"),
        ([0, 1, 2], [0, 57, 115], "57.5 times as much"),
        ([0, 1, 2], [0, 1e-3, 2e-3], "0.001 times as much"),
        ([0, 1, 1, 0], [0, 1, 1, 0.5], "too few readings"),
        ([0], [0], "too few"),
        ([1, 1], [0, 1], "one driven value"),
        ([0, 1], [0, float("nan")], "reading 2: a reading is not finite"),
    ],
)
def test_readings_that_are_no_curve_are_refused(driven: list[float], reached: list[float], what: str) -> None:
    with pytest.raises(DermisError, match=what):
        of_readings(driven, reached)


def test_exchanged_ways_are_refused() -> None:
    up, down = [(0.0, 0.0), (1.0, 1.0)], [(0.0, 0.2), (1.0, 1.2)]
    assert Response(tuple(up), tuple(down)).play == pytest.approx(0.2)
    with pytest.raises(DermisError, match="Exchange them"):
        Response(tuple(down), tuple(up))


@pytest.mark.parametrize(
    "change",
    [
        {"rising": []}, {"rising": [[0, 0], [1, 1, 1]]}, {"rising": [[0, 0], [1, "1"]]},
        {"rising": [[0, 0], [1, 10**400]]}, {"rising": [[0, 0], [1, 1]], "falling": [[2, 2], [3, 3]]},
        {"rising": [[0, 0], [True, 1]]}, {"latency": -1.0}, {"latency": float("nan")}, {"scatter": float("inf")},
        {"valid_days": 1.5}, {"valid_days": -1}, {"measured_on": "27.11.2026"}, {"measured_on": 3}, {"more": 1},
    ],
)  # fmt: skip
def test_what_a_file_may_hold_is_refused(change: dict[str, object]) -> None:
    plain = Response(((0.0, 0.0), (1.0, 1.0)), ((0.0, 0.0), (1.0, 1.0))).plain()
    with pytest.raises(DermisError):
        Response.of({**plain, **change})


@pytest.mark.parametrize(
    ("unit", "name", "limit"),
    [
        ("rad", "reached [mm]", "'mm'; allowed: rad, deg"), ("rad", "reached [ms]", "'ms'; allowed: rad, deg"),
        ("rad", "reached [N]", "'n'; allowed: rad, deg"), ("rad", "reached (caliper)", "'caliper'; allowed: rad, deg"),
        ("rad", "reached [turns] left", "'turns'; allowed: rad, deg"), ("rad", "reached_ms", "'ms'; allowed: rad, deg"),
        ("m", "reached [deg]", "'deg'; allowed: m, cm, mm, um"), ("N", "reached [kN]", "'kn'; allowed: N"),
        ("", "reached [ms]", "'ms'; allowed: m, cm, mm, um, rad, deg"),
    ],
)  # fmt: skip
def test_another_unit_is_refused(tmp_path: Path, unit: str, name: str, limit: str) -> None:
    path = tmp_path / "caliper.csv"
    path.write_text(f"driven,{name}\n0,0\n1,1\n")
    with pytest.raises(DermisError) as refused:
        read_csv(path, unit)
    assert f"does not fit this channel (found {limit}" in str(refused.value) and name in str(refused.value)


@pytest.mark.parametrize(
    ("unit", "name", "size"),
    [
        ("m", "driven", 1.0), ("m", "driven left", 1.0), ("m", "driven [ MM ]", 1e-3), ("m", "driven_um", 1e-6),
        ("m", "driven (millimetres)", 1e-3), ("m", "driven [mm] left", 1e-3), ("m", "driven []", 1.0),
        ("N", "driven [N]", 1.0), ("1", "driven [1]", 1.0), ("V", "driven", 1.0), ("", "driven [N]", 1.0),
        ("", "driven [deg]", math.radians(1.0)), ("rad", "commanded [rad]", 1.0),
    ],
)  # fmt: skip
def test_a_fitting_unit_is_converted(tmp_path: Path, unit: str, name: str, size: float) -> None:
    path = tmp_path / "caliper.csv"
    path.write_text(f"{name},{name.replace('driven', 'reached').replace('commanded', 'reached')}\n0,0\n10,10\n")
    assert read_csv(path, unit).span == pytest.approx((0.0, 10.0 * size))


def test_a_csv_has_units_in_its_names(tmp_path: Path) -> None:
    path = tmp_path / "caliper.csv"
    path.write_text("driven [deg],measured [deg]\n0,1\n30,31\n60,60\n")
    curve = read_csv(path, measured_on="2026-01-02")
    assert curve.rising == curve.falling and curve.measured_on == "2026-01-02"
    assert curve.span == pytest.approx((0.0, math.radians(60.0)))
    assert curve.reach == pytest.approx((math.radians(1.0), math.radians(60.0)))
    path.write_text("x,y\n0,1\n30,31\n")
    with pytest.raises(DermisError, match="'driven'"):
        read_csv(path)
    path.write_text("driven,reached\n0,1\n30,one\n")
    with pytest.raises(DermisError, match="line 3"):
        read_csv(path)
    path.write_text("driven,reached\n0,1\n30,20\n40,10\n")
    with pytest.raises(DermisError, match="caliper.csv.*does not rise"):
        read_csv(path)
