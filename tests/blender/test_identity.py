"""What was baked belongs to the finger and the device, whatever they and their copies are called."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import changes, identity, reporting
from blender_addon._core import Finding
from blender_addon.preview import device_preview
from blender_addon.results import command_curves, exported, plots, store
from blender_addon.streaming import streamed_track

from .build import cube, finger, keys, span
from .test_undo import push, undo


@pytest.fixture
def scene() -> Any:
    """Two fingers with a HapTip each that touch differently, baked."""
    made = span(1, 7)
    cube(size=0.06)
    for name, depth in (("A", 0.0302), ("B", 0.0301)):
        keys(finger(name), "location", (1, 7), [(0.0, 0.0, 0.034), (0.0, 0.0, depth)])
        bpy.data.objects[name].dermis.finger.devices.add().preset = "haptip"
    bpy.context.view_layer.update()
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return made


def tracks(scene: Any) -> dict[str, Any]:
    """Return each finger's commands by what the finger is called now."""
    result = store.current(scene)
    return {} if result is None else {o.finger: o.track.values for o in result.bake.outputs}


def swap() -> None:
    a, b = bpy.data.objects["A"], bpy.data.objects["B"]
    a.name = "C"
    b.name = "A"
    a.name = "B"
    bpy.context.view_layer.update()


def reopened(path: Path) -> Any:
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def same(one: Any, other: Any) -> bool:
    return sorted(one) == sorted(other) and all(np.array_equal(one[n], other[n]) for n in one)


def test_renamed_and_swapped_fingers_keep_their_own(scene: Any, tmp_path: Path) -> None:
    before = tracks(scene)
    assert not np.array_equal(before["A"], before["B"])
    bpy.data.objects["A"].name = "Index"
    assert same(tracks(scene), {"Index": before["A"], "B": before["B"]}), "before Blender evaluates anything"
    bpy.data.objects["Index"].name = "A"
    swap()
    swapped = {"A": before["B"], "B": before["A"]}
    assert same(tracks(scene), swapped) and store.state(scene) == "fresh", "a name is no part of what is felt"
    assert bpy.ops.dermis.export_tracks(directory=str(tmp_path), form="json") == {"FINISHED"}
    for name in "AB":
        from blender_addon._core import core

        read = core.track.export.read(tmp_path / f"{name}.haptip.json")
        assert np.allclose(read.values, swapped[name], atol=1e-6) and read.meta["finger"] == name
    assert exported.last(scene) is not None
    bpy.data.objects["A"].name = "Index"
    assert exported.last(scene) is not None, "the files are still of this bake"


def test_the_preview_and_the_stream_follow_the_finger(scene: Any) -> None:
    scene.frame_set(7)
    scene.dermis_stream.output = "A: haptip"
    before = {row.finger: dict(row.values) for row in device_preview.computed(scene).rows}
    own = streamed_track.chosen_output(scene).track
    swap()
    after = {row.finger: dict(row.values) for row in device_preview.computed(scene).rows}
    assert after == {"A": before["B"], "B": before["A"]} and before["A"] != before["B"]
    assert streamed_track.chosen_output(scene).track is own
    assert scene.dermis_stream.output == "B: haptip", "the panel calls it as it is called now"


@pytest.mark.parametrize("linked", [False, True])
def test_a_copy_is_unbaked(scene: Any, tmp_path: Path, linked: bool) -> None:
    before = tracks(scene)
    original = bpy.data.objects["A"]
    bpy.ops.object.select_all(action="DESELECT")
    original.select_set(True)
    bpy.context.view_layer.objects.active = original
    bpy.ops.object.duplicate(linked=linked)
    copy = bpy.context.object
    assert copy != original and same(tracks(scene), before)
    original.name, copy.name = "Original", "A"
    expected = {"Original": before["A"], "B": before["B"]}
    assert same(tracks(scene), expected), "the copy is called as the finger was that was baked"
    scene = reopened(tmp_path / "copy.blend")
    assert store.load(scene) is not None and same(tracks(scene), expected)
    bpy.data.objects.remove(bpy.data.objects["Original"])
    assert same(tracks(scene), {"B": before["B"]}), "the copy does not inherit either"


@pytest.mark.parametrize("kind", ["LINK_COPY", "FULL_COPY"])
def test_a_copied_scene(scene: Any, tmp_path: Path, kind: str) -> None:
    before = tracks(scene)
    bpy.ops.scene.new(type=kind)
    copy = bpy.context.scene
    assert copy != scene and store.current(copy) is None
    names = scene.name, copy.name
    reopened(tmp_path / "scenes.blend")
    scene, copy = (bpy.data.scenes[name] for name in names)
    assert store.load(scene) is not None and same(tracks(scene), before)
    if kind == "LINK_COPY":
        assert store.load(copy) is not None and same(tracks(copy), before), "these are the same fingers"
    else:
        with bpy.context.temp_override(scene=copy), pytest.raises(RuntimeError, match="not in this scene"):
            bpy.ops.dermis.load_result()
        assert store.current(copy) is None and tracks(copy) == {}


def test_appended_fingers_are_others(scene: Any, tmp_path: Path) -> None:
    before, path = tracks(scene), tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    scene = reopened(tmp_path / "b.blend")
    store.load(scene)
    with bpy.data.libraries.load(str(path), link=False) as (_, to):
        to.objects = ["A"]
    (copy,) = to.objects
    scene.collection.objects.link(copy)
    bpy.data.objects["A"].name = "Before"
    copy.name = "A"
    assert same(tracks(scene), {"Before": before["A"], "B": before["B"]})


def test_linked_fingers_of_one_name_and_their_overrides(scene: Any, tmp_path: Path) -> None:
    for folder, depth in (("left", 0.0301), ("right", 0.0303)):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        made = finger("Index")
        keys(made, "location", (1, 7), [(0.0, 0.0, 0.034), (0.0, 0.0, depth)])
        made.dermis.finger.devices.add().preset = "haptip"
        (tmp_path / folder).mkdir()
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / folder / "hand.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = span(1, 7)
    cube(size=0.06)
    for folder in ("left", "right"):
        with bpy.data.libraries.load(str(tmp_path / folder / "hand.blend"), link=True) as (_, to):
            to.objects = ["Index"]
        scene.collection.objects.link(to.objects[0])
    bpy.context.view_layer.update()
    bpy.ops.dermis.bake()
    names = [obj.name_full for obj in identity.fingers(scene)]
    assert len(set(names)) == 2 and sorted(tracks(scene)) == sorted(names)
    assert len({identity.identity(obj) for obj in identity.fingers(scene)}) == 2
    before = tracks(scene)
    scene = reopened(tmp_path / "use.blend")
    assert store.load(scene) is not None and same(tracks(scene), before)
    first = identity.fingers(scene)[0]
    own = first.override_create(remap_local_usages=True)
    second = own.copy()
    second.name = names[0]
    scene.collection.objects.link(second)
    given = identity.give(own), identity.give(second)
    assert given[0] != given[1]
    scene = reopened(tmp_path / "override.blend")
    found = {obj.name: identity.identity(obj) for obj in identity.fingers(scene) if obj.library is None}
    assert set(found.values()) == set(given), "an override keeps what it was given"


def test_devices_are_told_apart(scene: Any) -> None:
    items = bpy.data.objects["A"].dermis.finger.devices
    items.add().preset = "haptip"
    items[1].use_weight = not items[0].use_weight
    bpy.ops.dermis.bake()
    whose = store.current(scene).whose
    assert len(set(whose)) == 3 and len({d.device for d in whose if d.finger == whose[0].finger}) == 2
    labels = {c.label: c.output.track for c in streamed_track.choices(scene)}
    assert set(labels) == {"A: haptip", "A: haptip-2", "B: haptip"}
    scene.dermis_stream.output = "A: haptip-2"
    second = streamed_track.chosen_output(scene).track
    items.move(1, 0)
    assert streamed_track.chosen_output(scene).track is second is labels["A: haptip-2"]
    items.remove(0)
    bpy.context.view_layer.update()
    assert streamed_track.chosen_output(scene) is None, "what was chosen is gone, and no other takes its place"


def test_a_device_that_is_taken_off_leaves_its_track_to_no_other(scene: Any) -> None:
    bpy.context.view_layer.objects.active = bpy.data.objects["A"]
    assert bpy.ops.dermis.add_device(preset="haptip") == {"FINISHED"}
    bpy.data.objects["A"].dermis.finger.active_device = 0
    assert bpy.ops.dermis.remove_device() == {"FINISHED"}
    bpy.context.view_layer.update()
    found = {c.label: c.output is not None for c in streamed_track.choices(scene)}
    assert found == {"A: haptip": False, "B: haptip": True}


def test_a_finger_that_is_none_any_more_has_no_track(scene: Any) -> None:
    before, a = tracks(scene), bpy.data.objects["A"]
    a.dermis.role = "NONE"
    bpy.data.objects["B"].name = "C"
    assert same(tracks(scene), {"C": before["B"]})
    a.dermis.role = "FINGER"
    scene.collection.objects.unlink(a)
    assert same(tracks(scene), {"C": before["B"]})
    scene.collection.objects.link(a)
    bpy.context.view_layer.update()
    assert same(tracks(scene), {"A": before["A"], "C": before["B"]})


def test_an_old_file_knows_fingers_by_name_and_says_so_once(scene: Any, tmp_path: Path) -> None:
    before = tracks(scene)
    scene.dermis.bake_owners = ""
    for obj in identity.fingers(scene):
        obj.dermis.identity = ""
        obj.dermis.finger.devices[0].identity = ""
    identity._given.clear()
    identity._items.clear()
    scene = reopened(tmp_path / "old.blend")
    found = [f.code for f in store.load(scene).bake.findings]
    assert found.count("bake-by-name") == 1 and same(tracks(scene), before)
    swap()
    assert same(tracks(scene), {"A": before["B"], "B": before["A"]}), "from then on it is theirs"
    scene = reopened(tmp_path / "old.blend")
    assert "bake-by-name" not in [f.code for f in store.load(scene).bake.findings]
    assert same(tracks(scene), {"A": before["B"], "B": before["A"]})


def test_plots_follow_too(scene: Any) -> None:
    images = plots.make(store.current(scene))
    texture = bpy.data.textures.new("Shows A's", "IMAGE")
    texture.image = images["A.haptip"]
    swap()
    plots.make(store.current(scene))
    assert texture.image.name == "Plot B.haptip"


def test_a_mesh_that_copies_share_is_cleared_of_curves_once(scene: Any) -> None:
    mesh = bpy.data.meshes.new("Shared")
    obj = bpy.data.objects.new("Meshed", mesh)
    scene.collection.objects.link(obj)
    obj.location, obj.dermis.role = (0.0, 0.0, 0.0302), "FINGER"
    obj.dermis.finger.devices.add().preset = "haptip"
    bpy.context.view_layer.update()
    bpy.ops.dermis.bake()
    bpy.data.objects["A"].name = "B.001"
    obj.name = "A"
    command_curves.write(scene, store.current(scene))
    assert obj.name == "A" and command_curves.MARK in mesh, "its own curves, under whatever name"
    track = tracks(scene)["A"]
    assert np.isclose(mesh["haptip tactor_x (mm)"], 1e3 * track[0, 0])
    scene.collection.objects.link(obj.copy())  # Alt-D
    assert bpy.ops.dermis.remove_curves() == {"FINISHED"} and command_curves.MARK not in mesh


@pytest.mark.undo
def test_undo_takes_no_track_away(scene: Any) -> None:
    before = tracks(scene)
    push("baked")
    bpy.data.objects["A"].name = "Index"
    push("renamed")
    bpy.data.objects.remove(bpy.data.objects["Index"])
    push("removed")
    assert same(tracks(scene), {"B": before["B"]})
    undo()
    scene = bpy.context.scene
    assert same(tracks(scene), {"Index": before["A"], "B": before["B"]})
    undo()
    assert same(tracks(bpy.context.scene), before)


@pytest.mark.undo
def test_undo_to_before_the_bake_keeps_whose_it_is(scene: Any) -> None:
    before = tracks(scene)
    for obj in identity.fingers(scene):  # as it was before identities were given
        obj.dermis.identity = obj.dermis.finger.devices[0].identity = ""
    push("without")
    bpy.data.objects["A"].location.x = 1.0
    push("moved")
    undo()
    scene = bpy.context.scene
    swap()
    assert same(tracks(scene), {"A": before["B"], "B": before["A"]})
    assert all(d.device for d in store.current(scene).whose) and len(streamed_track.choices(scene)) == 2
    assert all(choice.output is not None for choice in streamed_track.choices(scene))


def test_the_baked_one_keeps_what_two_say(scene: Any, tmp_path: Path) -> None:
    """A file that was saved without the add-on: nobody wrote down which is the copy."""
    before, obj = tracks(scene), bpy.data.objects["B"]
    copy = obj.copy()
    copy.name = "A copy, before the other in every list"
    scene.collection.objects.link(copy)
    assert copy.dermis.identity == obj.dermis.identity
    on_save = next(f for f in bpy.app.handlers.save_pre if f.__module__.startswith("blender_addon"))
    bpy.app.handlers.save_pre.remove(on_save)
    try:
        scene = reopened(tmp_path / "without.blend")
    finally:
        bpy.app.handlers.save_pre.append(on_save)
    assert store.load(scene) is not None and same(tracks(scene), before)


def test_findings_are_about_the_object_that_they_named(scene: Any) -> None:
    reporting.show((Finding("warning", "probe", "something", where="finger 'A', skin"),), "test")
    own = bpy.data.objects["A"]
    swap()
    bpy.ops.dermis.go_to_finding(index=0)
    assert bpy.context.object == own and own.name == "B"


def test_names_end_what_the_live_preview_goes_on_from_and_nothing_else(scene: Any) -> None:
    bpy.context.view_layer.objects.active = bpy.data.objects["A"]
    bpy.data.objects["A"].select_set(True)
    bpy.context.view_layer.update()
    before, edits = changes.lineage(), changes.edits()
    bpy.data.objects["B"].select_set(True)
    bpy.context.view_layer.update()
    assert changes.lineage() == before, "selected, not renamed"
    swap()
    assert changes.lineage() > before and changes.edits() == edits


def test_the_live_preview_of_swapped_fingers_is_that_of_new_ones(scene: Any) -> None:
    scene.frame_start = 2  # so that no bake is fresh
    scene.frame_set(6)
    device_preview.step(bpy.context)
    scene.frame_set(7)
    shown = {row.finger: dict(row.values) for row in device_preview.step(bpy.context).rows}
    swap()
    swapped = {row.finger: dict(row.values) for row in device_preview.step(bpy.context).rows}
    device_preview.reset()
    fresh = {row.finger: dict(row.values) for row in device_preview.step(bpy.context).rows}
    assert swapped == fresh and set(shown) == {"A", "B"}, "nothing of the other's path goes on"


def test_calibrations_of_an_earlier_version_are_still_worn(scene: Any) -> None:
    own, obj = "0123456789abcdef" * 2, bpy.data.objects["A"]
    identity._given.clear()
    obj.dermis.identity, obj[identity.LEGACY] = "", own
    assert identity.identity(obj) == own and identity.give(obj) == own
    assert obj.dermis.identity == own and identity.LEGACY not in obj
