"""Gain curves: read between their points, and turned into filters that have them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from core.devices.gain_curve import FALL, GainCurve, filter_taps, filtered, minimum_phase
from core.errors import DermisError

SLOPED = GainCurve((50.0, 100.0, 1000.0), (4.0, 16.0, 1.6))


def test_between_points_the_gains_logarithm_is_straight_and_beyond_them_unknown() -> None:
    found = SLOPED.at(np.array([50.0, 75.0, 100.0, 550.0, 1000.0]))
    assert found == pytest.approx([4.0, 8.0, 16.0, math.sqrt(16.0 * 1.6), 1.6])
    assert np.isnan(SLOPED.at(np.array([0.0, 49.0, 1001.0]))).all()
    assert SLOPED.band == (50.0, 1000.0)


@pytest.mark.parametrize(
    ("frequency", "gain", "words"),
    [
        ((50.0,), (1.0,), "too few or too many points"),
        ((50.0, 60.0), (1.0,), "frequencies and gains differ"),
        ((50.0, 40.0), (1.0, 1.0), "must rise from point to point"),
        ((50.0, 50.0), (1.0, 1.0), "must rise from point to point"),
        ((0.0, 50.0), (1.0, 1.0), "a frequency must be above zero"),
        ((40.0, 50.0), (1.0, -1.0), "point 2: a gain must be above zero"),
        ((40.0, 50.0), (float("nan"), 1.0), "a gain must be above zero"),
    ],
)
def test_points_that_are_no_response_are_refused(frequency: Any, gain: Any, words: str) -> None:
    with pytest.raises(DermisError, match=words):
        GainCurve(frequency, gain)


@pytest.mark.parametrize("rate", [4000.0, 8000.0, 48_000.0])
def test_a_filter_has_the_gain_inside_the_band_and_less_and_less_beyond(rate: float) -> None:
    taps = filter_taps(SLOPED.at, SLOPED.band, rate)
    inside = np.geomspace(50.0, 1000.0, 777)
    _, found = freqz(taps, worN=np.r_[0.0, 25.0, 12.5, inside], fs=rate)
    assert np.abs(found[3:]) == pytest.approx(SLOPED.at(inside), rel=2.5e-3)
    slope = np.log(SLOPED.at(np.array([50.5])) / 4.0)[0] / np.log(1.01)  # goes on, less 12 and 48 dB
    assert np.abs(found[1:3]) == pytest.approx([4.0 * 2.0**-slope / 4.0, 4.0 * 4.0**-slope / 256.0], abs=5e-4)
    assert abs(found[0]) < 1e-3 and pytest.approx(np.log(4.0)) == FALL * np.log(2.0) ** 2


def test_a_filter_is_causal_and_undoes_a_minimum_phase_system() -> None:
    """A resonance written as a recursive filter, undone by the filter that is made from its gain alone."""
    b, a = [1.0, -1.2, 0.5], [1.0, -1.5, 0.9]
    _, response = freqz(b, a, worN=np.linspace(0.0, np.pi, 2049))
    undo = minimum_phase(-np.log(np.abs(response)))
    noise = np.random.default_rng(3).normal(size=3000)
    assert lfilter(undo, [1.0], lfilter(b, a, noise)) == pytest.approx(noise, abs=1e-9)


def test_what_no_filter_can_have_is_refused() -> None:
    with pytest.raises(DermisError, match="beyond half of the rate"):
        filter_taps(SLOPED.at, SLOPED.band, 1999.0)
    rng = np.random.default_rng(1)
    frequency = np.geomspace(50.0, 1000.0, 1000)
    rough = GainCurve(tuple(frequency), tuple(np.exp(rng.normal(0.0, 3.0, 1000))))
    with pytest.raises(DermisError, match="changes too fast over frequency"):
        filter_taps(rough.at, rough.band, 48_000.0)


@pytest.mark.parametrize("count", [63, 64, 65, 700, 5000])
def test_filtering_by_parts_is_a_convolution(count: int) -> None:
    rng = np.random.default_rng(count)
    values, taps = rng.normal(size=count), rng.normal(size=64)
    wanted = np.convolve(values, taps, "valid") if count >= 64 else np.zeros(0)
    assert filtered(values, taps) == pytest.approx(wanted, abs=1e-12)
