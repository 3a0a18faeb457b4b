"""Measured frequency responses: inverted for a second-order system whose inverse is known, read, and refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from core.arrays import Array
from core.devices.frequency_response import FrequencyResponse, Points, of_text, read_csv
from core.errors import DermisError
from tests.second_order import NATURAL, RATE, answer, measured, movement

HERTZ = np.arange(1.0, 301.0)


@pytest.mark.parametrize("centre", [0.0, 40.0, 110.0, 150.0])
def test_a_second_order_system_is_inverted_as_its_equation_says(centre: float) -> None:
    """What drives it is y + 2 z y' / w + y'' / w^2; the error falls with the square of the frequencies' distance."""
    times = np.arange(0.0, 1.0, 1.0 / RATE)
    wanted, exact = movement(times, centre)
    errors = []
    for apart in (8.0, 4.0, 2.0, 1.0):
        response = FrequencyResponse(measured(np.arange(apart, 300.1, apart)))
        driven = response.inverted(wanted, RATE)
        errors.append(float(np.abs(driven - exact).max() / np.abs(exact).max()))
    assert errors[-1] < 1e-4 and errors[0] < 2e-2
    assert errors[1] < 0.4 * errors[0] and errors[2] < 0.4 * errors[1] and errors[3] < 0.4 * errors[2]
    plain = float(np.abs(wanted - exact).max() / np.abs(exact).max())
    assert centre == 0.0 or plain > 50.0 * errors[-1], "as it is, it would be far off"


def test_at_a_measured_frequency_it_is_the_measured_answer() -> None:
    response = FrequencyResponse(measured(HERTZ))
    np.testing.assert_allclose(response.at(HERTZ), answer(HERTZ), rtol=1e-12)
    assert response.at(np.array([0.0]))[0] == 1.0, "slow movement is what zero, gain and curve describe"
    assert response.span == (1.0, 300.0)
    hertz, gain = response.peak
    assert hertz == 300.0 and gain == pytest.approx(abs(answer(np.array([300.0]))[0]))


def test_a_phase_that_was_written_within_a_turn_is_the_same() -> None:
    points = [(hz, gain, phase - 0.02 * hz) for hz, gain, phase in measured(HERTZ)]  # a delay of 3.2 ms
    wrapped = [(hz, gain, math.remainder(phase, 2.0 * math.pi)) for hz, gain, phase in points]
    assert min(phase for _, _, phase in points) < -2.0 * math.pi
    one, other = (FrequencyResponse(tuple(own)).at(np.linspace(0.0, 300.0, 999)) for own in (points, wrapped))
    np.testing.assert_allclose(one, other, rtol=1e-12)


def test_a_delay_is_undone_and_one_that_is_asked_for_is_kept() -> None:
    late = 0.004
    delay = tuple((hz, 1.0, -2.0 * math.pi * hz * late) for hz in (20.0, 50.0, 100.0, 150.0, 200.0))
    times = np.arange(0.0, 1.0, 1.0 / RATE)
    wanted = movement(times, 80.0)[0]
    response, shift = FrequencyResponse(delay), round(late * RATE)
    driven = response.inverted(wanted, RATE)
    np.testing.assert_allclose(driven[:-shift], wanted[shift:], atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_allclose(response.inverted(wanted, RATE, late), wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("values", [np.full(100, 0.3), np.zeros(1), np.zeros(0)])
def test_what_stands_still_is_driven_as_it_is(values: Array) -> None:
    np.testing.assert_array_equal(FrequencyResponse(measured(HERTZ)).inverted(values, RATE), values)


def test_a_slow_way_from_one_place_to_another_stays_what_it_is() -> None:
    """Its ends are apart: no step between them enters the track."""
    part = np.clip(np.linspace(-0.5, 1.5, 16001), 0.0, 1.0)
    way = 0.2 + part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    driven = FrequencyResponse(measured(HERTZ)).inverted(way, RATE)
    times = np.linspace(0.0, 16000.0 / RATE, 16001)
    first, second = np.gradient(way, times), np.gradient(np.gradient(way, times), times)
    exact = way + 2.0 * 0.25 / (2.0 * math.pi * NATURAL) * first + second / (2.0 * math.pi * NATURAL) ** 2
    assert np.abs(driven - exact).max() < 1e-4


def test_how_much_lies_beyond() -> None:
    times = np.arange(0.0, 1.0, 1.0 / RATE)
    slow, fast = movement(times, 60.0)[0], movement(times, 200.0)[0]
    response = FrequencyResponse(measured(np.arange(2.0, 121.0, 2.0)))
    assert response.beyond(slow, RATE) < 1e-6 and response.beyond(fast, RATE) > 0.999
    share = response.beyond(slow + 0.1 * fast, RATE)
    expected = 0.1 * np.linalg.norm(fast) / math.hypot(float(np.linalg.norm(slow)), 0.1 * float(np.linalg.norm(fast)))
    assert share == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("points", "what"),
    [
        (((10.0, 1.0, 0.0),), "too few"),
        (((0.0, 1.0, 0.0), (10.0, 1.0, 0.0)), "do not rise"),
        (((20.0, 1.0, 0.0), (20.0, 1.0, 0.0)), "do not rise"),
        (((10.0, 1.0, 0.0), (20.0, 0.09, 0.0)), "20 Hz.*gain is too small.*0.09"),
        (((10.0, 1.0, 0.0), (20.0, 11.0, 0.0)), "the gain is out of range"),
        (((10.0, 1.0, 0.0), (20.0, 1.0, -1.6)), "a turn may be missing"),
        (((10.0, 1.0, 1.6), (20.0, 1.0, 1.6)), "a turn may be missing"),
        (((10.0, 1.0, 0.0), (20.0, math.nan, 0.0)), "not three finite"),
        (((10.0, True, 0.0), (20.0, 1.0, 0.0)), "not three finite"),
    ],
)
def test_what_is_no_response_is_refused(points: Points, what: str) -> None:
    with pytest.raises(DermisError, match=what):
        FrequencyResponse(points)


def test_it_is_typed_and_read_in_the_units_of_its_columns(tmp_path: Path) -> None:
    typed = of_text("80: 1.2 -30; 20 1 -5", measured_on="2026-11-27", valid_days=3)
    assert typed.points == ((20.0, 1.0, math.radians(-5.0)), (80.0, 1.2, math.radians(-30.0)))
    assert FrequencyResponse.loads(typed.dumps()) == typed and typed.valid_days == 3
    path = tmp_path / "shaker.csv"
    path.write_text("phase [rad];gain [dB];Frequency [kHz]\n-0,1;0;0,02\n-0,5;6,0206;0,08\n")
    read = read_csv(path)
    assert [p[0] for p in read.points] == [20.0, 80.0] and read.points[1][1] == pytest.approx(2.0, rel=1e-4)
    assert read.points[1][2] == -0.5
    for text, what in (
        ("frequency,gain,phase\n20,1,0\n30,1,0\n", "unit of the phase"),
        ("frequency [Hz],amplitude,phase [deg]\n20,1,0\n30,1,0\n", "called 'gain'"),
        ("frequency [Hz],gain [mm],phase [deg]\n20,1,0\n30,1,0\n", "unit of the gain"),
        ("frequency [Hz],gain,phase [deg]\n20,1,0\n30,,0\n", "line 3"),
        ("frequency [Hz],gain,phase [deg]\n20,1,0\n30,0,0\n", "gain is too small"),
    ):
        path.write_text(text)
        with pytest.raises(DermisError, match=what):
            read_csv(path)
    for bad in ("", "20 1", "20 1 x", "20 1 0 0"):
        with pytest.raises(DermisError, match="needs three numbers|too few"):
            of_text(bad)
