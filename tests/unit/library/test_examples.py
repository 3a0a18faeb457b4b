"""The examples as a person runs them, with the library installed; each judged by a law that its result must keep."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from .conftest import ROOT, Installed

EXAMPLES = ROOT / "tests" / "examples"


def result(library: Installed, name: str) -> Any:
    """Run an example and return what its `main` does; what it prints comes before."""
    code = f"import json, runpy; print(json.dumps(runpy.run_path({str(EXAMPLES / name)!r})['main']()))"
    printed = library.run("-c", code).splitlines()
    assert len(printed) > 1, "an example shows something"
    return json.loads(printed[-1])


def test_every_example_is_judged_here() -> None:
    judged = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {path.stem for path in EXAMPLES.glob("*.py")} <= judged


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_sphere_and_edge(library: Installed) -> None:
    """Force grows faster than depth, as the contact grows; an edge's contact is a line, a ball's is round."""
    told = result(library, "sphere_and_edge.py")
    for surface in told.values():
        slopes = np.diff([0.0, *surface["force"]])
        assert (np.diff(slopes) > 0).all(), slopes
        assert (np.diff(surface["pressure"]) > 0).all()
    ball, edge = told["ball"], told["edge"]
    assert edge["along"][-1] > 4 * edge["across"][-1]
    assert ball["along"][-1] < 2 * ball["across"][-1]


def test_pins_matched(library: Installed) -> None:
    """Pins only push, and no harder than they can; of those that do, none is nearer than the optimum by its norm."""
    told = result(library, "pins_matched.py")
    touch, track = told.pop("touch"), told.pop("track")
    assert track["seconds"] == pytest.approx(1.0) and track["off"] < 1e-9
    for method, pins in told.items():
        if method.endswith(("1", "2")):
            assert pins["least"] >= 0.0 and pins["most"] <= pins["limit"] + 1e-12, method
            assert pins["off"] >= told["DM2"]["off"] >= told["DM0"]["off"], method
    assert told["DM2"]["optimality"] < 1e-9 and told["FM2"]["optimality"] < 1e-9
    assert told["FM2"]["sum"] == pytest.approx(touch["normal_force"], rel=0.15), "the same push, in few places"


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_thimble_follows(library: Installed) -> None:
    """It presses while the plate does and not before, as hard as it, and never faster than its servos turn."""
    told = result(library, "thimble_follows.py")
    depth = np.interp(told["track_time"], told["time"], told["depth"])
    wanted, rendered = np.array(told["wanted"]), np.array(told["rendered"])
    assert wanted[depth < -0.2e-3].max() == 0.0 and rendered[depth < -0.2e-3].max() == 0.0
    assert wanted.max() > 0.5 and np.median(np.abs(rendered - wanted)[wanted > 0.1]) < 0.05 * wanted.max()
    assert max(told["speed"]) <= told["speed_limit"][0] * (1 + 1e-9)


def test_texture_to_track(library: Installed) -> None:
    """A grating of period f vibrates at v / f: 40 mm/s over 2 mm is 20 Hz."""
    for speed, frequency in result(library, "texture_to_track.py").items():
        assert frequency == pytest.approx(float(speed) / 2e-3, abs=1.01)


def test_scene_to_csv(library: Installed) -> None:
    """The tap shows when the finger arrives, and the file gives back what was rendered, to nine digits."""
    told = result(library, "scene_to_csv.py")
    assert told["file"] == "Index.haptip.csv" and not told["errors"] and told["same_hash"]
    assert told["first_moved"] == pytest.approx(20e-3 / 0.2, abs=5e-3)
    assert told["off"] < 1e-9 and told["duration"] == pytest.approx(0.295, abs=1e-3)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_depth_map_to_volts(library: Installed) -> None:
    """Friction follows the slope uphill, steepest at sigma before the top, and volts [S4] eq. 1; nothing downhill."""
    told = result(library, "depth_map_to_volts.py")
    x, friction, volts = (np.array(told[name]) for name in ("x", "friction", "volts"))
    slope = -x / 15e-3 * np.exp(0.5 - x**2 / (2 * 15e-3**2))  # of the bump, relative to its steepest
    assert friction == pytest.approx(np.clip(100.0 * slope, 0.0, None), abs=1.5)
    assert x[volts.argmax()] == pytest.approx(-15e-3, abs=1e-3)
    assert not volts[x > 1e-3].any()
    felt = friction > 1.0
    assert np.log10(friction[felt]) == pytest.approx(1.24 * np.log10(volts[felt]) - 1.05, abs=1e-6)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_how_many_motors(library: Installed) -> None:
    """A plate that only presses moves all cables together: one motor will do. One that rolls needs them apart."""
    told = result(library, "how_many_motors.py")
    assert told["flat"]["motors"] == 1 < told["complex"]["motors"] <= 3
    for touch in told.values():
        assert touch["percent"][0][-1] == pytest.approx(0.0, abs=1e-9), "all motors leave what all motors leave"
