"""Platforms in Blender: tables, scrubbing, baking and export, settings, twins, and the six interactions as scenes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon import baking, choices
from blender_addon._core import core
from blender_addon.demos import demo_motors, touches
from blender_addon.devices import platform_devices, readiness
from blender_addon.preferences import library
from blender_addon.preview import device_preview
from blender_addon.preview import skin_preview as skins
from blender_addon.properties import object_properties
from blender_addon.results import store
from blender_addon.viewport import platform_card, platform_twin, twins
from blender_addon.viewport import shown as views
from core.recent import Recent
from core.steps import drain

pytestmark = pytest.mark.shared_tests("the engine's platforms")

ROWS = 216  # six steps a motor: coarse, and there in a moment


@pytest.fixture
def own_folders(tmp_path, monkeypatch):
    """Keep presets, tables and skins of these tests apart."""
    from blender_addon import preferences
    from blender_addon.design import design_results
    from blender_addon.devices import skin_models

    def folder(name, *, create=False):
        path = tmp_path / name
        if create:
            path.mkdir(parents=True, exist_ok=True)
        return path

    for module in (preferences, platform_devices, skin_models, design_results):
        monkeypatch.setattr(module, "user_folder", folder)
    monkeypatch.setattr(core.matching.lookup, "_TABLES", Recent(core.matching.lookup.TABLES))
    skin_models.forget()
    choices.refresh()
    yield tmp_path
    skin_models.forget()
    choices.forget()


@pytest.fixture
def demo(own_folders):
    """Return the flat interaction's first touch, shown, and its finger."""
    return shown("flat")


def shown(which: str, device: str = "cable_platform"):
    scene = demo_motors.build(which, device)
    bpy.context.window.scene = scene
    finger = scene.objects["Index"]
    bpy.context.view_layer.objects.active = finger
    finger.dermis.finger.devices[0].table_rows = ROWS
    scene.frame_start, scene.frame_end = 1, 60
    return scene, finger


def test_the_demos_surface_moves_as_the_engines_interaction(demo) -> None:
    scene, _ = demo
    model = core.skin.model.fingertip_skin(level="draft")
    touch = core.design.interactions.interaction("flat", demo_motors.felt_at(model), seed=0)
    surface, chunk = scene.objects["Surface"], touch.chunks[0]
    for sample in (0, 57, 130, 333, 1001):
        frame = float(chunk.frames[sample])
        scene.frame_set(int(frame), subframe=frame - int(frame))
        now = np.array(surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
        np.testing.assert_allclose(now, chunk.bodies[0, sample], atol=3e-6)


@pytest.mark.parametrize("which", list(touches.MOTORS))
def test_every_interaction_opens_with_its_own_length(own_folders, which) -> None:
    assert bpy.ops.dermis.demo_motors_scene(touch=which, seed=3) == {"FINISHED"}
    scene = next(s for s in bpy.data.scenes if s.name.startswith(f"{demo_motors.NAME}: {touches.MOTORS[which][0]}"))
    stops = len(core.design.interactions.STOPS[which])
    assert (scene.frame_end - 1) / scene.render.fps == pytest.approx(3 * (stops + 1) + 1, abs=0.04)
    assert scene.objects["Surface"].dermis.role == "TOUCHABLE"


def test_without_a_table_scrubbing_leaves_the_platform_out_and_sweeps_nothing(demo, monkeypatch) -> None:
    scene, finger = demo
    device = finger.dermis.finger.devices[0]

    def never(*_args, **_kwargs):
        raise AssertionError("a table was swept while scrubbing")

    monkeypatch.setattr(core.matching.lookup, "build", never)
    assert platform_devices.missing(finger, device)
    for shown_skin in (True, False):
        finger.dermis.finger.skin.shown = shown_skin
        scene.frame_set(20)
        assert device_preview.step(bpy.context).rows == ()


@pytest.mark.parametrize("device", ["cable_platform", "hexapod"])
def test_with_a_table_scrubbing_shows_what_a_bake_would(own_folders, device) -> None:
    scene, finger = shown("flat", device)
    assert bpy.ops.dermis.make_table() == {"FINISHED"}
    assert not platform_devices.missing(finger, finger.dermis.finger.devices[0])
    scene.frame_set(38)  # pressed in
    device_preview.step(bpy.context)
    skins.step(bpy.context)
    row = next(r for r in views.devices(scene).rows if r.device == device)
    state = skins.own(scene)[0]
    table = platform_devices.table(finger, finger.dermis.finger.devices[0])
    sensed = core.matching.readings.readings_of(state.model).counts(np.asarray(state.force)[None])
    expected = core.matching.lookup.commands_of(table, sensed)[0]
    assert state.touching and row.contact == 1.0
    np.testing.assert_allclose(list(row.values.values()), expected)
    finger.dermis.finger.skin.shown = False  # it is followed all the same
    device_preview.step(bpy.context)
    skins.step(bpy.context)
    hidden = next(r for r in views.devices(scene).rows if r.device == device)
    np.testing.assert_allclose(list(hidden.values.values()), expected)


def test_a_stopped_sweep_leaves_no_table_and_no_process(demo) -> None:
    _, finger = demo
    device = finger.dermis.finger.devices[0]
    work = core.work.child
    before = set(work._owners)
    steps = platform_devices.make(finger, device)
    for _ in range(3):
        next(steps)
    steps.close()
    assert set(work._owners) == before and platform_devices.missing(finger, device)


def test_the_panel_knows_of_the_table_that_a_bake_made(demo) -> None:
    scene, finger = demo
    scene.frame_set(38)
    skins.step(bpy.context)  # its skin is there
    assert readiness.of(finger)["platform"] == (None, "")
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    assert len(readiness.of(finger)["platform"].figures.commands) > 1


def test_bake_makes_the_table_with_progress_and_export_passes_the_check(demo, tmp_path) -> None:
    scene, finger = demo
    stages = []
    from blender_addon.preferences import library as presets

    bake = drain(baking.bake(scene, presets()), lambda p: stages.append(p.stage))
    assert "platform configurations" in stages and not platform_devices.missing(finger, finger.dermis.finger.devices[0])
    store.keep(scene, bake)
    assert bpy.ops.dermis.export_tracks(directory=str(tmp_path / "tracks")) == {"FINISHED"}
    track = core.track.csv.read(tmp_path / "tracks" / "Index.cable_platform.csv")
    assert track.values.shape[1] == 3 and not [f for f in track.check() if f.severity == "error"]
    assert track.meta["method"] == "lookup" and track.values.max() > 1.0  # [rad] the platform comes to the finger


def test_the_table_file_of_another_device_is_told_on_scrub_and_bake(demo, tmp_path) -> None:
    scene, finger = demo
    device = finger.dermis.finger.devices[0]
    model = platform_devices.model_of(finger)
    other = core.matching.table.build(library().device("hexapod"), model, core.matching.readings.readings_of(model), 64)
    other.save(tmp_path / "other.npz")
    device.table = str(tmp_path / "other.npz")
    errors = core.errors
    with pytest.raises(errors.DermisError, match="another device"):
        platform_devices.table(finger, device)
    assert not platform_devices.missing(finger, device)
    bake = drain(baking.bake(scene, library()))
    assert not bake.outputs and any("another device" in str(f) for f in bake.all_findings)


def test_settings_have_units_and_tooltips_and_reach_the_engine(demo) -> None:
    _, finger = demo
    device = finger.dermis.finger.devices[0]
    for name in ("table", "table_rows"):
        assert len(device.bl_rna.properties[name].description) > 40
    assert object_properties.parameters(device)["table_rows"] == ROWS
    assert platform_devices.absolute({"table": "//a.npz"})["table"] == bpy.path.abspath("//a.npz")


def test_the_cable_twin_is_in_balance_with_the_skin(demo) -> None:
    """Cable tensions shown are those that carry springs and skin: force on the platform adds up to nothing."""
    _, finger = demo
    spec, model = library().device("cable_platform"), platform_devices.model_of(finger)
    table = core.matching.table
    device = core.matching.platforms.mechanism(spec)
    command = core.matching.sweep.sweep(spec, model.positions, 27)[0][-2]
    at = platform_twin.state(spec, command, model, True)
    pressed = table.press_of(model, spec).press(command[None])
    load = -(pressed.force[0].astype(float)).sum(axis=0)
    arms = at.joints - at.base
    length = np.linalg.norm(arms, axis=1, keepdims=True)
    pull = at.tension[:, None] + device.spring * (length - device.free_length)
    aside = device.bending * (at.joints - (device.joints + [0.0, 0.0, device.height]))
    aside[:, 2] = 0.0
    left = (-pull * arms / length - aside).sum(axis=0) + load
    assert np.linalg.norm(load) > 0.2 and np.abs(left).max() < 0.02
    assert at.tension.min() >= 0.0
    np.testing.assert_allclose(at.share, at.tension / device.tension_limit)
    colours = [platform_twin.parts(at).colours]
    assert np.isfinite(colours[0]).all()


def test_the_six_leg_twin_closes_its_legs(own_folders) -> None:
    spec = library().device("hexapod")
    rest = np.array([c.rest for c in spec.channels])
    at = platform_twin.state(spec, rest + 1e-3 * np.array([1, -1, 2, 0, 1, -2]), None, False)
    np.testing.assert_allclose(
        np.linalg.norm(at.joints - at.base, axis=1) - rest, 1e-3 * np.array([1, -1, 2, 0, 1, -2]), atol=1e-8
    )
    assert at.tension is None
    part = platform_twin.parts(at)
    assert part.triangles.max() == len(part.positions) - 1


def test_the_card_says_angles_in_degrees_and_lengths_in_millimetres(demo) -> None:
    scene, _ = demo
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    scene.frame_set(38)
    row = views.devices(scene).rows[0]
    words = [text for _, _, text in platform_card.lines_of(row)]
    assert len(words) == 3 and all(text.endswith("°") for text in words)
    assert twins.twin_of(scene, row) is twins.twin_of(scene, row) is not None  # worked out once
