"""The skin of a bake as a mesh that plays: shape, values, colours, legend, and that it goes again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

import blender_addon
from blender_addon import baking, preferences
from blender_addon.film import film_objects, heat_material, skin_mesh
from blender_addon.preview.skin_state import SkinState
from blender_addon.results import store
from blender_addon.viewport import skin_colours, skin_field

from .build import cube, finger, keys, span

TOP, DEPTH = 0.02, 0.7e-3


def press(unit: float = 1.0, scale: float = 1.0, *, camera: bool = False) -> bpy.types.Scene:
    """Return a scene with the bake of a press that slides, in units of so many metres."""
    scene = span(1, 9)
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", unit
    hand = finger()
    hand.scale = [scale] * 3
    hand.dermis.finger.skin.shown, hand.dermis.finger.skin.level = True, "draft"
    cube("Plate", 0.04 / unit, (0.0, 0.0, (TOP - 0.02) / unit))
    z = [TOP + 0.02, TOP + 0.02, *[TOP - DEPTH] * 7]
    keys(hand, "location", list(range(1, 10)), np.column_stack([np.zeros(9), np.linspace(0, 1e-3, 9), z]) / unit)
    scene.dermis.sample_rate = 24.0
    if camera:
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(scene.camera)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return scene


def evaluated(obj: bpy.types.Object) -> dict[str, Any]:
    """Return what a render would see of a mesh: world positions, and values."""
    seen = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data: Any = seen.data
    flat = np.empty(3 * len(data.vertices), np.float32)
    data.attributes["position"].data.foreach_get("vector", flat)
    world = np.array(seen.matrix_world)
    out = {"position": flat.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]}
    for name in skin_mesh.ATTRIBUTES:
        out[name] = np.empty(len(data.vertices), np.float32)
        data.attributes[name].data.foreach_get("value", out[name])
    return out


def drawn(scene: bpy.types.Scene, frame: int, quantity: str) -> skin_field.Drawn:
    """Return what the view draws at a frame of the bake."""
    touch = store.current(scene).bake.skins["Finger"]
    state = SkinState.of("Finger", touch.model, touch.at(frame - 1), "bake", "", {})
    return skin_field.draw_of(state, quantity)


def test_the_mesh_plays_what_the_view_draws() -> None:
    scene = press()
    assert bpy.ops.dermis.film_skin() == {"FINISHED"}
    (obj,) = film_objects.of_kind(scene, "skin")
    for frame in (9, 1, 5, 300, -4):  # outside the bake the nearest frame stays
        scene.frame_set(frame)
        seen, inside = evaluated(obj), min(max(frame, 1), 9)
        for name, quantity in skin_mesh.ATTRIBUTES.items():
            values = drawn(scene, inside, quantity).values
            assert seen[name] == pytest.approx(values, rel=1e-6, abs=1e-12) and (values.any() or inside < 3)
        at = scene.objects["Finger"].matrix_world.translation
        assert seen["position"] == pytest.approx(drawn(scene, inside, "pressure").positions + np.array(at), abs=1e-8)
    rows = [drawn(scene, frame, "displacement") for frame in (4, 5)]
    scene.frame_set(4, subframe=0.25)
    seen = evaluated(obj)
    assert seen["displacement"] == pytest.approx(0.75 * rows[0].values + 0.25 * rows[1].values, rel=1e-5, abs=1e-10)


def test_made_again_it_is_the_same_object_and_the_bake_stays_up_to_date() -> None:
    scene = press()
    assert bpy.ops.dermis.film_skin() == {"FINISHED"}
    (obj,) = film_objects.of_kind(scene, "skin")
    own = bpy.data.materials.new("Own")
    obj.data.materials[0] = own
    counts = [len(kind) for kind in (bpy.data.objects, bpy.data.meshes, bpy.data.node_groups)]
    assert bpy.ops.dermis.film_skin() == {"FINISHED"}
    assert film_objects.of_kind(scene, "skin") == [obj] and obj.data.materials[0] == own
    assert counts == [len(kind) for kind in (bpy.data.objects, bpy.data.meshes, bpy.data.node_groups)]
    assert bpy.ops.dermis.bake() == {"FINISHED"} and len(store.current(scene).bake.skins) == 1
    assert bpy.ops.dermis.film_skin() == {"FINISHED"} and store.state(scene) == "fresh"


def test_one_click_removes_everything_that_was_made() -> None:
    scene = press(camera=True)
    hand = scene.objects["Finger"]
    before = [set(k.keys()) for k in (bpy.data.objects, bpy.data.meshes, bpy.data.node_groups, bpy.data.collections)]
    assert bpy.ops.dermis.film_skin() == {"FINISHED"}
    assert hand.hide_render and film_objects.of_kind(scene, "legend")
    assert bpy.ops.dermis.film_remove(kind="skin") == {"FINISHED"}
    after = [set(k.keys()) for k in (bpy.data.objects, bpy.data.meshes, bpy.data.node_groups, bpy.data.collections)]
    assert after == before and not hand.hide_render and store.state(scene) == "fresh"
    hand.hide_render = True  # the artist's own wish stays
    assert bpy.ops.dermis.film_skin() == {"FINISHED"} and bpy.ops.dermis.film_remove() == {"FINISHED"}
    assert hand.hide_render


def test_it_plays_from_a_file_without_the_add_on(tmp_path: Path) -> None:
    scene = press()
    assert bpy.ops.dermis.film_skin() == {"FINISHED"}
    want = drawn(scene, 7, "von_mises").values
    path = str(tmp_path / "film.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    blender_addon.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=path)
        bpy.context.scene.frame_set(7)
        assert evaluated(bpy.data.objects["Finger Skin"])["stress"] == pytest.approx(want, rel=1e-6, abs=1e-9)
    finally:
        blender_addon.register()


def test_a_bake_does_not_play_skins_and_leaves_them_playing() -> None:
    scene = press()
    assert bpy.ops.dermis.film_skin() == {"FINISHED"}
    (obj,) = film_objects.of_kind(scene, "skin")
    steps = baking.bake(scene, preferences.library())
    seen = set()
    for progress in steps:
        seen.add((progress.stage, obj.modifiers[0].show_viewport))
        if len(seen) > 2:
            break
    assert not any(playing for _, playing in seen)
    steps.close()
    assert obj.modifiers[0].show_viewport and store.state(scene) == "fresh"


@pytest.mark.parametrize(("unit", "scale"), [(0.001, 1.0), (1.0, 1.7)])
def test_units_and_a_scaled_finger_leave_the_skin_its_size(unit: float, scale: float) -> None:
    scene = press(unit, scale)
    assert bpy.ops.dermis.film_skin() == {"FINISHED"}
    scene.frame_set(6)
    at = np.array(scene.objects["Finger"].matrix_world.translation)
    seen = evaluated(film_objects.of_kind(scene, "skin")[0])
    assert (seen["position"] - at) * unit == pytest.approx(drawn(scene, 6, "pressure").positions, abs=1e-8)


def test_colours_are_the_views(tmp_path: Path) -> None:
    scene = press()
    assert bpy.ops.dermis.film_skin(show="pressure") == {"FINISHED"}
    nodes = bpy.data.materials[heat_material.NAME].node_tree.nodes
    assert heat_material.shown() == "pressure"
    largest = max(drawn(scene, f, "pressure").high for f in range(1, 10))
    end = nodes["Range"].inputs["From Max"].default_value
    assert largest <= end * (1 + 1e-6) and end <= 2.0 * largest
    scene.dermis.skin_view.range_mode, scene.dermis.skin_view.maximum = "fixed", 7.0
    scene.dermis.skin_view.quantity, scene.dermis.skin_view.colours = "displacement", "viridis"
    assert bpy.ops.dermis.film_colours(show="displacement") == {"FINISHED"}
    assert nodes["Range"].inputs["From Max"].default_value == pytest.approx(7e-3)
    for name in ("inferno", "viridis", "grey", "signed"):
        heat_material.ramp(nodes["Colours"].color_ramp, name)
        levels = np.linspace(0.0, 1.0, 333)
        light = np.array([nodes["Colours"].color_ramp.evaluate(v)[:3] for v in levels.tolist()])
        assert light == pytest.approx(heat_material.linear(skin_colours.at(name, levels)), abs=0.012), name


def test_a_changed_material_is_replaced_once() -> None:
    changed = heat_material.material()
    skin = bpy.data.meshes.new("Skin")
    skin.materials.append(changed)
    changed.node_tree.nodes.remove(changed.node_tree.nodes["Colours"])
    made = heat_material.material()
    assert made != changed and made.name == heat_material.NAME and heat_material.material() == made
    heat_material.show("pressure", 2.0, "viridis", 0.15)
    assert heat_material.shown() == "pressure" and heat_material.material() == made
    assert [m for m in bpy.data.materials if m.name.startswith(heat_material.NAME)] == [made, changed]
    assert skin.materials[0] == changed, "an artist's change stays on its skin"


def test_a_fingertip_of_ours_keeps_its_nail() -> None:
    bpy.ops.dermis.demo_skin_scene()
    scene = bpy.context.scene
    hand = scene.objects["Index"]
    scene.frame_end, scene.dermis.sample_rate = 9, 24.0
    hand.dermis.finger.skin.level, hand.dermis.finger.skin.contact = "draft", "nodes"
    hand.dermis.finger.skin.depth_mode = "compliant"
    assert bpy.ops.dermis.bake() == {"FINISHED"} and bpy.ops.dermis.film_skin() == {"FINISHED"}
    (obj,) = film_objects.of_kind(scene, "skin")
    faces: Any = obj.data.polygons
    nail = [p for p in faces if p.material_index == 1]
    own = [p for p in hand.data.polygons if p.material_index == 1]
    assert len(nail) == len(own) > 100 and obj.data.materials[1] == hand.data.materials[1]
    places = {tuple(round(c, 6) for c in hand.data.vertices[i].co) for p in own for i in p.vertices}
    assert {tuple(round(c, 6) for c in obj.data.vertices[i].co) for p in nail for i in p.vertices} == places
    assert len(evaluated(obj)["stress"]) == len(obj.data.vertices)


def test_without_a_bake_or_a_camera_it_says_so() -> None:
    span(1, 9)
    hand = finger()
    hand.dermis.finger.skin.shown = True
    assert not bpy.ops.dermis.film_skin.poll() and not bpy.ops.dermis.film_colours.poll()
    with pytest.raises(blender_addon._core.DermisError, match="skin is not baked"):
        next(skin_mesh.work_out(bpy.context.scene, ["Finger"]))
