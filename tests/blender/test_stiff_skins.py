"""Fingers whose tissue stiffens: what is shown is the engine's, preview and bake agree, bakes are stored and read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import reporting
from blender_addon.devices import skin_models
from blender_addon.preview import skin_preview
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


def state_of(level: str = "draft", *, points: bool = False) -> SkinState:
    """Return a skin that stiffens, pressed flat."""
    linear = fingertip_skin(level=level)
    model = linear.with_stiffening(made_up(linear))
    force = flat_press(model.compliance, model.positions[:, 2], DEPTH)
    return SkinState("Finger", model, force, float(force[:, 2].sum()), depth=DEPTH, source="live")


@pytest.mark.parametrize("level", ["draft", "standard"])
def test_what_is_drawn_is_the_engines_displacement_and_stress(level: str) -> None:
    state = state_of(level)
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


def test_how_much_of_each_pattern_a_contact_found_is_what_is_drawn() -> None:
    state = state_of()
    found = Stimulus(state.model, state.force).amounts
    assert found is not None
    same, other = replace(state, amounts=found), replace(state, amounts=0.5 * found)
    drawn = [skin_field.draw_of(one, "displacement").values for one in (state, same, other)]
    assert np.array_equal(drawn[0], drawn[1]) and np.abs(drawn[0] - drawn[2]).max() > 0.01 * drawn[0].max()
    shown = [skin_shown.values(one, "displacement", 1.0).values for one in (same, other)]
    assert not np.array_equal(*shown)


def test_stress_beneath_points_is_that_of_the_stiff_skin(pressing: bpy.types.Scene, skins: Cache) -> None:
    table(pressing, skins)
    skin = pressing.objects["Finger"].dermis.finger.skin
    skin.width_mm, skin.contact = 16.0, "points"  # whose smooth pad ships
    table(pressing, skins)
    for frame in range(1, 7):
        pressing.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    assert state.points is not None and state.amounts is not None and smooth_pad(state.model) is not None
    own = skin_field.kit(state.model.mesh)
    flat = replace(state, model=state.model.with_stiffening(None), amounts=None)
    stiff, linear = (skin_field.draw_of(one, "zz").values for one in (state, flat))
    ((below),) = own.below.values()
    vertices = below.vertices[np.argsort(-np.abs(stiff[below.vertices]))[:20]]  # just above what presses
    nodal = state.model.mesh.averaging @ (state.model.material.modulus * state.model.stiff.beyond(state.amounts))
    more = (own.surface.refine @ nodal[own.surface.nodes])[vertices, 2]
    assert stiff[vertices] - linear[vertices] == pytest.approx(more, abs=1e-4 * np.abs(linear).max())
    assert np.abs(more).max() > 0.02 * np.abs(linear).max()


@pytest.mark.parametrize("contact", ["nodes", "points"])
def test_a_preview_feels_what_the_bake_feels(pressing: bpy.types.Scene, skins: Cache, contact: str) -> None:
    skin = pressing.objects["Finger"].dermis.finger.skin
    skin.width_mm, skin.contact = 16.0, contact
    table(pressing, skins)
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
    key = table(pressing, skins)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    touch = store.current(pressing).bake.skins["Finger"]
    assert touch.amounts.dtype == np.float32 and touch.model.stiffening.key == key
    store.forget()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert np.array_equal(loaded.amounts, touch.amounts) and np.array_equal(loaded.slide, touch.slide)
    assert loaded.model.tissue == "neo_hookean"
    last = int(touch.contact[-1])
    first, second = (
        skin_field.draw_of(SkinState.of("F", t.model, t.at(last), "bake", "", {}), "von_mises") for t in (touch, loaded)
    )
    assert np.array_equal(first.values, second.values) and np.array_equal(first.positions, second.positions)


def test_a_stored_bake_whose_table_is_gone_is_not_shown_as_linear(pressing: bpy.types.Scene, skins: Cache) -> None:
    table(pressing, skins)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    store.forget()
    skin_models.forget()
    stiffening_store._known.clear()
    skins.clear()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    assert dict(store.current(pressing).bake.skins) == {}
    (refused,) = [f for f in reporting.findings() if f.code == "tissue-linear"]
    assert "table" in refused.what and refused.remedy == "Bake again"


def test_results_of_the_version_before_are_read(pressing: bpy.types.Scene, tmp_path: Path) -> None:
    pressing.objects["Finger"].dermis.finger.skin.tissue = "linear"
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    kept = store.current(pressing)
    path = store.cache().get(store._key(kept.bake.content_hash))
    assert path is not None
    with np.load(path) as file:
        arrays = {n: file[n] for n in file.files if not n.endswith(("_slide", "_amounts"))}
    header = json.loads(arrays.pop("header").tobytes())
    header["version"] = 1
    for entry in header["skins"]:
        del entry["tissue"], entry["stiffening"]
    path.unlink()

    def write(target: Path) -> None:
        with open(target, "wb") as out:
            np.savez_compressed(out, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)

    store.cache().put(store._key(kept.bake.content_hash, 1), write)
    store.forget()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert np.array_equal(loaded.force, kept.bake.skins["Finger"].force) and loaded.slide is None
    assert loaded.at(int(loaded.contact[-1])).slide == 0.0


def test_a_table_is_wanted_where_tissue_is_to_stiffen_and_none_is_there(
    pressing: bpy.types.Scene, skins: Cache
) -> None:
    parameters = skin_properties.parameters(pressing.objects["Finger"].dermis.finger.skin)
    wants = skin_models.wants_stiffening
    assert wants(parameters) and not wants({**parameters, "tissue": "linear"})
    assert not wants({**parameters, "skin": {"mesh": "mine.npz"}})
    table(pressing, skins)
    assert not wants(parameters)
    model = skin_models.of(parameters)
    assert model is skin_models.of(parameters) and model.tissue == "neo_hookean"
    assert skin_models.get(parameters["skin"], "draft").tissue == "linear"


def test_a_child_process_makes_the_table_and_ends_when_nobody_waits(pressing: bpy.types.Scene, skins: Cache) -> None:
    parameters = skin_properties.parameters(pressing.objects["Finger"].dermis.finger.skin)
    steps = skin_models.tables_made(parameters)  # nodes want no smooth pad
    first = next(steps)
    (job,) = skin_models._making.values()
    assert first.stage == "tissue" and not job.done()
    steps.close()  # Esc
    assert job.cancelled() and not skin_models._making and skin_models.wants_stiffening(parameters)
    assert not list(skins.folder.rglob("*")) if skins.folder.exists() else True


def test_what_no_table_can_be_made_for_is_told_and_stays_linear(pressing: bpy.types.Scene) -> None:
    skin = pressing.objects["Finger"].dermis.finger.skin
    skin.poisson = 0.497
    parameters = skin_properties.parameters(skin)
    assert list(skin_models.tables_made(parameters))  # waits until its refusal
    refusal = skin_models.refusal(parameters["skin"], skin_models.STIFFENING)
    assert "Poisson" in refusal and "0.497" in refusal and skin_models.of(parameters).tissue == "linear"
    pressing.frame_set(5)
    (state,) = skin_preview.step(bpy.context)
    assert "linear tissue: " in state.note and "Poisson" in state.note
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    assert "tissue-linear" in {f.code for f in store.current(pressing).bake.all_findings}


def test_a_preview_goes_on_with_linear_tissue_and_says_so(
    pressing: bpy.types.Scene, skins: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(skin_models, "make_stiffening", lambda skin: 0.34)
    pressing.frame_set(5)
    (state,) = skin_preview.step(bpy.context)
    assert "linear tissue while its table is made: 34%" in state.note and state.tissue == "linear"
    table(pressing, skins)
    pressing.frame_set(6)
    (state,) = skin_preview.step(bpy.context)
    assert "linear tissue" not in state.note and state.tissue == "neo_hookean" and state.amounts is not None
    pressing.frame_set(5)
    (state,) = skin_preview.step(bpy.context)
    assert state.tissue == "neo_hookean"  # and not the linear skin that was seen there


def test_the_frame_that_is_shown_follows_while_its_table_is_made(
    pressing: bpy.types.Scene, skins: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody has to go to another frame to see how far the table is, or what it brings."""
    pressing.frame_set(5)
    for made in (0.34, 0.6):
        monkeypatch.setattr(skin_models, "make_stiffening", lambda skin, made=made: made)
        (state,) = skin_preview.step(bpy.context)
        assert f"while its table is made: {made:.0%}" in state.note and state.tissue == "linear"
    table(pressing, skins)
    (state,) = skin_preview.step(bpy.context)
    assert "linear tissue" not in state.note and state.tissue == "neo_hookean" and state.normal_force > 0.0
    (again,) = skin_preview.step(bpy.context)
    assert again is state  # and then it holds


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


def test_a_bake_follows_the_exact_law_and_a_preview_the_series(pressing: bpy.types.Scene, skins: Cache) -> None:
    skin = pressing.objects["Finger"].dermis.finger.skin
    skin.width_mm, skin.tissue = 16.0, "neo_hookean_exact"  # whose tables ship
    for frame in range(1, 7):
        pressing.frame_set(frame)
        (live,) = skin_preview.step(bpy.context)
    assert live.tissue == "neo_hookean" and "a bake follows the exact law" in live.note and live.touching
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(pressing).bake
    touch = bake.skins["Finger"]
    assert touch.model.tissue == "neo_hookean_exact" and "tissue-series" not in {f.code for f in bake.all_findings}
    (shown,) = views.skins(pressing)
    assert shown.tissue == "neo_hookean_exact" and shown.matched.tissue == "neo_hookean"
    assert "exact neo-Hookean skin" in skin_field.error_text([shown])
    drawn = skin_field.draw_of(shown, "von_mises").values
    near = skin_field.draw_of(live, "von_mises").values
    assert 0.0 < np.abs(drawn - near).max() < 0.2 * near.max()
    assert touch.normal_force[5] == pytest.approx(live.normal_force, rel=0.03)
    store.forget()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert loaded.model.tissue == "neo_hookean_exact" and np.array_equal(loaded.amounts, touch.amounts)


def test_the_exact_laws_table_is_made_before_a_bake_alone(
    pressing: bpy.types.Scene, skins: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    pressing.objects["Finger"].dermis.finger.skin.tissue = "neo_hookean_exact"
    table(pressing, skins)
    parameters = skin_properties.parameters(pressing.objects["Finger"].dermis.finger.skin)
    assert skin_models.wants_exact(parameters) and not skin_models.wants_stiffening(parameters)
    assert not skin_models.wants_exact({**parameters, "tissue": "neo_hookean"})
    assert not list(skin_models.tables_made(parameters))
    steps = skin_models.tables_made(parameters, exact=True)
    first = next(steps)
    (job,) = skin_models._making.values()
    assert first.stage == "tissue" and not job.done()
    steps.close()  # Esc
    assert job.cancelled() and not skin_models._making and skin_models.wants_exact(parameters)
    monkeypatch.setattr(skin_models, "make_exact", lambda skin: None)  # it could not be made
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(pressing).bake
    assert bake.skins["Finger"].model.tissue == "neo_hookean"
    assert "tissue-series" in {f.code for f in bake.all_findings}
