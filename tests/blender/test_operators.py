"""Operators, as buttons and scripts call them; refusals say what to do and change nothing."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Vector

from blender_addon import preferences, reporting
from blender_addon.operators.work import Work
from blender_addon.properties import object_properties
from blender_addon.results import store

from .build import cube, finger, pressing, screen, span


def extent(obj: bpy.types.Object) -> np.ndarray:
    """Return the lowest and highest coordinates of a mesh object's vertices, in its own space."""
    points = np.array([v.co for v in obj.data.vertices])
    return np.array([points.min(axis=0), points.max(axis=0)])


@pytest.mark.parametrize("scale", [1.0, 0.001])
def test_a_new_finger_has_the_size_of_a_finger(scale: float) -> None:
    bpy.context.scene.unit_settings.scale_length = scale
    bpy.context.scene.cursor.location = (1.0, 2.0, 3.0)
    assert bpy.ops.dermis.add_finger() == {"FINISHED"}
    obj = bpy.context.object
    low, high = extent(obj) * scale * 1e3
    assert obj.dermis.role == "FINGER"
    assert obj.matrix_world.translation == Vector((1.0, 2.0, 3.0))
    assert high[0] - low[0] == pytest.approx(16.0, abs=0.05)
    assert high[1] == pytest.approx(10.5, abs=0.05)
    assert low[2] == pytest.approx(0.0, abs=0.01)  # the pad's centre is the lowest point, and the origin
    assert 12.0 < high[2] < 14.0


@pytest.mark.parametrize("scale", [1.0, 0.001])
def test_a_new_finger_lies_on_the_solid_that_the_cursor_is_inside(scale: float) -> None:
    bpy.context.scene.unit_settings.scale_length = scale
    thing = cube(size=0.1 / scale)  # which nothing has made touchable
    bpy.context.view_layer.update()
    for inside, place in (
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.05)),  # all sides are as near as each other: the upper one
        ((0.04, 0.01, 0.0), (0.05, 0.01, 0.0)),
        ((0.04, 0.01, 0.06), (0.04, 0.01, 0.06)),  # above it
    ):
        bpy.context.scene.cursor.location = Vector(inside) / scale
        bpy.ops.dermis.add_finger()
        bpy.context.view_layer.update()
        finger = bpy.context.object
        assert tuple(finger.matrix_world.translation * scale) == pytest.approx(place, abs=1e-6)
        assert tuple(finger.matrix_world.to_scale()) == pytest.approx((1.0, 1.0, 1.0), abs=1e-6)
        out = (finger.matrix_world.translation - thing.matrix_world.translation).normalized()
        assert finger.matrix_world.to_3x3().col[2].dot(out) > 0.7  # the nail is outside
    thing.hide_set(True)
    bpy.context.scene.cursor.location = (0.0, 0.0, 0.0)
    bpy.ops.dermis.add_finger()
    assert bpy.context.object.matrix_world.translation == Vector((0.0, 0.0, 0.0))


def test_the_fingertip_is_closed_but_for_the_nail_plate_and_faces_outwards() -> None:
    import bmesh

    bpy.ops.dermis.add_finger()
    shape = bmesh.new()
    shape.from_mesh(bpy.context.object.data)
    open_edges = [e for e in shape.edges if not e.is_manifold]
    assert open_edges and min(v.co.z for e in open_edges for v in e.verts) > 0.007  # only the nail plate's rim
    assert shape.calc_volume(signed=True) > 0
    skin = max(shape.faces, key=lambda f: -f.calc_center_median().z)
    assert skin.normal.z < -0.9  # the pad faces -Z
    shape.free()


def test_a_new_screen_has_its_size_and_a_relief() -> None:
    bpy.ops.dermis.add_screen(width=120.0, depth=75.0)
    obj = bpy.context.object
    low, high = extent(obj)
    assert obj.dermis.role == "SCREEN"
    assert (high - low)[:2] == pytest.approx([0.120, 0.075])
    pixels = np.empty(len(obj.dermis.screen.image.pixels), np.float32)
    obj.dermis.screen.image.pixels.foreach_get(pixels)
    red = pixels.reshape(-1, 4)[:, 0]
    assert red.min() == 0.0 and red.max() == pytest.approx(1.0, abs=0.01)


def test_make_touchable_takes_the_presets_values() -> None:
    thing = cube()
    thing.dermis.role = "NONE"
    bpy.context.view_layer.objects.active = thing
    assert bpy.ops.dermis.make_touchable(preset="rubber") == {"FINISHED"}
    wanted = preferences.library().material("rubber")
    values = object_properties.parameters(thing.dermis.material)
    for name, value in wanted.items():
        assert values[name] == (pytest.approx(value, rel=1e-6) if isinstance(value, float) else value), name
    assert (thing.dermis.role, thing.dermis.material.preset) == ("TOUCHABLE", "rubber")


def test_an_unknown_material_is_refused_and_changes_nothing() -> None:
    thing = cube()
    thing.dermis.role = "NONE"
    bpy.context.view_layer.objects.active = thing
    with pytest.raises(RuntimeError, match="no such preset"):
        bpy.ops.dermis.make_touchable(preset="unobtainium")
    assert thing.dermis.role == "NONE"
    assert [f.severity for f in reporting.findings()] == ["error"]


def test_a_finger_gets_several_devices_and_loses_the_chosen_one() -> None:
    hand = finger()
    bpy.context.view_layer.objects.active = hand
    for preset in ("haptip", "electrovibration", "haptip"):
        assert bpy.ops.dermis.add_device(preset=preset) == {"FINISHED"}
    hand.dermis.finger.active_device = 1
    bpy.ops.dermis.remove_device()
    assert [d.preset for d in hand.dermis.finger.devices] == ["haptip", "haptip"]
    assert hand.dermis.finger.active_device == 1
    with pytest.raises(RuntimeError, match="no such preset"):
        bpy.ops.dermis.add_device(preset="removed")
    assert len(hand.dermis.finger.devices) == 2


def test_a_device_needs_a_finger() -> None:
    cube()
    with pytest.raises(RuntimeError, match="not a finger"):
        bpy.ops.dermis.add_device(preset="haptip", finger="Cube")


def test_setting_a_role_keeps_the_settings() -> None:
    thing = cube()
    bpy.context.view_layer.objects.active = thing
    thing.dermis.material.friction = 0.9
    bpy.ops.dermis.set_role(role="NONE")
    bpy.ops.dermis.set_role(role="TOUCHABLE")
    assert thing.dermis.material.friction == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: cube(), "no finger"),
        (lambda: finger(), "nothing to touch"),
        (lambda: (cube(), finger(), span(5, 5)), "no duration"),
        (lambda: (cube(), finger(), span(9, 2)), "no duration"),
    ],
    ids=["no finger", "nothing to touch", "one frame", "reversed"],
)
def test_what_cannot_be_baked_is_refused_in_words(build, sentence: str) -> None:
    span(1, 10)
    build()
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.dermis.bake()
    assert store.current(bpy.context.scene) is None
    assert [f.severity for f in reporting.findings()] == ["error"]


def test_nothing_is_exported_before_a_bake() -> None:
    assert not bpy.ops.dermis.export_tracks.poll()


def test_an_output_folder_that_cannot_be_written_is_named(tmp_path) -> None:
    ready()
    bpy.ops.dermis.bake()
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(RuntimeError, match="cannot be written"):
        bpy.ops.dermis.export_tracks(directory=str(blocked / "tracks"))
    assert blocked.read_text() == "not a folder"


def test_export_writes_one_readable_track_for_each_finger_and_device(tmp_path) -> None:
    from core.track import csv

    ready()
    bpy.ops.dermis.bake()
    bpy.ops.dermis.export_tracks(directory=str(tmp_path))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["Finger.electrovibration.csv", "Finger.haptip.csv"]
    baked = store.current(bpy.context.scene).bake.outputs[0].track
    back = csv.read(tmp_path / "Finger.haptip.csv")
    assert back.times == pytest.approx(baked.times, rel=1e-8)
    assert back.values == pytest.approx(baked.values, rel=1e-8, abs=1e-15)


def test_a_stored_bake_comes_back_bit_for_bit(tmp_path) -> None:
    ready()
    bpy.ops.dermis.bake()
    scene = bpy.context.scene
    before = store.current(scene).bake
    path = str(tmp_path / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert store.current(bpy.context.scene) is None  # opening a file reads nothing
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    after = store.current(bpy.context.scene)
    assert store.state(bpy.context.scene) == "earlier"
    assert after.bake.content_hash == before.content_hash
    for a, b in zip(after.bake.outputs, before.outputs, strict=True):
        assert a.track.values.tobytes() == b.track.values.tobytes()
        assert a.track.spec.hash == b.track.spec.hash


def test_a_finding_takes_you_to_its_frame_and_object() -> None:
    from core.errors import Finding

    span(1, 20)
    hand, thing = finger(), cube()
    bpy.context.view_layer.objects.active = thing
    reporting.show((Finding("warning", "x", "something", where="finger 'Finger'", frame=7.25),), "test")
    assert bpy.ops.dermis.go_to_finding(index=0) == {"FINISHED"}
    assert bpy.context.scene.frame_current_final == pytest.approx(7.25)
    assert bpy.context.object == hand


def test_the_sampled_scene_is_written(tmp_path) -> None:
    ready()
    bpy.ops.dermis.export_scene(filepath=str(tmp_path / "scene"))
    assert (tmp_path / "scene.npz").stat().st_size > 0


def test_an_exported_screen_map_answers_as_the_bake_does(tmp_path) -> None:
    from core.matching.screen_map import ScreenMap

    bpy.ops.dermis.demo_scene()
    bpy.ops.dermis.bake()
    assert bpy.ops.dermis.export_screen_maps(directory=str(tmp_path)) == {"FINISHED"}
    (path,) = tmp_path.iterdir()
    assert path.name.startswith("Reader.") and path.name.endswith(".electrovibration.map.npz")
    screen_map = ScreenMap.load(path)
    (output,) = [o for o in store.current(bpy.context.scene).bake.outputs if o.device == "electrovibration"]
    amplitude, x, y = output.track.column("amplitude"), output.signals["x"], output.signals["y"]
    strong = [i for i in range(50, len(x) - 50) if amplitude[i] > 100.0][::97]
    assert len(strong) > 5
    for i in strong:
        direction = (x[i + 1] - x[i - 1], y[i + 1] - y[i - 1])
        # the bake averages the direction over its window, a map is asked with the direction of the moment
        assert screen_map.answer(x[i], y[i], direction).amplitude == pytest.approx(amplitude[i], rel=0.03)


def test_screen_maps_need_a_screen_device(tmp_path) -> None:
    span(1, 13)
    finger()
    screen()
    with pytest.raises(RuntimeError, match="no finger has a screen device"):
        bpy.ops.dermis.export_screen_maps(directory=str(tmp_path))


def ready() -> None:
    """Make a scene of half a second with a finger, two devices, a cube and a screen."""
    span(1, 13)
    hand = finger(location=(0.0, 0.0, 0.0302))
    cube(size=0.06)
    pad = screen(width=0.06, height=0.06)
    pad.location.z = 0.030
    bpy.ops.dermis.add_screen(relief="BUMPS")
    made = bpy.context.object
    pad.dermis.screen.image = made.dermis.screen.image
    bpy.data.objects.remove(made)
    for preset in ("haptip", "electrovibration"):
        hand.dermis.finger.devices.add().preset = preset
    bpy.context.view_layer.update()


def test_a_file_without_a_name_is_refused_in_words() -> None:
    cube()
    finger()
    span(1, 3)
    with pytest.raises(RuntimeError, match="no file is chosen"):
        bpy.ops.dermis.export_scene(filepath="")
    assert reporting.source() == "Save Sampled Scene"


@pytest.mark.parametrize("menu", ["choose_device", "choose_material", "choose_skin"])
def test_a_menu_without_a_window_is_refused_in_words(menu: str) -> None:
    bpy.context.view_layer.objects.active = finger() if menu == "choose_skin" else cube()
    with pytest.raises(RuntimeError, match="needs a window"):
        getattr(bpy.ops.dermis, menu)()


def test_work_finds_objects_in_their_places_even_where_blender_has_evaluated_nothing() -> None:
    """As in the redo panel, which undoes a step and calls the operator again; in a script Blender evaluates before."""
    seen = []

    class Looks(Work):
        bl_label = "Look"

        def work(self, context) -> None:
            seen.append(context.object.matrix_world.translation.x)

    obj = cube("Cube", 1.0)
    bpy.context.view_layer.objects.active = obj
    bpy.context.view_layer.update()
    obj.location.x = 3.0
    assert obj.matrix_world.translation.x == 0.0
    assert Looks().execute(bpy.context) == {"FINISHED"} and seen == [3.0]


def test_a_bake_in_which_nothing_is_touched_stands_and_says_how_far_all_stays_apart() -> None:
    scene, hand = pressing()
    hand.dermis.finger.devices.add().preset = "haptip"
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    assert "nothing-touched" not in {f.code for f in reporting.here(scene)}
    bpy.data.objects["Plate"].location.z = -20.0  # as of a path in millimetres
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    assert store.current(scene) is not None
    (found,) = [f for f in reporting.here(scene) if f.code == "nothing-touched"]
    assert found.severity == "info" and "at least 20 m" in found.value and "'Plate'" in found.value
