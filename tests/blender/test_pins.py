"""Pin arrays in Blender: settings, press test, comparison, the demo, and what the view draws."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon import choices, panels, reporting
from blender_addon._core import core
from blender_addon.demos import demo_pins
from blender_addon.preferences import library
from blender_addon.preview import device_preview, pin_preview, skin_preview
from blender_addon.properties import object_properties
from blender_addon.results import pin_reports, store
from blender_addon.viewport import pin_card, pin_twin
from blender_addon.viewport import shown as views
from core.scene.sliding import sliding_plane

from .stand_in import Anything, Panel

pytestmark = pytest.mark.shared_tests("the engine's pins")


@pytest.fixture
def demo():
    """Return the demo scene, shown."""
    choices.refresh()
    scene = demo_pins.build(1.5e-3, 0.5, 0.0)
    bpy.context.window.scene = scene
    finger = scene.objects["Index"]
    finger.dermis.finger.skin.level = "draft"
    bpy.context.view_layer.objects.active = finger
    return scene


def bake(scene: bpy.types.Scene):
    """Bake a few frames and return the result."""
    scene.frame_start, scene.frame_end = 1, 19
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return store.current(scene)


def test_settings_reach_the_track(demo) -> None:
    device = demo.objects["Index"].dermis.finger.devices[0]
    device.pin_method, device.pin_lead, device.pin_fade_out = "FM1", False, 0.0
    output = bake(demo).bake.outputs[0]
    assert output.track.meta["method"] == "FM1" and output.track.meta["lead_s"] == "0"
    assert output.track.values.shape[1] == 128 and output.track.values[-1].any()
    assert not output.track.values[0].any()  # it fades in
    assert {"pin_method", "pin_nodes"} <= set(object_properties.parameters(device))


def test_the_demos_bake_is_the_engines_own_experiment(demo) -> None:
    scene = sliding_plane(1.5e-3, 0.5)
    at = demo.objects["Plane"]
    for frame in (5, 1, 10, 30, 61):
        demo.frame_set(frame)
        sample = int(np.argmin(np.abs(scene.chunks[0].frames - frame)))
        now = at.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world.translation
        np.testing.assert_allclose(now, scene.chunks[0].bodies[0, sample, :3, 3], atol=2e-6)


def test_a_press_test_gives_alpha_and_can_be_undone(demo) -> None:
    skin = demo.objects["Index"].dermis.finger.skin
    model = core.skin.model.skin_from_parameters({}, level="draft")
    loads = 0.73 * core.matching.press_test.press_loads(model)
    names = {f"load_{k + 1}": float(f) for k, f in enumerate(loads)}
    skin.alpha = 0.9  # what is there must not matter
    assert bpy.ops.dermis.press_test(**names) == {"FINISHED"}
    assert skin.alpha == pytest.approx(0.73, rel=2e-3)  # a preset's lengths in single precision
    assert pin_reports.calibrated[bpy.data.objects["Index"].session_uid].residual < 5e-3
    assert "UNDO" in bpy.types.Operator.bl_rna_get_subclass_py("DERMIS_OT_press_test").bl_options


@pytest.mark.parametrize(
    ("loads", "words"),
    [
        ({}, "number|two readings"),
        ({"load_2": 1.0}, "two readings"),
        ({"load_1": 1.0, "load_2": 0.9}, "does not rise"),
        ({"load_1": -0.2, "load_2": 0.9}, "negative"),
    ],
)
def test_nonsense_is_refused_and_changes_nothing(demo, loads, words) -> None:
    skin = demo.objects["Index"].dermis.finger.skin
    skin.alpha = 0.8
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.dermis.press_test(**loads)
    assert skin.alpha == pytest.approx(0.8)


def test_methods_are_compared_for_the_bake_at_hand(demo) -> None:
    finger = demo.objects["Index"]
    with pytest.raises(RuntimeError, match="not baked"):
        bpy.ops.dermis.compare_pins()
    result = bake(demo)
    assert bpy.ops.dermis.compare_pins() == {"FINISHED"}
    shown = pin_reports.shown(demo, finger)
    direct = core.matching.pin_report.compare(result.bake.skins["Index"], library().device("pin_array_128"))
    assert [r.method for r in shown] == [r.method for r in direct]
    np.testing.assert_allclose([r.displacement_error for r in shown], [r.displacement_error for r in direct])
    (doubt,) = pin_reports.doubts(demo, finger)
    assert doubt.code == "coarse-skin" and doubt.where == "finger 'Index'"  # a draft skin under 126 pins
    finger.dermis.finger.devices[0].pin_method = "FM2"
    bake(demo)
    assert not pin_reports.shown(demo, finger) and not pin_reports.doubts(demo, finger)  # of another bake


def test_the_result_counts_the_samples_at_a_limit_and_findings_name_the_finger(demo) -> None:
    demo.objects["Index"].dermis.finger.skin.young_kpa = 250.0  # so stiff that pins need more than their 0.4 N
    output = bake(demo).bake.outputs[0]
    layout = Anything()
    Panel(panels.bake.DERMIS_PT_result, layout).draw(bpy.context)
    count = int(np.count_nonzero(output.signals["at_limit"]))
    assert count > 0 and f"{count:,} samples at a limit" in layout.words
    ours = [finding for finding in output.findings if "pin array" in finding.where]
    assert ours and {finding.where for finding in ours} == {"finger 'Index', pin array"}
    reporting.show(ours)
    assert reporting.about(reporting.findings()[0], demo) == demo.objects["Index"]


def test_a_finger_that_touched_nothing_is_refused_by_name(demo) -> None:
    demo.objects["Index"].location.z += 1.0
    bake(demo)
    with pytest.raises(RuntimeError, match="finger 'Index'.*nothing was touched"):
        bpy.ops.dermis.compare_pins()


def test_the_view_shows_the_bakes_pins(demo) -> None:
    result = bake(demo)
    demo.frame_set(15)
    shown = views.devices(demo)
    row = next(r for r in shown.rows if r.kind == "pin_array")
    expected = store.values_at(result, result.bake.outputs[0], 15.0)
    np.testing.assert_allclose(row.numbers, expected)
    pins = pin_preview.pins_of(demo.objects["Index"], "pin_array_128")
    part = pin_twin.discs(pins, row.numbers)
    hits = np.isfinite(pins.points[:, 0])
    assert len(part.positions) == hits.sum() * (1 + pin_twin.SIDES + 4)
    assert part.triangles.max() == len(part.positions) - 1
    centres = part.positions.reshape(hits.sum(), -1, 3)[:, 0]
    np.testing.assert_allclose(centres, pins.points[hits] - pin_twin.LIFT * pins.directions[hits], atol=1e-8)
    radii = np.linalg.norm(part.positions.reshape(hits.sum(), -1, 3)[:, 1] - centres, axis=1)
    forces = row.numbers[hits]
    assert np.all(np.diff(radii[np.argsort(forces)]) >= -1e-9)  # a larger disc for a larger force
    assert pin_card.grid(row, pins) == (8, 16)


def test_the_rendered_skin_stands_beside_the_target(demo) -> None:
    bake(demo)
    demo.frame_set(15)
    target, rendered = views.skins(demo)
    pins = core.matching.pins
    ready = pins.setup(target.model, library().device("pin_array_128"))
    solver = core.matching.deformation.PinSolver(ready.matcher, "DM2")
    expected = pins.rendered_force(ready, solver.solve(target.force).forces)
    np.testing.assert_allclose(rendered.force, expected, atol=1e-12)
    assert target.points is not None and rendered.points is None  # what is drawn beneath is not the target's
    assert rendered.finger == "Index: DM2 pins" and target.finger == "Index"


@pytest.mark.parametrize("shown", [True, False])
def test_live_pins_match_the_bake_and_do_not_fade_at_the_frame_that_is_shown(demo, shown) -> None:
    finger = demo.objects["Index"].dermis.finger
    finger.skin.shown, finger.devices[0].pin_lead = shown, False
    for frame in range(1, 12):
        demo.frame_set(frame)
        device_preview.step(bpy.context)
        skin_preview.step(bpy.context)
    rows = [r for r in views.devices(demo).rows if r.kind == "pin_array"]
    assert len(rows) == 1
    forces = rows[0].numbers
    finger.devices[0].pin_fade_in = finger.devices[0].pin_fade_out = 0.0
    baked = store.values_at(bake(demo), store.current(demo).bake.outputs[0], 11.0)
    # the preview takes one sample a frame, the bake ten; the press is at rest by then
    assert np.linalg.norm(forces - baked) < 0.04 * np.linalg.norm(baked) and baked.sum() > 0.45


def test_a_scene_with_pins_holds_blas_at_one_thread_and_others_do_not(demo) -> None:
    from blender_addon.devices import skin_models
    from blender_addon.sampling import scene_sweep

    finger = demo.objects["Index"].dermis.finger
    finger.skin.shown = False
    assert skin_models.solved_in(scene_sweep.sample(demo), library())
    finger.devices[0].preset = "haptip"
    assert not skin_models.solved_in(scene_sweep.sample(demo), library())
    finger.devices[0].preset = "not there"
    assert not skin_models.solved_in(scene_sweep.sample(demo), library())
