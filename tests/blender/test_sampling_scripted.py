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

from . import build, test_sampling_instances

LATE = 10
WHEN = ("frame_change_pre", "frame_change_post")


@pytest.fixture
def script() -> Iterator[Any]:
    """Give a function that has another one run at changes of the frame, from frame LATE on; its `end` ends them."""
    device_preview.reset()
    added: list[tuple[list[Any], Any]] = []

    def add(act: Callable[[], Any], when: str = "frame_change_post", first: int = LATE) -> None:
        def run(scene: bpy.types.Scene, _depsgraph: Any = None) -> None:
            if scene.frame_current >= first:
                act()

        run.__module__ = "somebody.elses"
        getattr(bpy.app.handlers, when).append(run)
        added.append((getattr(bpy.app.handlers, when), run))

    def end() -> None:
        while added:
            functions, run = added.pop()
            functions.remove(run)

    add.end = end  # type: ignore[attr-defined]
    yield add
    end()


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
def test_a_mesh_that_a_script_changes_late_is_followed(script: Any, when: str) -> None:
    scene, cube = scene_of_cube()
    script(lambda: lift(cube.data), when)
    tops = {f: m.vertices[:, 2].max() for f, m in surfaces_by_frame(scene).items()}
    cube.data.vertices[1].co.z = 0.5
    assert [f for f, z in tops.items() if z == pytest.approx(0.75)] == list(range(LATE, 21))
    assert [f for f, z in tops.items() if z == pytest.approx(0.5)] == list(range(1, LATE))


@pytest.mark.parametrize("how", ["adds one", "moves to the end", "empties the list"])
def test_what_a_script_edits_that_another_one_starts_late_is_followed(script: Any, how: str) -> None:
    """Add-ons that start on demand do so: their function then stands behind all that were there before."""
    scene, cube = scene_of_cube()
    functions = bpy.app.handlers.frame_change_post
    before = list(functions)

    def edit(_scene: bpy.types.Scene, _depsgraph: Any = None) -> None:
        for vertex in cube.data.vertices:
            vertex.co.z = np.sign(vertex.co.z) * (
                0.75 + 0.01 * scene.frame_current if scene.frame_current >= LATE else 0.5
            )
        cube.data.update()

    def start() -> None:
        if how == "empties the list":
            functions.clear()
        if how == "moves to the end" and edit in functions:
            functions.remove(edit)
        if edit not in functions:
            functions.append(edit)

    edit.__module__ = "somebody.elses"
    script(start)
    begins = list(functions)
    try:
        tops = {f: m.vertices[:, 2].max() for f, m in surfaces_by_frame(scene).items()}
    finally:
        functions[:] = begins
        script.end()
    assert functions[:] == before
    # Blender goes through the list by number: what takes the first place of an emptied list is not run at that frame.
    first = LATE + (how == "empties the list")
    expected = {f: 0.75 + 0.01 * f if f >= first else 0.5 for f in range(1, 21)}
    assert tops == pytest.approx(expected)


def test_a_shape_key_that_a_script_sets_late_is_followed(script: Any) -> None:
    scene, cube = scene_of_cube()
    cube.shape_key_add(name="Basis")
    key = cube.shape_key_add(name="Key")
    key.value = 0.0
    for point in key.data:
        point.co.z *= 2.0
    script(lambda: setattr(key, "value", 1.0))
    tops = {f: m.vertices[:, 2].max() for f, m in surfaces_by_frame(scene).items()}
    assert {f for f, z in tops.items() if z == pytest.approx(1.0)} == set(range(LATE, 21))


def test_another_mesh_that_a_script_gives_an_object_is_followed(script: Any) -> None:
    scene, cube = scene_of_cube()
    other = bpy.data.meshes.new("Other")
    other.from_pydata([(0, 0, 3), (1, 0, 3), (0, 1, 3)], [], [(0, 1, 2)])
    script(lambda: setattr(cube, "data", other))
    counts = {f: len(m.triangles) for f, m in surfaces_by_frame(scene).items()}
    assert {f for f, n in counts.items() if n == 1} == set(range(LATE, 21))


def test_a_modifier_whose_target_a_script_moves_is_followed(script: Any) -> None:
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
    script: Any, disable: Callable[[Any, bool], None], appears: bool
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


def test_a_parameter_that_a_script_sets_late_is_followed(script: Any) -> None:
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


def test_a_setting_that_cannot_follow_is_told_with_its_frame(script: Any) -> None:
    scene, cube = scene_of_cube()
    script(lambda: setattr(cube.dermis.material, "content_length_mm", 70.0), first=13)
    script(lambda: setattr(scene, "gravity", (0.0, 0.0, -1.0)), first=15)
    found = [(f.where, f.value, f.frame) for f in told(scene, "setting-changed")]
    assert found == [("object 'Cube'", "material.content_length_mm", 13.0), ("scene 'Scene'", "gravity", 15.0)]


def test_a_role_that_a_script_takes_away_is_told_and_the_object_is_felt_to_the_end(script: Any) -> None:
    scene, cube = scene_of_cube()
    script(lambda: setattr(cube.dermis, "role", "NONE"))
    found = [(f.where, f.value, f.frame) for f in told(scene, "setting-changed")]
    assert found == [("object 'Cube'", "role", float(LATE))]


def test_keyed_gravity_is_told_and_that_of_the_first_frame_holds() -> None:
    scene, _ = scene_of_cube()
    build.keys(scene, "gravity", [1, 7, 8], [(0, 0, -2), (0, 0, -2), (0, 0, -3)])
    scene.frame_set(18)
    tactile = scene_sweep.sample(scene)
    assert tactile.gravity == pytest.approx((0.0, 0.0, -2.0))
    assert [(f.value, f.frame) for f in told(scene, "setting-changed")] == [("gravity", 8.0)]


def test_a_script_that_changes_nothing_costs_no_finding_and_no_chunk_brings_surfaces(script: Any) -> None:
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


def test_a_simulation_that_a_script_turns_on_late_is_told(script: Any) -> None:
    scene, cube = scene_of_cube()
    cloth = cube.modifiers.new("Cloth", "CLOTH")
    cloth.show_viewport = False
    script(lambda: setattr(cloth, "show_viewport", True))
    (found,) = told(scene, "setting-changed")
    assert (found.where, found.value, found.frame) == ("object 'Cube'", "Cloth", LATE)


def test_a_finger_that_a_script_enables_late_is_told(script: Any) -> None:
    scene, _ = scene_of_cube()
    thumb = build.finger("Thumb")
    thumb.hide_viewport = True
    script(lambda: setattr(thumb, "hide_viewport", False))
    (found,) = told(scene, "setting-changed")
    assert (found.where, found.value, found.frame) == ("object 'Thumb'", "visibility", LATE)


def test_a_relief_whose_mesh_a_script_changes_late_is_told(script: Any) -> None:
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


def test_the_live_preview_follows_a_script(script: Any) -> None:
    scene, cube = scene_of_cube()
    script(lambda: setattr(cube, "hide_viewport", True), "frame_change_pre")
    seen = []
    for frame in (1, 9, 12):
        scene.frame_set(frame)
        seen.append(len(scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).bodies))
    assert seen == [1, 1, 0]


def stroke(cube: bpy.types.Object, depth: float) -> None:
    """Let the finger slide over the cube's top at a depth, wearing a shear tactor."""
    finger = bpy.data.objects["Finger"]
    build.keys(finger, "location", [1, 20], [(-0.1, 0.0, 0.5 - depth), (0.1, 0.0, 0.5 - depth)])
    finger.dermis.finger.devices.add().preset = "haptip"
    cube.dermis.material.friction, cube.dermis.material.texture_on = 0.25, True


def baked() -> tuple[np.ndarray, np.ndarray]:
    """Return the track's values and when there is contact."""
    made = drain(baking.bake(bpy.context.scene, Library(None)))
    assert not [f for f in made.all_findings if f.severity == "error"]
    return made.outputs[0].track.values, made.outputs[0].signals["contact"]


def test_a_bake_feels_a_mesh_that_a_script_lifts_late_as_if_it_were_keyed(script: Any) -> None:
    scene, cube = scene_of_cube()
    stroke(cube, depth=-0.0005)  # above the cube until that is lifted
    cube.shape_key_add(name="Basis")
    key = cube.shape_key_add(name="Key")
    for point in key.data:
        point.co.z += 0.001 * (point.co.z > 0)
    key.value = 0.0
    script(lambda: setattr(key, "value", float(scene.frame_current >= LATE)), first=1)
    scripted, contact = baked()
    script.end()
    build.keys(cube.data.shape_keys, 'key_blocks["Key"].value', [1, LATE], [0.0, 1.0], "CONSTANT")
    keyed, contact_keyed = baked()
    times = np.arange(len(contact)) / 1000.0
    late = times >= (LATE - 1) / 24
    assert contact[late][5:].all() and not contact[~late][:-5].any()
    np.testing.assert_array_equal(contact, contact_keyed)
    np.testing.assert_allclose(scripted, keyed, rtol=0, atol=1e-12)
    assert np.abs(scripted).max() > 1e-5


def test_a_bake_feels_a_friction_that_a_script_sets_late_as_if_it_were_keyed(script: Any) -> None:
    scene, cube = scene_of_cube()
    stroke(cube, depth=0.0005)
    material = cube.dermis.material
    script(lambda: setattr(material, "friction", 0.25 + 0.5 * (scene.frame_current >= LATE)), first=1)
    scripted, _ = baked()
    script.end()
    build.keys(cube, "dermis.material.friction", [1, LATE], [0.25, 0.75], "CONSTANT")
    keyed, _ = baked()
    np.testing.assert_allclose(scripted, keyed, rtol=0, atol=1e-12)
    assert np.abs(np.diff(scripted, axis=0)).max() > 1e-5


def test_stored_settings_are_plain_values() -> None:
    cube = build.cube()
    cube.dermis.material.friction, cube.dermis.material.texture_on = 0.25, True
    assert compat.stored(cube, "dermis")["material"]["friction"] == 0.25
    assert compat.stored(build.empty("Bare"), "dermis") == {}


@pytest.mark.parametrize("how", ["vertices", "nodes"])
def test_instances_that_a_script_switches_on_late_are_told(script: Any, how: str) -> None:
    scene = build.span(1, 20)
    build.finger()
    maker = build.mesh_object("Host", [(0, 0, 0), (3, 0, 0), (0, 3, 0)], [(0, 1, 2)])
    maker.dermis.role = "TOUCHABLE"
    if how == "vertices":
        peg = build.cube("Peg", 0.5)
        peg.dermis.role, peg.parent = "NONE", maker
    else:
        cube = test_sampling_instances.node("GeometryNodeMeshCube")
        tree = test_sampling_instances.on_points(maker, cube, join=True)
        maker.modifiers.clear()

    def switch() -> None:
        late = scene.frame_current >= LATE
        if how == "vertices":
            maker.instance_type = "VERTS" if late else "NONE"
        elif late and not maker.modifiers:
            maker.modifiers.new("Nodes", "NODES").node_group = tree
        elif not late:
            maker.modifiers.clear()

    script(switch, first=-1000)
    (finding,) = told(scene, "instances-too-late")
    assert (finding.severity, finding.where, finding.frame) == ("warning", "object 'Host'", LATE)


@pytest.mark.parametrize("others", [False, True], ids=["alone", "beside"])
def test_an_empty_that_a_script_makes_an_instancer_late_is_felt_or_told(script: Any, others: bool) -> None:
    """Where something else makes instances, whole frames are looked through anyway."""
    scene = build.span(1, 20)
    scene.dermis.sample_rate = 24.0
    build.finger()
    shown = test_sampling_instances.in_collection("Shown", test_sampling_instances.plain("Peg"))
    maker = build.empty("Maker")
    maker.dermis.role = "TOUCHABLE"
    maker.instance_collection = shown
    if others:
        test_sampling_instances.instance_of(shown, "Other", (5, 0, 0))

    def switch() -> None:
        maker.instance_type = "COLLECTION" if scene.frame_current >= LATE else "NONE"

    build.cube("Beside", location=(0, 9, 0))
    script(switch, first=-1000)
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    names = [body.name for body in tactile.bodies]
    if not others:
        assert "Maker" not in names
        (finding,) = [f for f in tactile.chunks.findings if f.code == "instances-too-late"]
        assert (finding.where, finding.frame) == ("object 'Maker'", LATE)
        return
    assert not [f for f in tactile.findings if f.code == "mesh-unusable" and "Maker" in f.where]
    there = [mesh is not ABSENT for mesh in got["surfaces"][names.index("Maker")]]
    np.testing.assert_array_equal(there, got["frames"] >= LATE)


@pytest.mark.parametrize("before", ["no faces at first", "none at the end"])
def test_a_mesh_that_a_script_gives_faces_late_is_felt_from_then_on(script: Any, before: str) -> None:
    scene, cube = scene_of_cube()
    build.cube("Other", location=(0, 9, 0))
    full, bare = cube.data, bpy.data.meshes.new("Bare")

    def switch() -> None:
        cube.data = full if (scene.frame_current >= LATE) == (before == "no faces at first") else bare

    script(switch, first=-1000)
    scene.frame_set(1)
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    there = [mesh is not ABSENT for mesh in got["surfaces"][[b.name for b in tactile.bodies].index("Cube")]]
    np.testing.assert_array_equal(there, (got["frames"] >= LATE) == (before == "no faces at first"))
    assert not [f for f in tactile.findings if f.code == "mesh-unusable"]


@pytest.mark.parametrize("role", ["TOUCHABLE", "FINGER", "SCREEN"])
def test_a_role_that_a_script_gives_late_is_told(script: Any, role: str) -> None:
    scene, _ = scene_of_cube()
    other = build.cube("Other", location=(0, 9, 0))
    other.dermis.role = "NONE"
    script(lambda: setattr(other.dermis, "role", role if scene.frame_current >= LATE else "NONE"), first=-1000)
    (finding,) = told(scene, "setting-changed")
    assert (finding.where, finding.value, finding.frame) == ("object 'Other'", "role", LATE)


def test_nodes_that_a_script_adds_late_and_that_show_no_instances_are_no_finding(script: Any) -> None:
    scene, cube = scene_of_cube()
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])

    def add() -> None:
        if not cube.modifiers:
            cube.modifiers.new("Nodes", "NODES").node_group = tree

    script(add)
    assert told(scene, "instances-too-late") == []
    assert len(cube.modifiers) == 1


@pytest.mark.parametrize("how", ["swapped", "renamed and edited", "renamed to the end"])
@pytest.mark.parametrize("chunk", [5, 64])
def test_objects_that_a_script_renames_are_not_taken_for_each_other(script: Any, how: str, chunk: int) -> None:
    """Blender's list of objects is in order of name."""
    scene = build.span(1, 10)
    scene.dermis.sample_rate = 48.0
    build.finger()
    one, other = build.cube("A"), build.cube("M", 0.5)
    build.keys(one, "location", [1, 10], [(0, 0, 0), (9, 0, 0)])
    build.keys(other, "location", [1, 10], [(0, 4, 0), (0, 13, 0)])
    build.keys(other, "hide_viewport", [1, 6], [0, 1], "CONSTANT")
    build.keys(one, "dermis.material.friction", [1, 10], [0.1, 1.0])

    def rename() -> None:
        frame = scene.frame_current
        now = 4 <= frame < (99 if how == "renamed to the end" else 8)
        if how == "swapped":
            if (one.name == "M") != now:
                one.name = "Between"
                other.name = "A" if now else "M"
                one.name = "M" if now else "A"
        else:
            one.name = "Z" if now else "A"
        if how == "renamed and edited":
            for vertex in one.data.vertices:
                vertex.co.z = np.sign(vertex.co.z) * (0.75 if frame >= 5 else 0.5)
            one.data.update()

    script(rename, first=-1000)
    tactile = scene_sweep.sample(scene, chunk_size=chunk)
    assert [b.name for b in tactile.bodies] == ["A", "M"]
    got = build.joined(tactile)
    frames = got["frames"]
    np.testing.assert_allclose(got["bodies"][0, :, 0, 3], frames - 1, atol=1e-5)
    np.testing.assert_allclose(got["bodies"][1, :, 1, 3][frames < 6], frames[frames < 6] + 3, atol=1e-5)
    np.testing.assert_allclose(got["animated"]["body/0/friction"], 0.1 * frames, atol=1e-5)
    np.testing.assert_array_equal([mesh is ABSENT for mesh in got["surfaces"][1]], frames >= 6)
    if how == "renamed and edited":
        tops = [mesh.vertices[:, 2].max() for mesh in got["surfaces"][0]]
        np.testing.assert_allclose(tops, np.where(frames >= 5, 0.75, 0.5), atol=1e-6)
