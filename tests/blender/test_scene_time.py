"""One clock: with stretched time, odd frame rates, sub-frames and negative ranges all agree on what is when."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np
import pytest

from blender_addon import changes, reporting, scene_time
from blender_addon._core import core
from blender_addon.film import film_objects, skin_mesh
from blender_addon.preview import device_preview, live_lanes, skin_preview
from blender_addon.results import command_curves, export_parts, store
from blender_addon.sampling import scene_sweep
from blender_addon.streaming import request_fields
from blender_addon.timeline import strip
from blender_addon.viewport import shown as views
from core.errors import Finding

from . import build
from .test_sampling_simulated import rigid
from .test_stream import HAPTIP

pytestmark = pytest.mark.shared_cases("timings differ in numbers")

TOP, DEPTH = 0.02, 0.7e-3  # [m]: a plate's face, and how deep it is pressed


class Timing(NamedTuple):
    """Settings of a scene's time."""

    old: int
    new: int
    fps: int
    base: float
    first: int
    last: int
    preview: bool = False

    def scene(self) -> bpy.types.Scene:
        """Give the scene these settings."""
        scene = build.span(self.first, self.last, self.fps, self.base)
        scene.render.frame_map_old, scene.render.frame_map_new = self.old, self.new
        if self.first < 0:  # a scene's own range begins at 0 at the earliest
            scene.dermis.use_range = True
            scene.dermis.frame_start, scene.dermis.frame_end = self.first, self.last
        if self.preview:  # the range that counts; the scene's own is another
            scene.use_preview_range = True
            scene.frame_preview_start, scene.frame_preview_end = self.first, self.last
            scene.frame_start, scene.frame_end = self.first - 5, self.last + 5
        return scene

    @property
    def rate(self) -> float:
        """Scene frames a second."""
        return self.fps / self.base

    def key_at(self, frame: float) -> float:
        """Return where a key lies that is felt at a scene frame."""
        return frame * self.old / self.new


TIMINGS = {
    "plain": Timing(100, 100, 24, 1.0, 1, 13),
    "slow": Timing(100, 200, 24, 1.0, 1, 13),
    "fast": Timing(100, 50, 25, 1.0, 4, 16, preview=True),
    "ntsc": Timing(100, 300, 24, 1.001, -9, 3),
    "tenth": Timing(900, 90, 30, 1.001, -40, -28),
}


@pytest.fixture(params=TIMINGS.values(), ids=TIMINGS.keys())
def timing(request: pytest.FixtureRequest) -> Timing:
    """Each kind of time."""
    return request.param


@pytest.fixture(autouse=True)
def nothing_remembered() -> Iterator[None]:
    """Start without a history, and leave none."""
    for kept in (skin_preview, device_preview):
        kept.reset()
    live_lanes.forget()
    yield
    live_lanes.forget()


def moving(timing: Timing) -> tuple[bpy.types.Scene, bpy.types.Object]:
    """Return a scene with a finger whose x [m] is the scene frame over 1000, beside a cube."""
    scene, hand = timing.scene(), build.finger()
    build.cube()
    ends = np.array([timing.first - 4.0, timing.last + 4.0])
    build.keys(hand, "location", timing.key_at(ends).tolist(), np.column_stack([ends / 1000, ends * 0, ends * 0 + 5]))
    bpy.context.view_layer.update()
    return scene, hand


def pressed(timing: Timing, **skin: Any) -> bpy.types.Scene:
    """Return a scene in which a draft finger comes down at its fifth scene frame and slides on."""
    scene, hand = timing.scene(), build.finger(location=(0.0, 0.0, TOP + 0.01))
    hand.dermis.finger.skin.shown, hand.dermis.finger.skin.level = True, "draft"
    for name, value in skin.items():
        setattr(hand.dermis.finger.skin, name, value)
    build.cube("Plate", 0.04, (0.0, 0.0, TOP - 0.02))
    shown = timing.first + np.arange(13.0)
    z = [TOP + 0.03, TOP + 0.03, TOP - 0.5 * DEPTH, TOP - 0.9 * DEPTH, *[TOP - DEPTH] * 9]
    places = np.column_stack([np.zeros(13), [0.0] * 6 + [1e-4 * i for i in range(7)], z])
    build.keys(hand, "location", timing.key_at(shown).tolist(), places)
    scene.dermis.sample_rate = timing.fps
    bpy.context.view_layer.update()
    return scene


# the module itself


def test_frames_that_are_set_are_read_and_evaluated_where_blender_says(timing: Timing) -> None:
    scene, hand = moving(timing)
    for frame in (timing.first, timing.first + 0.25, -6.75, -0.5, 0.0, timing.last - 0.125):
        scene_time.go_to(scene, frame)
        assert scene_time.shown(scene) == frame
        assert scene.frame_current_final == pytest.approx(scene_time.evaluated(scene, frame), rel=1e-6)
        assert scene_time.shown_at(scene, scene.frame_current_final) == pytest.approx(frame, rel=1e-6)
        if timing.first - 4 <= frame <= timing.last + 4:
            assert hand.matrix_world[0][3] == pytest.approx(frame / 1000, abs=1e-8)


def test_a_clock_counts_what_playback_takes(timing: Timing) -> None:
    clock = scene_time.clock(timing.scene(), timing.first)
    assert clock.seconds(timing.first + 12.0) == pytest.approx(12 * timing.base / timing.fps, rel=1e-7)
    assert clock.seconds(timing.first - 3.0) == pytest.approx(-3 * timing.base / timing.fps, rel=1e-7)
    at = np.linspace(-1.0, 2.0, 7)
    assert clock.seconds(clock.frames(at)) == pytest.approx(at, abs=1e-12)
    assert clock.count(clock.duration(0.3)) == pytest.approx(0.3, rel=1e-12)


# sampling


def test_a_sweep_and_a_sample_of_now_agree_at_every_frame(timing: Timing) -> None:
    scene, _ = moving(timing)
    scene_time.go_to(scene, -6.75)
    swept = build.joined(scene_sweep.sample(scene))
    assert scene_time.shown(scene) == -6.75  # it is put back, negative sub-frames too
    assert swept["frames"][0] == timing.first and len(swept["times"]) > 12 / timing.rate * 200
    assert swept["times"] == pytest.approx((swept["frames"] - timing.first) / timing.rate, abs=1e-7)
    assert swept["fingers"][0, :, 0, 3] == pytest.approx(swept["frames"] / 1000, abs=1e-8)
    for k in (0, 1, 7, 40, len(swept["frames"]) - 1):
        scene_time.go_to(scene, float(swept["frames"][k]))
        now = build.joined(scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()))
        assert now["frames"][0] == swept["frames"][k] and now["times"][0] == swept["times"][k]
        assert np.array_equal(now["fingers"][0, 0], swept["fingers"][0, k])


@pytest.mark.parametrize(("old", "new"), [(100, 50), (100, 200), (100, 300), (30, 70)])
def test_simulations_take_each_step_and_are_where_blender_shows_them(old: int, new: int) -> None:
    scene = Timing(old, new, 24, 1.0, 1, 25).scene()
    cube = build.cube("Cube", 1.0, (0, 0, 20))
    rigid(cube)
    build.finger()
    tactile = scene_sweep.sample(scene)
    (told,) = (f for f in tactile.findings if f.code == "simulation-stretched")
    assert f"by {new / old:g}" in told.value and ("leaves out" in told.what) == (new < old)
    got = build.joined(tactile)
    steps = scene_time.simulated_frames(scene, 1, (1, 25))
    whole = np.arange(min(1, old // new), np.ceil(25 * old / new) + 1)
    assert steps == pytest.approx(whole * new / old, rel=1e-6)
    fallen = {}
    for frame in steps.tolist():  # Blender's own way through the steps, from the start
        scene_time.go_to(scene, frame)
        fallen[frame] = cube.matrix_world[2][3]
    inside = [frame for frame in fallen if 1 <= frame <= 25]
    spacing = 1.0 / scene.dermis.sample_rate
    for frame in inside:
        z = np.interp(frame, got["frames"], got["bodies"][0, :, 2, 3])
        assert z == pytest.approx(fallen[frame], abs=9.81 * (old / new) ** 2 * spacing)
    scene.render.frame_map_new = scene.render.frame_map_old
    assert not [f for f in scene_sweep.sample(scene).findings if f.code == "simulation-stretched"]
    assert 20.0 - min(fallen.values()) > 0.4 * 9.81 * ((25 * old / new - 1) / 24) ** 2


def test_a_finding_names_the_scene_frame_and_the_button_goes_there(timing: Timing) -> None:
    scene, _ = moving(timing)
    body = bpy.data.objects["Cube"]
    build.keys(body, "hide_viewport", timing.key_at(timing.first + np.array([0.0, 6.0])).tolist(), [0, 1], "CONSTANT")
    tactile = scene_sweep.sample(scene)
    list(tactile.chunks)
    (absent,) = (f for f in tactile.chunks.findings if f.code == "absent")
    step = timing.rate / scene.dermis.sample_rate
    assert timing.first + 6.0 - 1e-4 <= absent.frame <= timing.first + 6.0 + step
    reporting.show((Finding("info", "test", "here", frame=-6.75),), "Test")
    assert bpy.ops.dermis.go_to_finding(index=0) == {"FINISHED"}
    assert scene_time.shown(scene) == -6.75


# bake against preview


def test_the_view_shows_what_was_baked_at_the_frame_live_and_from_the_bake(timing: Timing) -> None:
    timing = timing._replace(base=1.0)  # samples of the bake at whole frames, as the preview's
    scene = pressed(timing)
    live = {}
    for frame in range(timing.first, timing.last + 1):
        scene.frame_set(frame)
        (live[frame],) = skin_preview.step(bpy.context)
    skin_preview.reset()
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    touch = store.current(scene).bake.skins["Finger"]
    most = max(state.normal_force for state in live.values())
    assert most > 0.3
    for k, frame in enumerate(range(timing.first, timing.last + 1)):
        scene.frame_set(frame)
        (shown,) = skin_preview.own(scene)
        assert shown.source == "bake" and np.array_equal(shown.force, touch.at(k).force)
        assert shown.normal_force == pytest.approx(live[frame].normal_force, abs=1e-3 * most)
        assert (shown.normal_force > 0.0) == (k >= 2)


def test_the_live_preview_goes_on_by_seconds_of_playback(timing: Timing) -> None:
    scene = pressed(timing)
    step = int(0.2 * timing.rate)  # nearer than a play may skip
    for frame in (timing.first, timing.first + step):
        scene.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    assert state.note.startswith(f"live: computed from frame {timing.first} on") and "alone" not in state.note
    scene.frame_set(timing.first + step + int(0.3 * timing.rate))
    (state,) = skin_preview.step(bpy.context)
    assert "alone" in state.note or "continued" in state.note


@pytest.mark.parametrize(("name", "value"), [("frame_map_new", 200), ("fps", 30), ("fps_base", 1.001)])
def test_another_stretch_or_rate_is_an_edit_and_puts_the_bake_out_of_date(name: str, value: float) -> None:
    scene = pressed(TIMINGS["plain"])
    assert bpy.ops.dermis.bake() == {"FINISHED"} and store.state(scene) == "fresh"
    edits = changes.edits()
    before = getattr(scene.render, name)
    setattr(scene.render, name, value)
    bpy.context.view_layer.update()
    assert store.state(scene) == "stale" and changes.edits() > edits
    setattr(scene.render, name, before)
    bpy.context.view_layer.update()
    assert store.fingerprint(scene) == store.current(scene).fingerprint


def test_frames_seen_before_the_stretch_are_not_shown_as_they_were() -> None:
    scene = pressed(TIMINGS["plain"])
    for frame in range(1, 9):
        scene.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    scene.render.frame_map_new = 400
    bpy.context.view_layer.update()
    scene.frame_set(5)  # evaluates frame 1.25, where nothing touches
    (after,) = skin_preview.step(bpy.context)
    assert state.normal_force > 0.3 and after.normal_force == 0.0


# the strip


def test_strip_and_live_lanes_lie_at_scene_frames(timing: Timing) -> None:
    timing = timing._replace(base=1.0)
    scene = pressed(timing)
    for frame in range(timing.first, timing.last + 1):
        scene.frame_set(frame)
        skin_preview.step(bpy.context)
        views.on_frame(scene)
    (lane,) = strip.of(scene).live
    (seen,) = lane.series["force"]
    assert seen.frames.tolist() == list(range(timing.first, timing.last + 1))
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    (lane,) = strip.of(scene).lanes
    (felt,) = lane.series["force"]
    assert felt.frames == pytest.approx(seen.frames) and np.flatnonzero(felt.values)[0] == 2
    assert (seen.values > 0).tolist() == (felt.values > 0).tolist()


# streams and files


def track_of(timing: Timing, scene: bpy.types.Scene) -> Any:
    """Keep a bake of one tactor whose x [m] is 1 mm a second of playback; return the track."""
    hand = scene.objects["Finger"]
    if not hand.dermis.finger.devices:
        hand.dermis.finger.devices.add().preset = HAPTIP
    bpy.context.view_layer.update()
    times = np.arange(0.0, (timing.last - timing.first) / timing.rate, 1e-3)
    spec = core.presets.Library().device(HAPTIP)
    values = np.zeros((len(times), len(spec.channels)))
    values[:, 0] = 1e-3 * times
    meta = {"finger": "Finger", "frame_range": f"{timing.first} {timing.last}"}
    track = core.track.command_track.CommandTrack(spec, times, values, meta)
    bake = core.pipeline.bake
    store.keep(scene, bake.Bake((bake.Output("Finger", HAPTIP, track, {}, ()),), (), {}, "hash"))
    return track


def test_a_stream_is_told_the_seconds_of_playback(timing: Timing) -> None:
    scene, _ = moving(timing)
    track_of(timing, scene)
    for frame in (timing.first, timing.first + 6, timing.first + 6.5):
        scene_time.go_to(scene, frame)
        told, _ = request_fields.published(scene, ())
        assert told == pytest.approx((frame - timing.first) / timing.rate, abs=1e-7)


def test_a_tracks_value_at_a_frame_is_that_of_its_second(timing: Timing) -> None:
    scene, _ = moving(timing)
    track_of(timing, scene)
    result = store.current(scene)
    scene_time.go_to(scene, timing.first + 6.5)
    (row,) = device_preview.computed(scene).rows
    assert row.values["tactor_x"] == pytest.approx(1e-3 * 6.5 / timing.rate, abs=1e-10)
    assert export_parts.last_frame(result) == timing.last


def test_exported_contact_has_the_seconds_that_a_person_sees(timing: Timing, tmp_path: Path) -> None:
    scene = pressed(timing)
    scene.dermis.sample_rate = 480.0
    scene.objects["Finger"].dermis.finger.skin.shown = False
    scene.objects["Finger"].dermis.finger.devices.add().preset = HAPTIP
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    (output,) = store.current(scene).bake.outputs
    # straight from the second frame to the third, it comes to the plate at a share of the way
    share = 0.03 / (0.03 + 0.5 * DEPTH)
    at = output.track.times[np.flatnonzero(output.signals["contact"])[0]]
    assert at == pytest.approx((1.0 + share) / timing.rate, abs=2e-3 + 1e-2 / timing.rate)
    written, _ = export_parts.write(
        scene, store.current(scene), tmp_path, "csv", "ACTION", active=scene.objects["Finger"]
    )
    assert len(written) == 1  # the action's keys fill the range
    track = core.track.export.read(written[0])
    assert track.times[-1] == pytest.approx(12 / timing.rate, abs=2e-3)


# what is keyed


def test_a_recording_plays_as_long_as_it_is(timing: Timing, tmp_path: Path) -> None:
    scene, hand = moving(timing)
    bpy.context.view_layer.objects.active = hand
    path = tmp_path / "poses.csv"
    path.write_text("time,x_m,y_m,z_m\n" + "".join(f"{t / 10},{t},0,0\n" for t in range(21)))  # 2 s, 10 units a second
    bpy.ops.dermis.import_poses(filepath=str(path), first=timing.first)
    clock = scene_time.clock(scene, timing.first)
    for seconds in (0.0, 0.55, 1.3, 2.0):
        scene_time.go_to(scene, clock.frames(seconds))
        assert hand.matrix_world[0][3] == pytest.approx(10 * seconds, abs=1e-4)
    assert clock.seconds(float(scene.frame_end)) >= 2.0 - 1e-9
    if not timing.preview:
        assert clock.seconds(float(scene.frame_end - 1)) < 2.0 or scene.frame_end == timing.last


def test_a_keyed_touch_lasts_as_asked_and_begins_at_the_frame_shown(timing: Timing) -> None:
    scene = timing.scene()
    scene.cursor.location = (0.0, 0.0, 0.08)
    bpy.ops.dermis.add_finger()
    hand, plate = bpy.context.object, build.cube("Plate", 0.1)
    plate.select_set(True)
    start = timing.first + 0.5
    scene_time.go_to(scene, start)
    bpy.context.view_layer.update()
    bpy.ops.dermis.add_gesture(depth=1.0, direction=0.0, approach=24.0, height=4.0, hold=0.5, slide=12.0, speed=24.0)
    # [s]: 4/24 down, 1/24 to the depth, 0.5 held, 0.5 of sliding, 5/24 of lifting
    clock = scene_time.clock(scene, start)
    for twentyfourths, z, y in (
        (0, 54, 0),
        (4, 50, 0),
        (5, 49, 0),
        (17, 49, 0),
        (23, 49, 6),
        (29, 49, 12),
        (34, 54, 12),
    ):
        scene_time.go_to(scene, clock.frames(twentyfourths / 24))
        assert 1e3 * np.array(hand.matrix_world)[1:3, 3] == pytest.approx([y, z], abs=2e-3)
    assert scene.frame_end >= clock.frames(34 / 24) - 1e-6


@pytest.mark.parametrize("rate", [0.0, 240.0])
def test_curves_have_the_tracks_value_at_each_frame_shown(timing: Timing, rate: float) -> None:
    scene, hand = moving(timing)
    hand.data, mesh = None, bpy.data.meshes.new("Finger")
    holder = bpy.data.objects.new("Finger Mesh", mesh)
    bpy.data.objects.remove(hand)
    holder.name = "Finger"
    scene.collection.objects.link(holder)
    holder.dermis.role = "FINGER"
    track = track_of(timing, scene)
    command_curves.write(scene, store.current(scene), rate=rate)
    assert store.state(scene) == "fresh"
    for frame in range(timing.first, timing.last):
        scene.frame_set(frame)
        expected = np.interp((frame - timing.first) / timing.rate, track.times, track.values[:, 0])
        assert mesh["haptip tactor_x (mm)"] == pytest.approx(1e3 * expected, abs=1e-5)


# films


def test_a_films_skin_moves_at_the_frames_shown(timing: Timing) -> None:
    timing = timing._replace(base=1.0)
    scene = pressed(timing)
    assert bpy.ops.dermis.bake() == {"FINISHED"} and bpy.ops.dermis.film_skin() == {"FINISHED"}
    (obj,) = film_objects.of_kind(scene, "skin")
    touch = store.current(scene).bake.skins["Finger"]
    for k in (0, 1, 2, 3, 6, 12):
        row, values, _ = skin_mesh._row("Finger", touch, timing.first + k, scene.dermis.skin_view.exaggeration)
        scene.frame_set(timing.first + k)
        data = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        points = np.empty(3 * len(data.vertices), np.float32)
        data.attributes["position"].data.foreach_get("vector", points)
        pressure = np.empty(len(data.vertices), np.float32)
        data.attributes["pressure"].data.foreach_get("value", pressure)
        assert np.abs(points.reshape(-1, 3)[: len(row)] - row).max() < 1e-7
        assert np.abs(pressure[: len(row)] - values["pressure"]).max() <= 1e-4 * max(values["pressure"].max(), 1.0)
    assert values["pressure"].max() > 1e3  # [Pa]


def test_a_films_twin_moves_at_the_frames_shown(timing: Timing) -> None:
    scene, hand = moving(timing)
    track_of(timing, scene)
    scene.dermis.twin_exaggeration = 1.0
    assert bpy.ops.dermis.film_twins() == {"FINISHED"}
    cap = next(o for o in film_objects.of_kind(scene, "twin") if o[film_objects.PIECE] == "Cap")

    def place(frame: float) -> np.ndarray:
        scene_time.go_to(scene, frame)
        graph = bpy.context.evaluated_depsgraph_get()
        there = hand.evaluated_get(graph).matrix_world.inverted() @ cap.evaluated_get(graph).matrix_world
        return np.array(there)[:3, 3]

    begin = place(timing.first)
    for k in (1.0, 5.0, 6.5, 11.0):
        moved = np.linalg.norm(place(timing.first + k) - begin)
        assert moved == pytest.approx(1e-3 * k / timing.rate, abs=2e-7)
