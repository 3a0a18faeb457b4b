"""Fingers whose tissue stiffens: what is shown is the engine's, preview and bake agree, bakes are stored and read.

Skin follows the law itself and waits for nothing; a series is for the devices that follow it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import reporting
from blender_addon.devices import platform_devices, readiness, skin_models
from blender_addon.preview import pin_preview, platform_preview, skin_preview, thimble_preview
from blender_addon.preview.skin_state import SkinState
from blender_addon.properties import skin_properties
from blender_addon.results import store
from blender_addon.viewport import shown as views
from blender_addon.viewport import skin_field, skin_shown
from core.cache import Cache
from core.contact.trusted import trusted
from core.parameters.error_bands import error_band
from core.recent import Recent
from core.skin.model import fingertip_skin, shape_and_material
from core.skin.stimulus import Stimulus
from core.skin.stress import von_mises
from core.skin.surface_store import smooth_pad
from core.tissue import stiffening_store
from tests.made_up_tissue import kept, made_up
from tests.problems import flat_press
from tests.tissue import save_mesh

from .build import cube, finger, keys, span

TOP, DEPTH = 0.02, 0.9e-3


@pytest.fixture(autouse=True)
def skins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cache]:
    """Return the cache of skins, which is empty."""
    cache = Cache(tmp_path / "skins", 10**9)
    skin_preview.reset()
    skin_models.forget()
    monkeypatch.setattr(skin_models, "cache", lambda: cache)
    monkeypatch.setattr(stiffening_store, "_known", Recent(10))
    yield cache
    skin_preview.reset()
    skin_models.forget()


@pytest.fixture
def pressing(skins: Cache) -> bpy.types.Scene:
    """Return a scene in which a finger, of lengths that no preset has, is pressed and slides along."""
    scene = span(1, 9)
    hand = finger()
    skin = hand.dermis.finger.skin
    skin.shown, skin.level, skin.contact, skin.tissue = True, "draft", "nodes", "neo_hookean"
    skin.width_mm = 15.93
    cube("Plate", 0.04, (0.0, 0.0, TOP - 0.02)).dermis.material.friction = 0.6
    z = [TOP + 0.02, TOP + 0.02, TOP - DEPTH / 2, *[TOP - DEPTH] * 6]
    keys(hand, "location", list(range(1, 10)), np.column_stack([np.zeros(9), np.linspace(0, 1e-3, 9), z]))
    scene.dermis.sample_rate = 24.0
    bpy.context.view_layer.update()
    return scene


def table(scene: bpy.types.Scene, cache: Cache) -> str:
    """Put a made-up table of the scene's finger where a real one is found; return its key."""
    parameters = skin_properties.parameters(scene.objects["Finger"].dermis.finger.skin)
    shape, material = shape_and_material(parameters["skin"])
    assert shape is not None
    return kept(cache, shape, material.poisson)


def state_of(level: str = "draft", *, law: bool = True) -> SkinState:
    """Return a skin that stiffens, pressed flat: by the law, or by a series as devices render it."""
    linear = fingertip_skin(level=level)
    model = linear.with_law(made_up(linear)) if law else linear.with_stiffening(made_up(linear))
    force = flat_press(model.compliance, model.positions[:, 2], DEPTH)
    return SkinState("Finger", model, force, float(force[:, 2].sum()), depth=DEPTH, source="live")


def wear(scene: bpy.types.Scene, preset: str = "pin_array_128") -> None:
    """Put a device on the scene's finger."""
    scene.objects["Finger"].dermis.finger.devices.add().preset = preset
    bpy.context.view_layer.update()


@pytest.mark.parametrize("law", [True, False])
@pytest.mark.parametrize("level", ["draft", "standard"])
def test_what_is_drawn_is_the_engines_displacement_and_stress(level: str, law: bool) -> None:
    state = state_of(level, law=law)
    stimulus, own = Stimulus(state.model, state.force), skin_field.kit(state.model.mesh)
    nodes, count = own.surface.nodes, len(own.points)
    moved = skin_field.draw_of(state, "displacement")
    exact = np.linalg.norm(stimulus.displacement[nodes], axis=1)
    linear = np.linalg.norm(state.model.displacement(state.force)[nodes], axis=1)
    assert np.abs(moved.values[:count] - exact).max() < 1e-5 * exact.max() < 1e-2 * np.abs(linear - exact).max()
    smooth = stimulus.surface_values(stimulus.stress)[nodes]
    for quantity, wanted in (("zz", smooth[:, 2]), ("von_mises", von_mises(smooth))):
        drawn = skin_field.draw_of(state, quantity).values[:count]
        assert drawn == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max()), quantity
    energy = stimulus.surface_values(stimulus.energy_density)[nodes]
    assert skin_field.draw_of(state, "energy").values[:count] == pytest.approx(energy, rel=1e-6)


@pytest.mark.parametrize("law", [True, False])
def test_what_a_contact_kept_of_tissue_is_what_is_drawn(law: bool) -> None:
    state = state_of(law=law)
    found = Stimulus(state.model, state.force).amounts
    assert found is not None
    same, other = replace(state, amounts=found), replace(state, amounts=0.5 * found)
    drawn = [skin_field.draw_of(one, "displacement").values for one in (state, same, other)]
    assert np.array_equal(drawn[0], drawn[1]) and np.abs(drawn[0] - drawn[2]).max() > 0.01 * drawn[0].max()
    shown = [skin_shown.values(one, "displacement", 1.0).values for one in (same, other)]
    assert not np.array_equal(*shown)


def test_stress_beneath_points_is_that_of_the_stiff_skin(pressing: bpy.types.Scene) -> None:
    skin = pressing.objects["Finger"].dermis.finger.skin
    skin.width_mm, skin.contact = 16.0, "points"  # whose smooth pad ships
    for frame in range(1, 7):
        pressing.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    assert state.points is not None and state.amounts is not None and smooth_pad(state.model) is not None
    own = skin_field.kit(state.model.mesh)
    flat = replace(state, model=state.model.with_stiffening(None), amounts=None)
    stiff, linear = (skin_field.draw_of(one, "zz").values for one in (state, flat))
    ((below),) = own.below.values()
    vertices = below.vertices[np.argsort(-np.abs(stiff[below.vertices]))[:20]]  # just above what presses
    felt = Stimulus(state.model, state.force, state.points, state.amounts)
    nodal = state.model.mesh.averaging @ (felt.stress - state.model.stress(state.force))
    more = (own.surface.refine @ nodal[own.surface.nodes])[vertices, 2]
    assert stiff[vertices] - linear[vertices] == pytest.approx(more, abs=1e-4 * np.abs(linear).max())
    assert np.abs(more).max() > 0.02 * np.abs(linear).max()


@pytest.mark.parametrize("contact", ["nodes", "points"])
def test_a_preview_feels_what_the_bake_feels(pressing: bpy.types.Scene, contact: str) -> None:
    skin = pressing.objects["Finger"].dermis.finger.skin
    skin.width_mm, skin.contact = 16.0, contact
    stepped = {}
    for frame in range(1, 10):
        pressing.frame_set(frame)
        (stepped[frame],) = skin_preview.step(bpy.context)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    for frame in (4, 6, 9):
        pressing.frame_set(frame)
        (baked,) = views.skins(pressing)
        live = stepped[frame]
        assert (baked.source, live.source, live.tissue, baked.tissue) == ("bake", "live", "neo_hookean", "neo_hookean")
        near = 1e-3 * np.abs(live.force).max() if contact == "points" else 1e-7
        most = max(float(np.abs(state.force).max()) for state in stepped.values())  # what is kept is rounded by it
        assert np.abs(live.force - baked.force).max() <= max(near, 1e-6 * np.abs(live.force).max()) + most / 65536
        assert live.amounts is not None and baked.amounts is not None
        assert np.abs(live.amounts - baked.amounts).max() <= 1e-3 * np.abs(live.amounts).max()
        assert live.slide == pytest.approx(baked.slide, rel=1e-2, abs=1e-7)
        values = [skin_field.draw_of(s, "von_mises").values for s in (live, baked)]
        assert np.abs(values[0] - values[1]).max() <= 5e-3 * values[1].max()


def test_a_stored_bake_comes_back_with_how_its_skin_stiffened(pressing: bpy.types.Scene, skins: Cache) -> None:
    """No table has a part in it: the series that was there, and is gone, was for devices."""
    table(pressing, skins)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    touch = store.current(pressing).bake.skins["Finger"]
    assert touch.model.follows_law and touch.model.stiffening is not None
    assert touch.amounts.dtype == np.float32 and touch.amounts.shape == (len(touch.contact), 3 * touch.model.pad_count)
    store.forget()
    skin_models.forget()
    stiffening_store._known.clear()
    skins.clear()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert np.array_equal(loaded.amounts, touch.amounts) and np.array_equal(loaded.slide, touch.slide)
    assert loaded.model.follows_law and loaded.model.stiffening is None
    assert "earlier-tissue" not in {f.code for f in reporting.findings()}
    last = int(touch.contact[-1])
    first, second = (
        skin_field.draw_of(SkinState.of("F", t.model, t.at(last), "bake", "", {}), "von_mises") for t in (touch, loaded)
    )
    # what lies beneath the pad is found again, as near to the law as it was
    assert np.abs(first.values - second.values).max() < 5e-3 * first.high
    assert np.abs(first.positions - second.positions).max() < 2e-6


def rewritten(scene: bpy.types.Scene, version: int, entry: dict[str, Any], **arrays: Any) -> None:
    """Store the scene's bake as an earlier version did, and forget it: entries and arrays that are None go."""
    kept = store.current(scene)
    path = store.cache().get(store._key(kept.bake.content_hash))
    assert path is not None
    with np.load(path) as file:
        own = {n: file[n] for n in file.files if n.removeprefix("skin_0_") not in arrays}
    own |= {f"skin_0_{name}": array for name, array in arrays.items() if array is not None}
    header = json.loads(own.pop("header").tobytes())
    header["version"] = version
    for stored in header["skins"]:
        stored.update(entry)
        for name in [name for name, value in stored.items() if value is None]:
            del stored[name]
    path.unlink()

    def write(target: Path) -> None:
        with open(target, "wb") as out:
            np.savez_compressed(out, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **own)

    store.cache().put(store._key(kept.bake.content_hash, version), write)
    store.forget()


@pytest.mark.parametrize("tissue", ["neo_hookean", "neo_hookean_exact"])
def test_a_bake_by_the_series_of_an_earlier_version_is_shown_as_it_was(
    pressing: bpy.types.Scene, skins: Cache, tissue: str
) -> None:
    key = table(pressing, skins)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    felt = store.current(pressing).bake.skins["Finger"].matched
    rewritten(pressing, 2, {"tissue": tissue, "law": None, "stiffening": key}, amounts=felt.amounts)
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert not loaded.model.follows_law and loaded.model.stiffening.key == key and loaded.matched is loaded
    assert np.array_equal(loaded.force, felt.force)
    assert (tissue == "neo_hookean") == np.array_equal(loaded.amounts, felt.amounts)  # of the exact law's own patterns
    (told,) = [f for f in reporting.findings() if f.code == "earlier-tissue"]
    assert told.severity == "info" and told.remedy.startswith("Bake again")
    pressing.frame_set(6)
    (state,) = views.skins(pressing)
    assert state.source == "earlier" and state.tissue == "neo_hookean"
    assert skin_field.draw_of(state, "von_mises").values.max() > 0.0


def test_a_bake_by_a_series_whose_table_is_gone_is_refused(pressing: bpy.types.Scene, skins: Cache) -> None:
    key = table(pressing, skins)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    amounts = store.current(pressing).bake.skins["Finger"].matched.amounts
    rewritten(pressing, 2, {"tissue": "neo_hookean", "law": None, "stiffening": key}, amounts=amounts)
    skin_models.forget()
    stiffening_store._known.clear()
    skins.clear()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    assert dict(store.current(pressing).bake.skins) == {}
    (refused,) = [f for f in reporting.findings() if f.code == "earlier-tissue"]
    assert refused.severity == "error" and "table" in refused.what and refused.remedy == "Bake again"


def test_results_of_the_first_version_are_read(pressing: bpy.types.Scene) -> None:
    pressing.objects["Finger"].dermis.finger.skin.tissue = "linear"
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    kept = store.current(pressing)
    rewritten(pressing, 1, dict.fromkeys(("tissue", "law", "stiffening")), slide=None)
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert np.array_equal(loaded.force, kept.bake.skins["Finger"].force) and loaded.slide is None
    assert loaded.at(int(loaded.contact[-1])).slide == 0.0


@pytest.mark.parametrize("kind", ["lengths", "own mesh", "Poisson's ratio"])
def test_skin_that_stiffens_waits_for_nothing(pressing: bpy.types.Scene, tmp_path: Path, kind: str) -> None:
    skin = pressing.objects["Finger"].dermis.finger.skin
    if kind == "own mesh":
        save_mesh(fingertip_skin(level="draft").mesh, tmp_path / "mine.npz")
        skin.mesh_file = str(tmp_path / "mine.npz")
    elif kind == "Poisson's ratio":
        skin.poisson = 0.497
    parameters = skin_properties.parameters(skin)
    assert not list(skin_models.tables_made(parameters, followed=False))  # of contact on nodes, with no device
    for frame in range(1, 7):
        pressing.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    assert state.tissue == "neo_hookean" and state.model.stiffening is None and state.amounts is not None
    assert "tissue" not in state.note and not state.waits and not skin_models._making
    linear = replace(state, model=state.model.with_stiffening(None), amounts=None)
    moved = [skin_field.draw_of(one, "displacement").values.max() for one in (state, linear)]
    assert 0.5 * moved[1] < moved[0] < 0.99 * moved[1]
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(pressing).bake
    assert bake.skins["Finger"].model.follows_law and "matched-linear" not in {f.code for f in bake.all_findings}
    assert bake.skins["Finger"].normal_force[5] == pytest.approx(state.normal_force, rel=0.01)


def test_a_table_is_wanted_where_there_can_be_one_and_none_is_there(pressing: bpy.types.Scene, skins: Cache) -> None:
    parameters = skin_properties.parameters(pressing.objects["Finger"].dermis.finger.skin)
    wants = skin_models.wants_series
    assert wants(parameters) and not wants({**parameters, "tissue": "linear"})
    assert not wants({**parameters, "skin": {"mesh": "mine.npz"}})
    assert not wants({**parameters, "skin": {**parameters["skin"], "poisson": 0.497}})
    before = skin_models.of(parameters)
    assert before is skin_models.of(parameters) and before.tissue == "neo_hookean"
    assert before.matched.tissue == "linear"
    law = before.law
    table(pressing, skins)
    assert not wants(parameters)
    model = skin_models.of(parameters)
    assert model is skin_models.of(parameters) and model.tissue == model.matched.tissue == "neo_hookean"
    assert model.law is law  # what was made of it serves on
    stiffer = skin_models.of({**parameters, "skin": {**parameters["skin"], "young": 2e5}})
    assert stiffer.law is law and stiffer.stiffening is model.stiffening and stiffer.material.young == 2e5
    assert skin_models.get(parameters["skin"], "draft").tissue == "linear"


def test_a_bake_makes_the_table_where_a_device_follows_the_skin(
    pressing: bpy.types.Scene, skins: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(skin_models, "make_series", lambda skin: asked.append(skin))  # it could not be made
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    assert not asked
    wear(pressing)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(pressing).bake
    assert len(asked) == 1 and bake.skins["Finger"].model.follows_law
    (told,) = [f for f in bake.all_findings if f.code == "matched-linear"]
    assert told.severity == "warning" and "Finger" in told.where
    table(pressing, skins)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    again = store.current(pressing).bake
    assert len(asked) == 1 and "matched-linear" not in {f.code for f in again.all_findings}
    forces = [one.outputs[0].track.values for one in (bake, again)]
    assert np.abs(forces[0] - forces[1]).max() > 0.01 * forces[1].max()
    touches = [one.skins["Finger"].force for one in (bake, again)]
    assert np.array_equal(*touches)  # what is felt does not depend on it


def test_a_child_process_makes_the_table_and_ends_when_nobody_waits(pressing: bpy.types.Scene, skins: Cache) -> None:
    parameters = skin_properties.parameters(pressing.objects["Finger"].dermis.finger.skin)
    steps = skin_models.tables_made(parameters, followed=True)  # nodes want no smooth pad
    first = next(steps)
    (job,) = skin_models._making.values()
    assert first.stage == "tissue" and not job.done()
    steps.close()  # Esc
    assert job.cancelled() and not skin_models._making and skin_models.wants_series(parameters)
    assert not list(skins.folder.rglob("*")) if skins.folder.exists() else True


def test_devices_go_on_with_linear_tissue_and_say_so_until_their_table_is_made(
    pressing: bpy.types.Scene, skins: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody has to go to another frame to see how far the table is, or what it brings; the touch goes on as it was."""
    wear(pressing)
    wear(pressing, "thimble_3rrs")
    known = readiness.of(pressing.objects["Finger"])
    assert "thimble" in known and readiness.of(pressing.objects["Finger"]) is known
    for frame in range(1, 6):
        pressing.frame_set(frame)
        for made in (0.34, 0.6):
            monkeypatch.setattr(skin_models, "make_series", lambda skin, made=made: made)
            (state,) = skin_preview.step(bpy.context)
            assert f"devices on linear tissue while their table is made: {made:.0%}" in state.note and state.waits
            assert state.tissue == "neo_hookean" and state.matched.tissue == "linear" and state.matched.amounts is None
    (linear,) = pin_preview.live_rows(pressing, (state,))
    path = skin_preview._live.paths["Finger"]
    table(pressing, skins)
    (after,) = skin_preview.step(bpy.context)
    assert "linear tissue" not in after.note and not after.waits and after.matched.tissue == "neo_hookean"
    assert readiness.of(pressing.objects["Finger"]) is not known  # what is at hand is that of another skin now
    assert skin_preview._live.paths["Finger"] is path and np.array_equal(after.force, state.force)
    (stiff,) = pin_preview.live_rows(pressing, (after,))
    assert np.abs(stiff.numbers - linear.numbers).max() > 0.01 * stiff.numbers.max()
    (again,) = skin_preview.step(bpy.context)
    assert again is after  # and then it holds
    pressing.frame_set(6)
    (following,) = skin_preview.step(bpy.context)
    assert following.touching and following.matched.amounts is not None


def test_a_table_that_cannot_be_made_is_told_where_a_device_wants_it(
    pressing: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(skin_models, "make_series", lambda skin: None)
    monkeypatch.setattr(skin_models, "refusal", lambda skin, table: "the folder is full")
    pressing.frame_set(5)
    (state,) = skin_preview.step(bpy.context)
    assert "tissue" not in state.note
    wear(pressing)
    (state,) = skin_preview.step(bpy.context)
    assert "devices on linear tissue: the folder is full" in state.note and not state.waits
    pressing.objects["Finger"].dermis.finger.skin.poisson = 0.497  # that no table is made for
    (state,) = skin_preview.step(bpy.context)
    assert state.note.endswith("; devices on linear tissue") and not state.waits


def test_what_devices_take_of_a_touch_is_what_the_engine_says(pressing: bpy.types.Scene, skins: Cache) -> None:
    """And it is worked out where one asks, not for every frame."""
    table(pressing, skins)
    for frame in range(1, 7):
        pressing.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    views.renew(pressing)
    assert "matched" not in vars(state)
    wear(pressing, "thimble_3rrs")
    (state,) = skin_preview.step(bpy.context)
    finger = pressing.objects["Finger"]
    assert thimble_preview.follow(pressing, state, finger, finger.dermis.finger.devices[0]).rendered
    assert state.matched is state.matched and "matched" in vars(state)
    assert state.matched.model is state.model.matched and state.matched.model.stiff is state.model.stiff
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    touch = store.current(pressing).bake.skins["Finger"]
    sample = int(np.flatnonzero(touch.frames == 6.0)[0])
    wanted = touch.matched.amounts_at(sample)
    assert state.matched.amounts == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max())
    baked = views.skins(pressing)[0]
    assert baked.source == "bake"
    assert baked.matched.amounts == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


def test_a_platforms_table_is_swept_once_the_skins_own_are_there(pressing: bpy.types.Scene) -> None:
    wear(pressing, "cable_platform")
    hand = pressing.objects["Finger"]
    steps = platform_devices.make(hand, hand.dermis.finger.devices[0])
    assert [next(steps).stage for _ in range(2)] == ["skin", "tissue"]
    steps.close()
    assert not skin_models._making


def test_a_platform_previews_what_its_bake_does_on_stiff_skin(pressing: bpy.types.Scene, skins: Cache) -> None:
    table(pressing, skins)
    wear(pressing, "cable_platform")
    hand = pressing.objects["Finger"]
    device = hand.dermis.finger.devices[0]
    device.table_rows = 60
    assert platform_devices.model_of(hand).tissue == "neo_hookean" and not platform_devices.model_of(hand).follows_law
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    output = store.current(pressing).bake.outputs[0]
    assert not platform_devices.missing(hand, device)
    skin_preview.reset()
    for frame in range(1, 10):
        pressing.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    (row,) = platform_preview.live_rows(pressing, (state,))
    assert row.numbers == pytest.approx(output.track.values[-1], abs=0.02 * np.abs(output.track.values).max())


def test_a_tissue_that_older_versions_offered_opens_as_neo_hookean(tmp_path: Path) -> None:
    """It was the third in the menu, and files have its number."""
    path = tmp_path / "older.blend"
    for name, number in (("Linear", 0), ("Series", 1), ("Exact", 2)):
        skin = finger(name).dermis.finger.skin
        skin.tissue = "neo_hookean"  # so that the property is there
        values = skin.bl_system_properties_get() if hasattr(skin, "bl_system_properties_get") else skin
        values["tissue"] = number
    exact = bpy.data.objects["Exact"].dermis.finger.skin
    assert skin_properties.parameters(exact)["tissue"] == "neo_hookean"  # of a linked file it stays as it is
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    found = {name: bpy.data.objects[name].dermis.finger.skin.tissue for name in ("Linear", "Series", "Exact")}
    assert found == {"Linear": "linear", "Series": "neo_hookean", "Exact": "neo_hookean"}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.append(directory=f"{path}/Object/", filename="Exact")
    assert bpy.data.objects["Exact"].dermis.finger.skin.tissue == "neo_hookean"


def test_the_legend_says_the_band_of_each_tissue() -> None:
    stiff, linear = state_of(), replace(state_of(), model=fingertip_skin(level="draft"))
    for state, word in ((stiff, "neo-Hookean"), (linear, "linear")):
        text, band = skin_field.error_text([state]), error_band(state.tissue, state.depth)
        assert (
            text.startswith(f"{word} skin: stress about {100 * band.stress.median:.0f} % off") and "simulated" in text
        )
        force = f"{100 * band.force.median:.0f} %" if band.force.median >= 5e-3 else "below 1 %"  # never none at all
        assert f"force {force}" in text and "0.90 mm" in text
    both = skin_field.error_text([stiff, linear])
    assert "neo-Hookean skin" in both and "linear skin" in both
    far = replace(stiff, slide=trusted("neo_hookean").slide + 1e-3)
    assert "dragged farther than it is trusted" in skin_field.error_text([far]) and far.too_far and not far.too_deep
    deep = replace(stiff, depth=trusted("neo_hookean").depth + 1e-4)
    assert "deeper than it is trusted" in skin_field.error_text([deep]) and deep.too_deep
    assert not replace(linear, slide=0.05).too_far
