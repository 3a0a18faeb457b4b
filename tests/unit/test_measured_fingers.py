"""The page of measured fingers: laws and measures against closed forms, its numbers against those that were kept."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from core.skin.model import fingertip_skin
from core.skin.surface_store import smooth_pad
from tests.benchmarks.figures_fingers import NUMBERS, main
from tests.benchmarks.fingers import trials
from tests.benchmarks.fingers.balls import ball_profiles
from tests.benchmarks.fingers.laws import ellipsoid, exponential, paraboloid, power, slope, straight
from tests.benchmarks.fingers.numbers import _rim, width
from tests.benchmarks.fingers.page import page
from tests.benchmarks.fingers.plate import MM, TOLERANCE, Moment, Plate, _stretch

pytestmark = pytest.mark.one_line("3.11", "a tool of developers: the product does not use it")

PRESETS = Path(__file__).resolve().parents[2] / "presets"
PAGE = PRESETS / "skins" / "measured_fingers.md"
FRICTION = 0.6


@pytest.fixture(scope="module")
def skin():
    return fingertip_skin(level="draft")


@pytest.fixture(scope="module")
def pad(skin):
    return smooth_pad(skin)


def disc(step):
    """Places of a grid within a disc of radius one."""
    axis = np.arange(-1.0, 1.0 + step, step)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return points[np.linalg.norm(points, axis=1) <= 1.0]


def test_the_page_is_what_its_numbers_say():
    said = json.loads(NUMBERS.read_text())
    assert PAGE.read_text() == page(said)
    assert set(said["tissues"]) == {"linear", "neo-Hookean"}
    assert all(each["unsettled"] == 0 for each in said["tissues"].values())


def test_the_pictures_of_the_page_are_there():
    pictures = re.findall(r"\]\((\.\./pictures/\w+\.png)\)", PAGE.read_text())
    assert len(pictures) == 5
    assert all((PAGE.parent / picture).is_file() for picture in pictures)


def test_laws_are_found_again():
    d = np.linspace(0.05, 2.0, 40)
    found = exponential(d, 0.3 * np.expm1(1.7 * d))
    assert (found.scale, found.rate, found.fit) == pytest.approx((0.3, 1.7, 1.0), rel=1e-3)
    found = power(d, 1.2 * d**1.83)
    assert (found.scale, found.rate, found.fit) == pytest.approx((1.2, 1.83, 1.0), rel=1e-3)
    assert power(d, 0.3 * np.expm1(1.7 * d)).fit < exponential(d, 0.3 * np.expm1(1.7 * d)).fit < 1.0 + 1e-12
    assert slope(d, 3.0 * d**0.64) == pytest.approx(0.64)
    assert straight(d, 4.0 - 2.0 * d) == pytest.approx(1.0)
    assert straight(d, (d - d.mean()) ** 2) == pytest.approx(0.0, abs=1e-9)


def test_pressure_is_told_from_hertz():
    points = disc(0.1) * [1.0, 1.4] + [0.3, -0.2]
    inside = np.maximum(1.0 - (points[:, 0] - 0.3) ** 2 - ((points[:, 1] + 0.2) / 1.4) ** 2, 0.0)
    assert paraboloid(points, 5.0 * inside) == pytest.approx(1.0)
    assert ellipsoid(points, 5.0 * np.sqrt(inside)) == pytest.approx(1.0)
    assert paraboloid(points, np.sqrt(inside)) < 0.96 and ellipsoid(points, inside) < 0.96


def test_an_annulus_around_half_of_a_disc():
    points = disc(0.02)
    sticks = np.linalg.norm(points, axis=1) < np.sqrt(0.5)
    n = len(points)
    moment = Moment(np.zeros(3), np.zeros(3), 1.0, 1.0, 0.5, points, np.ones(n), np.ones(n), sticks, True)
    exact = (1.0 - 2.0**-1.5) / (1.0 - 0.5) / (2.0**-1.5 / 0.5)
    assert exact == pytest.approx(1.83, abs=5e-3)
    assert _rim(moment) == pytest.approx(exact, rel=0.01)


def test_area_that_skin_covers_is_the_determinant():
    places = disc(0.1)
    rest = np.column_stack([places, np.zeros(len(places))])
    assert _stretch(places, rest, places @ np.array([[1.1, 0.3], [0.0, 0.9]])) == pytest.approx(0.99)
    tilted = np.column_stack([places[:, 0], places[:, 1] * 0.8, places[:, 1] * 0.6])  # as large as it was
    assert _stretch(places, tilted, tilted[:, :2]) == pytest.approx(0.8)


def test_width_at_half_height():
    x = np.linspace(-3.0, 3.0, 61)
    assert width(x, np.maximum(1.0 - np.abs(x) / 2.0, 0.0)) == pytest.approx(2.0)


def test_a_plate_obeys_friction_and_holds_its_force(skin, pad):
    plate = Plate(skin, pad, 0, FRICTION, np.radians(20.0))
    first, *more = plate.drag(1.0, (0.0, 1.0), 5.0 * MM, 0.2 * MM)
    assert abs(first.force[2] - 1.0) < 5e-3 and first.stuck > 0.9
    last = more[-1]
    assert last.stuck < 0.01 and last.force[1] == pytest.approx(FRICTION * last.force[2], rel=0.01)
    for moment in (first, *more):
        assert moment.settled and moment.force[2] == pytest.approx(1.0, abs=0.03)
        assert np.hypot(*moment.force[:2]) <= FRICTION * moment.force[2] * (1.0 + 1e-3)
        assert moment.pressure @ moment.areas == pytest.approx(moment.force[2], rel=1e-6)
    again = plate.drag(1.0, (0.0, 1.0), 5.0 * MM, 0.2 * MM)
    forces = [np.array([m.force for m in moments]) for moments in ((first, *more), again)]
    np.testing.assert_allclose(forces[1], forces[0], atol=10.0 * TOLERANCE)  # from the press that was kept


def test_a_plate_without_friction_pushes_along_its_normal(skin, pad):
    moments = Plate(skin, pad, 0, 0.0, np.radians(20.0)).press([0.5 * MM, 1.0 * MM])
    for moment in moments:
        np.testing.assert_allclose(moment.force[:2], 0.0, atol=1e-6 * moment.force[2])
    assert moments[1].skin > moments[0].skin and moments[1].force[2] > moments[0].force[2]


def test_a_stiffer_skin_under_more_force_moves_alike(skin, pad):
    # u depends on f / E alone, so does what touches
    soft = Plate(skin, pad, 0, FRICTION).press([1.0 * MM])[0]
    stiff = Plate(skin, pad.with_material(young=2.0 * pad.material.modulus), 0, FRICTION).press([1.0 * MM])[0]
    np.testing.assert_allclose(stiff.force[2], 2.0 * soft.force[2], rtol=1e-3)
    assert stiff.skin == pytest.approx(soft.skin, rel=1e-3)


def test_balls_are_told_at_the_forces_that_were_asked_for():
    skin = fingertip_skin(level="draft")
    sharp, blunt = (ball_profiles(skin, r, [0.2, 0.4], 0.75 * MM) for r in (3.0 * MM, 12.0 * MM))
    for profiles in (sharp, blunt):
        assert len(profiles) == 2 and profiles[0].depth < profiles[1].depth
        assert (np.diff(profiles[0].across) > 0).all()
        np.testing.assert_allclose(profiles[1].density, profiles[1].density[::-1], rtol=0.02)  # the finger's two sides
    assert sharp[0].density.max() > blunt[0].density.max()
    assert sharp[0].depth > blunt[0].depth


def test_the_command_writes_page_pictures_and_numbers(tmp_path, capsys, monkeypatch):
    """With one ball for all, on linear skin: what balls do to skin is tested above."""
    kept = {}

    def profiles(skin, radius, forces, below):
        if below not in kept:
            kept[below] = ball_profiles(skin, radius, forces, below)
        return kept[below]

    monkeypatch.setattr(trials, "ball_profiles", profiles)
    arguments = ["--out", str(tmp_path), "--numbers", str(tmp_path / "n.json"), "--level", "draft", "--squares", "0"]
    assert main(arguments) == 0
    said = json.loads((tmp_path / "n.json").read_text())
    text = (tmp_path / "skins" / "measured_fingers.md").read_text()
    assert text == page(said) and capsys.readouterr().out == text + "\n"
    assert len(list((tmp_path / "pictures").glob("fingers_*.png"))) == 5
    drags = [d for by in said["tissues"]["linear"]["drag"].values() for d in by.values()]
    assert all(d["held"] < 0.05 and 0.0 < d["straight"] <= 1.0 and d["rim"] > 1.0 for d in drags)
