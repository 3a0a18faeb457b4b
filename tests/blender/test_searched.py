"""Devices that are searched for a pose, in Blender: six legs matched by stress, and the floor of a baked touch."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon import choices
from blender_addon._core import core
from blender_addon.demos import demo_thimble
from blender_addon.devices import active_presets, platform_devices, readiness, thimble_adaptation
from blender_addon.preview import device_preview, skin_preview, thimble_preview
from blender_addon.results import floors, store
from blender_addon.viewport import platform_card
from blender_addon.viewport import shown as views
from core.steps import drain

pytestmark = pytest.mark.shared_tests("the engine searches")


@pytest.fixture
def ball():
    """Return the ball scene, its finger and its thimble."""
    choices.refresh()
    scene = demo_thimble.build("BALL")
    bpy.context.window.scene = scene
    finger = scene.objects["Index"]
    bpy.context.view_layer.objects.active = finger
    scene.frame_start, scene.frame_end = 1, 40
    return scene, finger, finger.dermis.finger.devices[0]


@pytest.fixture
def legs(ball):
    """Return the same scene with six legs in the thimble's place."""
    scene, finger, device = ball
    device.preset = "hexapod"
    device.platform_method = "stress"
    return scene, finger, device


def baked(scene):
    """Bake and return the result."""
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return store.current(scene)


def drawn(panel, context=None):
    """Return what a panel draws, as words: labels, operators and properties."""
    words = []

    class Layout:
        """Takes down what is drawn."""

        def __getattr__(self, name):
            def call(*args, **keys):
                words.extend(str(a) for a in (*args, *keys.values()) if isinstance(a, str))
                return Layout()

            return call

    drawn_by = type("Drawn", (), {"layout": Layout()})()
    panel.draw(drawn_by, context or bpy.context)
    return words


def test_six_legs_need_no_table_when_they_are_searched(legs):
    scene, finger, device = legs
    assert active_presets.searched(device).kind == "hexapod" and active_presets.searched_of(finger) == device
    assert not platform_devices.missing(finger, device)
    device.platform_method = "lookup"
    device.table_rows = 777  # of which nobody keeps a table
    assert active_presets.searched(device) is None and platform_devices.missing(finger, device)
    device.preset = "cable_platform"
    device.platform_method = "stress"
    assert active_presets.searched(device) is None


def test_six_legs_bake_scrub_and_show_the_rendered_skin(legs):
    scene, finger, device = legs
    scene.frame_set(1)
    finger.dermis.finger.skin.shown = True
    scene.dermis.thimble_view.split = True
    for frame in range(2, 24):
        scene.frame_set(frame)
        device_preview.step(bpy.context)
        skin_preview.step(bpy.context)
    row = next(r for r in views.devices(scene).rows if r.device == "hexapod")
    assert not thimble_preview.failure("Index")
    live = np.array(list(row.values.values()))
    assert row.contact == 1.0 and 0.0 < row.signals["mismatch"] < 0.6 and live.shape == (6,)
    assert len(platform_card.lines_of(row)) == 6
    rendered = thimble_preview.rendered(scene, skin_preview.own(scene))
    assert len(rendered) == 1 and rendered[0].finger == "Index: platform"
    assert rendered[0].work == "rendered" and rendered[0].normal_force > 0.05
    output = baked(scene).bake.outputs[0]
    assert output.track.meta["method"] == "stress" and output.signals["mismatch"].max() > 0.0
    at = int(np.abs(output.track.times - 22 / scene.render.fps).argmin())
    told = output.signals
    # other samples lead to another minimum among those of a round ball, but the touch is the same
    assert told["normal_force"][at] == pytest.approx(rendered[0].normal_force, rel=0.3)
    assert told["mismatch"][at] < 0.8  # its legs are slow: what a frame shows is where they would be
    low, high = ([getattr(c, end) for c in output.track.spec.channels] for end in ("low", "high"))
    assert ((output.track.values >= low) & (output.track.values <= high)).all()


def test_of_a_bake_the_panel_tells_its_error_and_no_wait_of_the_preview_before(ball, monkeypatch):
    """A preview that waits for its tables stops where a bake is shown, so its last words stay."""
    scene, finger, device = ball
    scene.frame_set(1)
    finger.dermis.finger.skin.shown = scene.dermis.thimble_view.split = True
    for frame in range(2, 24):
        scene.frame_set(frame)
        device_preview.step(bpy.context)
        skin_preview.step(bpy.context)
    thimble_preview.rendered(scene, skin_preview.own(scene))
    path = thimble_preview._paths["Index"]
    monkeypatch.setattr(path, "error", "preparing Thimble 3-RRS: 0%")
    baked(scene)
    scene.frame_set(30)
    views.renew(scene)
    words = " ".join(drawn(bpy.types.DERMIS_PT_thimble))
    assert "Error of the match" in words and "preparing" not in words


def test_six_legs_that_are_coupled_are_refused_in_words(legs):
    spec = core.presets.Library().device("cable_platform")
    with pytest.raises(core.errors.DermisError, match="only six legs with a motor each"):
        core.matching.thimble_use.by_stress(spec, {"platform_method": "stress"})


@pytest.mark.one_line("3.13", "the engine searches in a child; the rest of this file runs on both lines")
def test_six_legs_learn_a_finger(legs, tmp_path, monkeypatch):
    scene, finger, device = legs
    monkeypatch.setattr(
        thimble_adaptation.thimble_devices, "user_folder", lambda name, create=False: _made(tmp_path / name)
    )
    made = drain(thimble_adaptation.adapt(finger, trajectories=40, iterations=8))
    assert int(made["samples"]) > 100 and np.isfinite(made["errors"]).all()
    device.platform_method = "ridge"
    readiness.forget()
    output = baked(scene).bake.outputs[0]
    assert output.track.meta["method"] == "ridge" and not [f for f in output.findings if f.code == "surrogate"]


def _made(path):
    path.mkdir(parents=True, exist_ok=True)
    return path


@pytest.mark.parametrize("preset", ["thimble_3rrs", "hexapod"])
def test_the_floor_is_found_and_shown(ball, preset, monkeypatch):
    scene, finger, device = ball
    device.preset = preset
    device.platform_method = "stress"
    with pytest.raises(RuntimeError):  # nothing is baked
        bpy.ops.dermis.find_floor()
    scene.frame_end = 24
    baked(scene)
    monkeypatch.setattr(core.matching.floor, "MOST", 8)
    assert floors.shown(scene, finger, device) is None
    assert bpy.ops.dermis.find_floor() == {"FINISHED"}
    found = floors.shown(scene, finger, device)
    assert 0.0 < found.best[0] <= found.rendered[0] and found.samples >= 1
    assert (found.lateral is None) == (preset == "hexapod")
    panel = bpy.types.DERMIS_PT_thimble if preset == "thimble_3rrs" else bpy.types.DERMIS_PT_platform
    views.renew(scene)
    words = drawn(panel)
    assert "dermis.find_floor" in words and "best pose found" in words
    assert any(f"{100 * found.best[0]:.0f} / " in word for word in words)
    assert ("lateral axes too" in words) == (preset == "thimble_3rrs")
    scene.frame_end = 25
    baked(scene)
    assert floors.shown(scene, finger, device) is None  # it was of another touch


def test_a_floor_can_be_stopped(ball):
    scene, finger, device = ball
    baked(scene)
    steps = floors.find(scene, finger)
    next(steps)
    steps.close()
    assert floors.shown(scene, finger, device) is None
