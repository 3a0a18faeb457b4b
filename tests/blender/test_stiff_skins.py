"""Fingers whose tissue stiffens: what is shown is the engine's, preview and bake agree, bakes are stored and read.

Skin and the devices that follow it wait for nothing.
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
from blender_addon.devices import platform_devices, skin_models
from blender_addon.preview import pin_preview, platform_preview, skin_preview, thimble_preview
from blender_addon.preview.skin_state import SkinState
from blender_addon.properties import skin_properties
from blender_addon.results import store
from blender_addon.viewport import shown as views
from blender_addon.viewport import skin_cards, skin_field, skin_shown
from core.cache import Cache
from core.contact.trusted import trusted
from core.parameters.error_bands import error_band
from core.skin.model import fingertip_skin
from core.skin.stimulus import Stimulus
from core.skin.stress import von_mises
from core.skin.surface_store import smooth_pad
from tests.problems import flat_press
from tests.tissue import probes_at, save_mesh

from .build import cube, finger, keys, span

pytestmark = pytest.mark.shared_tests("the engine's tissue")

TOP, DEPTH = 0.02, 0.9e-3


@pytest.fixture(autouse=True)
def skins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cache]:
    """Return the cache of skins, which is empty."""
    cache = Cache(tmp_path / "skins", 10**9)
    skin_preview.reset()
    skin_models.forget()
    monkeypatch.setattr(skin_models, "cache", lambda: cache)
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


def state_of(level: str = "draft") -> SkinState:
    """Return a skin that stiffens, pressed flat."""
    model = fingertip_skin(level=level).with_law()
    force = flat_press(model.compliance, model.positions[:, 2], DEPTH)
    return SkinState("Finger", model, force, float(force[:, 2].sum()), depth=DEPTH, source="live")


def wear(scene: bpy.types.Scene, preset: str = "pin_array_128") -> None:
    """Put a device on the scene's finger."""
    scene.objects["Finger"].dermis.finger.devices.add().preset = preset
    bpy.context.view_layer.update()


@pytest.mark.parametrize("level", ["draft", "standard"])
def test_what_is_drawn_is_the_engines_displacement_and_stress(level: str) -> None:
    state = state_of(level)
    stimulus, own = Stimulus(state.model, state.force), skin_field.kit(state.model.mesh)
    nodes, count = own.surface.nodes, len(own.surface.points)
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


def test_what_a_contact_kept_of_tissue_is_what_is_drawn() -> None:
    state = state_of()
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
    flat = replace(state, model=state.model.linear, amounts=None)
    stiff, linear = (skin_field.draw_of(one, "zz").values for one in (state, flat))
    ((below),) = own.below.values()
    vertices = below.vertices[np.argsort(-np.abs(stiff[below.vertices]))[:20]]  # just above what presses
    felt = Stimulus(state.model, state.force, state.points, state.amounts)
    places = below.table.probes.points[np.searchsorted(below.vertices, vertices)]
    more = probes_at(state.model.mesh, places).read(felt.stress - state.model.stress(state.force))[:, 2]
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
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    touch = store.current(pressing).bake.skins["Finger"]
    assert touch.model.follows_law
    assert touch.amounts.dtype == np.float32 and touch.amounts.shape == (len(touch.contact), 3 * touch.model.pad_count)
    store.forget()
    skin_models.forget()
    skins.clear()
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert np.array_equal(loaded.amounts, touch.amounts) and np.array_equal(loaded.slide, touch.slide)
    assert loaded.model.follows_law
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
def test_a_bake_by_the_series_of_an_earlier_version_is_read_and_told_by_the_law(
    pressing: bpy.types.Scene, tissue: str
) -> None:
    """Its forces are as they were; how much there was of each pattern says nothing any more."""
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    felt = store.current(pressing).bake.skins["Finger"]
    patterns = np.ones((len(felt.contact), 5), np.float32)
    rewritten(pressing, 2, {"tissue": tissue, "law": None, "stiffening": "0123"}, amounts=patterns)
    assert bpy.ops.dermis.load_result() == {"FINISHED"}
    loaded = store.current(pressing).bake.skins["Finger"]
    assert loaded.model.follows_law and loaded.amounts is None
    assert np.array_equal(loaded.force, felt.force)
    (told,) = [f for f in reporting.findings() if f.code == "earlier-tissue"]
    assert told.severity == "info" and "Bake again" in told.remedy
    pressing.frame_set(6)
    (state,) = views.skins(pressing)
    assert state.source == "earlier" and state.tissue == "neo_hookean"
    sample = int(np.flatnonzero(loaded.frames == 6.0)[0])
    by_law = skin_field.draw_of(state, "von_mises").values
    kept = replace(state, amounts=felt.amounts_at(sample))
    assert np.abs(by_law - skin_field.draw_of(kept, "von_mises").values).max() < 0.05 * by_law.max()


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
    wear(pressing)
    assert not list(skin_models.tables_made(parameters))  # of contact on nodes
    for frame in range(1, 7):
        pressing.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
    assert state.tissue == "neo_hookean" and state.amounts is not None
    assert "tissue" not in state.note and not state.waits and not skin_models._making
    linear = replace(state, model=state.model.linear, amounts=None)
    moved = [skin_field.draw_of(one, "displacement").values.max() for one in (state, linear)]
    assert 0.5 * moved[1] < moved[0] < 0.99 * moved[1]
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(pressing).bake
    assert bake.skins["Finger"].model.follows_law and "stress_error" in bake.outputs[0].signals
    assert bake.skins["Finger"].normal_force[5] == pytest.approx(state.normal_force, rel=0.01)


@pytest.mark.parametrize("preset", ["pin_array_128", "thimble_3rrs"])
def test_a_preview_tells_the_errors_of_its_bake_by_the_law(pressing: bpy.types.Scene, preset: str) -> None:
    """Commands and errors of a frame are by the same law in both, and the whole stress stands in the card's note."""
    wear(pressing, preset)
    module = pin_preview if preset == "pin_array_128" else thimble_preview
    for frame in range(1, 10):
        pressing.frame_set(frame)
        (state,) = skin_preview.step(bpy.context)
        rows, rendered = module.live_rows(pressing, (state,)), module.rendered(pressing, (state,))
    (row,), (made,) = rows, rendered
    assert made.amounts is not None and "whole stress" in made.note
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    output = store.current(pressing).bake.outputs[0]
    told = float(output.signals["stress_error"][-2])
    said = float(made.note.split("%")[-2 if made.note.count("%") > 1 else 0].split()[-1])
    assert said == pytest.approx(100.0 * told, abs=12.0) and row.numbers.any()


def test_skins_of_other_stiffness_share_what_was_made_for_the_law(pressing: bpy.types.Scene) -> None:
    parameters = skin_properties.parameters(pressing.objects["Finger"].dermis.finger.skin)
    model = skin_models.of(parameters)
    assert model is skin_models.of(parameters) and model.follows_law
    stiffer = skin_models.of({**parameters, "skin": {**parameters["skin"], "young": 2e5}})
    assert stiffer.law is model.law and stiffer.material.young == 2e5
    assert skin_models.get(parameters["skin"], "draft").tissue == "linear"


def test_a_platforms_table_is_swept_once_the_skins_own_are_there(pressing: bpy.types.Scene) -> None:
    wear(pressing, "cable_platform")
    hand = pressing.objects["Finger"]
    steps = platform_devices.make(hand, hand.dermis.finger.devices[0])
    assert [next(steps).stage for _ in range(2)] == ["skin", "platform configurations"]
    steps.close()
    assert not skin_models._making


def test_a_platform_previews_what_its_bake_does_on_stiff_skin(pressing: bpy.types.Scene, skins: Cache) -> None:
    wear(pressing, "cable_platform")
    hand = pressing.objects["Finger"]
    device = hand.dermis.finger.devices[0]
    device.table_rows = 60
    assert platform_devices.model_of(hand).follows_law
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
        mesh = "the standard mesh (6.4k tetrahedra) alone 10 % at 2 mm, 1.6 mm below the skin, this mesh has "
        assert (mesh + f"{len(state.model.mesh.tetrahedra):,}" in text) == (word == "neo-Hookean")
        assert skin_field.error_lines([state]) == [f"{word} skin: stress about {100 * band.stress.median:.0f} % off"]
    assert skin_field.error_lines([stiff, linear])[1].startswith("linear skin")
    waiting = SkinState("Finger", None, np.zeros((0, 3)), note="making the draft skin: 10%")
    assert skin_field.error_lines([waiting]) == [] and len(skin_field.error_lines([waiting, stiff])) == 1
    air = replace(stiff, depth=0.0)
    assert skin_field.error_lines([air]) == ["neo-Hookean skin: stress 1 % off at 1 mm"]
    assert all(len(line) <= skin_cards.LETTERS for line in skin_field.error_lines([air, stiff, linear]))
    both = skin_field.error_text([stiff, linear])
    assert "neo-Hookean skin" in both and "linear skin" in both
    far = replace(stiff, slide=trusted("neo_hookean").slide + 1e-3)
    assert skin_field.error_lines([far])[1] == "dragged farther than it is trusted"
    assert "dragged farther than it is trusted" in skin_field.error_text([far]) and far.too_far and not far.too_deep
    deep = replace(stiff, depth=trusted("neo_hookean").depth + 1e-4)
    assert skin_field.error_lines([deep])[1] == "deeper than it is trusted"
    assert "deeper than it is trusted" in skin_field.error_text([deep]) and deep.too_deep
    assert replace(linear, slide=trusted("linear").slide + 1e-4).too_far
