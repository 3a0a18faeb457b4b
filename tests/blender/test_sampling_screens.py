"""Touch screens: reliefs from images, files, sequences and meshes, against functions that can be written down."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon.sampling import scene_sweep
from tests.blender import build

N = 257  # odd, so that one ray goes through the middle


def image(name: str, values: np.ndarray, *, is_float: bool = True) -> bpy.types.Image:
    """Make an image of grey values, row 0 at the bottom."""
    rows, columns = values.shape
    made = bpy.data.images.new(name, columns, rows, float_buffer=is_float, is_data=True)
    rgba = np.ones((rows, columns, 4), np.float32)
    rgba[:, :, :3] = values[:, :, None]
    made.pixels.foreach_set(rgba.ravel())
    return made


def sampled_screen(scene: bpy.types.Scene):
    tactile = scene_sweep.sample(scene)
    return tactile.screens[0], tactile


def test_an_image_comes_raw_with_row_0_at_the_bottom():
    scene = build.span(1, 3)
    obj = build.screen("Screen", 0.2, 0.1)
    values = np.random.default_rng(1).random((20, 30)).astype(np.float32)
    obj.dermis.screen.image = image("Relief", values)
    obj.dermis.screen.height_mm = 3.0
    build.finger()
    screen, tactile = sampled_screen(scene)
    np.testing.assert_array_equal(screen.height_map, values)
    assert screen.size == pytest.approx((0.2, 0.1)) and screen.height_unit == pytest.approx(0.003)
    assert "height" not in screen.parameters and screen.parameters["touch_distance"] == pytest.approx(0.001)
    obj.dermis.screen.invert = True
    np.testing.assert_array_equal(sampled_screen(scene)[0].height_map, -values)


def test_a_byte_image_is_not_bent_by_its_colour_space():
    scene = build.span(1, 3)
    obj = build.screen()
    levels = np.tile(np.arange(0, 250, 50, dtype=np.float32) / 255, (5, 1))  # few levels are kept as they are
    made = bpy.data.images.new("Bytes", 5, 5)
    assert made.colorspace_settings.name == "sRGB"
    rgba = np.ones((5, 5, 4), np.float32)
    rgba[:, :, :3] = levels[:, :, None]
    made.pixels.foreach_set(rgba.ravel())
    obj.dermis.screen.image = made
    build.finger()
    np.testing.assert_allclose(sampled_screen(scene)[0].height_map, levels, atol=1e-7)


def test_a_sphere_cast_onto_a_turned_screen_has_its_exact_heights():
    scene = build.span(1, 3)
    scene.unit_settings.scale_length = 0.001  # millimetres
    obj = build.screen("Screen", 40.0, 20.0)
    obj.rotation_euler, obj.location, obj.scale = (0.7, -0.4, 1.1), (100, 50, 20), (1, 2, 1)  # 40 x 40 mm
    bpy.context.view_layer.update()
    bpy.ops.mesh.primitive_uv_sphere_add(segments=256, ring_count=128, radius=60)
    ball = bpy.context.object
    ball.location = obj.matrix_world @ type(obj.location)((4, -2, 10))  # on the screen 4 mm right, 2 * 2 mm down
    obj.dermis.screen.source, obj.dermis.screen.mesh_object, obj.dermis.screen.resolution = "MESH", ball, N
    build.finger()
    screen, tactile = sampled_screen(scene)
    assert screen.height_map.shape == (N, N) and screen.height_unit == 1.0
    assert screen.size == pytest.approx((0.04, 0.02))  # before the object's matrix
    x, y = np.meshgrid(*[((np.arange(N) + 0.5) / N - 0.5) * 0.04] * 2)
    exact = 0.010 + np.sqrt(0.060**2 - (x - 0.004) ** 2 - (y + 0.004) ** 2)
    # The sphere's facets lie inside it by R (1 - cos(pi / 256)), a little more towards the rim.
    np.testing.assert_allclose(screen.height_map, exact, atol=2e-5)


def test_beside_a_cast_mesh_lies_the_screen_itself_and_is_counted():
    scene = build.span(1, 3)
    obj = build.screen("Screen", 0.2, 0.1)
    plate = build.mesh_object(
        "Plate", [(-1, -1, 0.01), (0.05, -1, 0.01), (0.05, 1, 0.01), (-1, 1, 0.01)], [(0, 1, 2, 3)]
    )
    obj.dermis.screen.source, obj.dermis.screen.mesh_object, obj.dermis.screen.resolution = "MESH", plate, 100
    build.finger()
    screen, _ = sampled_screen(scene)
    assert screen.height_map.shape == (50, 100)
    np.testing.assert_allclose(screen.height_map[:, :75], 0.01, atol=1e-7)
    assert (screen.height_map[:, 75:] == 0.0).all()
    assert [(f.code, f.severity, f.count, f.value) for f in screen.findings] == [
        ("bare-screen", "info", 50 * 25, "25 % of it")
    ]


def test_of_two_layers_the_one_nearer_the_viewer_is_felt():
    scene = build.span(1, 3)
    obj = build.screen("Screen", 0.2, 0.2)
    square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    vertices = [(x, y, z) for z in (-0.02, 0.005) for x, y in square]
    stack = build.mesh_object("Stack", vertices, [(0, 1, 2, 3), (4, 5, 6, 7)])
    obj.dermis.screen.source, obj.dermis.screen.mesh_object, obj.dermis.screen.resolution = "MESH", stack, 8
    build.finger()
    np.testing.assert_allclose(sampled_screen(scene)[0].height_map, 0.005, atol=1e-7)


def test_files_and_sequences(tmp_path):
    scene = build.span(1, 3)
    obj = build.screen()
    ramps = [np.tile(np.linspace(0, 1, 8, dtype=np.float32) * k, (4, 1)) for k in (1, 2, 3)]
    for k, ramp in enumerate(ramps):
        np.save(tmp_path / f"relief_{k + 1:04}.npy", ramp)
    settings = obj.dermis.screen
    settings.filepath, settings.source, settings.height_mm = str(tmp_path / "relief_0001.npy"), "FILE", 2.0
    build.finger()
    screen, _ = sampled_screen(scene)
    np.testing.assert_allclose(screen.height_map, ramps[0], atol=1e-7)
    settings.source, settings.sequence_start = "SEQUENCE", 5
    screen, _ = sampled_screen(scene)
    np.testing.assert_allclose(screen.height_map, np.stack(ramps), atol=1e-7)
    assert screen.parameters["sequence_start"] == 5


@pytest.mark.parametrize(
    "case", ["no image", "no pixels", "no file name", "no such file", "no mesh", "beside", "no area"]
)
def test_a_screen_without_a_relief_is_left_out_with_the_reason(case, tmp_path):
    scene = build.span(1, 3)
    build.cube()
    tip = build.finger()
    obj = build.screen()
    settings = obj.dermis.screen
    expected = {
        "no image": "the image is missing",
        "no pixels": "the image has no pixels",
        "no file name": "no image file",
        "no such file": "gone.png",
        "no mesh": "no mesh was chosen",
        "beside": "no part of the mesh",
        "no area": "the touch screen has no area",
    }[case]
    if case == "no pixels":
        settings.image = bpy.data.images.new("Gone", 4, 4)
        settings.image.source, settings.image.filepath = "FILE", str(tmp_path / "gone.png")
    elif case in ("no file name", "no such file"):
        settings.source = "FILE"
        settings.filepath = "" if case == "no file name" else str(tmp_path / "gone.png")
    elif case in ("no mesh", "beside"):
        settings.source = "MESH"
        settings.mesh_object = None if case == "no mesh" else bpy.data.objects["Cube"]
        bpy.data.objects["Cube"].location = (9, 9, 9)
    elif case == "no area":
        settings.image = image("Relief", np.ones((2, 2), np.float32))
        obj.data.clear_geometry()
    device = tip.dermis.finger.devices.add()
    device.preset, device.screen = "electrovibration", obj
    tactile = scene_sweep.sample(scene)
    assert tactile.screens == ()
    (finding,) = [f for f in tactile.findings if f.code == "screen-unusable"]
    assert (
        finding.severity == "error"
        and expected in str(finding)
        and "Screen" in str(finding)
        or "gone.png" in str(finding)
    )
    assert [f.value for f in tactile.findings if f.code == "screen-missing"] == ["Screen"]


def test_the_pose_of_a_screen_sits_in_its_middle():
    scene = build.span(1, 3)
    obj = build.mesh_object("Corner", [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0)], [(0, 1, 2, 3)], (10, 0, 0))
    obj.dermis.role = "SCREEN"
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    obj.dermis.screen.image = image("Relief", values)
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert tactile.screens[0].size == (4.0, 2.0)
    np.testing.assert_allclose(build.joined(tactile)["screens"][0, 0, :3, 3], (12, 1, 0), atol=1e-6)
    # Mirrored, what lay at the origin's side still does: the map is turned over instead of the matrix.
    obj.scale = (-1, 1, 1)
    tactile = scene_sweep.sample(scene)
    pose = build.joined(tactile)["screens"][0, 0]
    np.testing.assert_allclose(pose[:3, 3], (8, 1, 0), atol=1e-6)
    np.testing.assert_allclose(pose[:3, :3], np.eye(3), atol=1e-6)
    np.testing.assert_array_equal(tactile.screens[0].height_map, values[:, ::-1])


def test_the_live_preview_keeps_a_relief_until_told():
    scene = build.span(1, 3)
    obj = build.screen()
    picture = image("Relief", np.linspace(0, 1, 20, dtype=np.float32).reshape(4, 5))
    obj.dermis.screen.image = picture
    build.finger()

    def now():
        return scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).screens[0].height_map

    first = now()
    assert now() is first
    picture.pixels.foreach_set(np.tile(np.array([0, 0, 0, 1], np.float32), 20))
    scene_sweep.forget()
    assert now().max() == 0.0


@pytest.mark.parametrize("role", ["screen", "finger"])
def test_a_screen_or_a_finger_whose_visibility_is_keyed_is_said_to_be_felt_throughout(role: str) -> None:
    scene = build.span(1, 7)
    obj, tip, _ = build.screen(), build.finger(), build.cube()
    obj.dermis.screen.image = image("Relief", np.ones((4, 4), np.float32))
    hidden = obj if role == "screen" else tip
    build.keys(hidden, "hide_viewport", [1, 4], [0, 1], "CONSTANT")
    tactile = scene_sweep.sample(scene)
    frames = build.joined(tactile)["frames"]
    (finding,) = [f for f in tactile.chunks.findings if f.code in ("absent", "felt-throughout")]
    assert (finding.severity, finding.code) == ("warning", "felt-throughout")
    assert (
        finding.where == f"{role} '{hidden.name}'"
        and {"screen": "stays touchable", "finger": "keeps touching"}[role] in finding.what
    )
    assert (finding.frame, finding.count) == (4.0, int((frames >= 4).sum()))


@pytest.mark.parametrize("linked", [False, True])
def test_a_screen_that_instances_show_is_told(linked: bool) -> None:
    """Whether the scene has the screen itself as well or not."""
    scene = build.span(1, 3)
    pane = build.screen()
    pane.dermis.screen.image = image("Relief", np.ones((4, 4), np.float32))
    tablet = bpy.data.collections.new("Tablet")
    tablet.objects.link(pane)
    if not linked:
        scene.collection.objects.unlink(pane)
    shower = build.empty("Shower", (0.5, 0, 0))
    shower.instance_type, shower.instance_collection = "COLLECTION", tablet
    build.finger(), build.cube()
    tactile = scene_sweep.sample(scene)
    found = [(f.severity, f.where) for f in tactile.findings if f.code == "screen-instance"]
    assert found == [("warning", "screen 'Screen'")]
    assert [s.name for s in tactile.screens] == (["Screen"] if linked else [])


@pytest.mark.parametrize("how", ["shape key", "script", "still"])
def test_a_screen_whose_mesh_grows_is_said_to_keep_its_first_size(how: str) -> None:
    scene = build.span(1, 7)
    scene.unit_settings.scale_length = 0.001
    pane = build.screen("Pane", 200, 100)  # millimetres
    pane.scale = (0.5, 1, 1)
    pane.dermis.screen.image = image("Relief", np.ones((4, 4), np.float32))
    build.finger()
    pane.shape_key_add(name="Basis")
    key = pane.shape_key_add(name="Wide")
    for point in key.data:
        point.co.x *= 2
        point.co.z += 5  # out of the plane: no matter of size
    if how == "still":
        for point in key.data:
            point.co.x /= 2

    def widen(shown: bpy.types.Scene, _depsgraph: object = None) -> None:
        key.value = max(0.0, (shown.frame_current_final - 1) / 6)

    if how == "script":
        bpy.app.handlers.frame_change_post.append(widen)
    else:
        build.keys(pane.data.shape_keys, 'key_blocks["Wide"].value', [1, 7], [0, 1])
    try:
        tactile = scene_sweep.sample(scene)
        list(tactile.chunks)
    finally:
        if how == "script":
            bpy.app.handlers.frame_change_post.remove(widen)
    found = [f for f in tactile.chunks.findings if f.code == "screen-size-changes"]
    assert len(found) == (how != "still")
    for finding in found:
        assert (finding.severity, finding.where) == ("warning", "screen 'Pane'")
        assert 1 < finding.frame < 1.5
        assert finding.value == "an edge moves by 50 mm, at frame 7"  # 100 mm in its own X, at half the scale
