"""Simulations: a falling body falls with 9.81 m/s2 at every sample, and twice with the same bytes."""

from __future__ import annotations

from fractions import Fraction

import bpy
import numpy as np
import pytest

from blender_addon.sampling import scene_sweep, simulated_motion
from blender_addon.scene_time import Clock
from core.motion import Motion
from core.scene import tactile_scene
from core.scene.content_hash import ContentHash
from tests.blender import build


def rigid(obj: bpy.types.Object, kind: str = "ACTIVE") -> None:
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.rigidbody.object_add()
    obj.rigid_body.type = kind
    obj.rigid_body.linear_damping = obj.rigid_body.angular_damping = 0.0
    obj.select_set(False)


def content_hash(tactile) -> str:
    running = ContentHash(tactile)
    for _ in running.through(tactile.chunks):
        pass
    return running.hexdigest()


@pytest.mark.parametrize("fps", [24, 25])
def test_a_falling_cube_accelerates_at_g_at_every_sample(fps):
    scene = build.span(1, 1 + fps, fps)
    cube = build.cube("Cube", 1.0, (0, 0, 20))
    cube.rotation_euler = (0.3, 0.2, 0.1)
    cube.scale = (1, 2, 3)
    rigid(cube)
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert tactile.bodies[0].simulated
    got = build.joined(tactile)
    motion = Motion(got["times"], got["bodies"][0]).at(got["times"])
    np.testing.assert_allclose(motion.acceleration[:, 2], -9.81, rtol=0.02)
    # Bullet steps ten times a frame, velocity first: z = z0 - g (t^2 + t dt) / 2.
    t, dt = got["times"], 1 / (10 * fps)
    np.testing.assert_allclose(got["bodies"][0, :, 2, 3], 20 - 9.81 * (t**2 + t * dt) / 2, atol=2e-5)
    scale = np.linalg.norm(got["bodies"][0, :, :3, :3], axis=1)
    np.testing.assert_allclose(scale, np.broadcast_to([1, 2, 3], (len(t), 3)), rtol=1e-6)


def test_the_same_bytes_twice_fresh_and_from_the_cache():
    scene = build.span(1, 25)
    cube = build.cube("Cube", 1.0, (0.2, 0.1, 2))
    cube.rotation_euler = (0.3, 0.2, 0.1)
    floor = build.mesh_object("Floor", [(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)], [(0, 1, 2, 3)])
    rigid(cube)
    rigid(floor, "PASSIVE")
    build.finger()
    first = content_hash(scene_sweep.sample(scene))
    scene.frame_set(17, subframe=0.5)
    assert content_hash(scene_sweep.sample(scene)) == first


def test_what_hangs_on_a_simulation_is_swept_with_it_and_nothing_else():
    scene = build.span(1, 13)
    cube = build.cube("Cube", 1.0, (0, 0, 20))
    rigid(cube)
    held = build.finger("Held", (0, 0, 1))
    held.parent = cube
    watcher = build.cube("Watcher")
    watcher.constraints.new("COPY_LOCATION").target = held
    driven = build.cube("Driven")
    curve = driven.driver_add("location", 0)
    variable = curve.driver.variables.new()
    variable.name, variable.type = "z", "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].transform_type = cube, "LOC_Z"
    curve.driver.expression = "z"
    free = build.cube("Free")
    build.keys(free, "location", [1, 13], [(0, 0, 0), (1, 0, 0)])
    found = simulated_motion.find(scene)
    by_uid = {o.session_uid: o.name for o in bpy.data.objects}
    assert {by_uid[u] for u in found.uids} == {"Cube", "Held", "Watcher", "Driven"}
    tactile = scene_sweep.sample(scene)
    assert {b.name: b.simulated for b in tactile.bodies} == {
        "Cube": True,
        "Driven": True,
        "Free": False,
        "Watcher": True,
    }
    got = build.joined(tactile)
    acceleration = Motion(got["times"], got["fingers"][0]).at(got["times"]).acceleration
    np.testing.assert_allclose(acceleration[:, 2], -9.81, rtol=0.02)
    np.testing.assert_allclose(got["bodies"][2, :, 0, 3], got["times"] * 2, atol=1e-6)


def test_a_range_that_begins_late_starts_the_simulation_at_its_start():
    scene = build.span(13, 25)
    rigid(build.cube("Cube", 1.0, (0, 0, 20)))
    build.finger()
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    t, dt = 0.5 + got["times"], 1 / 240
    np.testing.assert_allclose(got["bodies"][0, :, 2, 3], 20 - 9.81 * (t**2 + t * dt) / 2, atol=2e-5)
    assert tactile.chunks.done == 25 + 121


def test_cloth_is_smooth_between_frames_and_exact_on_them():
    scene = build.span(1, 13)
    n = 6
    points = [(x / n, y / n, 1.0) for y in range(n + 1) for x in range(n + 1)]
    faces = [
        (r * (n + 1) + c, r * (n + 1) + c + 1, (r + 1) * (n + 1) + c + 1, (r + 1) * (n + 1) + c)
        for r in range(n)
        for c in range(n)
    ]
    sheet = build.mesh_object("Sheet", points, faces)
    sheet.dermis.role = "TOUCHABLE"
    cloth = sheet.modifiers.new("Cloth", "CLOTH")
    cloth.settings.air_damping = 0.0
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert tactile.bodies[0].simulated and tactile.bodies[0].mesh is None
    got = build.joined(tactile)
    meshes = got["surfaces"][0]
    assert len({id(m.triangles) for m in meshes}) == 1
    height = np.array([m.vertices[:, 2].mean() for m in meshes])
    whole = []
    for frame in range(1, 14):
        scene.frame_set(frame)
        mesh = sheet.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        whole.append(np.mean([v.co.z for v in mesh.vertices]))
    np.testing.assert_allclose(height[::10], whole, atol=1e-6)
    # Curvature follows that of the whole frames; Blender's own straight segments would give 0 and ten times as much.
    curvature = np.diff(height, 2) * 240**2
    at_frames = np.diff(whole, 2) * 24**2
    expected = np.interp(np.arange(10, 111), np.arange(10, 111, 10), at_frames)
    np.testing.assert_allclose(curvature[9:110], expected, atol=0.2 * np.abs(at_frames).max())


def test_a_fluid_domain_is_refused_by_name():
    scene = build.span(1, 3)
    domain = build.cube("Water")
    build.cube("Cup")
    domain.modifiers.new("Fluid", "FLUID").fluid_type = "DOMAIN"
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Cup"]
    assert [(f.severity, f.where) for f in tactile.findings if f.code == "fluid"] == [("error", "object 'Water'")]


def falling_particles(floor: float | None) -> tuple[bpy.types.Scene, bpy.types.Object]:
    """Let two particles that show a cube fall, on a floor at a height; return the scene and who emits them."""
    scene = build.span(1, 12, 25)
    pebble = build.cube("Pebble", 0.1, (0, 0, -50))
    source = build.mesh_object("Source", [(0, 0, 5), (1, 0, 5), (0, 1, 5)], [(0, 1, 2)])
    source.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = source.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime = 2, 1, 1, 500
    settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", pebble, 1.0
    settings.normal_factor = settings.drag_factor = settings.brownian_factor = 0.0
    if floor is not None:
        corners = [(-9, -9, floor), (9, -9, floor), (9, 9, floor), (-9, 9, floor)]
        build.mesh_object("Floor", corners, [(0, 1, 2, 3)]).modifiers.new("Collision", "COLLISION")
    build.finger()
    return scene, source


@pytest.mark.parametrize(
    ("floor", "rate", "chunk"), [(4.8, 50.0, 64), (4.8, 50.0, 5), (4.8, 25.0, 64), (None, 50.0, 64)]
)
def test_particles_that_are_felt_beside_where_blender_shows_them_are_told(floor, rate, chunk):
    scene, source = falling_particles(floor)
    scene.dermis.sample_rate = rate
    tactile = scene_sweep.sample(scene, chunk_size=chunk)
    got = build.joined(tactile)
    names = [b.name for b in tactile.bodies]
    off = np.zeros(len(got["frames"]))
    for k, frame in enumerate(got["frames"].tolist()):
        scene.frame_set(int(frame), subframe=frame % 1.0)
        for item in bpy.context.evaluated_depsgraph_get().object_instances:
            if item.is_instance:
                body = names.index(f"Pebble @ Source {item.persistent_id[0]}.0")
                place = got["bodies"][body, k, :3, 3]
                off[k] = max(off[k], np.linalg.norm(place - np.array(item.matrix_world.translation)))
    told = [f for f in tactile.chunks.findings if f.code == "particles-between-frames"]
    assert len(told) == (off.max() > 1e-4)
    for finding in told:
        assert finding.where == f"object '{source.name}'" and off.max() > 0.01
        assert finding.value == f"up to {1000 * off.max():.4g} mm, at frame {got['frames'][np.argmax(off)]:g}"
        assert finding.frame == got["frames"][np.argmax(off > 1.1e-5)]
    assert bool(told) == (floor is not None and rate > 25.0)


def test_particles_that_show_a_touchable_object_fall_smoothly():
    scene = build.span(1, 26, 25)  # Blender's particles live 0.04 s a frame, whatever the frame rate
    pebble = build.cube("Pebble", 0.1, (0, 0, -50))
    source = build.mesh_object("Source", [(0, 0, 9), (1, 0, 9), (0, 1, 9)], [(0, 1, 2)])
    source.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = source.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime = 2, 1, 1, 500
    settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", pebble, 1.0
    settings.normal_factor = settings.drag_factor = settings.brownian_factor = 0.0
    settings.integrator = "VERLET"
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert [(b.name, b.simulated) for b in tactile.bodies if "@" in b.name] == [
        ("Pebble @ Source 0.0", True),
        ("Pebble @ Source 1.0", True),
    ]
    got = build.joined(tactile)
    falling = Motion(got["times"], got["bodies"][1]).at(got["times"]).acceleration[30:-30, 2]
    np.testing.assert_allclose(falling, -9.81, rtol=0.001)


def test_what_is_let_go_late_rests_until_then_and_falls_from_then_on():
    scene = build.span(1, 12)
    rigid(build.cube("Cube", 1.0, (0, 0, 20)))
    scene.rigidbody_world.point_cache.frame_start = 5
    build.finger()
    got = build.joined(scene_sweep.sample(scene))
    t, dt = np.maximum(got["times"] - 4 / 24, 0.0), 1 / 240
    np.testing.assert_allclose(got["bodies"][0, :, 2, 3], 20 - 9.81 * (t**2 + t * dt) / 2, atol=2e-5)


@pytest.mark.parametrize(("born", "life"), [(1, 500), (4, 500), (4, 4)])
def test_particles_come_and_go_where_blender_shows_them(born, life):
    scene, source = falling_particles(None)
    scene.dermis.sample_rate = 50.0
    settings = source.particle_systems[0].settings
    settings.frame_end, settings.frame_start, settings.lifetime = born, born, life
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    names, seen = [b.name for b in tactile.bodies], 0
    for k, frame in enumerate(got["frames"].tolist()):
        scene.frame_set(int(frame), subframe=frame % 1.0)
        for item in bpy.context.evaluated_depsgraph_get().object_instances:
            if item.is_instance:
                body = names.index(f"Pebble @ Source {item.persistent_id[0]}.0")
                np.testing.assert_allclose(got["bodies"][body, k, :3, 3], item.matrix_world.translation, atol=1e-5)
                seen += 1
    assert seen >= 2 * 2 * min(life, 8)
    assert not any(f.code == "particles-between-frames" for f in tactile.chunks.findings)


def test_surfaces_that_get_other_faces_or_rest_for_a_while_move_smoothly_otherwise():
    times, clock = np.arange(20) / 24.0, Clock(Fraction(24), 1.0)
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    faces = [np.array([(0, 1, 2), (0, 2, 3)], np.int32), np.array([(0, 1, 2)], np.int32)]

    def height(t):
        return np.maximum(t - times[6], 0.0) ** 2

    recording = simulated_motion.Recording(times)
    for i, time in enumerate(times.tolist()):
        recording.keep_surface("Cloth", tactile_scene.Mesh(corners + [0, 0, height(time)], faces[int(i >= 10)]))
    between = np.linspace(times[3], times[14], 111)
    made = recording.surfaces_at("Cloth", between)
    expected = np.where((between > times[9]) & (between < times[10] - 1e-9), height(times[9]), height(between))
    np.testing.assert_allclose([m.vertices[0, 2] for m in made], expected, atol=1e-7)
    (found,) = recording.findings(clock)
    assert (found.code, found.where, found.count) == ("faces-between-frames", "object 'Cloth'", 9)
    assert found.frame == pytest.approx(10.1)


def test_a_simulated_surface_without_faces_for_a_while_is_told():
    scene = build.span(1, 8)
    scene.dermis.sample_rate = 24.0
    sheet = build.mesh_object("Sheet", [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], [(0, 1, 2, 3)])
    sheet.dermis.role = "TOUCHABLE"
    sheet.vertex_groups.new(name="All").add([0, 1, 2, 3], 0.5, "ADD")
    sheet.modifiers.new("Cloth", "CLOTH")
    mask = sheet.modifiers.new("Mask", "MASK")
    mask.vertex_group = "All"
    for frame, threshold in ((1, 0.0), (4, 0.0), (5, 1.0)):
        mask.threshold = threshold
        mask.keyframe_insert("threshold", frame=frame)
    build.finger()
    tactile = scene_sweep.sample(scene)
    surfaces = build.joined(tactile)["surfaces"][0]
    gone = [m is tactile_scene.ABSENT for m in surfaces]
    told = [f for f in tactile.chunks.findings if f.code == "no-faces"]
    assert any(gone) and not all(gone)
    assert [(f.frame, f.count) for f in told] == [(1.0 + gone.index(True), sum(gone))]
