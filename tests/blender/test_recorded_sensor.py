"""Import > Recorded Sensor: a recording becomes the track of a finger's device, scrubbed, exported, kept."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import baking, reporting
from blender_addon.preferences import library
from blender_addon.preview import device_preview
from blender_addon.results import store
from core.design.follow import follow, table_of
from core.design.recordings import read_recording
from core.steps import drain

from .build import finger, span

pytestmark = pytest.mark.shared_tests("recordings are read by the engine")


def files(folder: Path) -> tuple[Path, Path]:
    """Write a made-up table of the cable platform and a recording of four channels, 100 Hz for 1.5 s."""
    rng = np.random.default_rng(0)
    spec = library().device("cable_platform")
    high = np.array([c.high for c in spec.channels])
    commands = np.vstack([np.zeros(3), rng.uniform(0.05, 0.9, (800, 3))]) * high
    mix = rng.standard_normal((3, 4))
    rows = np.column_stack([commands, 1000.0 + 900.0 * (commands / high) @ mix])
    t = np.arange(151) / 100.0
    moved = high * (0.3 + 0.2 * np.sin(np.outer(t, [2.0, 3.0, 4.0])))
    felt = np.column_stack([t, 1000.0 + 900.0 * (moved / high) @ mix])
    for name, names, values in (("table", "m1,m2,m3,a,b,c,d", rows), ("felt", "time_s,a,b,c,d", felt)):
        lines = [names, *(",".join(f"{v:.9g}" for v in row) for row in values)]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    return folder / "table.csv", folder / "felt.csv"


def ready(device: str = "cable_platform") -> bpy.types.Object:
    """Make an active finger with a device."""
    span(1, 10, fps=24)
    made = finger(location=(0.0, 0.0, 0.0))
    item = made.dermis.finger.devices.add()
    item.preset = device
    bpy.context.view_layer.objects.active = made
    bpy.context.view_layer.update()
    return made


@pytest.fixture
def imported(tmp_path):
    """Import the recording; return the files and the scene's result."""
    ready()
    table, felt = files(tmp_path)
    assert bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table)) == {"FINISHED"}
    return table, felt, store.current(bpy.context.scene)


def test_the_track_is_the_engines_and_can_be_scrubbed(imported):
    table, felt, result = imported
    scene, spec = bpy.context.scene, library().device("cable_platform")
    own = follow(spec, table_of(spec, table), read_recording(felt)).track
    (output,) = result.bake.outputs
    np.testing.assert_array_equal(output.track.values, own.values)
    assert output.device == "cable_platform" and scene.frame_end == 37 and store.state(scene) == "fresh"
    for frame in (1, 13, 30):
        scene.frame_set(frame)
        values = store.values_at(result, output, frame)
        at = (frame - 1) / 24.0
        np.testing.assert_allclose(values, [np.interp(at, own.times, column) for column in own.values.T])
        assert device_preview.computed(scene) is not None


def test_an_edit_of_the_scene_leaves_it_as_it_is(imported):
    """Nothing of the scene is in the track, so that it can be exported and streamed whatever moves there."""
    scene = bpy.context.scene
    bpy.context.object.location.x += 0.01
    bpy.context.view_layer.update()
    assert store.state(scene) == "fresh"
    drain(baking.verified(scene, library()))
    scene.render.fps = 30  # frames fall elsewhere on the track
    assert store.state(scene) == "stale"


def test_it_comes_back_with_the_file(imported):
    _, _, result = imported
    scene = bpy.context.scene
    store.forget()
    again = store.load(scene)
    np.testing.assert_array_equal(again.bake.outputs[0].track.values, result.bake.outputs[0].track.values)
    assert again.bake.recorded and store.state(scene) == "earlier"


def test_fewer_motors_and_rest_are_the_engines(tmp_path):
    ready()
    table, felt = files(tmp_path)
    bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table), motors=1, rest=0.05)
    spec = library().device("cable_platform")
    own = follow(spec, table_of(spec, table), read_recording(felt, (0.0, 0.05)), motors=1).track
    kept = store.current(bpy.context.scene).bake.outputs[0].track
    np.testing.assert_allclose(kept.values, own.values, rtol=1e-6)


def test_what_cannot_be_followed_is_refused_in_words(tmp_path):
    made = ready()
    table, felt = files(tmp_path)
    with pytest.raises(RuntimeError, match="a look-up needs a table"):
        bpy.ops.dermis.import_sensor(filepath=str(felt))
    bad = tmp_path / "bad.csv"
    bad.write_text(felt.read_text().replace("time_s,a,b,c,d", "time_s,a,b,c,e"))
    with pytest.raises(RuntimeError, match="not one of the table's"):
        bpy.ops.dermis.import_sensor(filepath=str(bad), table=str(table))
    assert reporting.source() == "Import Recorded Sensor" and store.current(bpy.context.scene) is None
    made.dermis.finger.devices[0].preset = "haptip"
    with pytest.raises(RuntimeError, match="platform or a thimble"):
        bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table))
    made.dermis.finger.devices[0].preset = "cable_platform"
    made.dermis.finger.devices[0].table = str(table)  # the device's own table is taken where none is named
    assert bpy.ops.dermis.import_sensor(filepath=str(felt)) == {"FINISHED"}


def test_the_active_device_follows_where_a_finger_has_two(tmp_path):
    made = ready("hexapod")
    table, felt = files(tmp_path)
    devices = made.dermis.finger.devices
    devices.add().preset = "cable_platform"
    made.dermis.finger.active_device = 1
    assert bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table)) == {"FINISHED"}
    assert store.current(bpy.context.scene).bake.outputs[0].device == "cable_platform"
    made.dermis.finger.active_device = 0
    with pytest.raises(RuntimeError, match="beyond the motor's range"):  # the table is of the other one
        bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table))
    devices[1].enabled, made.dermis.finger.active_device = False, 1
    with pytest.raises(RuntimeError, match="beyond the motor's range"):  # what is switched off does not follow
        bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table))


def test_a_recording_longer_than_a_scene_or_its_rest_is_refused(tmp_path):
    """The last frame was clamped to 1,048,574 without a word, and all of it taken for rest."""
    ready()
    table, felt = files(tmp_path)
    head, *lines = felt.read_text().splitlines()
    rows = [line.split(",") for line in lines]
    day = tmp_path / "day.csv"
    day.write_text("\n".join([head, *(",".join([f"{570 * i}", *row[1:]]) for i, row in enumerate(rows))]) + "\n")
    before = bpy.context.scene.frame_end
    with pytest.raises(RuntimeError, match=r"longer than a scene can be .*2,052,001'; allowed: 1,048,574"):
        bpy.ops.dermis.import_sensor(filepath=str(day), table=str(table))
    with pytest.raises(RuntimeError, match="the rest lasts longer than the recording .*allowed: .* 0 to 1.5 s"):
        bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table), rest=99.0)
    assert bpy.context.scene.frame_end == before and store.current(bpy.context.scene) is None


def test_names_of_any_script_and_missing_files(tmp_path):
    made = ready()
    table, felt = files(tmp_path)
    made.name = "Finger \u89e6\u899a"
    paths = [tmp_path / f"{name} \u00e4 \u89e6 \U0001f446.csv" for name in ("felt", "table")]
    for path, content in zip(paths, (felt, table), strict=True):
        path.write_bytes(content.read_bytes())
    assert bpy.ops.dermis.import_sensor(filepath=str(paths[0]), table=str(paths[1])) == {"FINISHED"}
    assert store.current(bpy.context.scene).bake.outputs[0].finger == made.name
    with pytest.raises(RuntimeError, match="no file is chosen"):  # it was taken for FOLDER.csv
        bpy.ops.dermis.import_sensor(filepath=f"{tmp_path}/", table=str(table))
    for given, own in ((tmp_path / "none.csv", table), (felt, tmp_path / "none.csv")):
        with pytest.raises(RuntimeError, match="cannot be read"):
            bpy.ops.dermis.import_sensor(filepath=str(given), table=str(own))
    assert store.current(bpy.context.scene).bake.outputs[0].finger == made.name, "what was there stays"


@pytest.mark.undo
def test_undo_takes_the_range_back_and_the_track_is_out_of_date_as_a_bake_is(tmp_path):
    ready()
    table, felt = files(tmp_path)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.dermis.import_sensor(filepath=str(felt), table=str(table))
    bpy.ops.ed.undo_push(message="imported")
    assert store.state(bpy.context.scene) == "fresh" and bpy.context.scene.frame_end == 37
    bpy.ops.ed.undo()
    assert store.state(bpy.context.scene) == "stale" and bpy.context.scene.frame_end == 10
    bpy.ops.ed.redo()
    assert store.state(bpy.context.scene) == "fresh" and bpy.context.scene.frame_end == 37
