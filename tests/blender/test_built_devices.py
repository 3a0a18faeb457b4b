"""A calibration belongs to one built device: kept on this computer, worn by one finger, and by no copy of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon import identity
from blender_addon._core import core
from blender_addon.results import store
from blender_addon.streaming import board_identity, built_devices, calibration_offers, device_calibration, session

from . import build
from .test_stream import HAPTIP, a_track, state, wait
from .test_stream_calibration import PLAIN, SET, driven, listed
from .test_undo import push, undo

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("files of calibrations, and the sender")]
VIRTUAL = b"VIRTUAL1".hex()  # what the simulated device answers with


def bake(scene: Any, *fingers: str) -> None:
    """Keep a bake with a HapTip's track for some fingers."""
    pipeline = core.pipeline.bake
    found = tuple(pipeline.Output(n, HAPTIP, a_track(finger_name=n), {}, ()) for n in fingers)
    build.keep(scene, *found)


@pytest.fixture
def scene() -> Any:
    """Two fingers with a HapTip each, and a bake for both."""
    made = bpy.context.scene
    made.frame_start, made.frame_end = 1, 49
    for name in ("Index", "Thumb"):
        build.finger(name).dermis.finger.devices.add().preset = HAPTIP
    bake(made, "Index", "Thumb")
    made.dermis_stream.output = "Index: haptip"
    return made


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    session.close()


def mark(scene: Any, name: str = "left, red tape", serial: str = "") -> None:
    """Calibrate the finger's device and save it under a name."""
    device_calibration.fill_channels(scene)
    scene.dermis_stream.channels[0].zero, scene.dermis_stream.channels[0].gain = 0.125, -1.0
    assert bpy.ops.dermis.calibration_keep(name=name, serial=serial) == {"FINISHED"}


def another_session(monkeypatch: pytest.MonkeyPatch) -> None:
    """Be a Blender that was started later."""
    monkeypatch.setattr(calibration_offers, "_SESSION", "another")
    device_calibration.forget()


def another_computer(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Be a Blender that knows no built device."""
    another_session(monkeypatch)
    monkeypatch.setattr(built_devices, "user_folder", lambda *_, **__: folder)


def reopened(path: Path) -> Any:
    """Save and open the file; return its scene."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def worn(scene: Any) -> str:
    """Return the name of the device that is listed after connecting, '' for none."""
    session.connect(scene)
    one = device_calibration.worn_by(scene)
    return one.made.name if one is not None else ""


def test_it_is_remembered_for_the_finger_on_this_computer(scene: Any, tmp_path: Path, monkeypatch: Any) -> None:
    mark(scene)
    folder = built_devices.user_folder(built_devices.FOLDER)
    read = core.devices.calibration.Calibration.load(folder / "haptip-left-red-tape.json")
    assert (read.name, read.device, read.entries["pulley_1"].zero) == ("left, red tape", HAPTIP, 0.125)
    another_session(monkeypatch)
    scene = reopened(tmp_path / "a.blend")
    assert worn(scene) == "left, red tape" and listed(scene) == SET and driven(scene)["pulley_1"].gain == -1.0
    assert calibration_offers.offers(scene) == []
    scene.dermis_stream.output = "Thumb: haptip"
    assert worn(scene) == "" and listed(scene) == PLAIN


def test_renaming_the_finger_loses_nothing(scene: Any, tmp_path: Path, monkeypatch: Any) -> None:
    mark(scene)
    bpy.data.objects["Index"].name = "Zeigefinger"
    assert worn(scene) == "left, red tape" and listed(scene) == SET, "the bake still says 'Index'"
    bake(scene, "Zeigefinger", "Thumb")
    scene.dermis_stream.output = "Zeigefinger: haptip"
    assert worn(scene) == "left, red tape" and scene.dermis_stream.channels_of == "Zeigefinger: haptip"
    another_session(monkeypatch)
    scene = reopened(tmp_path / "a.blend")
    assert worn(scene) == "left, red tape" and listed(scene) == SET


def test_what_is_not_saved_survives_renaming_too(scene: Any) -> None:
    session.connect(scene)
    scene.dermis_stream.channels[0].zero, scene.dermis_stream.channels[0].gain = 0.125, -1.0
    bpy.data.objects["Index"].name = "Zeigefinger"
    bake(scene, "Zeigefinger")
    scene.dermis_stream.output = "Zeigefinger: haptip"
    assert listed(scene) == SET and driven(scene)["pulley_1"].zero == 0.125


@pytest.mark.parametrize("original_goes", [False, True])
def test_a_copy_of_a_finger_wears_nothing(scene: Any, tmp_path: Path, monkeypatch: Any, original_goes: bool) -> None:
    mark(scene)
    copy = bpy.data.objects["Index"].copy()
    copy.name = "A Copy"  # before 'Index' in every list
    scene.collection.objects.link(copy)
    if original_goes:
        bpy.data.objects.remove(bpy.data.objects["Index"])
    store.forget()
    scene.dermis_stream.output = "A Copy: haptip"
    assert worn(scene) == "" and listed(scene) == PLAIN and driven(scene) == {}
    another_session(monkeypatch)
    scene = reopened(tmp_path / "a.blend")
    assert worn(scene) == "" and listed(scene) == PLAIN
    if not original_goes:
        scene.dermis_stream.output = "Index: haptip"
        assert worn(scene) == "left, red tape" and listed(scene) == SET


def test_a_copy_in_a_file_that_was_only_opened_wears_nothing(scene: Any, tmp_path: Path, monkeypatch: Any) -> None:
    mark(scene)
    another_session(monkeypatch)
    scene = reopened(tmp_path / "a.blend")
    copy = bpy.data.objects["Index"].copy()
    scene.collection.objects.link(copy)
    bpy.data.objects.remove(bpy.data.objects["Index"])
    scene.dermis_stream.output = f"{copy.name}: haptip"
    assert worn(scene) == "" and listed(scene) == PLAIN


def test_a_file_of_another_computer_calibrates_nothing_here(scene: Any, tmp_path: Path, monkeypatch: Any) -> None:
    mark(scene)
    another_computer(monkeypatch, tmp_path / "there")
    scene = reopened(tmp_path / "a.blend")
    assert [o.name for o in calibration_offers.offers(scene)] == ["Index: haptip"], "offered before connecting too"
    assert "not known on this computer" in (session.connect(scene) or board_identity.advice(scene))
    assert device_calibration.worn_by(scene) is None and listed(scene) == PLAIN and driven(scene) == {}
    bpy.ops.dermis.calibration_keep_found(name="from a friend")
    assert calibration_offers.offers(scene) == [] and listed(scene) == PLAIN, "saved, and worn by nobody"
    (one,) = built_devices.devices(HAPTIP)
    assert (one.made.name, one.made.entries["pulley_1"].gain) == ("from a friend", -1.0)
    bpy.ops.dermis.calibration_use(file=one.file)
    assert listed(scene) == SET and driven(scene)["pulley_1"].zero == 0.125


def test_a_file_of_an_older_version_is_offered_once(scene: Any, tmp_path: Path, monkeypatch: Any) -> None:
    """Version 0.1.0 kept calibrations in the .blend: the list, and a shelf of 'finger: device'."""
    settings = scene.dermis_stream
    for channels in (settings.channels, settings.shelf.add().channels):
        for name in ("pulley_1", "pulley_2"):
            channels.add().name = name
        channels[0].zero, channels[0].gain = 0.125, -1.0
    settings.channels_of, settings.shelf[0].name = "Index: haptip", "Thumb: haptip"
    settings.channels[0].zero = 0.25
    another_session(monkeypatch)
    scene = reopened(tmp_path / "old.blend")
    assert worn(scene) == "" and listed(scene) == PLAIN and driven(scene) == {}, "nothing is applied silently"
    assert [(o.name, o.channels[0]["zero"]) for o in calibration_offers.offers(scene)] == [
        ("Index: haptip", 0.25),
        ("Thumb: haptip", 0.125),
    ]
    bpy.ops.dermis.calibration_keep_found(index=1, name="thumb's")
    bpy.ops.dermis.calibration_drop_found(index=0)
    another_session(monkeypatch)
    scene = reopened(tmp_path / "old.blend")
    assert calibration_offers.offers(scene) == []


def test_changes_that_were_not_saved_are_offered_by_the_next_session(
    scene: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    mark(scene)
    scene.dermis_stream.channels[0].zero = 0.5
    another_session(monkeypatch)
    scene = reopened(tmp_path / "a.blend")
    assert worn(scene) == "left, red tape" and listed(scene) == SET
    (offer,) = calibration_offers.offers(scene)
    assert offer.channels[0]["zero"] == 0.5


def test_choosing_another_device_loses_nothing_unsaved(scene: Any) -> None:
    mark(scene)
    scene.dermis_stream.channels[0].zero = 0.5
    bpy.ops.dermis.calibration_use(file="")
    assert listed(scene) == PLAIN and calibration_offers.offers(scene)[0].channels[0]["zero"] == 0.5
    bpy.ops.dermis.calibration_use(file="haptip-left-red-tape.json")
    assert listed(scene) == SET


@pytest.mark.undo
def test_undo_takes_neither_identity_nor_choice(scene: Any) -> None:
    push("before anything")
    mark(scene)
    own = identity.identity(bpy.data.objects["Index"])
    bpy.data.objects["Index"].location.x = 0.5
    push("moved")
    undo()
    scene = bpy.context.scene
    assert identity.identity(bpy.data.objects["Index"]) == own
    assert worn(scene) == "left, red tape" and listed(scene) == SET


@pytest.mark.undo
def test_after_undo_panel_list_and_device_agree(scene: Any) -> None:
    mark(scene)
    bpy.ops.dermis.calibration_use(file="")
    session.connect(scene)
    push("uncalibrated")
    bpy.ops.dermis.calibration_use(file="haptip-left-red-tape.json")
    push("calibrated")
    assert board_identity.shown(scene) == ("left, red tape", "", False)
    assert driven(scene)["pulley_1"].zero == 0.125
    undo()
    scene = bpy.context.scene
    session.heartbeat()  # in the window at most 20 ms later
    assert listed(scene) == PLAIN and driven(scene) == {}
    shown = board_identity.shown(scene)
    assert shown.name == "Uncalibrated" and "'left, red tape' was chosen last" in shown.message
    bpy.ops.dermis.calibration_use(file="haptip-left-red-tape.json")
    assert listed(scene) == SET and board_identity.shown(scene).message == ""


def test_a_device_whose_file_is_gone_can_be_changed_for_another(scene: Any) -> None:
    mark(scene)
    device_calibration.forget()
    (built_devices.user_folder(built_devices.FOLDER) / "haptip-left-red-tape.json").unlink()
    scene.dermis_stream.output = "Thumb: haptip"
    with pytest.raises(RuntimeError, match="cannot be read"):
        scene.dermis_stream["output"] = "Index: haptip"
        bpy.ops.dermis.stream_connect()
    bpy.ops.dermis.calibration_use(file="")
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"} and listed(scene) == PLAIN


def test_the_device_that_answers_is_recognised(scene: Any) -> None:
    made = core.devices.calibration.Calibration.of(core.presets.Library().device(HAPTIP))
    built_devices.save(made.with_entry("pulley_1", zero=0.125, gain=-1.0).owned_by("in the box", VIRTUAL))
    session.connect(scene)
    assert listed(scene) == PLAIN
    status = wait(lambda s: s["state"] == "ready" and "in the box" in s["message"])
    assert "serial number" in status["message"] and board_identity.answered() == (VIRTUAL,)
    assert listed(scene) == SET and driven(scene)["pulley_1"].zero == 0.125
    assert built_devices.choice(identity.identity(bpy.data.objects["Index"]), HAPTIP) == "haptip-in-the-box.json"


def test_going_without_is_a_choice_that_nothing_overrides(scene: Any) -> None:
    mark(scene, serial=VIRTUAL)
    bpy.ops.dermis.calibration_use(file="")
    session.connect(scene)
    wait(lambda s: s["state"] == "ready" and "left, red tape" in s["message"])
    assert listed(scene) == PLAIN and driven(scene) == {}


def test_another_device_than_the_chosen_one_is_not_armed(scene: Any) -> None:
    mark(scene, serial="0102030405060708")
    session.connect(scene)
    status = wait(lambda s: s["state"] == "ready" and "the device that answered is not" in s["message"])
    assert board_identity.shown(scene).wrong
    assert "left, red tape" in status["message"] and VIRTUAL in status["message"]
    with pytest.raises(RuntimeError, match="the device that answered is not"):
        bpy.ops.dermis.stream_arm()
    wait(state("ready"))
    assert not session.status()["armed"]
    bpy.ops.dermis.calibration_keep(name="left, red tape", serial=VIRTUAL)
    bpy.ops.dermis.stream_arm()
    wait(lambda s: s["armed"])


def test_under_way_the_calibration_of_another_device_ends_the_stream(scene: Any) -> None:
    mark(scene, serial="0102030405060708")
    bpy.ops.dermis.calibration_use(file="")
    scene.dermis_stream.mode = "jog"
    session.connect(scene)
    wait(state("ready"))
    bpy.ops.dermis.stream_arm()
    wait(lambda s: s["armed"])
    bpy.ops.dermis.calibration_use(file="haptip-left-red-tape.json")
    wait(lambda s: not s["armed"] and "the device that answered is not" in s["message"])


def test_an_id_that_boards_share_tells_none_apart() -> None:
    shared = b"DERMISU1".hex()
    assert board_identity.serials({"device": shared}) == ()
    assert board_identity.serials({"device": shared, "received": {"usb_serial": "7573\x01"}}) == ("7573",)
    assert board_identity.serials({"device": VIRTUAL, "received": {"usb_serial": "7573"}}) == (VIRTUAL, "7573")


def test_refusals_are_words(scene: Any) -> None:
    with pytest.raises(RuntimeError, match="no name"):
        bpy.ops.dermis.calibration_keep(name=" ")
    mark(scene)
    scene.dermis_stream.output = "Thumb: haptip"
    with pytest.raises(RuntimeError, match="another device has this name"):
        bpy.ops.dermis.calibration_keep(name="left, red tape")
    folder = built_devices.user_folder(built_devices.FOLDER)
    (folder / "haptip-left-red-tape.json").write_text("{")
    built_devices.refresh()
    scene.dermis_stream.output = "Index: haptip"
    with pytest.raises(RuntimeError, match="not JSON"):
        bpy.ops.dermis.stream_connect()
    assert not session.connected() and len(built_devices.damaged()) == 1
    (folder / built_devices.TABLE).write_text('{"schema": "dermis-fingers 1", "fingers": {"x": 3}}')
    built_devices.refresh()
    with pytest.raises(RuntimeError, match="which finger wears which device"):
        bpy.ops.dermis.stream_connect()
    assert board_identity.shown(scene).wrong
    with pytest.raises(RuntimeError, match="which finger wears which device"):
        bpy.ops.dermis.calibration_use(file="")
    assert '"x": 3' in (folder / built_devices.TABLE).read_text(), "what cannot be read is not overwritten"
