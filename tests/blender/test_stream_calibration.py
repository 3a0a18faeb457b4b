"""A calibration drives the device that it was made on, and no other: not another finger's, not another scene's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon._core import core
from blender_addon.results import store
from blender_addon.streaming import device_calibration, session
from blender_addon.viewport import shown as views

from . import build
from .test_stream import HAPTIP, a_track, heard, state, wait

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]


@pytest.fixture
def scene() -> Any:
    """Two fingers with a HapTip each, and a bake for both."""
    pipeline, made = core.pipeline.bake, bpy.context.scene
    made.frame_start, made.frame_end = 1, 49
    for name in ("Index", "Thumb"):
        build.finger(name).dermis.finger.devices.add().preset = HAPTIP
    found = tuple(pipeline.Output(n, HAPTIP, a_track(finger_name=n), {}, ()) for n in ("Index", "Thumb"))
    build.keep(made, *found)
    made.dermis_stream.output = "Index: haptip"
    made.dermis_stream.ramp = 0.1
    return made


def listed(scene: Any) -> list[tuple[float, float, bool]]:
    """Return zero, gain and whether there are limits of every actuator in the list."""
    return [(c.zero, c.gain, c.use_limits) for c in scene.dermis_stream.channels]


def driven(scene: Any) -> dict[str, Any]:
    """Return the calibration that the sender was told."""
    return dict(core.devices.calibration.Calibration.loads(session._client._request["calibration"]).entries)


PLAIN = [(0.0, 1.0, False)] * 2
SET = [(0.125, -1.0, False), (0.0, 1.0, False)]


def test_the_twin_shows_what_was_commanded_of_a_device_that_is_mounted_the_other_way_round(scene: Any) -> None:
    settings = scene.dermis_stream
    settings.mode = "follow"
    scene.frame_set(7)
    session.connect(scene)
    settings.channels[0].zero, settings.channels[0].gain = 0.05, -1.0
    wait(state("ready"))
    session.arm(scene)
    wanted = a_track().values[250]
    wait(lambda s: np.allclose(heard(s), [0.05 - wanted[2], wanted[3]], atol=1e-4))
    shown = views.devices(scene)
    assert shown.source == "device"
    at = [shown.rows[0].values[name] for name in ("tactor_x", "tactor_y", "pulley_1", "pulley_2")]
    assert at == pytest.approx(wanted, abs=1e-4)
    assert at[:2] == pytest.approx(wanted[:2], abs=2e-6), "mirrored and moved, the tactor would be elsewhere"


def test_each_fingers_device_has_its_own(scene: Any) -> None:
    settings = scene.dermis_stream
    session.connect(scene)
    settings.channels[0].zero, settings.channels[0].gain = 0.125, -1.0
    assert driven(scene)["pulley_1"].zero == 0.125
    session.close()
    settings.output = "Thumb: haptip"
    session.connect(scene)
    assert listed(scene) == PLAIN and driven(scene) == {} and settings.channels_of == "Thumb: haptip"
    session.close()
    settings.output = "Index: haptip"
    session.connect(scene)
    assert listed(scene) == SET
    assert {n: (e.zero, e.gain) for n, e in driven(scene).items()} == {"pulley_1": (0.125, -1.0)}


def test_switching_under_way_switches_the_calibration_too(scene: Any) -> None:
    settings = scene.dermis_stream
    settings.mode = "jog"
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    settings.channels[0].zero = 0.125
    wait(lambda s: s["armed"] and abs(heard(s)[0] - 0.125) < 1e-4)
    settings.output = "Thumb: haptip"
    assert driven(scene) == {}
    wait(lambda s: s["armed"] and abs(heard(s)[0]) < 1e-4)
    settings.output = "Index: haptip"
    wait(lambda s: s["armed"] and abs(heard(s)[0] - 0.125) < 1e-4)


def test_the_choice_counts_before_the_bake_does(scene: Any) -> None:
    """Without a bake the settings speak of the finger that is chosen, not of the first."""
    store.forget()
    scene.dermis_stream.output = "Thumb: haptip"
    session.connect(scene)
    assert scene.dermis_stream.channels_of == "Thumb: haptip"


def test_a_loaded_track_is_for_the_device_of_the_finger_it_names(scene: Any, tmp_path: Path) -> None:
    session.connect(scene)
    scene.dermis_stream.channels[0].zero, scene.dermis_stream.channels[0].gain = 0.125, -1.0
    path = tmp_path / "thumb.csv"
    core.track.csv.write(a_track(finger_name="Thumb"), path)
    bpy.ops.dermis.load_track(filepath=str(path))
    assert driven(scene) == {} and scene.dermis_stream.channels_of == "Thumb: haptip"
    scene.dermis_stream.track_file = ""
    assert listed(scene) == SET


def test_cancelling_in_another_scene_touches_neither(scene: Any) -> None:
    session.connect(scene)
    scene.dermis_stream.channels[0].zero = 0.125
    bpy.ops.dermis.stream_calibrate(action="BEGIN")
    scene.dermis_stream.channels[0].zero = 0.25
    other = bpy.data.scenes.new("Other")
    with bpy.context.temp_override(scene=other):
        assert not device_calibration.calibrating(other)
        bpy.ops.dermis.stream_calibrate(action="CANCEL")
    assert len(other.dermis_stream.channels) == 0 and other.dermis_stream.mode == "play"
    assert scene.dermis_stream.channels[0].zero == 0.25 and device_calibration.calibrating(scene)
    with bpy.context.temp_override(scene=other):
        bpy.ops.dermis.stream_calibrate(action="BEGIN")
    bpy.ops.dermis.stream_calibrate(action="CANCEL")
    assert scene.dermis_stream.channels[0].zero == 0.125 and device_calibration.calibrating(other)


def test_cancelling_after_a_switch_gives_each_device_its_own_back(scene: Any) -> None:
    settings = scene.dermis_stream
    session.connect(scene)
    settings.channels[0].zero, settings.channels[0].gain = 0.125, -1.0
    bpy.ops.dermis.stream_calibrate(action="BEGIN")
    settings.channels[0].zero = 0.25
    settings.output = "Thumb: haptip"
    settings.channels[1].zero = 0.0625
    bpy.ops.dermis.stream_calibrate(action="CANCEL")
    assert settings.channels_of == "Thumb: haptip" and listed(scene) == PLAIN and driven(scene) == {}
    settings.output = "Index: haptip"
    assert listed(scene) == SET


def test_cancelling_what_began_before_connecting_leaves_the_actuators_listed(scene: Any) -> None:
    bpy.ops.dermis.stream_calibrate(action="BEGIN")
    session.connect(scene)
    scene.dermis_stream.channels[0].zero = 0.125
    bpy.ops.dermis.stream_calibrate(action="CANCEL")
    assert listed(scene) == PLAIN


def test_a_dot_in_the_name_is_a_part_of_it(scene: Any, tmp_path: Path) -> None:
    session.connect(scene)
    for side, zero in (("left", 0.125), ("right", 0.25)):
        scene.dermis_stream.channels[0].zero = zero
        bpy.ops.dermis.calibration_save(filepath=str(tmp_path / f"haptip.{side}"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["haptip.left.json", "haptip.right.json"]
    read = core.devices.calibration.Calibration.load
    assert [read(tmp_path / f"haptip.{side}.json").entries["pulley_1"].zero for side in ("left", "right")] == [
        0.125,
        0.25,
    ]
    bpy.ops.dermis.calibration_save(filepath=str(tmp_path / "haptip.left.json"))
    assert len(list(tmp_path.iterdir())) == 2, "a name that has its ending gets no second one"
    with pytest.raises(RuntimeError, match="no file is chosen"):
        bpy.ops.dermis.calibration_save(filepath="")


def test_cancelling_brings_back_the_device_from_before(scene: Any) -> None:
    session.connect(scene)
    channel = scene.dermis_stream.channels[0]
    for name, zero in (("other", 0.25), ("mine", 0.125)):
        channel.zero = zero
        bpy.ops.dermis.calibration_keep(name=name)
    bpy.ops.dermis.stream_calibrate(action="BEGIN")
    bpy.ops.dermis.calibration_use(file="haptip-other.json")
    assert (scene.dermis_stream.channels[0].zero, device_calibration.worn_by(scene).made.name) == (0.25, "other")
    bpy.ops.dermis.stream_calibrate(action="CANCEL")
    assert (scene.dermis_stream.channels[0].zero, device_calibration.worn_by(scene).made.name) == (0.125, "mine")
    assert driven(scene)["pulley_1"].zero == 0.125


def test_what_is_put_by_is_kept_in_the_file_for_this_session(scene: Any, tmp_path: Path) -> None:
    session.connect(scene)
    scene.dermis_stream.channels[0].zero, scene.dermis_stream.channels[0].gain = 0.125, -1.0
    scene.dermis_stream.output = "Thumb: haptip"
    session.close()
    path = str(tmp_path / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = bpy.context.scene
    assert listed(scene) == PLAIN
    scene.dermis_stream.output = "Index: haptip"
    assert listed(scene) == SET
