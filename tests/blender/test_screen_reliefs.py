"""Reliefs of touch screens as an artist meets them: holes, steps, frozen meshes, and the mesh felt without a map."""

from __future__ import annotations

import math
import struct
import warnings

import bpy
import numpy as np
import pytest

from blender_addon import baking
from blender_addon._core import DermisError
from blender_addon.sampling import height_maps, scene_sweep
from core.presets import Library
from core.steps import drain
from tests.blender import build
from tests.blender.test_sampling_screens import image

pytestmark = pytest.mark.shared_tests("reliefs are numbers of the engine")

SLOPED = 0.2  # rise of the test plane along x


def bake():
    return drain(baking.bake(bpy.context.scene, Library(None)))


def relief():
    """Return the first screen's heights [its own unit], its unit [m], and its findings by code."""
    tactile = scene_sweep.sample()
    screen = tactile.screens[0]
    list(tactile.chunks)
    return screen.height_map, screen.height_unit, {f.code: f for f in (*screen.findings, *tactile.chunks.findings)}


def stroke(device="electrovibration", z=0.0, **settings):
    """Let a finger slide along +x over the screen in 2 s; return it with its device."""
    build.span(1, 49)
    tip = build.finger()
    build.keys(tip, "location", [1, 49], [(-0.09, 0, z), (0.09, 0, z)])
    use = tip.dermis.finger.devices.add()
    use.preset = device
    for name, value in settings.items():
        setattr(use, name, value)
    return tip, use


def plane(rise=SLOPED):
    """Add a touchable plane through the origin that climbs along x."""
    corners = [(x, y, rise * x) for x, y in ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))]
    made = build.mesh_object("Slope", corners, [(0, 1, 2, 3)])
    made.dermis.role = "TOUCHABLE"
    return made


def volts(friction):
    return 10 ** ((math.log10(friction) + 1.05) / 1.24)


# --- heights


def test_a_height_of_zero_is_flat_and_gives_no_voltage():
    stroke(scale_mode="manual", scale=1000.0)
    screen = build.screen()
    ramp = np.tile((np.arange(64, dtype=np.float32) + 0.5) / 64, (32, 1))
    screen.dermis.screen.image = image("Ramp", ramp)
    screen.dermis.screen.height_mm = 2.0
    (high,) = bake().outputs
    # 2 mm over 0.2 m: friction 1000 * 0.01 all the way
    np.testing.assert_allclose(high.track.values[100:-100, 0], volts(10.0), rtol=1e-4)
    screen.dermis.screen.height_mm = 0.0
    heights, unit, findings = relief()
    assert not heights.any() and unit == 1.0 and findings["no-height"].severity == "warning"
    (flat,) = bake().outputs
    assert flat.signals["contact"].all() and not flat.track.values[:, 0].any()


def test_steps_of_a_float_image_and_of_a_mesh_are_exact_and_those_of_bytes_are_smoothed():
    build.span(1, 3)
    build.finger()
    screen = build.screen()
    tent = np.tile(np.minimum(np.arange(40), 40 - np.arange(40)).astype(np.float32) / 255, (40, 3))
    settings = screen.dermis.screen
    settings.image = image("Float", tent)
    heights, _, findings = relief()
    np.testing.assert_array_equal(heights, tent)
    assert findings == {}
    settings.image = image("Bytes", tent, is_float=False)
    heights, _, findings = relief()
    assert set(findings) == {"staircase-smoothed"} and 0 < np.abs(heights - tent).max() <= 0.5 / 255 * (1 + 1e-4)
    steps = [(x, y, z) for z in (0.001, 0.002) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    steps[4], steps[7] = (0.0, -1, 0.002), (0.0, 1, 0.002)
    settings.source, settings.resolution = "MESH", 20
    settings.mesh_object = build.mesh_object("Steps", steps, [(0, 1, 2, 3), (4, 5, 6, 7)])
    heights, _, findings = relief()
    np.testing.assert_allclose(heights, np.tile(np.repeat([0.001, 0.002], 10), (10, 1)), atol=1e-7)
    assert findings == {}, "two heights of a mesh are meant"


# --- holes


def test_transparent_pixels_are_holes_alike_in_a_file_and_in_a_blender_image(tmp_path):
    build.span(1, 3)
    build.finger()
    values = np.full((16, 32), 200 / 255, np.float32)
    rgba = np.stack([values, values, values, np.ones_like(values)], -1)
    rgba[:, 8:12] = 0.0
    made = bpy.data.images.new("Holes", 32, 16, alpha=True, is_data=True)
    made.pixels.foreach_set(rgba.ravel())
    made.filepath_raw, made.file_format = str(tmp_path / "holes.png"), "PNG"
    made.save()
    settings = build.screen().dermis.screen
    settings.source, settings.filepath = "FILE", str(tmp_path / "holes.png")
    from_file, _, in_file = relief()
    settings.source, settings.image = "IMAGE", bpy.data.images.load(str(tmp_path / "holes.png"))
    from_image, _, in_image = relief()
    for heights, findings in ((from_file, in_file), (from_image, in_image)):
        np.testing.assert_allclose(heights, 200 / 255, rtol=1e-6)
        assert findings["holes-filled"].count == 16 * 4
    settings.image.alpha_mode = "NONE"
    heights, _, findings = relief()
    assert "holes-filled" not in findings and not heights[:, 8:12].any(), "who ignores alpha has no holes"


def test_zero_is_a_hole_where_the_artist_says_so(tmp_path):
    build.span(1, 3)
    build.finger()
    depth = np.full((8, 8), 0.5, np.float32)
    depth[2:4, 2:5] = 0.0
    np.save(tmp_path / "depth_1.npy", depth[::-1])
    settings = build.screen().dermis.screen
    settings.invert, settings.image, settings.filepath = True, image("Depth", depth), str(tmp_path / "depth_1.npy")
    for source in ("IMAGE", "FILE", "SEQUENCE"):
        settings.source, settings.no_data = source, ""
        heights, _, findings = relief()
        np.testing.assert_array_equal(heights, -depth)
        assert "holes-filled" not in findings
        settings.no_data = "0"
        heights, _, findings = relief()
        np.testing.assert_allclose(heights, -0.5, rtol=1e-6)
        assert findings["holes-filled"].count == 6


def camera(tmp_path, kind=np.uint16, zeros=True):
    """Write a depth camera's picture in millimetres, 0.9 to 1.1 m away."""
    x, y = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 30))
    depth = np.rint(900 + 120 * x + 80 * y).astype(kind)
    if zeros:
        depth[5:10, 8:20] = 0
    np.save(tmp_path / "camera.npy", depth[::-1])
    return depth.astype(np.float64)


def test_a_depth_cameras_map_is_opened_with_the_question_what_its_numbers_are(tmp_path):
    build.span(1, 3)
    build.finger()
    obj, depth = build.screen(), camera(tmp_path)
    bpy.context.view_layer.objects.active = obj
    path = str(tmp_path / "camera.npy")
    assert bpy.ops.dermis.open_map(filepath=path, map_unit="mm", invert=True) == {"FINISHED"}
    settings = obj.dermis.screen
    assert (settings.source, settings.filepath, settings.map_unit, settings.invert) == ("FILE", path, "mm", True)
    assert [f.code for f in height_maps.offered(obj)] == ["zeros-like-holes"]
    heights, unit, findings = relief()
    np.testing.assert_allclose(heights * unit, -1e-3 * depth, atol=1e-6)
    assert findings["zeros-like-holes"].count == 60 and "no-unit" not in findings
    settings.no_data = "0"  # what the panel offers
    assert not height_maps.offered(obj)
    heights, unit, findings = relief()
    assert (heights * unit).max() < -0.89 and findings["holes-filled"].count == 60


@pytest.mark.parametrize("kind", [np.int32, np.uint16, np.float32])
def test_a_map_of_measures_asks_for_its_unit(tmp_path, kind):
    build.span(1, 3)
    build.finger()
    build.cube()
    obj, depth = build.screen(), camera(tmp_path, kind, zeros=False)
    settings = obj.dermis.screen
    settings.source, settings.filepath = "FILE", str(tmp_path / "camera.npy")
    if kind is np.int32:  # as brightness there would be nothing left of it
        assert not scene_sweep.sample().screens
    else:
        assert relief()[2]["no-unit"].severity == "warning"
    assert [f.code for f in height_maps.offered(obj)] == ["no-unit"]
    settings.map_unit = "mm"
    assert not height_maps.offered(obj)
    heights, unit, findings = relief()
    np.testing.assert_allclose(heights * unit, 1e-3 * depth, rtol=1e-6)
    assert "no-unit" not in findings


def tiff(path, values, no_data=None):
    """Write a grey TIFF of one strip, of the array's own type, row 0 at the bottom; it may declare a no-data number."""
    rows, columns = values.shape
    size, form = 8 * values.dtype.itemsize, {"u": 1, "i": 2, "f": 3}[values.dtype.kind]
    tags = [(256, columns), (257, rows), (258, size), (259, 1), (262, 1), (273, 8), (277, 1), (278, rows)]
    tags += [(279, values.nbytes), (339, form)]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    if no_data is not None:  # four characters stand in the entry itself
        tags.append((42113, no_data))
        entries += struct.pack("<HHI4s", 42113, 2, 4, no_data)
    pixels = values[::-1].astype(values.dtype.newbyteorder("<")).tobytes()
    head = struct.pack("<2sHI", b"II", 42, 8 + len(pixels))
    path.write_bytes(head + pixels + struct.pack("<H", len(tags)) + entries + bytes(4))
    return str(path)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int16, np.uint32, np.int32, np.float32])
def test_a_tiff_has_the_same_heights_as_an_image_and_as_a_file(tmp_path, kind, packed):
    """Blender makes the largest number of a type 1: heights were 65535 or 2^32 times too low."""
    build.span(1, 3)
    build.finger()
    settings = build.screen().dermis.screen
    ramp = np.add.outer(np.arange(30), np.arange(40))
    values = (ramp if kind is np.uint8 else 1000 + 4 * ramp).astype(kind)
    path = tiff(tmp_path / "map.tif", values)
    settings.map_unit, settings.no_data = "mm", "none"
    settings.source, settings.filepath = "FILE", path
    heights, unit, _ = relief()
    np.testing.assert_allclose(heights * unit, 1e-3 * values, rtol=1e-6, atol=1e-8)
    settings.image = bpy.data.images.load(path)
    settings.image.colorspace_settings.name = "Non-Color"
    if packed:
        settings.image.pack()
        (tmp_path / "map.tif").unlink()
    settings.source = "IMAGE"
    heights, unit, _ = relief()
    np.testing.assert_allclose(heights * unit, 1e-3 * values, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(("kind", "number"), [(np.uint8, 7), (np.uint16, 999), (np.int16, -99), (np.float32, -99)])
def test_what_a_tiff_declares_to_be_no_data_is_a_hole_of_the_image_too(tmp_path, kind, number, packed):
    """Blender keeps no tags: cliffs were felt where the file has no heights, and are filled from around."""
    build.span(1, 3)
    build.finger()
    settings = build.screen().dermis.screen
    values = (100 + np.add.outer(np.arange(30), np.arange(40))).astype(kind)
    values[10:14, 20:25] = number
    path = tiff(tmp_path / "map.tif", values, str(number).encode().ljust(4, b"\0"))
    settings.map_unit = "mm"
    settings.source, settings.filepath = "FILE", path
    heights, unit, told = relief()
    assert 1e-3 * 99 < heights.min() * unit and heights.max() * unit < 1e-3 * 200 and "holes-filled" in told
    settings.image = bpy.data.images.load(path)
    settings.image.colorspace_settings.name = "Non-Color"
    if packed:
        settings.image.pack()
        (tmp_path / "map.tif").unlink()
    settings.source = "IMAGE"
    same, same_unit, told = relief()
    np.testing.assert_allclose(same * same_unit, heights * unit, rtol=1e-5)
    assert "holes-filled" in told and "no-data-unknown" not in told


def test_a_tiff_that_is_not_there_or_another_by_now_does_not_say_where_it_has_no_data(tmp_path):
    build.span(1, 3)
    build.finger()
    settings = build.screen().dermis.screen
    values = (100 + np.add.outer(np.arange(30), np.arange(40))).astype(np.float32)
    path = tiff(tmp_path / "map.tif", values, b"-99\0")
    settings.image, settings.source, settings.map_unit = bpy.data.images.load(path), "IMAGE", "white"
    settings.image.colorspace_settings.name = "Non-Color"
    assert "no-data-unknown" not in relief()[2]
    for other in (values.T, values + 1.0, None):
        if other is None:
            (tmp_path / "map.tif").unlink()
        else:
            tiff(tmp_path / "map.tif", np.ascontiguousarray(other), b"-99\0")
        told = relief()[2]["no-data-unknown"]
        assert told.severity == "warning" and settings.image.name in told.where and "file" in told.remedy
    settings.no_data = "none"
    assert "no-data-unknown" not in relief()[2], "the artist has said it"


def test_of_several_tiles_the_first_is_felt_and_that_is_said(tmp_path):
    build.span(1, 3)
    build.finger()
    settings = build.screen().dermis.screen
    values = (10 + np.add.outer(np.arange(30), np.arange(40))).astype(np.uint8)
    tiff(tmp_path / "map.1001.tif", values)
    tiles = bpy.data.images.load(str(tmp_path / "map.1001.tif"))
    tiles.source, tiles.filepath = "TILED", str(tmp_path / "map.<UDIM>.tif")
    settings.image, settings.source, settings.map_unit = tiles, "IMAGE", "mm"
    heights, unit, told = relief()
    assert heights.min() * unit == pytest.approx(0.01) and "no-data-unknown" not in told
    assert "udim-first-tile" not in told, "there is one"
    tiff(tmp_path / "map.1002.tif", 80 + values)
    tiles.tiles.new(1002)
    tiles.reload()
    told = relief()[2]
    assert told["udim-first-tile"].value == "tile 1001 of 1001, 1002" and "no-data-unknown" not in told


def test_an_image_whose_numbers_are_scaled_by_nobody_knows_what_is_to_be_a_file(tmp_path):
    build.span(1, 3)
    build.finger()
    build.cube()
    settings = build.screen().dermis.screen
    path = tiff(tmp_path / "map.tif", np.arange(1200, dtype=np.uint16).reshape(30, 40))
    settings.image = bpy.data.images.load(path)
    settings.image.colorspace_settings.name = "Non-Color"
    settings.map_unit = "mm"
    assert relief()[1] == 1e-3 * 65535
    (tmp_path / "map.tif").unlink()  # the pixels are still in Blender
    tactile = scene_sweep.sample()
    (told,) = [f for f in tactile.findings if "scales the numbers" in str(f)]
    assert not tactile.screens and told.remedy.startswith("Choose it as a file")
    settings.map_unit = "white"  # brightness is right as it is
    heights, _, _ = relief()
    assert heights.max() == pytest.approx(1199 / 65535)


def test_an_image_of_lengths_needs_no_height():
    build.span(1, 3)
    build.finger()
    settings = build.screen().dermis.screen
    ramp = np.tile(np.linspace(0, 0.003, 16, dtype=np.float32), (8, 1))
    settings.image = image("Lengths", ramp)
    assert relief()[2]["no-unit"].value == "0 to 0.003"
    settings.map_unit, settings.height_mm = "m", 0.0
    heights, unit, findings = relief()
    np.testing.assert_allclose(heights * unit, ramp, rtol=1e-6)
    assert not {"no-unit", "no-height"} & set(findings)


def test_a_sequence_begins_at_the_chosen_file_and_tells_of_gaps_and_of_its_end(tmp_path):
    stroke(profile="height")
    for k in (1, 2, 3, 4, 6, 7):
        ramp = np.tile(np.linspace(0, 1, 8, dtype=np.float32) * k, (4, 1))
        np.save(tmp_path / f"map_{k:03}.npy", ramp)
    settings = build.screen().dermis.screen
    settings.source, settings.filepath = "SEQUENCE", str(tmp_path / "map_003.npy")
    heights, _, findings = relief()
    np.testing.assert_array_equal(heights[:, 0, -1], [3.0, 4.0])
    assert findings["sequence-gap"].value == "map_004.npy, then map_006.npy" and findings["sequence-gap"].count == 2
    codes = {f.code: f for f in bake().all_findings}
    # Two maps, frames 1 and 2; the second lasts to 2.5 of 49 frames.
    assert codes["sequence-short"].frame == pytest.approx(2.5, abs=24 / 1000) and "sequence-gap" in codes


# --- meshes


def test_a_mesh_that_changes_under_a_still_relief_is_reported():
    def codes():
        return set(relief()[2])

    scene = build.span(1, 49)
    build.finger()
    screen, cube = build.screen(), build.cube("Relief", 0.05)
    cube.dermis.role = "NONE"
    settings = screen.dermis.screen
    settings.source, settings.mesh_object, settings.resolution = "MESH", cube, 32
    still, _, findings = relief()
    assert "relief-frozen" not in findings
    assert still[8, 16] == pytest.approx(0.025) and still[0, 0] == 0.0
    # It moves only late in the range.
    build.keys(cube, "location", [1, 40, 49], [(0, 0, 0), (0, 0, 0), (0.1, 0, 0)])
    heights, _, findings = relief()
    np.testing.assert_array_equal(heights, still)
    assert findings["relief-frozen"].severity == "info" and "Relief to Mesh" in findings["relief-frozen"].remedy
    assert 40 < findings["relief-frozen"].frame < 40.1
    # It comes and goes between two of the few frames that were once looked at.
    build.keys(cube, "location", [1, 8, 9, 10], [(0, 0, 0), (0, 0, 0), (0.1, 0, 0), (0, 0, 0)])
    assert 8 < relief()[2]["relief-frozen"].frame < 8.2
    assert scene.frame_current == 1
    # A mesh that rides on its screen does not change there.
    cube.animation_data_clear()
    cube.parent = screen
    build.keys(screen, "location", [1, 49], [(0, 0, 0), (0.3, 0.1, 0)])
    assert "relief-frozen" not in codes()
    # It deforms.
    cube.shape_key_add(name="Basis")
    grown = cube.shape_key_add(name="Grown")
    for point in grown.data:
        point.co *= 2
    build.keys(cube.data.shape_keys, 'key_blocks["Grown"].value', [1, 49], [0.0, 1.0])
    assert "relief-frozen" in codes()
    # A device that feels the mesh itself feels it move.
    use = bpy.data.objects["Finger"].dermis.finger.devices.add()
    use.preset, use.relief = "electrovibration", "mesh"
    assert "relief-frozen" not in codes()


@pytest.mark.parametrize("scale", [(1, 1, 0), (0, 1, 1)])
def test_a_screen_scaled_to_nothing_is_refused_in_words(scale):
    build.span(1, 3)
    build.finger()
    build.cube("Other", 0.1, (1, 1, 1))
    screen, cube = build.screen(), build.cube("Relief", 0.05)
    settings = screen.dermis.screen
    settings.source, settings.mesh_object, screen.scale = "MESH", cube, scale
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tactile = scene_sweep.sample()
    assert tactile.screens == ()
    (finding,) = [f for f in tactile.findings if f.code == "screen-unusable"]
    assert "scale is zero" in finding.what and finding.where == "screen 'Screen'"


@pytest.mark.parametrize("formula", ["slope", "printed"])
def test_the_mesh_itself_is_felt_on_a_plane(formula):
    plane()
    tip, use = stroke(relief="mesh", relief_formula=formula, scale_mode="manual", scale=100.0, downhill="absolute")
    build.keys(tip, "location", [1, 49], [(-0.09, 0, -0.09 * SLOPED), (0.09, 0, 0.09 * SLOPED)])
    screen = build.screen()
    screen.dermis.screen.touch_distance_mm = 50.0
    baked = bake()
    (output,) = baked.outputs
    # n = (-s, 0, 1) / sqrt(1 + s^2); v = +x
    exact = 100.0 * (SLOPED if formula == "slope" else SLOPED / math.sqrt(1 + SLOPED**2))
    felt = output.signals["contact"] > 0
    assert felt[5:].all()
    np.testing.assert_allclose(output.signals["friction"][5:], exact, rtol=1e-5)
    np.testing.assert_allclose(output.track.values[5:, 0], volts(exact), rtol=1e-5)
    # Uphill eq. 5 resists; the printed form has the other sign.
    use.downhill = "rectify"
    (output,) = bake().outputs
    np.testing.assert_allclose(output.signals["friction"][5:], exact if formula == "slope" else 0.0, rtol=1e-5)
    assert {f.code for f in baked.all_findings} >= {"no-map"}, "a screen needs no map to be felt as a mesh"
    assert [f for f in baked.all_findings if f.severity == "error"] == []


def test_the_mesh_itself_is_felt_on_a_sphere_that_moves():
    radius, amount = 0.1, 0.05
    bpy.ops.mesh.primitive_uv_sphere_add(segments=256, ring_count=128, radius=radius, rotation=(math.pi / 2, 0, 0))
    ball = bpy.context.object
    ball.dermis.role = "TOUCHABLE"
    ball.location = (0, 0, -radius)
    # The finger rests and the ball runs along below it: [S4]'s direction is the finger's on the screen, which rides on
    # the ball, so the finger slides over it along -x.
    build.span(1, 49)
    screen = build.screen("Screen", 0.4, 0.4)
    screen.parent = ball
    screen.matrix_parent_inverse = ball.matrix_world.inverted()
    screen.dermis.screen.touch_distance_mm = 50.0
    build.keys(ball, "location", [1, 49], [(-amount, 0, -radius), (amount, 0, -radius)])
    tip = build.finger("Finger")
    times = np.linspace(0, 1, 49)
    off = amount - 2 * amount * times  # of the finger from the ball's middle
    build.keys(tip, "location", list(range(1, 50)), [(0, 0, math.sqrt(radius**2 - x**2) - radius) for x in off])
    use = tip.dermis.finger.devices.add()
    use.preset, use.relief, use.scale_mode, use.scale, use.downhill = (
        "electrovibration",
        "mesh",
        "manual",
        100.0,
        "absolute",
    )
    (output,) = bake().outputs
    x = amount - 2 * amount * output.track.times / output.track.times[-1]
    exact = 100.0 * np.abs(x) / np.sqrt(radius**2 - x**2)
    moved = (output.signals["contact"] > 0) & (np.arange(len(x)) > 5)
    assert moved.sum() > 0.98 * len(x)
    # Facets of 1.4 degrees with smooth normals
    assert np.abs(output.signals["friction"] - exact)[moved].max() < 0.2


# --- time


@pytest.mark.parametrize("rate", [240, 7])
def test_a_screens_track_lasts_as_long_as_a_tactors(rate):
    tip, _ = stroke(device="haptip")
    tip.dermis.finger.devices.add().preset = "electrovibration"
    build.cube("Cube", 0.05)
    screen = build.screen()
    screen.dermis.screen.image = image("Ramp", np.tile(np.arange(16, dtype=np.float32) / 15, (8, 1)))
    scene = build.span(1, 31, 30, 1.001)
    scene.dermis.sample_rate = rate
    tactor, voltage = bake().outputs
    assert (tactor.device, voltage.device) == ("haptip", "electrovibration")
    np.testing.assert_array_equal(voltage.track.times, np.arange(1002) / 1000)  # 30 frames of 1001/30000 s
    np.testing.assert_array_equal(voltage.track.times, tactor.track.times)


def elevations(tmp_path, number):
    """Write a map of heights in whole millimetres, with a patch of one number where nothing was measured."""
    x, y = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 30))
    heights = np.rint(200 + 120 * x + 80 * y).astype(np.int16)
    heights[5:10, 8:20] = number
    np.save(tmp_path / "heights.npy", heights[::-1])
    return str(tmp_path / "heights.npy")


@pytest.mark.parametrize("number", [-9999, -32768, 32767])
def test_no_data_of_a_height_map_is_asked_about(tmp_path, number):
    """They became cliffs of many metres without a word."""
    build.span(1, 3)
    build.finger()
    obj = build.screen()
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.dermis.open_map(filepath=elevations(tmp_path, number), map_unit="mm") == {"FINISHED"}
    (asked,) = height_maps.offered(obj)
    assert (asked.code, asked.value, asked.count) == ("no-data-likely", str(number), 60)
    with bpy.context.temp_override(object=obj):  # the panel's buttons
        bpy.ops.wm.context_set_string(data_path="object.dermis.screen.no_data", value=asked.value)
    assert obj.dermis.screen.no_data == str(number) and not height_maps.offered(obj)
    heights, unit, findings = relief()
    assert 0.19 < (heights * unit).min() and (heights * unit).max() < 0.41 and findings["holes-filled"].count == 60
    holes = np.load(tmp_path / "heights.npy")[::-1] == number
    np.testing.assert_array_equal(scene_sweep.sample().screens[0].holes, holes)
    obj.scale.x = -1.0  # the map is turned over, and its holes with it
    np.testing.assert_array_equal(scene_sweep.sample().screens[0].holes, holes[:, ::-1])
    obj.scale.x = 1.0
    obj.dermis.screen.no_data = "none"
    heights, unit, findings = relief()
    assert "no-data-likely" not in findings and np.isclose(heights * unit, number * 1e-3).sum() == 60
    obj.dermis.screen.no_data = "-9999 mm"
    with pytest.raises(DermisError, match="No Data: .*not a number that can mean 'no data'"):
        scene_sweep.sample()


def test_a_second_number_is_asked_about_after_the_first(tmp_path):
    """One answer was taken as the answer to all, and the second number was felt as a cliff."""
    build.span(1, 3)
    build.finger()
    obj = build.screen()
    bpy.context.view_layer.objects.active = obj
    path = elevations(tmp_path, -9999)
    heights = np.load(path)
    heights[2:4, 3:9] = -32768
    np.save(path, heights)
    for said, asked in (("", "-32768"), ("-32768", "-9999"), ("-32768; -9999", None), ("-32768; none", None)):
        assert bpy.ops.dermis.open_map(filepath=path, map_unit="mm", no_data=said) == {"FINISHED"}
        offered = height_maps.offered(obj)
        assert [f.value for f in offered] == ([asked] if asked else [])
        if asked:  # the panel's button
            obj.dermis.screen.no_data = height_maps.words_on_no_data(obj, asked)
            assert not height_maps.offered(obj)
            assert obj.dermis.screen.no_data == (f"{said}; {asked}" if said else asked)
    obj.dermis.screen.no_data = "-32768; -9999"
    assert relief()[2]["holes-filled"].count == 72


def test_files_of_earlier_versions_keep_their_zeros_as_holes(tmp_path):
    build.span(1, 3)
    build.finger()
    depth = np.full((8, 8), 0.5, np.float32)
    depth[2:4, 2:5] = 0.0
    settings = build.screen().dermis.screen
    settings.source, settings.image, settings.zero_is_hole = "IMAGE", image("Depth", depth), True
    assert relief()[2]["holes-filled"].count == 6
    settings.no_data = "none"
    assert "holes-filled" not in relief()[2]
