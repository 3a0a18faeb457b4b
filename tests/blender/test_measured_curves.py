"""Measured curves of a built device: typed, read, driven, kept with it, and told when they are old."""

from __future__ import annotations

from datetime import date, timedelta
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon._core import core
from blender_addon.panels.calibration import DERMIS_PT_stream_calibration
from blender_addon.preferences import library
from blender_addon.quantities import quantity
from blender_addon.streaming import board_identity, built_devices, device_calibration, session

from . import build
from .stand_in import Anything, Panel
from .test_stream import HAPTIP, a_track, heard, state, wait

pytestmark = pytest.mark.shared_tests("files of calibrations, and the sender")

UP, DOWN = ("-30 -29; -20 -20; -10 -10; 0 0; 10 10; 20 20; 30 30", "20 21; 10 11; 0 1; -10 -9; -20 -19; -30 -29")
TYPED = f"{UP}; {DOWN}"  # a degree of play


@pytest.fixture
def scene() -> Any:
    """A finger with a HapTip, connected, jogged by hand."""
    made = bpy.context.scene
    build.finger("Index").dermis.finger.devices.add().preset = HAPTIP
    build.keep(made, core.pipeline.bake.Output("Index", HAPTIP, a_track(finger_name="Index"), {}, ()))
    made.dermis_stream.output, made.dermis_stream.ramp, made.dermis_stream.mode = "Index: haptip", 0.1, "jog"
    session.connect(made)
    yield made
    session.close()


def told(scene: Any) -> Any:
    """Return what the sender was told of the first pulley."""
    made = core.devices.calibration.Calibration.loads(session._client._request["calibration"])
    return made.entries.get("pulley_1")


@pytest.mark.real_time
def test_a_typed_curve_is_driven_inverted_and_kept_with_the_device(scene: Any) -> None:
    settings = scene.dermis_stream
    assert bpy.ops.dermis.measured_curve_type(channel="pulley_1", readings=TYPED, valid_days=10) == {"FINISHED"}
    curve = told(scene).response
    assert curve.valid_days == 10 and curve.measured_on == date.today().isoformat()
    wait(state("ready"))
    session.arm(scene)
    settings.channels[0].jog = 0.3
    wait(lambda s: s.get("values") and abs(float(curve.rises(s["values"][0])) - 0.3) < 1e-4)
    wait(lambda s: abs(heard(s)[0] - session.status()["values"][0]) < 1e-3)
    session.stop()
    bpy.ops.dermis.calibration_keep(name="left, red tape", serial="")
    kept = built_devices.device(device_calibration.worn_by(scene).file).made
    assert kept.entries["pulley_1"].response == curve and not device_calibration.unsaved(scene)
    bpy.ops.dermis.measured_curve_drop(channel="pulley_1")
    assert told(scene) is None and device_calibration.unsaved(scene)
    device_calibration.use(scene, device_calibration.worn_by(scene).file)
    assert settings.channels[0].response


def test_a_csv_is_read(scene: Any, tmp_path: Path) -> None:
    path = tmp_path / "caliper.csv"
    path.write_text("driven [deg],reached [deg]\n-30,-28\n0,1\n30,29\n")
    assert bpy.ops.dermis.measured_curve_load(filepath=str(path), channel="pulley_1", latency=0.02) == {"FINISHED"}
    assert told(scene).response.latency == pytest.approx(0.02)
    path.write_text("driven [deg],reached [deg]\n-30,-28\n0,-29\n30,29\n")
    with pytest.raises(RuntimeError, match="does not rise"):
        bpy.ops.dermis.measured_curve_load(filepath=str(path), channel="pulley_1")
    assert told(scene).response.latency == pytest.approx(0.02), "what was refused changes nothing"


@pytest.mark.parametrize(
    ("readings", "what"),
    [
        ("0 0; 30", "not pairs"),
        ("0 0; 30 x", "not pairs"),
        ("", "not pairs"),
        ("10 10; 30 30", "safe state lies outside"),
    ],
)
def test_what_is_no_curve_is_refused_in_words(scene: Any, readings: str, what: str) -> None:
    with pytest.raises(RuntimeError, match=what):
        bpy.ops.dermis.measured_curve_type(channel="pulley_1", readings=readings)
    assert not scene.dermis_stream.channels[0].response


def test_connect_says_that_it_is_old(scene: Any) -> None:
    curve = core.devices.response_readings.of_readings(
        [-0.5, 0.5], [-0.5, 0.5], measured_on=(date.today() - timedelta(40)).isoformat(), valid_days=30
    )
    scene.dermis_stream.channels[0].response = curve.dumps()
    bpy.ops.dermis.calibration_keep(name="left, red tape", serial="")
    session.close()
    session.connect(scene)
    said = board_identity.advice(scene)
    assert "calibrated 40 days ago" in said and "30 days" in said


def test_the_panel_offers_a_curve_and_says_what_it_is(scene: Any) -> None:
    def words() -> str:
        layout = Anything()
        Panel(DERMIS_PT_stream_calibration, layout).draw(bpy.context)
        return " ".join(layout.words)

    assert words().count("Measured Curve...") == 2
    bpy.ops.dermis.measured_curve_type(channel="pulley_1", readings=TYPED)
    said = words()
    assert said.count("Measured Curve...") == 1 and "reaches -29.00" in said and "play 1.00" in said
    wire = core.stream.protocols.wire.Wire.of(library().device(HAPTIP))
    low, high = (quantity(float(of[wire.names.index("pulley_1")]), "rad") for of in (wire.range_low, wire.range_high))
    assert f"(preset: {low} to {high})" in said, "what the built device reaches stands beside its preset"
    assert f"measured on {date.today().isoformat()}" in said
    scene.dermis_stream.channels[1].response = "{}"
    assert "fields missing" in words(), "what a file of somebody else's holds is told, not drawn as a curve"


def test_a_frequency_response_is_typed_read_kept_and_taken_away(scene: Any, tmp_path: Path) -> None:
    row = scene.dermis_stream.channels[0]
    typed = bpy.ops.dermis.frequency_response_type(channel="pulley_1", readings="20 1 -5; 80 1.2 -30", valid_days=10)
    assert typed == {"FINISHED"}
    response = told(scene).frequency
    assert response.span == (20.0, 80.0) and response.valid_days == 10
    assert response.measured_on == date.today().isoformat()
    layout = Anything()
    Panel(DERMIS_PT_stream_calibration, layout).draw(bpy.context)
    words = " ".join(layout.words)
    assert "answers 20 to 80 Hz, 1.2 times at 80 Hz" in words and words.count("Frequency Response...") == 1
    path = tmp_path / "shaker.csv"
    path.write_text("frequency [Hz],gain [dB],phase [deg]\n10,0,-2\n50,1,-20\n")
    assert bpy.ops.dermis.frequency_response_load(filepath=str(path), channel="pulley_1") == {"FINISHED"}
    assert told(scene).frequency.span == (10.0, 50.0)
    path.write_text("frequency [Hz],gain [dB],phase [deg]\n10,0,-2\n50,-40,-20\n")
    with pytest.raises(RuntimeError, match="gain is too small"):
        bpy.ops.dermis.frequency_response_load(filepath=str(path), channel="pulley_1")
    with pytest.raises(RuntimeError, match="needs three numbers"):
        bpy.ops.dermis.frequency_response_type(channel="pulley_1", readings="20 1")
    assert told(scene).frequency.span == (10.0, 50.0), "what was refused changes nothing"
    bpy.ops.dermis.calibration_keep(name="left, red tape", serial="")
    assert built_devices.device(device_calibration.worn_by(scene).file).made.entries["pulley_1"].frequency.span[1] == 50
    assert "inverse of its frequency response" in board_identity.advice(scene), "Connect reports"
    bpy.ops.dermis.measured_curve_drop(channel="pulley_1", part="frequency")
    assert not row.frequency and told(scene) is None and device_calibration.unsaved(scene)
    device_calibration.use(scene, device_calibration.worn_by(scene).file)
    assert scene.dermis_stream.channels[0].frequency
