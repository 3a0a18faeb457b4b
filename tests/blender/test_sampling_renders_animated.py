"""What renders show otherwise at later frames only: settings and shapes that keys, drivers or scripts change."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon.sampling import render_differences, render_surfaces, scene_sweep
from core.scene.tactile_scene import ABSENT

from . import build
from .test_sampling_instances import host, plain
from .test_sampling_renders import apart, told


@pytest.fixture(autouse=True)
def ranged() -> None:
    """Start with a finger and a range of frames."""
    build.span(1, 12)
    build.finger()


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, str]]:
    """Note the frames at which objects are measured, and their names."""
    noted: list[tuple[float, str]] = []
    measure = render_surfaces.distances

    def distances(objects: Any, scene: Any, view_layer: Any) -> Any:
        noted.extend((scene.frame_float, o.name) for o in objects)
        return measure(objects, scene, view_layer)

    monkeypatch.setattr(render_surfaces, "distances", distances)
    return noted


def subdivided(levels: int = 1, rendered: int = 1, size: float = 1.0) -> Any:
    cube = build.cube(size=size)
    modifier = cube.modifiers.new("Fine", "SUBSURF")
    modifier.levels, modifier.render_levels = levels, rendered
    return cube


def keyed(cube: Any) -> None:
    cube.modifiers["Fine"].show_render = True
    build.keys(cube, 'modifiers["Fine"].show_render', [1, 6], [1, 0], "CONSTANT")


def driven(cube: Any) -> None:
    cube.driver_add('modifiers["Fine"].show_render').driver.expression = "frame < 6"


def scripted(cube: Any) -> None:
    def switch(scene: Any, _depsgraph: Any = None) -> None:
        bpy.data.objects["Cube"].modifiers["Fine"].show_render = scene.frame_current < 6

    bpy.app.handlers.frame_change_pre.append(switch)


@pytest.mark.parametrize("change", [keyed, driven, scripted])
def test_a_modifier_that_renders_lose_later(change: Any) -> None:
    change(subdivided())
    try:
        (found,) = told()
    finally:
        bpy.app.handlers.frame_change_pre[:] = []
    assert (found.severity, found.where, found.value) == ("warning", "object 'Cube'", "Fine is off in renders")
    assert found.frame == 6.0 and apart(found) > 0.1


def test_levels_that_renders_raise_later_and_the_largest_distance() -> None:
    cube = subdivided(levels=2, rendered=2)
    cube.modifiers["Fine"].use_limit_surface = False
    build.keys(cube, 'modifiers["Fine"].render_levels', [1, 4, 6, 8], [2, 1, 0, 2], "CONSTANT")
    (found,) = told()
    assert found.frame == 4.0 and "at frame 6" in found.what and found.value == "Fine: 2, in renders 0"
    assert apart(found) > 0.3  # a corner goes from half the diagonal, 0.87, far inwards


def test_simplify_that_is_keyed() -> None:
    subdivided(levels=3, rendered=3)
    scene = bpy.context.scene
    scene.render.use_simplify, scene.render.simplify_subdivision_render = True, 6
    build.keys(scene, "render.simplify_subdivision", [1, 6], [6, 0], "CONSTANT")
    (found,) = told()
    assert found.frame == 6.0 and found.value == "Fine: 0, in renders 3" and apart(found) > 0.3


@pytest.mark.parametrize("change", ["keyed", "scripted"])
def test_what_renders_hide_later(change: str) -> None:
    cube = build.cube()
    if change == "keyed":
        build.keys(cube, "hide_render", [1, 6], [0, 1], "CONSTANT")
    else:

        def hide(scene: Any, _depsgraph: Any = None) -> None:
            bpy.data.objects["Cube"].hide_render = scene.frame_current >= 6

        bpy.app.handlers.frame_change_pre.append(hide)
    try:
        (found,) = told()
    finally:
        bpy.app.handlers.frame_change_pre[:] = []
    assert (found.severity, found.where, found.frame) == ("info", "object 'Cube'", 6.0)


def test_what_both_hide_at_the_same_frames_is_no_difference() -> None:
    build.cube("Other", location=(9.0, 0.0, 0.0))
    cube = build.cube()
    for path in ("hide_render", "hide_viewport"):
        build.keys(cube, path, [1, 4, 8], [1, 0, 1], "CONSTANT")
    assert not told()


def test_settings_that_both_change_alike_are_no_difference(measured: list[Any]) -> None:
    cube = subdivided()
    for path in ("show_render", "show_viewport"):
        build.keys(cube, f'modifiers["Fine"].{path}', [1, 6], [1, 0], "CONSTANT")
    assert not told() and not measured


def lifted(frames: Any, strengths: Any) -> Any:
    """Return a cube that a modifier lifts in the viewport only, by keyed strengths."""
    cube = build.cube()
    lift = cube.modifiers.new("Lift", "DISPLACE")
    lift.direction, lift.mid_level, lift.show_render = "Z", 0.0, False
    build.keys(cube, 'modifiers["Lift"].strength', frames, strengths)
    return cube


def test_a_surface_that_differs_from_a_later_frame_on() -> None:
    lifted([4, 12], [0.0, 0.5])
    (found,) = told()
    assert found.value == "Lift is off in renders" and 4.0 < found.frame < 8.0
    assert apart(found) == pytest.approx(0.5, rel=0.01) and "at frame 12" in found.what


def test_a_surface_that_may_differ_between_the_frames_that_are_compared() -> None:
    build.span(1, 81)  # every tenth is compared
    lifted([14, 15, 16], [0.0, 0.5, 0.0])
    (found,) = told()
    assert (found.severity, found.frame) == ("info", None)
    assert "may show another surface" in found.what and "at the 9 frames" in found.what


def test_a_surface_that_is_the_same_at_every_frame_is_not_told() -> None:
    build.span(1, 9)
    lifted([1, 9], [0.0, 0.0])
    assert not told()


def test_a_scale_that_is_keyed_makes_distances_larger(measured: list[Any]) -> None:
    cube = subdivided(0, 1)
    build.keys(cube, "scale", [1, 12], np.ones((2, 3)) * [[1.0], [4.0]])
    (found,) = told()
    first = apart(told_of_still())
    assert apart(found) == pytest.approx(4.0 * first, rel=0.01) and "at frame 12" in found.what


def told_of_still() -> Any:
    bpy.data.objects["Cube"].animation_data_clear()
    bpy.data.objects["Cube"].scale = (1.0, 1.0, 1.0)
    (found,) = told()
    return found


def test_a_still_surface_is_measured_once_and_equal_settings_never(measured: list[Any]) -> None:
    subdivided(0, 1)
    subdivided(1, 1).name = "Equal"
    build.keys(bpy.data.objects["Cube"], "location", [1, 12], [(0, 0, 0), (1, 0, 0)])
    assert len(told()) == 1
    assert measured == [(1.0, "Cube")]


def test_how_often_a_large_surface_is_measured_is_bounded(measured: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    cube = lifted([1, 12], [0.1, 0.5])
    told()
    assert len(measured) == render_differences.FRAMES
    measured.clear()
    monkeypatch.setattr(render_differences, "LARGEST", 2 * len(cube.data.polygons))
    (found,) = told()
    assert [frame for frame, _ in measured] == [1.0, 12.0] and apart(found) == pytest.approx(0.5, rel=0.01)


def test_measuring_changes_nothing_of_what_is_sampled(measured: list[Any]) -> None:
    """Particles, a rigid body and an object that deforms: the same poses and surfaces, to the last bit."""
    emitter = host("Emitter", role="NONE")
    emitter.modifiers.new("Hail", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime = 7, 1, 6, 20
    settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", plain("P", 0.2), 1.0
    settings.instance_object.dermis.role = "TOUCHABLE"
    bpy.ops.rigidbody.world_add()
    falling = build.cube("Falling", location=(5.0, 0.0, 5.0))
    bodies = bpy.data.collections.new("Bodies")
    bpy.context.scene.rigidbody_world.collection = bodies
    bodies.objects.link(falling)
    lift = lifted([1, 12], [0.1, 0.5]).modifiers["Lift"]
    taken = []
    for lift.show_render in (True, False):
        taken.append(build.joined(scene_sweep.sample()))
    assert len(measured) == render_differences.FRAMES
    one, other = taken
    for name in ("frames", "fingers", "bodies"):
        assert np.array_equal(one[name], other[name]), name
    assert np.ptp(one["bodies"][:, :, 2, 3], axis=1).max() > 0.5  # something falls
    for body, meshes in one["surfaces"].items():
        for mine, theirs in zip(meshes, other["surfaces"][body], strict=True):
            assert (mine is ABSENT) == (theirs is ABSENT)
            assert mine is ABSENT or np.array_equal(mine.vertices, theirs.vertices)
