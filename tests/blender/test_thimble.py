"""Thimbles in Blender: settings, twin, target and rendered skin, mismatch, panel, plot."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon import baking, choices
from blender_addon._core import core
from blender_addon.demos import demo_thimble
from blender_addon.devices import skin_models, thimble_devices
from blender_addon.preferences import library
from blender_addon.preview import device_preview, skin_preview, thimble_preview
from blender_addon.properties import object_properties
from blender_addon.results import store
from blender_addon.streaming import reported_values
from blender_addon.viewport import shown as views
from blender_addon.viewport import thimble_card, thimble_twin, twins
from core.contact.skin_contact import SkinContact

pytestmark = pytest.mark.shared_tests("the engine's thimble")


@pytest.fixture
def demo():
    """Return the ball scene, shown."""
    choices.refresh()
    scene = demo_thimble.build("BALL")
    bpy.context.window.scene = scene
    bpy.context.view_layer.objects.active = scene.objects["Index"]
    return scene


def bake(scene: bpy.types.Scene, last: int = 40):
    """Bake some frames and return the result."""
    scene.frame_start, scene.frame_end = 1, last
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return store.current(scene)


def device_of(scene: bpy.types.Scene):
    """Return the settings of the thimble on 'Index'."""
    return scene.objects["Index"].dermis.finger.devices[0]


def test_settings_reach_the_engine(demo) -> None:
    device = device_of(demo)
    device.thimble_method, device.thimble_hover_mm = "force", 0.9
    output = bake(demo, 24).bake.outputs[0]
    assert output.track.meta["method"] == "force"
    skin = store.current(demo).bake.skins["Index"].pressed
    use = core.matching.thimble_use.prepare(
        library().device("thimble_3rrs"), skin, object_properties.parameters(device)
    )
    assert use.hover == pytest.approx(0.9e-3)
    matching = core.matching.thimble.follower(use).matching
    np.testing.assert_allclose(output.track.values[0, :3], matching.angles, atol=1e-7)  # it waits at that distance
    device.thimble_method = "geometry"
    other = bake(demo, 24).bake.outputs[0]
    assert np.abs(other.track.values - output.track.values).max() > 1e-3


def test_a_calibration_moves_the_mounting(demo) -> None:
    device = device_of(demo)
    rest = bake(demo, 3).bake.outputs[0].track.values[0, :3]
    device.thimble_calibrated = True
    device.thimble_felt_1 = device.thimble_felt_2 = device.thimble_felt_3 = 0.15
    demo.frame_set(1)
    felt = bake(demo, 3).bake.outputs[0].track.values[0, :3]
    # the person first feels the disc at 0.15 rad, so hovering there is a little less
    assert (felt - rest > 0.1).all() or (felt - rest < -0.1).all()
    assert np.abs(felt - 0.15).max() < np.abs(felt - rest).max()
    row = views.devices(demo).rows[0]
    mechanism, _ = twins.mounted_mechanism(demo.objects["Index"], row.device)
    plain = core.devices.thimble.mechanism(library().device("thimble_3rrs"))
    assert abs(mechanism.mount[2, 3] - plain.mount[2, 3]) > 1e-4  # the twin is mounted as the engine mounts it


@pytest.mark.parametrize("source", ["bake", "live"])
def test_the_twins_joints_obey_forward_kinematics(demo, source) -> None:
    if source == "bake":
        bake(demo)
        demo.frame_set(30)
    else:
        for frame in range(12, 31):
            demo.frame_set(frame)
            device_preview.step(bpy.context)
            skin_preview.step(bpy.context)
    row = next(r for r in views.devices(demo).rows if r.kind == "thimble")
    assert views.devices(demo).source == source
    at = twins.twin_of(demo, row).state
    device, _ = twins.mounted_mechanism(demo.objects["Index"], row.device)
    angles = thimble_twin.servo_angles(row)
    assert np.abs(angles).max() > 0.02
    # links keep their lengths, legs their planes, and the platform's joints their places: nothing of inverse kinematics
    np.testing.assert_allclose(np.linalg.norm(at.knee - at.servo, axis=1), device.crank, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(at.platform - at.knee, axis=1), device.rod, atol=1e-9)
    base = (np.linalg.inv(device.mount) @ np.c_[at.platform, np.ones(3)].T)[:3].T
    for i, out in enumerate(core.devices.linkage.LEG_DIRECTIONS):
        assert abs(np.cross(out, base[i])[2]) < 1e-9
    np.testing.assert_allclose(at.x, [row.values["pitch"], row.values["roll"], row.values["distance"]], atol=2e-3)
    shares = thimble_twin.shares(row)
    np.testing.assert_allclose(shares, np.abs(angles) / device.servo_range, rtol=1e-6)
    part = thimble_twin.parts(device, at, shares)
    assert part.triangles.max() == len(part.positions) - 1 and np.isfinite(part.positions).all()


def test_servos_that_a_device_reports_are_shown_in_their_own_pose(demo) -> None:
    bake(demo, 30)
    demo.frame_set(30)
    baked = views.devices(demo)
    angles = {f"servo_{i}": 0.0 for i in (1, 2, 3)}
    (row,) = reported_values.with_reported(baked, angles, baked.rows[0]).rows
    joints = twins.twin_of(demo, row).state
    np.testing.assert_allclose(joints.x[:2], 0.0, atol=1e-9)  # three equal servos hold the disc level
    assert abs(baked.rows[0].values["distance"] - joints.x[2]) > 1e-4 and not row.signals
    drawn: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(thimble_card.paint, "text", lambda words, *_: drawn.append(words))
        patch.setattr(thimble_card.paint, "rectangle", lambda *_: None)
        thimble_card.card(row, joints, 0.0, 0.0, 200.0, 1.0)
    assert f"{1e3 * joints.x[2]:.2f} mm" in drawn and not any("mismatch" in words for words in drawn)


def test_a_pose_that_has_the_servos_angles_is_what_a_search_finds(demo) -> None:
    device = core.devices.thimble.mechanism(library().device("thimble_3rrs"))
    made = []
    for x in ([0.0, 0.0, 0.018], [0.1, -0.15, 0.0175], [-0.2, 0.05, 0.0185]):
        angles = device.joints(x)[0]
        at = thimble_twin.joints(device, angles, np.array(x))
        found = thimble_twin.joints(device, angles, np.array([0.0, 0.0, 0.0181]))
        np.testing.assert_array_equal(at.x, x)
        for one, other in zip(at, found, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-9)
        off = thimble_twin.joints(device, angles + 1e-6, np.array(x))
        assert 1e-10 < np.abs(off.x - x).max() < 1e-4  # the angles count, not the pose that is told
        made.append((device, at, np.array([0.2, 0.9, 1.0])))
    for together, alone in zip(thimble_twin.all_parts(made), [thimble_twin.parts(*one) for one in made], strict=True):
        for one, other in zip(together, alone, strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_servo_near_its_limit_turns_orange(demo) -> None:
    device = core.devices.thimble.mechanism(library().device("thimble_3rrs"))
    at = thimble_twin.joints(device, np.zeros(3), np.array([0.0, 0.0, 0.018]))
    cold, warm = (thimble_twin.parts(device, at, np.array([0.0, s, 0.0])) for s in (0.84, 1.0))
    changed = np.flatnonzero(np.abs(cold.colours - warm.colours).max(axis=1) > 0.1)
    assert len(changed) == 14  # one crank: seven corners at each end
    centre = cold.positions[changed].mean(axis=0)
    np.testing.assert_allclose(centre, 0.5 * (at.servo[1] + at.knee[1]), atol=1e-3)
    assert warm.colours[changed, 0].max() > 0.8 > warm.colours[changed, 2].max()


def test_from_a_bake_the_rendered_skin_is_what_the_track_does(demo, monkeypatch) -> None:
    made, packed = [], SkinContact.packed  # what the track is made from: a search tells it from what is kept
    monkeypatch.setattr(SkinContact, "packed", lambda self: made.append(self) or packed(self))
    baking.forget()
    result = bake(demo)
    output, felt = result.bake.outputs[0], made[0]
    thimble = core.matching.thimble
    use = thimble_devices.prepared(device_of(demo), felt.pressed)
    forces = thimble.forces_at(felt, output.track.times)
    found = thimble.match_touch(use, forces, use.device.servo_speed / output.track.spec.rate)
    for frame in (31, 25, 37):  # on a sample of 100 Hz: 24 frames are a second
        demo.frame_set(frame)
        sample = round((frame - 1) / 24 * 100)
        if abs(sample - (frame - 1) / 24 * 100) > 1e-9:
            continue
        target, rendered = views.skins(demo)
        assert (target.finger, rendered.finger) == ("Index", "Index: thimble")
        np.testing.assert_allclose(rendered.force, found.force[sample], atol=3e-5 * np.abs(found.force[sample]).max())
    demo.frame_set(31)
    row = views.devices(demo).rows[0]
    assert row.signals["mismatch"] == pytest.approx(found.mismatch[125], abs=1e-9)
    # and that mismatch is the one of the two skins that are shown side by side
    target, rendered = views.skins(demo)
    observation_matrix = core.matching.description.describe(use.device, use.skin, use.friction).observation_matrix
    a, b = (observation_matrix @ s.force.ravel() for s in (target, rendered))
    assert np.linalg.norm(b - a) / np.linalg.norm(a) == pytest.approx(found.mismatch[125], abs=1e-3)
    assert f"{100 * found.mismatch[125]:.0f} % off" in rendered.note


@pytest.mark.parametrize("contact", ["points", "nodes"])
def test_what_is_rendered_is_shown_where_the_touch_is_solved(demo, contact) -> None:
    demo.objects["Index"].dermis.finger.skin.contact = contact
    for source in ("live", "bake"):
        if source == "bake":
            bake(demo, 24)
        for frame in range(16, 22):
            demo.frame_set(frame)
            device_preview.step(bpy.context)
            skin_preview.step(bpy.context)
        target, rendered = views.skins(demo)
        assert (target.source, rendered.source) == (source, source) and rendered.touching
        for state in (target, rendered):
            assert (state.points is not None) == (contact == "points")
            if state.points is not None:
                np.testing.assert_allclose(state.points.force.sum(axis=0), state.force.sum(axis=0), atol=1e-6)
        followed = thimble_preview._paths.get("Index")
        if source == "live":
            assert followed.follower.matching.contact.points.on == contact
        else:
            assert thimble_preview._played["Index"].replay.contact.points.on == contact


def test_live_follows_the_skin_step_by_step(demo) -> None:
    """The preview is the engine's own follower on the skins that are shown: one frame after the other, from rest."""
    frames, targets, rows = range(9, 30), [], []
    for frame in frames:
        demo.frame_set(frame)
        device_preview.step(bpy.context)
        skin_preview.step(bpy.context)
        states = views.skins(demo)
        targets.append(states[0].force)
        rows.append(next(r for r in views.devices(demo).rows if r.kind == "thimble"))
    skin = states[0].model
    with skin_models.one_thread():
        use = thimble_devices.prepared(device_of(demo), skin.on_nodes)  # as the demo's draft skin is touched
        following = core.matching.thimble.follower(use)
        for i, (target, row) in enumerate(zip(targets, rows, strict=True)):
            following.matching.change = use.device.servo_speed / 24 if i else None
            found = following.step(target)
            np.testing.assert_allclose(thimble_twin.servo_angles(row), found.angles, atol=1e-6)
            assert row.signals["mismatch"] == pytest.approx(found.mismatch, abs=1e-6)
    assert rows[-1].contact == 1.0 and rows[-1].signals["mismatch"] > 0.05


def test_a_change_within_a_frame_searches_it_anew_and_a_jump_starts_from_rest(demo) -> None:
    def at(frame: int):
        demo.frame_set(frame)
        device_preview.step(bpy.context)
        skin_preview.step(bpy.context)
        return next(r for r in views.devices(demo).rows if r.kind == "thimble")

    for frame in range(14, 21):
        first = at(frame)
    device_of(demo).thimble_hover_mm = 0.5  # touched skin does not care
    again = at(20)
    np.testing.assert_allclose(thimble_twin.servo_angles(again), thimble_twin.servo_angles(first), atol=0.02)
    jumped = at(50)
    assert thimble_preview._paths["Index"].follower.matching.change is None
    assert jumped.contact == 1.0


@pytest.mark.parametrize("shown", [True, False])
def test_live_and_bake_agree(demo, shown) -> None:
    demo.objects["Index"].dermis.finger.skin.shown = shown
    for frame in range(6, 22):
        demo.frame_set(frame)
        device_preview.step(bpy.context)
        skin_preview.step(bpy.context)
    rows = [r for r in views.devices(demo).rows if r.kind == "thimble"]
    assert len(rows) == 1
    baked = store.values_at(bake(demo, 24), store.current(demo).bake.outputs[0], 21.0)
    # one sample a frame against ten
    np.testing.assert_allclose(np.degrees(thimble_twin.servo_angles(rows[0])), np.degrees(baked[:3]), atol=1.5)


def test_without_split_only_the_target_is_shown(demo) -> None:
    bake(demo)
    demo.frame_set(31)
    assert len(views.skins(demo)) == 2
    demo.dermis.thimble_view.split = False
    assert len(views.skins(demo)) == 1


def test_what_has_no_adaptation_says_so_and_goes_on(demo) -> None:
    device = device_of(demo)
    device.thimble_method = "network"
    result = bake(demo, 24)
    assert result.bake.outputs[0].track.meta["method"] == "stress"
    finding = next(f for f in result.bake.all_findings if f.code == "surrogate")
    assert "direct method" in finding.what and "Adapt" in finding.remedy and finding.severity == "warning"
    demo.frame_set(20)
    device.thimble_surrogate = "/not/there.npz"
    device_preview.step(bpy.context)
    skin_preview.step(bpy.context)
    assert any(r.kind == "thimble" for r in views.devices(demo).rows)


def test_workspace_loops_are_closed_and_reached(demo) -> None:
    device = core.devices.thimble.mechanism(library().device("thimble_3rrs"))
    loops = twins.workspace_of(device, 0.018)
    assert len(loops) > 5 and loops is twins.workspace_of(device, 0.018)
    reach = core.devices.workspace.workspace(device, 0.018)
    for level, loop in enumerate(loops):
        np.testing.assert_allclose(loop[0], loop[-1])
        for tip, x in zip(loop, reach.configurations(level), strict=False):
            # undo the pointer and what is left is a pose that the servos hold
            pose = device.in_finger(device.pose(x))
            np.testing.assert_allclose(tip - thimble_twin.POINTER * pose[:3, 2], pose[:3, 3], atol=1e-9)
            assert device.feasible(x)
    at = thimble_twin.joints(device, np.zeros(3), np.array([0.0, 0.0, 0.018]))
    tip = thimble_twin.pointer(at.pose)[1]
    np.testing.assert_allclose(tip, [0.0, 0.0, -thimble_twin.POINTER], atol=1e-9)


def test_the_plot_is_written(demo, tmp_path) -> None:
    with pytest.raises(RuntimeError, match="not baked"):
        bpy.ops.dermis.plot_thimble(filepath=str(tmp_path / "p.png"))
    bake(demo)
    assert bpy.ops.dermis.plot_thimble(filepath=str(tmp_path / "p.png")) == {"FINISHED"}
    data = (tmp_path / "p.png").read_bytes()
    assert data.startswith(b"\x89PNG") and len(data) > 20_000
    assert bpy.ops.dermis.plot_thimble(filepath=str(tmp_path / "p.svg")) == {"FINISHED"}
    text = (tmp_path / "p.svg").read_text()
    assert "#2a9d3a" in text and "#2255cc" in text and "simulated" in text


def test_export_gives_a_track_that_checks(demo, tmp_path) -> None:
    bake(demo)
    assert bpy.ops.dermis.export_tracks(directory=str(tmp_path)) == {"FINISHED"}
    path = tmp_path / "Index.thimble_3rrs.csv"
    assert path.is_file() and core.__main__.main(["check", str(path)]) == 0
