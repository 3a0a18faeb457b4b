"""How many motors, in Blender: baked scenes and recordings to number, picture and a preset that can be used at once."""

from __future__ import annotations

import json

import bpy
import numpy as np
import pytest

from blender_addon import changes, choices
from blender_addon._core import core
from blender_addon.design import design_results
from blender_addon.devices import platform_devices
from blender_addon.operators import design
from blender_addon.preferences import library
from blender_addon.results import store
from core.steps import drain

from .stand_in import Anything, Panel
from .test_platforms import own_folders, shown  # noqa: F401  a fixture

pytestmark = pytest.mark.shared_tests("the engine counts motors")

ROWS = 512
_SWEPT: dict[tuple[str, str], object] = {}


def once(swept):
    """Return a sweep that is worked out once for the same device, skin and rows."""

    def known(spec, *skin):
        key = spec.hash, json.dumps(skin, sort_keys=True)
        if key not in _SWEPT:
            _SWEPT[key] = yield from swept(spec, *skin)
        return _SWEPT[key]

    return known


@pytest.fixture
def baked(own_folders, monkeypatch):  # noqa: F811
    """Return the tip interaction, its first touch baked, added to its own panel; tables are swept once."""
    monkeypatch.setattr(platform_devices, "swept", once(platform_devices.swept))
    monkeypatch.setattr(design_results, "presets_folder", lambda: own_folders / "presets")
    scene, finger = shown("tip")
    scene.frame_end = 70
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    scene.dermis_design.table_rows = ROWS
    assert bpy.ops.dermis.add_design_touch(kind="SCENE") == {"FINISHED"}
    return scene, finger, own_folders


def sensed(scene, seed=0):
    touch = next(iter(store.current(scene).bake.skins.values()))
    return core.design.task.sense_touch(touch, noise=scene.dermis_design.noise, seed=seed)


def test_the_answer_is_the_engines_for_the_same_bake_and_table(baked) -> None:
    scene, _, _ = baked
    assert bpy.ops.dermis.design() == {"FINISHED"}
    found = design_results.current(scene).design
    spec = library().device("cable_platform")
    values = store.current(scene).skins["Index"]
    _SWEPT.clear()
    _, table = drain(platform_devices.swept(spec, values["skin"], values["level"], ROWS, "linear"))
    direct = drain(core.design.task.answer(spec, table, {"t": sensed(scene)}, noise=2.0))
    assert found.names == ("Tip, Flat, Tip",)
    np.testing.assert_array_equal(found.joint.error, direct.joint.error)
    assert found.joint.motors() == direct.joint.motors()


def test_the_panel_explains_error_part_and_shared_pulleys(baked) -> None:
    scene, _, _ = baked
    assert bpy.ops.dermis.design() == {"FINISHED"}
    layout = Anything()
    Panel(bpy.types.DERMIS_PT_design, layout).draw(bpy.context)
    found, words = design_results.current(scene).design, " ".join(layout.words)
    assert "Error: excess over the error with all motors" in words and "of this column alone explains" in words
    assert ("would be the same for any limit" in words) == (found.motors("touch") is not None)
    assert words.count("may share a") == len(found.shared.groups)
    assert words.count("With shared") == bool(found.shared.groups)


def test_the_picture_is_an_image_of_the_file_and_a_png(baked) -> None:
    scene, _, _ = baked
    bpy.ops.dermis.design()
    answer, image = design_results.current(scene), bpy.data.images[design_results.IMAGE]
    assert answer.picture.read_bytes().startswith(b"\x89PNG")
    assert tuple(image.size) == (1280, 720) and bpy.path.abspath(image.filepath) == str(answer.picture)
    assert bpy.ops.dermis.show_design() == {"FINISHED"}
    bpy.ops.dermis.design()  # again: the same image, not another one
    assert sum(i.name.startswith(design_results.IMAGE) for i in bpy.data.images) == 1


def test_without_an_image_editor_the_panel_has_the_results_and_the_place_of_the_picture(baked) -> None:
    scene, _, _ = baked
    editors = {area.type for window in bpy.context.window_manager.windows for area in window.screen.areas}
    assert "IMAGE_EDITOR" not in editors
    assert bpy.ops.dermis.design() == {"FINISHED"}
    answer, layout = design_results.current(scene), Anything()
    Panel(bpy.types.DERMIS_PT_design, layout).draw(bpy.context)
    said = " ".join(layout.words)
    assert "motors" in layout.words and str(answer.picture) in said.replace(" ", "") + said
    assert answer.picture.is_file() and bpy.ops.dermis.open_design.poll()
    assert bpy.ops.dermis.show_design() == {"FINISHED"}
    answer.picture.unlink()
    with pytest.raises(RuntimeError, match="no longer there"):
        bpy.ops.dermis.open_design()
    made = bpy.ops.dermis.show_plots()
    assert made == {"FINISHED"} and any(image.name.startswith("Plot ") for image in bpy.data.images)


def test_a_cancelled_search_leaves_the_list_of_touches(baked) -> None:
    scene, _, _ = baked
    bpy.ops.dermis.remove_design_touch()
    assert not scene.dermis_design.touches
    steps = design._designed(scene)
    next(steps)
    steps.close()  # as Esc does
    assert not scene.dermis_design.touches


def test_the_picture_opens_by_itself_where_an_image_editor_is_there(baked) -> None:
    area = bpy.context.window_manager.windows[0].screen.areas[0]
    before, area.type = area.type, "IMAGE_EDITOR"
    try:
        assert area.spaces.active.image is None
        bpy.ops.dermis.design()
        assert area.spaces.active.image == bpy.data.images[design_results.IMAGE]
    finally:
        area.type = before


def test_the_new_preset_scrubs_bakes_and_exports_at_once(baked, tmp_path) -> None:
    scene, finger, folder = baked
    scene.dermis_design.motors = 2
    bpy.ops.dermis.design()
    key = design_results.current(scene).preset
    assert (folder / "presets" / "devices" / f"{key}.json").is_file()
    entry = choices.entry("devices", key)
    assert entry is not None and entry.user and entry.error is None and choices.kind_of(key) == "cable_platform"
    original = store.current(scene).bake.outputs[0].track
    finger.dermis.finger.devices[0].enabled = False
    assert bpy.ops.dermis.add_device(preset=key, finger="Index") == {"FINISHED"}
    device = finger.dermis.finger.devices[1]
    device.table_rows = finger.dermis.finger.devices[0].table_rows
    assert not platform_devices.missing(finger, device)  # the mechanism is the same, and so is its table
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    track = store.current(scene).bake.outputs[0].track
    spec = library().device(key)
    assert track.spec.hash == spec.hash and track.values.shape[1] == len(spec.channels) == 2
    coupling = core.devices.coupling.coupling_of(spec)
    driven = coupling.original(track.values)
    deep = original.values[:, 0] > 0.8 * original.values[:, 0].max()  # where the touch is
    assert np.abs(driven - original.values)[deep].max() < 0.25 * np.ptp(original.values)
    assert bpy.ops.dermis.export_tracks(directory=str(tmp_path)) == {"FINISHED"}
    assert core.track.csv.read(tmp_path / f"Index.{key}.csv").values.shape == track.values.shape


def test_another_number_of_motors_is_written_without_searching_again(baked, monkeypatch) -> None:
    scene, _, _ = baked
    bpy.ops.dermis.design()
    monkeypatch.setattr(design_results, "find", None)
    scene.dermis_design.motors, scene.dermis_design.rule = 3, "paper"
    assert bpy.ops.dermis.design_preset() == {"FINISHED"}
    key = design_results.current(scene).preset
    assert len(library().device(key).channels) == 3
    scene.dermis_design.motors = 4
    with pytest.raises(RuntimeError, match="as many motors as the device has"):
        bpy.ops.dermis.design_preset()


def test_the_report_is_written_as_text_json_picture_and_preset(baked, tmp_path) -> None:
    scene, _, _ = baked
    with pytest.raises(RuntimeError):
        bpy.ops.dermis.save_design(directory=str(tmp_path))
    bpy.ops.dermis.design()
    assert bpy.ops.dermis.save_design(directory=str(tmp_path)) == {"FINISHED"}
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["interactions"] == ["Tip, Flat, Tip"] and report["device"] == "cable_platform"
    assert {"report.txt", "report.png"} <= {p.name for p in tmp_path.iterdir()}


def test_recordings_and_scenes_are_judged_together(baked, tmp_path) -> None:
    scene, _, _ = baked
    rows = sensed(scene, seed=5)
    names = ",".join(["time", *(f"e{i}" for i in range(19)), "pressure"])
    lines = [f"{0.01 * i:.2f}," + ",".join(map(str, row)) for i, row in enumerate(rows.tolist())]
    (tmp_path / "robot.csv").write_text("\n".join([names, *lines]))
    assert bpy.ops.dermis.add_design_touch(kind="FILE", filepath=str(tmp_path / "robot.csv")) == {"FINISHED"}
    bpy.ops.dermis.design()
    found = design_results.current(scene).design
    assert found.names == ("Tip, Flat, Tip", "robot") and len(found.alone) == 2
    assert found.samples == (len(rows), len(rows))
    (tmp_path / "robot.csv").write_text("\n".join([names, *lines[:-1], lines[-1].replace(",", ",,", 1)]))
    with pytest.raises(RuntimeError, match=f"robot.csv.*{len(lines) + 1}"):
        bpy.ops.dermis.design()


def test_what_cannot_be_answered_is_said(baked) -> None:
    scene, finger, _ = baked
    own = scene.dermis_design
    for device, words in (("haptip", "not a platform"), ("nowhere", "not a platform")):
        own.device = device
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.dermis.design()
    own.device = "cable_platform"
    own.finger = "Thumb"
    with pytest.raises(RuntimeError, match="no such skin"):
        bpy.ops.dermis.design()
    while own.touches:
        bpy.ops.dermis.remove_design_touch()
    assert not bpy.ops.dermis.remove_design_touch.poll()
    for obj in scene.objects:
        obj.dermis.role = "NONE"
    changes.mark_dirty(finger.name)
    assert not bpy.ops.dermis.design.poll()


def test_a_press_of_the_button_is_enough(baked) -> None:
    """It takes this scene where none is listed, and bakes what has no fresh bake."""
    scene, _, _ = baked
    bpy.ops.dermis.remove_design_touch()
    store.forget()
    assert bpy.ops.dermis.design() == {"FINISHED"}
    assert [item.scene for item in scene.dermis_design.touches] == [scene]
    first = store.current(scene)
    assert store.state(scene) == "fresh" and design_results.current(scene) is not None
    assert bpy.ops.dermis.design() == {"FINISHED"} and store.current(scene) is first, "it is baked once"


def test_what_is_no_platform_is_refused_before_anything_is_baked(baked) -> None:
    scene, _, _ = baked
    store.forget()
    scene.dermis_design.device = "haptip"
    with pytest.raises(RuntimeError, match="not a platform"):
        bpy.ops.dermis.design()
    assert store.state(scene) == "none"


def test_a_scene_that_never_touches_is_told(baked) -> None:
    scene, _, _ = baked
    scene.objects["Surface"].animation_data_clear()
    scene.objects["Surface"].location = (0.0, 0.0, -0.05)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    with pytest.raises(RuntimeError, match="nothing is ever touched"):
        bpy.ops.dermis.design()


def test_a_coupled_device_is_not_reduced_again(baked) -> None:
    scene, _, _ = baked
    bpy.ops.dermis.design()
    scene.dermis_design.device = design_results.current(scene).preset
    with pytest.raises(RuntimeError, match="coupled already"):
        bpy.ops.dermis.design()


def test_stopping_half_way_changes_nothing(baked) -> None:
    scene, _, folder = baked
    _SWEPT.clear()
    before = set(core.work.child._owners)
    steps = design_results.find(scene)
    for _ in range(4):
        next(steps)
    steps.close()
    assert design_results.current(scene) is None and set(core.work.child._owners) == before
    assert not list((folder / "presets").rglob("*.json"))


def test_the_panel_lists_only_platforms(own_folders) -> None:  # noqa: F811
    from blender_addon.design.design_properties import DermisDesign

    search = DermisDesign.__annotations__["device_name"].keywords["search"]
    assert set(search(None, None, "")) == {"Cable platform (3 motors)", "Six-leg platform (6 motors)"}
    assert search(None, None, "six") == ["Six-leg platform (6 motors)"]
