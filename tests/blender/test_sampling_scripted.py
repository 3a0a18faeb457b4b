"""What is still at first and changes later: by scripts, by keyed visibility, by simulations that are keyed on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import baking, compat
from blender_addon.preview import device_preview
from blender_addon.sampling import scene_sweep
from core.presets import Library
from core.scene.tactile_scene import ABSENT
from core.steps import drain

from . import build

LATE = 10
WHEN = ("frame_change_pre", "frame_change_post")


@pytest.fixture
def script() -> Iterator[Callable[..., None]]:
    """Give a function that has another one run at changes of the frame, from frame LATE on."""
    device_preview.reset()
    added: list[tuple[list[Any], Any]] = []

    def add(act: Callable[[], Any], when: str = "frame_change_post", first: int = LATE) -> None:
        def run(scene: bpy.types.Scene, _depsgraph: Any = None) -> None:
            if scene.frame_current >= first:
                act()

        run.__module__ = "somebody.elses"
        getattr(bpy.app.handlers, when).append(run)
        added.append((getattr(bpy.app.handlers, when), run))

    yield add
    for functions, run in added:
        functions.remove(run)


def scene_of_cube() -> tuple[bpy.types.Scene, bpy.types.Object]:
    """Return a scene of 20 frames with a finger and a cube of 1 m, which nothing animates."""
    scene = build.span(1, 20)
    build.finger()
    return scene, build.cube()


def told(scene: bpy.types.Scene, code: str) -> list[Any]:
    """Return the findings with a code of the whole sweep."""
    tactile = scene_sweep.sample(scene)
    list(tactile.chunks)
    return [f for f in (*tactile.findings, *tactile.chunks.findings) if f.code == code]


def surfaces_by_frame(scene: bpy.types.Scene) -> dict[float, Any]:
    """Return the surface of the only body at whole frames."""
    tactile = scene_sweep.sample(scene)
    (body,) = tactile.bodies
    got = build.joined(tactile)
    meshes = got["surfaces"].get(0) or [body.mesh] * len(got["frames"])
    return {f: m for f, m in zip(got["frames"].tolist(), meshes, strict=True) if f == round(f)}


def lift(mesh: bpy.types.Mesh) -> None:
    """Put the top of a cube 0.25 m higher."""
    for vertex in mesh.vertices:
        if vertex.co.z > 0:
            vertex.co.z = 0.75
    mesh.update()


@pytest.mark.parametrize("when", WHEN)
def test_a_mesh_that_a_script_changes_late_is_followed(script: Callable[..., None], when: str) -> None:
    scene, cube = scene_of_cube()
    script(lambda: lift(cube.data), when)
    tops = {f: m.vertices[:, 2].max() for f, m in surfaces_by_frame(scene).items()}
    cube.data.vertices[1].co.z = 0.5
    assert [f for f, z in tops.items() if z == pytest.approx(0.75)] == list(range(LATE, 21))
    assert [f for f, z in tops.items() if z == pytest.approx(0.5)] == list(range(1, LATE))


def test_a_shape_key_that_a_script_sets_late_is_followed(script: Callable[..., None]) -> None:
    scene, cube = scene_of_cube()
    cube.shape_key_add(name="Basis")
    key = cube.shape_key_add(name="Key")
    key.value = 0.0
    for point in key.data:
        point.co.z *= 2.0
    script(lambda: setattr(key, "value", 1.0))
    tops = {f: m.vertices[:, 2].max() for f, m in surfaces_by_frame(scene).items()}
    assert {f for f, z in tops.items() if z == pytest.approx(1.0)} == set(range(LATE, 21))


def test_another_mesh_that_a_script_gives_an_object_is_followed(script: Callable[..., None]) -> None:
    scene, cube = scene_of_cube()
    other = bpy.data.meshes.new("Other")
    other.from_pydata([(0, 0, 3), (1, 0, 3), (0, 1, 3)], [], [(0, 1, 2)])
    script(lambda: setattr(cube, "data", other))
    counts = {f: len(m.triangles) for f, m in surfaces_by_frame(scene).items()}
    assert {f for f, n in counts.items() if n == 1} == set(range(LATE, 21))


def test_a_modifier_whose_target_a_script_moves_is_followed(script: Callable[..., None]) -> None:
    """Nothing of the cube itself is edited: Blender evaluates it because it depends on what is."""
    scene, cube = scene_of_cube()
    hook = build.empty("Hook")
    modifier = cube.modifiers.new("Hook", "HOOK")
    modifier.object = hook
    modifier.vertex_indices_set([1])
    script(lambda: setattr(hook, "location", (0.0, 0.0, 2.0)))
    tops = {f: m.vertices[:, 2].max() for f, m in surfaces_by_frame(scene).items()}
    assert {f for f, z in tops.items() if z == pytest.approx(2.5)} == set(range(LATE, 21))


def _hide(cube: bpy.types.Object, on: bool) -> None:
    cube.hide_viewport = on


def _hide_collection(cube: bpy.types.Object, on: bool) -> None:
    cube.users_collection[0].hide_viewport = on


def _exclude(cube: bpy.types.Object, on: bool) -> None:
    name = cube.users_collection[0].name
    bpy.context.view_layer.layer_collection.children[name].exclude = on


@pytest.mark.parametrize("disable", [_hide, _hide_collection, _exclude])
@pytest.mark.parametrize("appears", [False, True])
def test_what_a_script_hides_or_shows_late_goes_or_comes(
    script: Callable[..., None], disable: Callable[[Any, bool], None], appears: bool
) -> None:
    scene, cube = scene_of_cube()
    collection = bpy.data.collections.new("Part")
    scene.collection.children.link(collection)
    collection.objects.link(cube)
    scene.collection.objects.unlink(cube)
    disable(cube, appears)
    bpy.context.view_layer.update()

    def act() -> None:
        late = scene.frame_current >= LATE
        disable(cube, late != appears)

    script(act, "frame_change_pre", first=1)
    tactile = scene_sweep.sample(scene)
    assert "disabled" not in {f.code for f in tactile.findings}
    got = build.joined(tactile)
    there = {f for f, m in zip(got["frames"].tolist(), got["surfaces"][0], strict=True) if m is not ABSENT}
    assert {f for f in there if f == round(f)} == set(range(LATE, 21) if appears else range(1, LATE))


def test_a_parameter_that_a_script_sets_late_is_followed(script: Callable[..., None]) -> None:
    scene, cube = scene_of_cube()
    finger = bpy.data.objects["Finger"]
    finger.dermis.finger.devices.add().preset = "haptip"

    def act() -> None:
        cube.dermis.material.friction = 0.125 * (scene.frame_current - LATE)
        finger.dermis.finger.devices[0].scale = 0.25

    script(act)
    got = build.joined(scene_sweep.sample(scene))
    late = got["frames"] >= LATE
    assert set(got["animated"]) == {"body/0/friction", "device/0/0/scale"}
    whole = np.floor(got["frames"])
    assert got["animated"]["body/0/friction"][late] == pytest.approx(0.125 * (whole[late] - LATE))
    assert set(got["animated"]["device/0/0/scale"][late]) == {0.25}
    assert not (got["animated"]["device/0/0/scale"][~late] == 0.25).any()


def test_a_setting_that_cannot_follow_is_told_with_its_frame(script: Callable[..., None]) -> None:
    scene, cube = scene_of_cube()
    script(lambda: setattr(cube.dermis.material, "content_length_mm", 70.0), first=13)
    script(lambda: setattr(scene, "gravity", (0.0, 0.0, -1.0)), first=15)
    found = [(f.where, f.value, f.frame) for f in told(scene, "setting-changed")]
    assert found == [("object 'Cube'", "material.content_length_mm", 13.0), ("scene 'Scene'", "gravity", 15.0)]


def test_keyed_gravity_is_told_and_that_of_the_first_frame_holds() -> None:
    scene, _ = scene_of_cube()
    build.keys(scene, "gravity", [1, 7, 8], [(0, 0, -2), (0, 0, -2), (0, 0, -3)])
    scene.frame_set(18)
    tactile = scene_sweep.sample(scene)
    assert tactile.gravity == pytest.approx((0.0, 0.0, -2.0))
    assert [(f.value, f.frame) for f in told(scene, "setting-changed")] == [("gravity", 8.0)]


def test_a_script_that_changes_nothing_costs_no_finding_and_no_chunk_brings_surfaces(
    script: Callable[..., None],
) -> None:
    scene, _ = scene_of_cube()
    script(lambda: None)
    tactile = scene_sweep.sample(scene)
    assert not tactile.findings and tactile.bodies[0].mesh is not None
    assert not build.joined(tactile)["surfaces"]
    assert not tactile.chunks.findings


def test_a_simulation_that_is_keyed_on_late_is_swept_at_whole_frames() -> None:
    scene, cube = scene_of_cube()
    cloth = cube.modifiers.new("Cloth", "CLOTH")
    build.keys(cube, 'modifiers["Cloth"].show_viewport', [1, 5], [0, 1], "CONSTANT")
    scene.frame_set(1)
    assert not cloth.show_viewport
    assert scene_sweep.sample(scene).bodies[0].simulated


def test_a_simulation_that_a_script_turns_on_late_is_told(script: Callable[..., None]) -> None:
    scene, cube = scene_of_cube()
    cloth = cube.modifiers.new("Cloth", "CLOTH")
    cloth.show_viewport = False
    script(lambda: setattr(cloth, "show_viewport", True))
    (found,) = told(scene, "setting-changed")
    assert (found.where, found.value, found.frame) == ("object 'Cube'", "Cloth", LATE)


def test_a_finger_that_a_script_enables_late_is_told(script: Callable[..., None]) -> None:
    scene, _ = scene_of_cube()
    thumb = build.finger("Thumb")
    thumb.hide_viewport = True
    script(lambda: setattr(thumb, "hide_viewport", False))
    (found,) = told(scene, "setting-changed")
    assert (found.where, found.value, found.frame) == ("object 'Thumb'", "visibility", LATE)


def test_a_relief_whose_mesh_a_script_changes_late_is_told(script: Callable[..., None]) -> None:
    scene = build.span(1, 20)
    build.finger()
    pane, cube = build.screen(), build.cube("Relief", 0.05)
    cube.dermis.role = "NONE"
    pane.dermis.screen.source, pane.dermis.screen.mesh_object, pane.dermis.screen.resolution = "MESH", cube, 16
    script(lambda: lift(cube.data), first=12)
    (found,) = told(scene, "relief-frozen")
    assert (found.where, found.value, found.frame) == ("screen 'Screen'", "Relief", 12.0)


def test_what_is_hidden_at_first_and_made_by_modifiers_can_be_touched_later() -> None:
    """Blender does not evaluate what is hidden: at first there are no faces."""
    scene, cube = scene_of_cube()
    bpy.data.objects.remove(cube)
    line = build.mesh_object("Line", [(-0.5, 0, 0), (0.5, 0, 0)], [])
    line.data.edges.add(1)
    line.data.edges[0].vertices = (0, 1)
    line.dermis.role = "TOUCHABLE"
    screw = line.modifiers.new("Screw", "SCREW")
    screw.axis, screw.angle, screw.screw_offset = "Z", 0.0, 1.0
    build.keys(line, "hide_viewport", [1, 5], [1, 0], "CONSTANT")
    scene.frame_set(1)
    tactile = scene_sweep.sample(scene)
    assert "mesh-unusable" not in {f.code for f in tactile.findings}
    got = build.joined(tactile)
    there = [m is not ABSENT for m in got["surfaces"][0]]
    assert there == (got["frames"] >= 5.0).tolist()


def test_the_live_preview_follows_a_script(script: Callable[..., None]) -> None:
    scene, cube = scene_of_cube()
    script(lambda: setattr(cube, "hide_viewport", True), "frame_change_pre")
    seen = []
    for frame in (1, 9, 12):
        scene.frame_set(frame)
        seen.append(len(scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).bodies))
    assert seen == [1, 1, 0]


def test_a_bake_feels_a_mesh_that_a_script_lifts_late(script: Callable[..., None]) -> None:
    scene, cube = scene_of_cube()
    finger = bpy.data.objects["Finger"]
    finger.location = (0.0, 0.0, 0.75)  # 0.25 m above the cube until it is lifted
    finger.dermis.finger.devices.add().preset = "haptip"
    script(lambda: lift(cube.data))
    (output,) = drain(baking.bake(scene, Library(None))).outputs
    contact, seconds = output.signals["contact"], (LATE - 1) / 24
    times = np.arange(len(contact)) / 1000.0
    assert contact[times > seconds + 0.01].all() and not contact[times < seconds - 0.05].any()


def test_stored_settings_are_plain_values() -> None:
    cube = build.cube()
    cube.dermis.material.friction = 0.25
    assert compat.stored(cube, "dermis")["material"]["friction"] == 0.25
    assert compat.stored(build.empty("Bare"), "dermis") == {}
