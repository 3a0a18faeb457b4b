"""Skins while scrubbing: exact forces, history, what is skipped, and agreement with the bake."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import baking, changes
from blender_addon.panels import summary
from blender_addon.preview import skin_preview
from blender_addon.preview.skin_state import SkinState
from blender_addon.results import store
from blender_addon.viewport import shown as views
from blender_addon.viewport import skin_field, skin_shown
from core.contact.skin_contact import SkinContact
from core.skin.model import fingertip_skin
from tests.problems import flat_press
from tests.tissue import save_mesh

from .build import cube, empty, finger, keys, span

pytestmark = pytest.mark.shared_tests("the engine's skin")

DEPTH = 0.8e-3
TOP = 0.02  # height of the plate's face [m]


@pytest.fixture(autouse=True)
def nothing_remembered():
    """Start without a history."""
    skin_preview.reset()
    skin_shown.forget_range()


@pytest.fixture
def pressing() -> bpy.types.Scene:
    """Return a scene in which a draft finger comes down on a plate by frame 5 and slides along it until frame 13."""
    scene = span(1, 13)
    hand = finger(location=(0.0, 0.0, TOP + 0.01))
    hand.dermis.finger.skin.shown = True
    hand.dermis.finger.skin.level = "draft"
    plate = cube("Plate", 0.04, (0.0, 0.0, TOP - 0.02))
    plate.dermis.material.friction = 0.5
    z = [TOP + 0.03, TOP + 0.03, TOP - 0.5 * DEPTH, TOP - 0.9 * DEPTH, TOP - DEPTH, *[TOP - DEPTH] * 8]
    y = [0.0] * 6 + [0.1e-3 * i for i in range(7)]
    keys(hand, "location", list(range(1, 14)), np.column_stack([np.zeros(13), y, z]))
    scene.dermis.sample_rate = 24.0
    bpy.context.view_layer.update()
    return scene


def at(scene: bpy.types.Scene, frame: int) -> SkinState:
    """Go to a frame and solve it."""
    scene.frame_set(frame)
    (state,) = skin_preview.step(bpy.context)
    return state


def test_a_press_without_friction_has_the_exact_forces(pressing: bpy.types.Scene) -> None:
    bpy.data.objects["Plate"].dermis.material.friction = 0.0
    state = at(pressing, 5)
    model = fingertip_skin(level="draft")
    exact = flat_press(model.compliance, model.positions[:, 2], DEPTH)
    assert state.normal_force == pytest.approx(exact[:, 2].sum(), rel=1e-3)
    assert np.abs(state.force - exact).max() < 1e-3 * np.abs(exact).max()
    assert state.tangential_force < 1e-6 * state.normal_force
    assert state.depth == pytest.approx(DEPTH - model.positions[:, 2].min(), rel=1e-4)


def test_stepping_forward_gives_what_a_bake_at_the_same_rate_gives(
    pressing: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    stepped = {frame: at(pressing, frame) for frame in range(1, 14)}
    made: list[SkinContact] = []
    packed = SkinContact.packed
    monkeypatch.setattr(SkinContact, "packed", lambda self: made.append(self) or packed(self))
    baking.forget()
    bpy.ops.dermis.bake()
    most = float(made[0].force.max())
    for frame in (3, 5, 8, 13):
        pressing.frame_set(frame)
        (baked,) = views.skins(pressing)
        assert baked.source == "bake"
        # one and the same stepper: what differs is that a bake has forces in single precision, and keeps them packed
        np.testing.assert_array_equal(stepped[frame].force.astype(np.float32), made[0].force_at(frame - 1))
        np.testing.assert_allclose(baked.force, stepped[frame].force, rtol=0, atol=most / 65536)
        assert stepped[frame].tangential_force == baked.tangential_force
        assert (stepped[frame].depth, stepped[frame].lift) == (baked.depth, baked.lift)
    assert stepped[13].tangential_force > 0.2 * stepped[13].normal_force


@pytest.mark.parametrize("how", ["scale", "parent", "shape"])
def test_what_grows_under_a_resting_finger_drags_its_skin(how: str) -> None:
    """Scale keys, a scaled parent and a shape key move the plate alike and drag the skin alike, live and baked."""
    scene = span(1, 12)
    plate = cube("Plate", 0.06)
    plate.dermis.material.friction = 0.6
    hand = finger(location=(0.015, 0.0, 0.03 - 0.001))
    hand.dermis.finger.skin.shown = True
    hand.dermis.finger.skin.level = "draft"
    wide = [(1, 1, 1), (1, 1, 1), (1.2, 1, 1)]
    if how == "scale":
        keys(plate, "scale", [1, 4, 12], wide)
    elif how == "parent":
        plate.parent = empty("Parent")
        keys(plate.parent, "scale", [1, 4, 12], wide)
    else:
        plate.shape_key_add(name="Basis")
        for point in plate.shape_key_add(name="wide").data:
            point.co.x *= 1.2
        keys(plate.data.shape_keys, 'key_blocks["wide"].value', [1, 4, 12], [0, 0, 1])
    scene.dermis.sample_rate = 24.0
    bpy.context.view_layer.update()
    live = [at(scene, frame) for frame in range(1, 13)]
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    (baked,) = views.skins(scene)
    assert baked.source == "bake" and live[-1].source == "live"
    for state in (live[-1], baked):  # 3 mm of plate went past: it slips, and Coulomb's law holds
        assert state.tangential_force == pytest.approx(0.6 * state.normal_force, rel=1e-2)
        assert state.force.sum(axis=0)[0] > 0.75
    assert np.abs(live[-1].force - baked.force).max() < 2e-3 * np.abs(baked.force).max()


def test_a_jump_starts_from_rest_and_says_so(pressing: bpy.types.Scene) -> None:
    for frame in range(1, 13):
        along = at(pressing, frame)
    assert along.note == "live: computed from frame 1 on"
    jumped = at(pressing, 25)
    assert "frame 25 alone, without earlier contact" in jumped.note
    skin_preview.reset()
    again = at(pressing, 12)
    assert again.note.startswith("live: frame 12 alone")
    # without the slide in its past the skin is not dragged along
    assert again.tangential_force < 0.2 * along.tangential_force


def test_a_frame_that_was_visited_is_shown_as_it_was_until_something_changes(pressing: bpy.types.Scene) -> None:
    played = {frame: at(pressing, frame) for frame in range(1, 13)}
    for frame in (7, 3, 11):
        again = at(pressing, frame)
        assert np.array_equal(again.force, played[frame].force)
        assert again.note == "live, as played: computed from frame 1 on"
        assert again.counters == played[frame].counters  # nothing was solved for it
    assert at(pressing, 13).note == "live: computed from frame 1 on"  # and from where it ended it goes on
    changes.mark_dirty("something")
    assert "frame 7 alone, without earlier contact" in at(pressing, 7).note


def test_a_jump_goes_on_from_the_nearest_kept_state_as_if_played_from_there(pressing: bpy.types.Scene) -> None:
    for frame in (*range(1, 9), 10, 12):
        at(pressing, frame)
    back = at(pressing, 9)
    assert back.note == "live: continued from frame 7"
    forward = at(pressing, 11)
    assert forward.note == "live: computed from frame 1 on"
    skin_preview.reset()
    for frame in range(1, 8):
        at(pressing, frame)
    assert np.array_equal(back.force, at(pressing, 9).force)
    assert np.array_equal(forward.force, at(pressing, 11).force)
    skin_preview.reset()
    assert np.abs(back.force - at(pressing, 9).force).max() > 0.01 * np.abs(back.force).max()


def test_a_change_within_a_frame_does_not_advance_the_history(pressing: bpy.types.Scene) -> None:
    for frame in range(1, 9):
        state = at(pressing, frame)
    changes.mark_dirty("nothing really")
    (again,) = skin_preview.step(bpy.context)
    assert again is not state
    assert again.force == pytest.approx(state.force, abs=1e-4 * np.abs(state.force).max())
    (same,) = skin_preview.step(bpy.context)
    assert same is again


def test_undo_resets_the_history(pressing: bpy.types.Scene) -> None:
    for frame in range(1, 9):
        at(pressing, frame)
    changes.note_history()
    assert views.skins(pressing) == ()
    assert "frame 9 alone" in at(pressing, 9).note


def test_far_and_still_frames_are_skipped_and_counted(pressing: bpy.types.Scene) -> None:
    first = at(pressing, 1)
    assert (first.work, first.touching) == ("idle", False)
    assert at(pressing, 2).counters["skipped, nothing near"] == 2
    for frame in (3, 4, 5):
        assert at(pressing, frame).work == "solved"
    at(pressing, 6)
    still = at(pressing, 7)  # the second frame without movement
    assert still.work in ("same", "unchanged")
    before = skin_shown.counters()
    views.renew(pressing)
    views.renew(pressing)
    after = skin_shown.counters()
    assert after["stress_computed"] - before["stress_computed"] == 1
    assert after["stress_kept"] - before["stress_kept"] == 1 and after["stress_skipped"] == before["stress_skipped"]
    views.now(pressing)
    drawn = views.draws()
    views.now(pressing)
    assert views.draws() == drawn + 1, "a view that is drawn again works nothing out"
    assert skin_shown.counters() == after


def test_a_hidden_skin_is_not_solved(pressing: bpy.types.Scene) -> None:
    bpy.data.objects["Finger"].dermis.finger.skin.shown = False
    pressing.frame_set(5)
    assert skin_preview.step(bpy.context) == ()
    assert not summary.of(pressing).skins


def test_a_soft_object_takes_part_of_the_depth(pressing: bpy.types.Scene) -> None:
    material = bpy.data.objects["Plate"].dermis.material
    hard = at(pressing, 5).normal_force
    material.surface_stiffness_mpa_m = 17.0
    skin_preview.reset()
    soft = at(pressing, 5).normal_force
    assert 0.2 * hard < soft < 0.9 * hard
    material.surface_stiffness_mpa_m = 1e6
    skin_preview.reset()
    assert at(pressing, 5).normal_force == pytest.approx(hard, rel=2e-3)


def test_a_compliant_bone_keeps_its_force_limit(pressing: bpy.types.Scene) -> None:
    skin = bpy.data.objects["Finger"].dermis.finger.skin
    rigid = at(pressing, 5)
    skin.depth_mode, skin.bone_stiffness, skin.force_limit = "compliant", 1e6, 0.5 * rigid.normal_force
    skin_preview.reset()
    limited = at(pressing, 5)
    assert limited.force[:, 2].sum() == pytest.approx(0.5 * rigid.normal_force, rel=5e-3)
    assert limited.lift > 0.05e-3 and limited.depth == pytest.approx(rigid.depth - limited.lift, abs=2e-5)
    # what is drawn is lifted with the bone
    drawn = skin_field.draw_of(limited, "pressure")
    assert drawn.positions[:, 2].max() - rigid_top(limited) == pytest.approx(limited.lift, abs=5e-5)


def rigid_top(state: SkinState) -> float:
    """Return the height of the drawn skin's highest vertex at rest."""
    return float(skin_field.kit(state.model.mesh).surface.rest[:, 2].max())


def test_a_turned_scene_gives_the_same_forces(pressing: bpy.types.Scene) -> None:
    from mathutils import Matrix

    straight = at(pressing, 5)
    pivot = bpy.data.objects.new("Pivot", None)
    pressing.collection.objects.link(pivot)
    for name in ("Finger", "Plate"):
        bpy.data.objects[name].parent = pivot
    pivot.matrix_world = Matrix.Translation((0.3, -0.2, 0.1)) @ Matrix.Rotation(1.1, 4, (1.0, 2.0, -0.5))
    bpy.context.view_layer.update()
    skin_preview.reset()
    turned = at(pressing, 5)
    assert turned.force == pytest.approx(straight.force, abs=2e-3 * np.abs(straight.force).max())


def test_a_press_that_is_too_deep_is_a_finding_with_its_frame(pressing: bpy.types.Scene) -> None:
    hand = bpy.data.objects["Finger"]
    keys(hand, "location", [1, 5, 8, 13], [(0, 0, TOP + 0.03), (0, 0, TOP - 1e-3), (0, 0, TOP - 2.3e-3),
                                           (0, 0, TOP - 2.3e-3)])  # fmt: skip
    bpy.ops.dermis.bake()
    found = [f for f in store.current(pressing).bake.all_findings if f.code == "too-deep"]
    assert len(found) == 1 and 5 < found[0].frame <= 8
    assert "2.00" <= found[0].value < "2.31"


def test_a_changed_scene_is_shown_as_out_of_date(pressing: bpy.types.Scene) -> None:
    bpy.ops.dermis.bake()
    pressing.frame_set(5)
    assert views.skins(pressing)[0].note == "from the bake"
    bpy.data.objects["Finger"].dermis.finger.skin.young_kpa = 80.0
    (stale,) = views.skins(pressing)
    assert (stale.source, stale.note) == ("stale", "from a bake that is out of date")
    (live,) = skin_preview.step(bpy.context)
    assert live.source == "live" and views.skins(pressing)[0] is live
    assert live.normal_force == pytest.approx(0.8 * stale.normal_force, rel=0.02)


def test_a_size_without_room_for_tissue_says_so(pressing: bpy.types.Scene) -> None:
    bpy.data.objects["Finger"].dermis.finger.skin.bone_thickness_mm = 12.0
    pressing.frame_set(5)
    (state,) = skin_preview.step(bpy.context)
    assert state.model is None and not state.touching
    assert "bone_thickness" in state.note and "12.60 mm" in state.note
    assert views.renew(pressing).skins.drawn == (None,)


def test_a_mesh_of_ones_own_is_touched_as_a_fingertip_is(pressing: bpy.types.Scene, tmp_path: Path) -> None:
    """Our own draft fingertip, saved and named as a file, feels what the lengths do."""
    skin = bpy.data.objects["Finger"].dermis.finger.skin
    plain = [at(pressing, frame) for frame in range(4, 10)]
    path = tmp_path / "mine.npz"
    save_mesh(fingertip_skin(level="draft").mesh, path)
    skin.mesh_file = str(path)
    skin.level = "standard"  # of no meaning any more
    own = [at(pressing, frame) for frame in range(4, 10)]
    for before, after in zip(plain, own, strict=True):
        np.testing.assert_allclose(after.force, before.force, atol=1e-7)  # what is solved is known no better
    assert views.renew(pressing).skins.drawn[0] is not None
    path.write_bytes(b"another file")
    skin.mesh_file = str(path)
    broken = at(pressing, 4)
    assert broken.model is None and "mine.npz" in broken.note
