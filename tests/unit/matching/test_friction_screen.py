"""[S4] from an animated finger to volts: every figure from the closed form of the surface it slides over."""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction

import numpy as np
import pytest

from core.contact.pad_sampler import PadSampler
from core.errors import DermisError
from core.matching.friction_screen import render, screen_maps
from core.matching.screen_map import ScreenMap
from core.parameters.device import DEVICE
from core.pipeline.render import run
from core.presets import Library
from core.scene.tactile_scene import Chunk, DeviceUse, Finger, Screen, TactileScene, device_times

RATE = 240.0
SIZE = (0.2, 0.1)
SPEC = Library().device("electrovibration")


def volts(friction):
    """Eq. 1 solved for the voltage, base 10; nothing for friction of zero or less."""
    friction = np.asarray(friction, float)
    return np.where(friction > 0, 10 ** ((np.log10(np.maximum(friction, 1e-300)) + 1.05) / 1.24), 0.0)


def centres(rows, columns, size=SIZE):
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * size[0]
    y = ((np.arange(rows) + 0.5) / rows - 0.5) * size[1]
    return np.meshgrid(x, y)


SIGMA, TOP = 0.015, 0.003  # a bump in the middle of the screen


def bump(rows=400, columns=800):
    x, y = centres(rows, columns)
    return (TOP * np.exp(-(x**2 + y**2) / (2 * SIGMA**2))).astype(np.float32)


BUMP = bump()
STEEPEST = TOP / (SIGMA * math.sqrt(math.e))


def scene_of(
    path,
    *,
    heights=BUMP,
    unit=1.0,
    parameters=None,
    device=None,
    screen_at=None,
    size=SIZE,
    finger_world=None,
    screens=1,
    use_screen="Pad",
    animated=None,
):
    """A finger whose pad follows `path` (n, 3) in the screen's own frame, sampled at 240 Hz."""
    path = np.asarray(path, float)
    n = len(path)
    matrices = np.tile(np.eye(4), (n, 1, 1)) if screen_at is None else np.asarray(screen_at, float)
    fingers = np.tile(np.eye(4), (n, 1, 1))
    fingers[:, :3, 3] = (
        np.einsum("nij,nj->ni", matrices[:, :3, :3], path) + matrices[:, :3, 3]
        if finger_world is None
        else finger_world
    )
    use = DeviceUse("electrovibration", device or {}, use_screen)
    screen = Screen("Pad", size, heights, unit, parameters or {})
    all_screens = (screen,) + tuple(dataclasses.replace(screen, name=f"Pad {i + 2}") for i in range(screens - 1))
    poses = np.stack([matrices] + [offset(matrices, 0.5 * (i + 1)) for i in range(screens - 1)])
    chunk = Chunk(
        frames=1 + np.arange(n) * 24 / RATE,
        times=np.arange(n) / RATE,
        fingers=fingers[None],
        bodies=np.zeros((0, n, 4, 4)),
        screens=poses,
        animated=animated or {},
    )
    last = 1 + max(1, math.ceil((n - 1) * 24 / RATE))
    return TactileScene("test", Fraction(24), (1, last), RATE, (Finger("Index", (use,)),), (), all_screens, [chunk])


def offset(matrices, along_x):
    moved = matrices.copy()
    moved[:, 0, 3] += along_x
    return moved


def sampled(scene):
    sampler = PadSampler(scene)
    for chunk in scene.chunks:
        sampler.add(chunk)
    return sampler.finish()


def rendered(scene, spec=SPEC):
    return render(sampled(scene), scene, 0, scene.fingers[0].devices[0], spec)


def stroke(start, end, seconds=1.0, z=0.0):
    t = np.linspace(0, 1, round(seconds * RATE) + 1)[:, None]
    line = np.asarray(start) + t * (np.asarray(end) - np.asarray(start))
    return np.column_stack([line, np.full(len(line), z)])


ACROSS = stroke((-0.08, 0.0), (0.08, 0.0))


def exact_slope(x, y=0.0):
    """dF/dx of the bump, in parts of the steepest: +-1 at -+sigma."""
    return -x / SIGMA * np.exp(0.5 - (x**2 + y**2) / (2 * SIGMA**2))


def codes(result):
    return {f.code: f for f in result.findings}


@pytest.mark.parametrize(
    ("downhill", "expected"),
    [
        ("rectify", lambda g: 100 * np.maximum(g, 0)),
        ("offset", lambda g: 50 + 50 * g),
        ("absolute", lambda g: 100 * np.abs(g)),
    ],
)
def test_slope_profile_over_a_bump(downhill, expected):
    result = rendered(scene_of(ACROSS, device={"downhill": downhill}))
    track = result.track
    np.testing.assert_allclose(track.times, np.arange(1001) / 1000, rtol=0, atol=1e-12)
    x = -0.08 + 0.16 * track.times
    np.testing.assert_allclose(result.signals["x"], x, atol=1e-12)
    friction = expected(exact_slope(x))
    # The first sample of a touch has no direction yet.
    assert result.signals["friction"][0] == (50.0 if downhill == "offset" else 0.0)
    assert np.abs(result.signals["friction"][1:] - friction[1:]).max() < 0.1
    np.testing.assert_allclose(track.column("amplitude"), volts(result.signals["friction"]), rtol=1e-12)
    assert track.column("amplitude").max() == pytest.approx(288.189, abs=0.2)
    assert (track.column("carrier") == 60.0).all()
    assert result.signals["contact"].all()


def test_uphill_resists_from_either_side():
    back = rendered(scene_of(ACROSS[::-1]))
    x = back.signals["x"]
    friction = back.signals["friction"]
    assert np.abs(friction[1:] - 100 * np.maximum(-exact_slope(x), 0)[1:]).max() < 0.1
    assert friction[(x > 0.01) & (x < 0.02)].min() > 80
    assert friction[x < -0.005].max() < 0.1


def test_oblique_path_takes_the_slope_along_it():
    path = stroke((-0.06, -0.03), (0.04, 0.045), seconds=0.5)
    result = rendered(scene_of(path, device={"downhill": "absolute"}))
    x, y = result.signals["x"], result.signals["y"]
    vector = np.array([0.8, 0.6])
    along = exact_slope(x, y) * vector[0] + exact_slope(y, x) * vector[1]
    assert np.abs(result.signals["friction"][1:] - 100 * np.abs(along[1:])).max() < 0.2
    np.testing.assert_allclose(result.signals["direction_x"][1:], 0.8, atol=1e-9)
    np.testing.assert_allclose(result.signals["direction_y"][1:], 0.6, atol=1e-9)


def test_slopes_are_physical():
    result = rendered(scene_of(ACROSS, heights=BUMP * 1e3, unit=1e-3, device={"scale_mode": "manual", "scale": 250.0}))
    grad = result.signals["grad_x"]
    exact = STEEPEST * exact_slope(result.signals["x"])
    assert np.abs(grad - exact).max() < 1e-3 * STEEPEST
    up = exact > 0.01
    np.testing.assert_allclose(result.signals["friction"][up], 250 * grad[up], rtol=1e-12)


def test_height_profile():
    result = rendered(scene_of(ACROSS, device={"profile": "height"}))
    x = result.signals["x"]
    # The largest pixel is not the exact top; the lowest is the far corner, zero within 1e-9.
    assert np.abs(result.signals["friction"] - (1 + 99 * np.exp(-(x**2) / (2 * SIGMA**2)))).max() < 0.05
    manual = rendered(scene_of(ACROSS, device={"profile": "height", "scale_mode": "manual", "scale": 20000.0}))
    assert manual.signals["friction"].max() == pytest.approx(20000 * TOP, rel=1e-3)


def test_rectangle_profile_is_on_within_its_level():
    result = rendered(scene_of(ACROSS, device={"profile": "rectangle", "threshold": 0.5}))
    x = np.abs(result.signals["x"])
    half = SIGMA * math.sqrt(2 * math.log(2))
    pixel = SIZE[0] / BUMP.shape[1]
    assert (result.signals["friction"][x < half - pixel] == 100).all()
    assert (result.signals["friction"][x > half + pixel] == 1).all()
    levels = np.unique(np.round(result.track.column("amplitude"), 1))
    np.testing.assert_allclose(levels, [7.0, 288.2], atol=0.05)


def test_contact_needs_distance_and_rectangle():
    z = np.array([0.0006, 0.0005, 0.0, -0.004, -0.021])
    for height, touching in zip(z, (False, True, True, True, False), strict=True):
        result = rendered(scene_of(stroke((-0.01, 0), (0.01, 0), 0.1, z=height)))
        assert result.signals["contact"].all() == touching, height
        assert ("never-touches" in codes(result)) == (not touching)
    leaving = rendered(
        scene_of(stroke((0.0, 0.0), (0.2, 0.0)), heights=np.tile(np.arange(9, dtype=np.float32), (2, 1)))
    )
    inside = leaving.signals["x"] <= 0.1
    np.testing.assert_array_equal(leaving.signals["contact"], inside)
    assert (leaving.track.column("amplitude")[~inside] == 0).all()
    assert leaving.track.column("amplitude")[inside][1:-60].min() > 280


def test_touch_distance_of_the_screen_goes_before_the_fingers():
    scene = scene_of(stroke((-0.01, 0), (0.01, 0), 0.1, z=0.002), parameters={"touch_distance": 0.001})
    finger = dataclasses.replace(scene.fingers[0], parameters={"touch_distance": 0.003})
    assert not rendered(dataclasses.replace(scene, fingers=(finger,))).signals["contact"].any()
    wide = dataclasses.replace(scene.screens[0], parameters={})
    assert rendered(dataclasses.replace(scene, fingers=(finger,), screens=(wide,))).signals["contact"].all()


def turned_screen(n):
    """A screen that is scaled by 2 x 0.5, mirrored in x, turned, and travels."""
    angle, t = 0.7, np.arange(n) / RATE
    turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    matrices = np.tile(np.eye(4), (n, 1, 1))
    matrices[:, :3, :3] = turn @ np.diag([-2.0, 0.5, 3.0])
    matrices[:, :3, 3] = np.stack([5 + 0.3 * np.sin(9 * t), t**2, -2 * t], axis=1)
    return matrices


def test_a_moving_mirrored_scaled_screen_feels_like_one_at_rest():
    # The same surface in metres: the object's own size is halved in x and doubled in y, the scale undoes it.
    straight = rendered(scene_of(ACROSS))
    moved = rendered(scene_of(ACROSS * [0.5, 2.0, 1.0], size=(0.1, 0.2), screen_at=turned_screen(len(ACROSS))))
    np.testing.assert_allclose(moved.signals["x"], straight.signals["x"], atol=1e-12)
    np.testing.assert_allclose(moved.track.column("amplitude")[1:], straight.track.column("amplitude")[1:], atol=1e-3)
    assert "screen-scale-animated" not in codes(moved)
    assert "screen-sheared" not in codes(moved)


def test_a_finger_that_rides_on_the_screen_is_at_rest():
    n = 121
    result = rendered(scene_of(np.tile([-0.015, 0.0, 0.0], (n, 1)), screen_at=turned_screen(n), size=(0.1, 0.2)))
    assert result.signals["contact"].all()
    assert (result.track.column("amplitude") == 0).all()


def test_direction_is_held_after_an_abrupt_stop():
    stop = np.concatenate([stroke((-0.055, 0), (-0.015, 0), 0.4), np.tile([-0.015, 0, 0], (96, 1))])
    for window in (0.0, 0.02):
        result = rendered(scene_of(stop, device={"direction_window": window}))
        after = result.track.times > 0.4
        assert result.signals["direction_x"][1:].min() > 0.999, window
        # On the steepest flank, at rest: full friction stays.
        assert np.abs(result.signals["friction"][after] - 100).max() < 1.0


def holed(path, holes, heights=BUMP, parameters=None):
    scene = scene_of(path, heights=heights, parameters=parameters)
    return dataclasses.replace(scene, screens=(dataclasses.replace(scene.screens[0], holes=holes),))


def test_a_finger_that_passes_over_a_hole_is_told_with_its_frame():
    """The heights there are nobody's: without a word they would be felt as measured."""
    x, y = centres(400, 800)
    holes = (np.abs(x - 0.02) < 0.01) & (y > -0.02)
    passed = codes(rendered(holed(ACROSS, holes)))["over-hole"]
    assert passed.severity == "warning"
    assert passed.count == pytest.approx(0.02 / 0.16 * SPEC.rate, abs=1.0)
    assert passed.frame == pytest.approx(1 + 24 * (0.01 + 0.08) / 0.16, abs=24 / SPEC.rate)
    around = holed(stroke((-0.08, -0.03), (0.08, -0.03)), holes)
    lifted = holed(stroke((-0.08, 0.0), (0.08, 0.0), z=0.01), holes)
    for scene in (around, lifted, holed(ACROSS, None)):
        assert "over-hole" not in codes(rendered(scene))
    np.testing.assert_array_equal(rendered(holed(ACROSS, holes)).track.values, rendered(scene_of(ACROSS)).track.values)


def test_holes_of_a_sequence_are_those_of_the_map_that_is_shown():
    maps = np.stack([BUMP[::10, ::10]] * 24)
    holes = np.zeros(maps.shape, bool)
    holes[12:] = True
    passed = codes(rendered(holed(ACROSS, holes, maps)))["over-hole"]
    assert passed.frame == pytest.approx(1 + 11.5, abs=24 / SPEC.rate)


def test_automatic_scale_is_that_of_the_whole_sequence():
    # The relief grows to three times its height; never is a single frame scaled by itself.
    stack = np.stack([BUMP, 3 * BUMP])
    parameters = {"map_fps": 2.0}  # shown at 0 and at 0.5 s, then held
    result = rendered(scene_of(ACROSS, heights=stack, parameters=parameters, device={"downhill": "absolute"}))
    t, x = result.track.times, result.signals["x"]
    grown = 1 + 2 * np.minimum(t / 0.5, 1)
    assert np.abs(result.signals["friction"][1:] - (100 / 3 * grown * np.abs(exact_slope(x)))[1:]).max() < 0.1
    alone = rendered(scene_of(ACROSS))
    assert alone.track.column("amplitude").max() == pytest.approx(result.track.column("amplitude").max(), rel=1e-3)


def test_sequence_starts_at_its_scene_frame_with_one_map_a_frame():
    stack = np.stack([BUMP * 0, BUMP])
    result = rendered(scene_of(ACROSS, heights=stack, parameters={"sequence_start": 13}))  # frame 13 is 0.5 s
    t, height = result.track.times, result.signals["height"]
    assert (height[t <= 0.5] == 0).all()
    late = t > 0.5 + 1 / 24 + 1e-9
    exact = TOP * np.exp(-(result.signals["x"] ** 2) / (2 * SIGMA**2))
    assert np.abs(height - exact)[late].max() < 1e-3 * TOP


def test_a_sequence_that_ends_before_the_range_says_so():
    def short(maps, **parameters):
        heights = np.stack([BUMP[::40, ::40]] * maps)
        return codes(rendered(scene_of(ACROSS, heights=heights, parameters=parameters))).get("sequence-short")

    # 25 frames, 1 s: frame 25 shows the 25th map; of ten, the last lasts to the middle between frames 10 and 11.
    assert short(25) is short(1) is short(24, sequence_start=2) is None
    finding = short(10)
    assert finding.severity == "warning" and finding.value == "10 maps"
    assert finding.count == sum(k / 1000 > 9.5 / 24 for k in range(1001))
    assert finding.frame == pytest.approx(10.5, abs=24 / 1000)
    assert short(10, sequence_start=16) is None


def test_animated_settings_override_the_constant_ones():
    t = np.arange(len(ACROSS)) / RATE
    above = stroke((-0.08, 0.0), (0.08, 0.0), z=0.5e-3)
    animated = {
        "device/0/0/carrier": 60 + 140 * t,
        "device/0/0/scale": 100 * t,
        "screen/0/touch_distance": 0.001 * (1 - t),
    }
    result = rendered(
        scene_of(above, device={"scale_mode": "manual", "scale": 7.0, "carrier": 80.0}, animated=animated)
    )
    times = result.track.times
    np.testing.assert_allclose(result.track.column("carrier"), 60 + 140 * times)
    touching = times <= 0.5
    np.testing.assert_array_equal(result.signals["contact"], touching)
    up = (result.signals["x"] < -0.001) & touching & (times > 0.002)
    np.testing.assert_allclose(result.signals["friction"][up], (100 * times * result.signals["grad_x"])[up], rtol=1e-9)


def test_a_keyed_scale_may_begin_at_zero_and_the_largest_is_written_down():
    t = np.arange(len(ACROSS)) / RATE
    result = rendered(
        scene_of(ACROSS, device={"scale_mode": "manual", "scale": 0.0}, animated={"device/0/0/scale": 100 * t})
    )
    up = (result.signals["x"] < -0.001) & (result.track.times > 0.002)
    exact = 100 * result.track.times * result.signals["grad_x"]
    np.testing.assert_allclose(result.signals["friction"][up], exact[up], rtol=1e-9)
    assert result.signals["friction"].max() > 1.0 and result.track.meta["scale"] == "100"


@pytest.mark.parametrize(("name", "value"), [("threshold", 1.5), ("scale", -1.0), ("carrier", 0.0)])
def test_a_device_animated_out_of_range_is_left_out_with_its_frame(name, value):
    keyed = np.full(len(ACROSS), DEVICE[name].default)
    keyed[24] = value
    scene = scene_of(ACROSS, animated={f"device/0/0/{name}": keyed})
    bake = run(scene)
    (told,) = [f for f in bake.findings if f.code == "device-unavailable"]
    assert not bake.outputs and f"frame 3.4: '{name}' is too" in told.what


def test_a_screen_animated_out_of_range_is_refused_with_its_frame():
    keyed = np.full(len(ACROSS), 1e3)
    with pytest.raises(DermisError, match="screen '.*', frame 1: 'touch_distance' is too large"):
        run(scene_of(ACROSS, animated={"screen/0/touch_distance": keyed}))


def test_without_a_name_the_finger_feels_every_screen():
    path = np.concatenate([stroke((-0.03, 0), (0.0, 0), 0.25), stroke((0.47, 0), (0.5, 0), 0.25)[1:]])
    result = rendered(scene_of(path, screens=2, use_screen=""))
    assert set(np.unique(result.signals["screen"])) >= {0.0, 1.0}
    late = result.track.times > 0.3
    assert (result.signals["screen"][late] == 1).all()
    np.testing.assert_allclose(result.signals["x"][late].max(), 0.0, atol=1e-4)
    assert np.abs(result.signals["friction"] - 100 * np.maximum(exact_slope(result.signals["x"]), 0))[late].max() < 0.2


def test_manual_scale_above_the_span_is_counted_and_left_for_the_limiter():
    result = rendered(scene_of(ACROSS, device={"scale_mode": "manual", "scale": 300 / STEEPEST}))
    friction = 300 * np.maximum(exact_slope(result.signals["x"]), 0)
    finding = codes(result)["above-measured-span"]
    assert abs(finding.count - int((friction > 100).sum())) <= 2
    assert result.track.column("amplitude").max() == pytest.approx(float(volts(300.0)), rel=2e-3)
    assert result.track.column("amplitude").max() > SPEC.channel("amplitude").high


def test_flat_map_says_so():
    result = rendered(scene_of(ACROSS, heights=np.ones((4, 4), np.float32)))
    assert codes(result)["flat-map"].severity == "warning"
    assert (result.track.column("amplitude") == 0).all()


def test_rate_does_not_depend_on_the_frame_rate():
    scene = scene_of(ACROSS)
    ntsc = dataclasses.replace(scene, fps=Fraction(30000, 1001), frame_range=(1, 31))  # 1.001 s, of which 1 s is swept
    known, longer = rendered(scene).track, rendered(ntsc).track
    np.testing.assert_array_equal(known.times, longer.times[:1001])
    np.testing.assert_array_equal(known.values, longer.values[:1001])


def test_the_track_lasts_as_long_as_the_range_and_as_every_other_devices():
    ntsc = dataclasses.replace(scene_of(ACROSS), fps=Fraction(30000, 1001), frame_range=(1, 31))
    result = rendered(ntsc)
    np.testing.assert_array_equal(result.track.times, np.arange(1002) / 1000)
    np.testing.assert_array_equal(result.track.times, device_times(ntsc, SPEC.rate))
    # The finger goes on as it moved between the last two samples of the sweep.
    assert result.signals["x"][-1] == pytest.approx(-0.08 + 0.16 * 1.001, abs=1e-12)


def screens_scaled(*scale):
    matrices = np.tile(np.eye(4), (len(ACROSS), 1, 1))
    matrices[:, :3, :3] = np.diag(scale)
    return matrices


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"heights": np.zeros((0, 0), np.float32)}, "no pixels"),
        ({"heights": np.full((2, 2), np.nan, np.float32)}, "not finite"),
        ({"use_screen": "Gone"}, "no such touch screen"),
        ({"size": (0.0, 0.1)}, "no area"),
        ({"unit": -1.0}, "height unit"),
        ({"screen_at": screens_scaled(1, 0, 1), "finger_world": ACROSS}, "no area|nothing"),
        ({"screen_at": screens_scaled(1, 1, 0), "finger_world": ACROSS}, "scale is zero"),
        ({"device": {"profile": "sine"}}, "profile"),
        ({"device": {"downhill": "free"}}, "downhill"),
        ({"device": {"scale_mode": "guess"}}, "scale"),
        ({"device": {"scale_mode": "manual", "scale": 0.0}}, "zero"),
        ({"device": {"scale_mode": "manual", "scale": math.nan}}, "finite"),
        ({"device": {"direction_window": -1.0}}, "direction_window"),
        ({"parameters": {"map_fps": -1.0}}, "map_fps"),
    ],
)
def test_refuses_with_a_reason(options, message):
    with pytest.raises(DermisError, match=message):
        rendered(scene_of(ACROSS, **options))


def test_scene_without_a_screen():
    scene = dataclasses.replace(scene_of(ACROSS), screens=())
    with pytest.raises(DermisError, match="no touch screen"):
        screen_maps(scene, np.zeros((0, 1, 4, 4)), scene.fingers[0].devices[0], SPEC)


# --- the map for a real finger


def test_exported_map_answers_like_the_bake(tmp_path):
    stack = np.stack([BUMP, 2 * BUMP])
    for profile in ("slope", "height", "rectangle"):
        scene = scene_of(ACROSS, heights=stack, parameters={"map_fps": 1.0}, device={"profile": profile})
        touch, use = sampled(scene), scene.fingers[0].devices[0]
        result = render(touch, scene, 0, use, SPEC)
        screen_maps(scene, touch.screens, use, SPEC)[0].save(tmp_path / "pad.npz")
        live = ScreenMap.load(tmp_path / "pad.npz")
        for i in range(7, 1000, 31):
            answer = live.answer(result.signals["x"][i], 0.0, (0.25, 0.0), result.track.times[i])
            assert answer.amplitude == pytest.approx(result.track.column("amplitude")[i], rel=1e-6, abs=1e-9), profile
            assert answer.carrier == 60.0
            assert not answer.limited
        assert live.answer(0.3, 0.0, (1.0, 0.0)).amplitude == 0.0


def test_live_answer_never_exceeds_the_limit(tmp_path):
    scene = scene_of(ACROSS, device={"scale_mode": "manual", "scale": 300 / STEEPEST})
    live = screen_maps(scene, np.eye(4)[None, None], scene.fingers[0].devices[0], SPEC)[0]
    answer = live.answer(-SIGMA, 0.0, (1.0, 0.0))
    assert (answer.amplitude, answer.limited) == (300.0, True)
    assert answer.friction == pytest.approx(300, rel=1e-3)
    assert live.answer(-SIGMA, 0.0, (0.0, 0.0)).amplitude == 0.0
    with pytest.raises(DermisError, match="not finite"):
        live.answer(math.nan, 0.0, (1.0, 0.0))


def test_export_gives_the_same_bytes_and_refuses_what_it_does_not_know(tmp_path):
    scene = scene_of(ACROSS)
    made = screen_maps(scene, np.eye(4)[None, None], scene.fingers[0].devices[0], SPEC)[0]
    first, second = tmp_path / "a.npz", tmp_path / "b.npz"
    made.save(first)
    ScreenMap.load(first).save(second)
    assert first.read_bytes() == second.read_bytes()
    with np.load(first, allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["heights"][0], BUMP)
        text = archive["meta"].tobytes().decode()
    for broken_text, message in (
        (text.replace("map 1", "map 2"), "version"),
        (text.replace('"offset"', '"off"'), "fields"),
        (text.replace('"rectify"', '"free"'), "downhill"),
        ("[]", "version"),
    ):
        np.savez(second, heights=BUMP[None], meta=np.frombuffer(broken_text.encode(), np.uint8))
        with pytest.raises(DermisError, match=message):
            ScreenMap.load(second)
    np.savez(second, meta=np.frombuffer(text.encode(), np.uint8))
    with pytest.raises(DermisError, match="not a screen map"):
        ScreenMap.load(second)
    second.write_bytes(first.read_bytes()[:500])
    with pytest.raises(DermisError, match="not a screen map"):
        ScreenMap.load(second)
    with pytest.raises(DermisError, match="cannot be read"):
        ScreenMap.load(tmp_path / "none.npz")
    with pytest.raises(DermisError, match="cannot be written"):
        made.save(tmp_path / "a.npz" / "inside.npz")


@pytest.mark.parametrize(
    ("unit", "device", "screens", "told"),
    [
        (0.0, {"scale_mode": "manual", "scale": 5.0}, 1, 1),
        (0.0, {}, 2, 2),  # one scale for two screens
        (0.0, {}, 1, 0),  # the steepest slope is friction 100, however high the map
        (0.0, {"scale_mode": "manual", "scale": 5.0, "profile": "rectangle"}, 1, 0),
        (1e-3, {"scale_mode": "manual", "scale": 5.0}, 1, 0),
    ],
)
def test_a_map_without_a_unit_is_told_where_commands_depend_on_it(unit, device, screens, told):
    path = stroke((-0.04, 0.0), (0.04, 0.0))
    heights = np.tile(np.linspace(0, 1, 12, dtype=np.float32), (8, 1))
    scene = scene_of(path, heights=heights, unit=unit, device=device, screens=screens, use_screen="")
    found = [f for f in rendered(scene).findings if f.code == "no-unit"]
    assert len(found) == told
    assert all(f.severity == "warning" and f.value == f"{1e3 * SIZE[0]:.3g} mm" for f in found)
