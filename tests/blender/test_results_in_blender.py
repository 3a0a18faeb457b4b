"""Results where people look: plots as images, what an export wrote, bakes that come back with their file."""

from __future__ import annotations

import wave
from pathlib import Path

import aud
import bpy
import numpy as np
import pytest

from blender_addon import handlers, reporting
from blender_addon.preferences import user_folder
from blender_addon.results import exported, plots, recall, store, stored_skins
from blender_addon.timeline import strip
from core.track import export as track_export

from .build import cube, finger, keys, span
from .stand_in import Anything, draw_panels

pytestmark = pytest.mark.shared_cases("formats of the engine")

FINGERS = {"Index", "Reader", "Thumb"}


@pytest.fixture
def demo() -> bpy.types.Scene:
    """Return the demo scene, baked."""
    bpy.ops.dermis.demo_scene()
    bpy.ops.dermis.bake()
    return bpy.context.scene


def pixels(image: bpy.types.Image) -> np.ndarray:
    return np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], 4)


def test_plots_are_images_of_their_tracks(demo: bpy.types.Scene) -> None:
    assert bpy.ops.dermis.show_plots() == {"FINISHED"}
    images = {i.name.removeprefix("Plot "): i for i in bpy.data.images if plots.MARK in i}
    assert set(images) == {"Index.haptip", "Thumb.haptip", "Reader.electrovibration"}
    picture = pixels(images["Index.haptip"])
    assert picture.shape[1] == 1380 and picture[..., :3].std() > 0.05
    assert images["Index.haptip"].packed_file is not None  # it is saved with the file


def test_another_request_replaces_the_plots_and_who_shows_them_goes_on(demo: bpy.types.Scene) -> None:
    first = plots.make(store.current(demo))
    number = len(bpy.data.images)
    texture = bpy.data.textures.new("Shows it", "IMAGE")
    texture.image = first["Index.haptip"]
    again = plots.make(store.current(demo))
    assert len(bpy.data.images) == number and texture.image == again["Index.haptip"]
    assert texture.image.name == "Plot Index.haptip"


@pytest.mark.parametrize("form", ["csv", "json", "binary", "c"])
def test_every_format_is_written_with_plots_beside(demo: bpy.types.Scene, tmp_path: Path, form: str) -> None:
    assert exported.last(demo) is None and not bpy.ops.dermis.open_export.poll()
    assert bpy.ops.dermis.export_tracks(directory=str(tmp_path), form=form, plots=True) == {"FINISHED"}
    names = sorted(path.name for path in tmp_path.iterdir())
    suffix = {"csv": ".csv", "json": ".json", "binary": ".dtrack", "c": ".h"}[form]
    stems = ("Index.haptip", "Reader.electrovibration", "Thumb.haptip")
    assert names == sorted(f"{stem}{end}" for stem in stems for end in (suffix, ".png"))
    last = exported.last(demo)
    assert last is not None and last.folder == tmp_path and sorted(p.name for p in last.files) == names
    assert bpy.ops.dermis.open_export.poll()
    if form in ("json", "binary"):
        read = track_export.read(tmp_path / f"Index.haptip{suffix}")
        track = store.current(demo).bake.outputs[0].track
        assert np.allclose(read.values, track.values, atol=1e-6)


def test_a_screen_becomes_a_wav_with_the_settings_of_the_panel(demo: bpy.types.Scene, tmp_path: Path) -> None:
    layout = Anything()
    draw_panels(layout)
    assert "full_scale" not in layout.words
    demo.dermis.export_format, demo.dermis.wav.rate, demo.dermis.wav.gain = "wav", 96_000, 100.0
    draw_panels(layout)
    bpy.ops.dermis.export_tracks(directory=str(tmp_path), form="wav")
    assert [path.name for path in tmp_path.iterdir()] == ["Reader.electrovibration.wav"]
    codes = {finding.code for finding in reporting.findings()}
    assert {"refused", "open-loop"} <= codes  # two tactors have no waveform
    track = next(o.track for o in store.current(demo).bake.outputs if o.finger == "Reader")
    with wave.open(str(tmp_path / "Reader.electrovibration.wav")) as file:
        assert file.getframerate() == 96_000 and file.getnframes() == int(track.duration * 96_000 + 1e-6) + 1
    sound = aud.Sound.file(str(tmp_path / "Reader.electrovibration.wav"))  # Blender's own reader of sounds
    peak = float(np.abs(sound.data()).max())
    assert sound.specs == (96_000.0, 1) and peak * 300.0 == pytest.approx(track.column("amplitude").max(), rel=5e-3)
    demo.dermis.wav.full_scale = 0.5
    bpy.context.view_layer.objects.active = bpy.data.objects["Reader"]
    with pytest.raises(RuntimeError, match="beyond full scale"):
        bpy.ops.dermis.export_as(directory=str(tmp_path / "as"), form="wav", active_only=True)
    demo.dermis.wav.clip = True
    bpy.ops.dermis.export_as(directory=str(tmp_path / "as"), form="wav", active_only=True)
    assert "clipped" in {finding.code for finding in reporting.findings()}


def test_the_box_goes_with_the_next_bake(demo: bpy.types.Scene, tmp_path: Path) -> None:
    bpy.ops.dermis.export_tracks(directory=str(tmp_path))
    assert exported.last(demo) is not None
    layout = Anything()
    draw_panels(layout)
    assert layout.words.count("Wrote 3 files") == 1  # in the head, and not again under Export
    bpy.ops.dermis.bake()
    assert exported.last(demo) is None


def test_a_stored_bake_comes_back_after_loading_and_nothing_is_written(demo: bpy.types.Scene, tmp_path: Path) -> None:
    bake = store.current(demo).bake
    file = tmp_path / "demo.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.open_mainfile(filepath=str(file))
    scene = bpy.context.scene
    assert store.current(scene) is None  # without a window nothing is read by itself
    results = user_folder("results")
    before = {p: p.stat().st_mtime_ns for p in results.rglob("*")}
    assert recall.work() == 1
    assert {p: p.stat().st_mtime_ns for p in results.rglob("*")} == before
    assert store.state(scene) == "earlier"
    back = store.current(scene).bake
    assert [o.track.values.tobytes() for o in back.outputs] == [o.track.values.tobytes() for o in bake.outputs]
    assert reporting.source() == f"Stored bake of {scene.name}"
    assert recall.work() == 0  # it is there
    layout = Anything()
    draw_panels(layout)
    assert "result is from an earlier session:" in " ".join(layout.words)
    assert strip.of(scene).state == "earlier"


def test_a_bake_that_is_gone_is_left_alone(demo: bpy.types.Scene) -> None:
    store.forget()
    demo.dermis.bake_key = "0" * 64
    assert recall.work() == 0 and store.current(demo) is None


def test_a_damaged_one_is_said_and_the_file_opens(demo: bpy.types.Scene) -> None:
    path = store.cache().get(store._key(demo.dermis.bake_key))
    path.write_bytes(path.read_bytes()[:100])
    store.forget()
    assert recall.work() == 0
    assert [f.severity for f in reporting.findings()] == ["error"]


def test_opening_a_file_in_background_starts_no_timer() -> None:
    handlers._on_load()
    assert not bpy.app.timers.is_registered(recall._on_timer)


@pytest.fixture
def pressed() -> bpy.types.Scene:
    """Return a scene with the bake of a skin, stored and read again."""
    scene = span(1, 5)
    hand = finger()
    hand.dermis.finger.skin.shown, hand.dermis.finger.skin.level = True, "draft"
    cube("Plate", 0.04, (0.0, 0.0, -0.02))
    keys(hand, "location", [1, 3, 5], np.array([[0, 0, 0.02], [0, 0, -1e-3], [0, 0, -1e-3]]))
    scene.dermis.sample_rate = 24.0
    bpy.ops.dermis.bake()
    return scene


def test_stored_skins_are_read_when_they_are_first_needed(pressed: bpy.types.Scene) -> None:
    force = store.current(pressed).bake.skins["Finger"].normal_force
    store.forget()
    result = store.load(pressed)
    skins = result.bake.skins
    assert isinstance(skins, stored_skins.StoredSkins) and skins._read is None
    assert len(skins) == 1 and bool(skins)
    (lane,) = strip.of(pressed).lanes
    assert np.array_equal(lane.series["force"][0].values, force)
    assert skins._read is None  # neither counting nor the strip needs a model
    assert np.array_equal(skins["Finger"].normal_force, force) and skins._read is not None
    assert skins.get("Nobody") is None


def test_skins_whose_file_is_gone_meanwhile_are_missing_and_said(pressed: bpy.types.Scene) -> None:
    store.forget()
    result = store.load(pressed)
    store.cache().clear()
    assert dict(result.bake.skins) == {} and len(result.bake.skins) == 0
    assert [f.severity for f in reporting.findings()] == ["error"]


def test_the_demo_bakes_without_warnings(demo: bpy.types.Scene) -> None:
    assert [str(f) for f in reporting.findings() if f.severity != "info"] == []


@pytest.mark.parametrize("fingers", ["ONE", "FIVE"])
def test_the_camera_sees_every_finger(fingers: str) -> None:
    from bpy_extras.object_utils import world_to_camera_view

    bpy.ops.dermis.demo_skin_scene(fingers=fingers)
    scene = bpy.context.scene
    for frame in range(scene.frame_start, scene.frame_end + 1, 12):
        scene.frame_set(frame)
        for obj in (o for o in scene.objects if o.dermis.role == "FINGER"):
            places = (world_to_camera_view(scene, scene.camera, obj.matrix_world @ v.co)[:2] for v in obj.data.vertices)
            seen = np.array(list(places))
            assert seen.min() > 0.0 and seen.max() < 1.0, f"{obj.name} at frame {frame}"
