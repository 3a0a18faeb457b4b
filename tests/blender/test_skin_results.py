"""What is kept of a baked skin: forces in the stored result, resultants as CSV; and skins as the artist sets them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import preferences
from blender_addon.preview import skin_preview
from blender_addon.properties import skin_properties
from blender_addon.results import store, stored_skins
from blender_addon.viewport import shown as views
from blender_addon.viewport import skin_field
from core.contact import skin_arrays
from core.parameters.error_bands import error_band
from core.skin.model import skin_from_parameters

from .build import cube, finger, keys, span

pytestmark = pytest.mark.shared_tests("the engine's results")

TOP, DEPTH = 0.02, 0.7e-3


@pytest.fixture
def baked() -> bpy.types.Scene:
    """Return a scene with the bake of a press that slides."""
    scene = span(1, 9)
    hand = finger()
    hand.dermis.finger.skin.shown, hand.dermis.finger.skin.level = True, "draft"
    cube("Plate", 0.04, (0.0, 0.0, TOP - 0.02))
    z = [TOP + 0.02, TOP + 0.02, *[TOP - DEPTH] * 7]
    keys(hand, "location", list(range(1, 10)), np.column_stack([np.zeros(9), np.linspace(0, 1e-3, 9), z]))
    scene.dermis.sample_rate = 24.0
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return scene


def test_stored_forces_come_back_and_give_the_same_picture(baked: bpy.types.Scene) -> None:
    touch = store.current(baked).bake.skins["Finger"]
    assert touch.force.dtype == np.float32 and len(touch.contact) == 7
    store.forget()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(baked).bake.skins["Finger"]
    assert np.array_equal(loaded.force, touch.force) and np.array_equal(loaded.contact, touch.contact)
    for name in ("frames", "normal_force", "tangential_force", "depth", "lift", "sticking", "slipping"):
        assert np.array_equal(getattr(loaded, name), getattr(touch, name)), name
    assert loaded.model.key == touch.model.key
    assert np.array_equal(loaded.model.compliance, touch.model.compliance)
    baked.frame_set(6)
    (state,) = views.skins(baked)
    assert (state.source, state.note) == ("earlier", "from an earlier session's bake")
    assert state.normal_force == touch.normal_force[5]


def test_export_writes_resultants_that_sum_the_nodes(baked: bpy.types.Scene, tmp_path: Path) -> None:
    baked.dermis.output_dir = str(tmp_path)
    assert bpy.ops.dermis.export_tracks(directory=str(tmp_path)) == {"FINISHED"}
    lines = (tmp_path / "Finger.skin.csv").read_text().splitlines()
    comments = [line for line in lines if line.startswith("#")]
    assert comments[0] == "# dermis-resultants 2" and "# finger: Finger" in comments
    names = lines[len(comments)].split(",")
    rows = [dict(zip(names, line.split(","), strict=True)) for line in lines[len(comments) + 1 :]]
    touch = store.current(baked).bake.skins["Finger"]
    assert [float(r["frame[1]"]) for r in rows] == touch.frames.tolist()
    assert rows[0]["centre_x[m]"] == "" and float(rows[0]["normal_force[N]"]) == 0.0
    for at, sample in enumerate(touch.contact):
        total = touch.force[at].astype(float).sum(axis=0)
        written = [float(rows[sample][f"force_{a}[N]"]) for a in "xyz"]
        assert written == pytest.approx(total, rel=1e-7, abs=1e-12)
        assert abs(float(rows[sample]["centre_x[m]"])) < 2e-4  # the pad is symmetric
    lowest = touch.model.positions[:, 2].min()
    assert float(rows[-1]["depth[m]"]) == pytest.approx(DEPTH - lowest, rel=1e-4)
    assert "# tissue: linear" in comments and rows[0]["stress_error[1]"] == ""
    band = error_band("linear", float(touch.depth[-1]), float(touch.slide[-1]))
    assert float(rows[-1]["stress_error[1]"]) == pytest.approx(band.stress.median, rel=1e-6)
    assert float(rows[-1]["force_error[1]"]) == pytest.approx(band.force.median, rel=1e-6)
    assert float(rows[-1]["slide[m]"]) == pytest.approx(touch.slide[-1], rel=1e-6) and touch.slide[-1] > 0.0
    assert float(rows[-1]["force_z[N]"]) > 0.0 > float(rows[-1]["force_y[N]"])  # it slides towards its tip


def test_forces_on_points_are_stored_beside_those_on_nodes(baked: bpy.types.Scene) -> None:
    on_nodes = store.current(baked).bake
    baked.objects["Finger"].dermis.finger.skin.contact = "points"
    assert store.state(baked) == "stale" and bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(baked).bake
    touch, rough = bake.skins["Finger"], on_nodes.skins["Finger"]
    assert rough.points is None and touch.points is not None and len(touch.points.starts) == len(touch.contact) + 1
    assert touch.normal_force[-1] == pytest.approx(rough.normal_force[-1], rel=0.15)  # a draft mesh is stiff
    again = bpy.ops.dermis.bake()
    assert again == {"FINISHED"} and store.current(baked).bake.skins["Finger"].force.tobytes() == touch.force.tobytes()
    store.forget()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(baked).bake.skins["Finger"].points
    for name in skin_arrays.POINTS:
        assert np.array_equal(getattr(loaded, name), getattr(touch.points, name)), name
    baked.frame_set(6)
    (state,) = views.skins(baked)
    shown, nodes = (skin_field.draw_of(one, "von_mises") for one in (state, replace(state, points=None)))
    assert state.points is not None and not np.array_equal(shown.values, nodes.values)
    assert np.array_equal(shown.positions, nodes.positions)


def test_a_preview_on_points_feels_what_the_bake_feels(baked: bpy.types.Scene) -> None:
    skin = baked.objects["Finger"].dermis.finger.skin
    skin.contact = "points"
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    touch = store.current(baked).bake.skins["Finger"]
    store.forget()
    skin_preview.reset()
    for frame in range(1, 10):
        baked.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    assert state.points is not None and state.normal_force == pytest.approx(touch.normal_force[-1], rel=1e-3)
    skin.contact = "nodes"
    (state,) = skin_preview.step(bpy.context)
    assert state.points is None


def test_no_two_skins_share_a_file(baked: bpy.types.Scene, tmp_path: Path) -> None:
    bake = store.current(baked).bake
    skins = dict.fromkeys(("a b", "a_b", "A B"), bake.skins["Finger"])
    written = stored_skins.export(replace(bake, skins=skins), tmp_path)
    assert [p.name for p in written] == ["a_b.skin.csv", "a_b-2.skin.csv", "A_B-3.skin.csv"]
    assert [p.read_text().split("# finger: ")[1].splitlines()[0] for p in written] == list(skins)


@pytest.mark.parametrize("key", [e.key for e in preferences.library().list("skins")])
def test_presets_reach_the_engine_as_they_stand(key: str) -> None:
    hand = finger()
    bpy.context.view_layer.objects.active = hand
    assert bpy.ops.dermis.apply_skin(preset=key) == {"FINISHED"}
    wanted = preferences.library().skin(key)
    given = skin_properties.parameters(hand.dermis.finger.skin)["skin"]
    assert set(given) == set(wanted)
    for name, value in wanted.items():
        assert given[name] == pytest.approx(value, rel=1e-6), name
    assert len(skin_from_parameters(given, level="draft").mesh.tetrahedra) == 1560


def test_our_fingertip_follows_its_lengths_and_an_artists_mesh_does_not() -> None:
    bpy.ops.dermis.add_finger()
    ours = bpy.context.object
    other = cube("Hand", 0.02)
    other.dermis.role = "FINGER"
    before = [tuple(v.co) for v in other.data.vertices]
    for obj in (ours, other):
        skin = obj.dermis.finger.skin
        skin.width_mm, skin.length_mm, skin.tip_mm, skin.thickness_mm = 20.0, 30.0, 13.0, 16.0
    points = np.array([v.co for v in ours.data.vertices]) * 1e3
    low, high = points.min(axis=0), points.max(axis=0)
    assert high[0] - low[0] == pytest.approx(20.0, abs=0.05)
    assert (low[1], high[1]) == pytest.approx((-17.0, 13.0), abs=0.05)
    assert low[2] == pytest.approx(0.0, abs=0.01) and 15.0 < high[2] < 17.0
    assert [tuple(v.co) for v in other.data.vertices] == before


def test_our_fingertip_lies_on_the_engines_skin() -> None:
    """The heat map is drawn over it: pad and sides coincide, but for the crease of the joint."""
    from blender_addon.fingertip_mesh import Lengths, shape
    from core.skin.shape import FingertipShape

    skin = FingertipShape()
    vertices = shape(Lengths())[0][: 60 * 80] * 1e-3
    palm = vertices[(vertices[:, 2] < 0.95 * skin.height_palm) & (vertices[:, 1] > -9e-3)]
    x, y, z = palm.T
    axial = y / skin.tip
    section = np.sqrt(np.clip(1.0 - np.maximum(axial, 0.0) ** 2, 0.0, 1.0))
    q2 = np.minimum(axial, 0.0) ** 2
    half, depth = (
        size * section * (1.0 - 0.5 * q2 / (1.0 + q2 / (2.0 * drop)))
        for size, drop in ((0.5 * skin.width, 0.05), (skin.height_palm, 0.12))
    )
    level = np.hypot(x / half, (skin.height_palm - z) / depth)
    assert np.abs((level - 1.0) * np.minimum(half, depth)).max() < 0.1e-3


@pytest.mark.parametrize("fingers", ["ONE", "FIVE"])
def test_the_demo_scenes_touch_everything(fingers: str) -> None:
    assert bpy.ops.dermis.demo_skin_scene(fingers=fingers) == {"FINISHED"}
    scene = bpy.data.scenes["Dermis Skin Demo"]
    bpy.context.window.scene = scene
    for obj in scene.objects:
        obj.dermis.finger.skin.level = "draft"
    scene.dermis.sample_rate = 48.0
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(scene).bake
    assert len(bake.skins) == (1 if fingers == "ONE" else 5)
    assert not [f for f in bake.all_findings if f.severity == "error" or f.code in ("not-converged", "too-deep")]
    for touch in bake.skins.values():
        assert touch.normal_force.max() > 0.05 and touch.tangential_force.max() > 0.02
        assert (touch.tangential_force <= 0.6 * touch.normal_force * 1.001 + 1e-9).all() or fingers == "ONE"
