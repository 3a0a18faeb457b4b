"""[S4] eq. 1 and its inverse, the calibration's span, and the device preset."""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pytest

from core.devices.friction_screen import FrictionLaw, FrictionScreen
from core.errors import DermisError
from core.presets import Library

BASE_E = math.e


@pytest.fixture
def spec():
    return Library().device("electrovibration")


def exact_volts(friction, base):
    """Invert log_b f = 1.24 log_b V - 1.05 with 40 digits."""
    with mpmath.workdps(40):
        b = mpmath.mpf(base)
        return float(b ** ((mpmath.log(mpmath.mpf(friction), b) + mpmath.mpf("1.05")) / mpmath.mpf("1.24")))


@pytest.mark.parametrize("base", [10.0, BASE_E])
@pytest.mark.parametrize("friction", [1e-3, 1.0, 17.3, 50.0, 100.0, 250.0])
def test_volts_against_high_precision(friction, base):
    assert float(FrictionLaw(base=base).volts(friction)) == pytest.approx(exact_volts(friction, base), rel=1e-13)


def test_volts_of_both_readings_of_the_logarithm():
    np.testing.assert_allclose(FrictionLaw().volts([1, 50, 100]), [7, 165, 288], atol=0.5)
    np.testing.assert_allclose(FrictionLaw(base=BASE_E).volts([1, 50, 100]), [2.3, 55, 96], atol=0.5)


def test_no_friction_is_no_voltage_and_nan_is_not_hidden():
    np.testing.assert_array_equal(FrictionLaw().volts([0.0, -5.0, -0.0, -math.inf]), 0.0)
    assert np.isnan(FrictionLaw().volts(math.nan))
    assert FrictionLaw().friction(0.0) == 0.0


@pytest.mark.parametrize("base", [10.0, BASE_E])
def test_inverse_is_the_printed_line_in_logarithms(base):
    volts = np.geomspace(0.5, 400, 40)
    friction = FrictionLaw(base=base).friction(volts)
    line = 1.24 * np.log(volts) / np.log(base) - 1.05
    np.testing.assert_allclose(np.log(friction) / np.log(base), line, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(FrictionLaw(base=base).volts(friction), volts, rtol=1e-12)


def test_inverse_refuses_a_negative_amplitude():
    with pytest.raises(DermisError, match="negative"):
        FrictionLaw().friction([-1.0])


@pytest.mark.parametrize(
    "fields",
    [
        {"slope": 0},
        {"slope": -1},
        {"slope": math.nan},
        {"intercept": math.inf},
        {"base": 1},
        {"base": 0.5},
        {"base": math.nan},
    ],
)
def test_refuses_a_law_that_is_none(fields):
    with pytest.raises(DermisError, match="friction law"):
        FrictionLaw(**fields)


def test_preset(spec):
    assert spec.rate == 1000.0
    assert [(c.name, c.unit, c.rest) for c in spec.channels] == [("amplitude", "V", 0.0), ("carrier", "Hz", 60.0)]
    screen = FrictionScreen.of(spec)
    assert screen.law == FrictionLaw()
    assert screen.limit >= screen.law.volts(100.0), "the preset must be able to show full friction"
    assert screen.span_high == pytest.approx(exact_volts(100, 10))
    assert screen.span_high / screen.span_low == pytest.approx(3.5)
    # Ten levels, each 15 % above the last.
    assert 1.15**9 == pytest.approx(3.5, rel=0.01)


def test_calibration_fields_are_followed(spec):
    other = dataclasses.replace(
        spec, parameters={**spec.parameters, "law_base": BASE_E, "span_high": 80.0, "span_factor": 4.0}
    )
    screen = FrictionScreen.of(other)
    assert float(screen.law.volts(100)) == pytest.approx(exact_volts(100, BASE_E))
    assert (screen.span_low, screen.span_high) == (20.0, 80.0)


def test_outside_the_span_is_counted_and_nothing_changed(spec):
    screen = FrictionScreen.of(dataclasses.replace(spec, parameters={**spec.parameters, "span_high": 70.0}))
    volts = np.array([0.0, 19.9, 20.0, 70.0, 70.1, 90.0, 0.0])
    before = volts.copy()
    carrier = np.array([10.0, 60, 60, 60, 200, 200.5, 60])
    findings = {f.code: f for f in screen.check(volts, carrier, "here")}
    np.testing.assert_array_equal(volts, before)
    assert {code: f.count for code, f in findings.items()} == {
        "below-measured-span": 1,
        "above-measured-span": 2,
        "carrier-not-measured": 1,
    }
    assert findings["above-measured-span"].severity == "warning"
    assert screen.check(volts[2:4], carrier[2:4]) == ()


def test_full_friction_is_not_above_the_span(spec):
    screen = FrictionScreen.of(spec)
    assert screen.check(screen.law.volts(np.array([100.0])), np.array([60.0])) == ()


def test_refuses_other_devices_and_missing_limits(spec):
    with pytest.raises(DermisError, match="not a friction screen"):
        FrictionScreen.of(dataclasses.replace(spec, kind="shear_tactor"))
    amplitude = dataclasses.replace(spec.channels[0], high=None)
    with pytest.raises(DermisError, match="voltage limit"):
        FrictionScreen.of(dataclasses.replace(spec, channels=(amplitude, spec.channels[1])))
    with pytest.raises(DermisError, match="no such channel"):
        FrictionScreen.of(dataclasses.replace(spec, channels=spec.channels[:1]))
    with pytest.raises(DermisError, match="span"):
        FrictionScreen.of(dataclasses.replace(spec, parameters={"span_factor": 0.5}))


def test_plain_values_and_back(spec):
    screen = FrictionScreen.of(spec)
    assert FrictionScreen.from_dict(screen.as_dict()) == screen
    for broken in ({}, {**screen.as_dict(), "limit": "many"}, {**screen.as_dict(), "colour": 1.0}, {"law": 3}):
        with pytest.raises(DermisError, match="malformed"):
            FrictionScreen.from_dict(broken)
