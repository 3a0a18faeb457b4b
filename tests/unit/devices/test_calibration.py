"""Calibrations: numbers, limits, and files."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.devices.response import Response
from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError

TODAY = date(2027, 1, 6)
SPEC = DeviceSpec("dev", "Dev", "test", 100.0, (Channel("a", "rad", -1.0, 1.0, actuator="s"), Channel("b", "m")))


def test_the_tighter_limit_holds() -> None:
    made = Calibration.of(SPEC).with_entry("a", zero=0.1, gain=-2.0, low=-3.0, high=0.5)
    zero, gain, low, high = made.for_spec(SPEC)
    assert (zero.tolist(), gain.tolist()) == ([0.1, 0.0], [-2.0, 1.0])
    assert (low.tolist(), high.tolist()) == ([-1.0, -np.inf], [0.5, np.inf])


def test_file_round_trip(tmp_path: Path) -> None:
    made = Calibration.of(SPEC).with_entry("a", zero=0.1, gain=1 / 3)
    made.save(tmp_path / "desk.json")
    assert Calibration.load(tmp_path / "desk.json") == made
    assert made.findings(SPEC, TODAY) == ()
    assert [f.code for f in made.findings(replace(SPEC, source={"x": 1}), TODAY)] == ["calibration-of-another-preset"]


@pytest.mark.parametrize(
    ("numbers", "what"),
    [({"gain": 0.0}, "does not move"), ({"zero": float("nan")}, "finite"), ({"low": 1.0, "high": 0.0}, "low is above")],
)
def test_impossible_numbers(numbers: dict[str, float], what: str) -> None:
    with pytest.raises(DermisError, match=what):
        Calibration.of(SPEC).with_entry("a", **numbers)


def test_misfits_are_refused() -> None:
    with pytest.raises(DermisError, match="another device"):
        Calibration("other").for_spec(SPEC)
    with pytest.raises(DermisError, match="no such channel"):
        Calibration.of(SPEC).with_entry("c", zero=1.0).for_spec(SPEC)
    with pytest.raises(DermisError, match="do not overlap"):
        Calibration.of(SPEC).with_entry("a", low=2.0, high=3.0).for_spec(SPEC)
    for text in ("[]", '{"schema": []}', "{", '{"schema": "dermis-calibration 2"}', "[" * 100_000):
        with pytest.raises(DermisError):
            Calibration.loads(text)


def test_the_file_says_whose_it_is(tmp_path: Path) -> None:
    made = Calibration.of(SPEC).with_entry("a", zero=0.1).owned_by("left thimble, red tape", "7573530323135")
    made.save(tmp_path / "a.json")
    read = Calibration.load(tmp_path / "a.json")
    assert read == made and (read.name, read.serial) == ("left thimble, red tape", "7573530323135")
    assert read.with_entry("a", gain=-1.0).name == read.name


def test_files_of_version_1_are_still_read() -> None:
    text = (
        '{"schema": "dermis-calibration 1", "device": "dev", "spec_hash": "h",'
        ' "actuators": {"a": {"zero": 0.1, "gain": 2.0, "low": null, "high": 0.5}}}'
    )
    read = Calibration.loads(text)
    assert (read.device, read.name, read.serial, read.entries["a"].gain) == ("dev", "", "", 2.0)
    assert '"dermis-calibration 4"' in read.dumps() and Calibration.loads(read.dumps()) == read
    named = text.replace("calibration 1", "calibration 2").replace(
        '"device"', '"name": "left", "serial": "7", "device"'
    )
    assert Calibration.loads(named) == read.owned_by("left", "7"), "version 2 knew no curves"
    for wrong in (text.replace("calibration 1", "calibration 2"), named.replace("calibration 2", "calibration 3")):
        with pytest.raises(DermisError, match="missing or unknown"):
            Calibration.loads(wrong)


@pytest.mark.parametrize("name", ["a\nb", "x" * 101, " left", "bell\x07", 3, None])
def test_names_are_one_line_of_text(name: Any) -> None:
    with pytest.raises(DermisError, match="not a text of one line"):
        Calibration.of(SPEC).owned_by(name)
    text = Calibration.of(SPEC).dumps().replace('"name": ""', f'"name": {json.dumps(name)}')
    with pytest.raises(DermisError, match="not a text of one line"):
        Calibration.loads(text)


CURVE = Response(((-1.0, -0.9), (1.0, 0.95)), ((-1.0, -0.85), (1.0, 1.0)), 0.0, 0.01, "2026-11-27", 30)


def test_a_measured_curve_is_in_the_file(tmp_path: Path) -> None:
    made = Calibration.of(SPEC).with_entry("a", zero=0.1, response=CURVE)
    made.save(tmp_path / "a.json")
    assert Calibration.load(tmp_path / "a.json") == made
    assert made.with_entry("a", gain=2.0).entries["a"].response == CURVE
    assert made.without_curves().entries["a"].response is None and made.without_curves().entries["a"].zero == 0.1
    text = made.dumps().replace("-0.9", "57.0")
    with pytest.raises(DermisError, match="calibration, a: measured curve, rising.*does not rise"):
        Calibration.loads(text)


@pytest.mark.parametrize(
    ("on", "days", "codes"),
    [
        ("2026-11-27", 30, ["calibration-expired"]),
        ("2026-11-27", 40, []),
        ("2026-11-27", 0, []),
        ("2027-01-07", 30, ["calibration-day-ahead"]),
        ("", 30, []),
    ],
)
def test_an_old_curve_is_told(on: str, days: int, codes: list[str]) -> None:
    curve = replace(CURVE, measured_on=on, valid_days=days)
    found = Calibration.of(SPEC).with_entry("a", response=curve).findings(SPEC, TODAY)
    assert [f.code for f in found] == codes
    if codes == ["calibration-expired"]:
        assert "calibrated 40 days ago" in str(found[0]) and "30 days" in str(found[0])
