"""A finger over a bump: friction against the closed form of a Gaussian, volts against the friction law."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.__main__ import main
from core.devices.friction_screen import FrictionScreen
from core.errors import DermisError
from core.presets import Library
from core.studies.bump import PROFILES, Bump, bump_curve, csv

HEIGHT, WIDTH = 1e-3, 8e-3


@pytest.fixture(scope="module")
def found() -> Bump:
    return bump_curve(Library(), height=HEIGHT, width=WIDTH)


def test_friction_is_that_of_the_papers_profiles(found: Bump) -> None:
    """Height from 1 to 100, slope up to 100 uphill and none downhill, a rectangle from half the height on."""
    share = np.exp(-0.5 * (found.place / WIDTH) ** 2)
    inside = slice(2, -2)
    np.testing.assert_allclose(found.relief[inside], HEIGHT * share[inside], atol=2e-4 * HEIGHT)
    np.testing.assert_allclose(found.friction["height"][inside], 1.0 + 99.0 * share[inside], atol=0.1)
    slope = np.maximum(-found.place / WIDTH * share * np.exp(0.5), 0.0)
    np.testing.assert_allclose(found.friction["slope"][inside], 100.0 * slope[inside], atol=0.2)
    clear = np.abs(share - 0.5) > 0.01
    np.testing.assert_array_equal(found.friction["rectangle"][clear], np.where(share[clear] > 0.5, 100.0, 1.0))


def test_volts_are_those_that_the_law_asks_for(found: Bump) -> None:
    device = FrictionScreen.of(Library().device("electrovibration"))
    for profile in PROFILES:
        expected = np.minimum(device.law.volts(found.friction[profile]), device.limit)
        np.testing.assert_allclose(found.volts[profile], expected, rtol=1e-6, atol=1e-6)


def test_a_bump_that_is_none_is_refused() -> None:
    with pytest.raises(DermisError, match=r"height out of range .*allowed: 0.001 to 20 mm"):
        bump_curve(Library(), height=0.5)
    with pytest.raises(DermisError, match="speed out of range"):
        bump_curve(Library(), speed=float("nan"))
    with pytest.raises(DermisError, match="not a friction screen"):
        bump_curve(Library(), "haptip")


def test_the_verb_writes_table_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str], found: Bump) -> None:
    assert main(["bump", "--out", str(tmp_path)]) == 0
    assert "slope" in capsys.readouterr().out
    assert (tmp_path / "electrovibration.bump.csv").read_text() == csv(found)
    assert (tmp_path / "electrovibration.bump.png").read_bytes()[:4] == b"\x89PNG"
