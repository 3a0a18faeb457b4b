"""A finger's skin of the tissue that it wants, and what devices are matched on where no table of it is at hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.cache import Cache
from core.contact.solver.cone import STICK
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.path import PathSolver
from core.errors import DermisError
from core.experiment import fingertip
from core.parameters.error_bands import NEO_HOOKEAN
from core.pipeline.bake import Bake
from core.pipeline.render import render
from core.presets import Library
from core.recent import Recent
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.skin.felt_state import matched_amounts
from core.skin.model import fingertip_skin
from core.skin.shape import shape_from_parameters
from core.skin.stimulus import Stimulus
from core.steps import drain
from core.surface.gap import Surface
from core.tissue import stiffening_store
from core.tissue.finger_skin import finger_skin, for_devices, of_tissue
from core.tissue.stiffening_store import stiffening_key
from tests.made_up_tissue import kept
from tests.touches import slide

WIDTH = 15.93e-3  # that no preset has


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cache:
    """Return an empty cache, with no table in memory."""
    monkeypatch.setattr(stiffening_store, "_known", Recent(10))
    return Cache(tmp_path, 10**9)


@pytest.fixture
def parameters() -> dict[str, object]:
    """Return a finger's parameters, of lengths that no preset has."""
    own = Library().skin("index_medium") | {"width": WIDTH}
    return {"skin": own, "skin_level": "draft", "skin_shown": True, "tissue": "neo_hookean", "contact": "nodes"}


def table(cache: Cache) -> str:
    """Put a made-up table of these lengths into a cache."""
    lengths = {n: v for n, v in Library().skin("index_medium").items() if n not in ("young", "poisson", "alpha")}
    return kept(cache, shape_from_parameters(lengths | {"width": WIDTH}), 0.48)


def scene(parameters: dict[str, object]) -> TactileScene:
    """Return a finger that is pressed onto a table by a millimetre; 'device' is what it wears."""
    own = {name: value for name, value in parameters.items() if name != "device"}
    devices = (DeviceUse(str(parameters["device"])),) if "device" in parameters else ()
    way = [(0.0, 0.0, 1e-3 - 0.2e-3 * i) for i in range(11)]
    block = Body("Table", Surface.block().mesh, Library().material("wood"))
    return scene_from_poses(100.0, [(Finger("Index", devices, parameters=own), way)], [(block, (0.0, 0.0, 0.0))])


def baked(parameters: dict[str, object], cache: Cache) -> Bake:
    """Return the bake of that press."""
    return drain(render(scene(parameters), Library(), cache=cache))


def test_tissue_follows_the_law_with_and_without_a_table_for_devices(
    cache: Cache, parameters: dict[str, object]
) -> None:
    before = finger_skin(parameters, {}, cache=cache)
    assert before.follows_law and before.tissue == "neo_hookean"
    assert before.stiffening is None and before.matched.tissue == "linear"
    key = table(cache)
    made = of_tissue(before, "neo_hookean")
    assert made.follows_law and made.stiffening is not None and made.stiffening.key == key
    assert made.matched.stiffening is made.stiffening and not made.matched.follows_law
    assert made.law is before.law and made.with_material(young=5e4).law is made.law
    # fingers of one shape share the table, whatever their stiffness and mesh
    other = finger_skin(parameters, {}, level="standard", cache=cache).with_material(young=5e4)
    assert other.stiffening is made.stiffening and other.follows_law
    assert finger_skin({**parameters, "tissue": "linear"}, {}, cache=cache).tissue == "linear"
    assert of_tissue(made, "linear").tissue == "linear" and of_tissue(made, "neo_hookean") is made


def test_what_older_files_call_exact_follows_the_law(cache: Cache, parameters: dict[str, object]) -> None:
    assert finger_skin({**parameters, "tissue": "neo_hookean_exact"}, {}, cache=cache).follows_law


def test_the_key_of_a_table_is_of_shape_and_poissons_ratio_alone(parameters: dict[str, object]) -> None:
    shape = fingertip_skin(level="draft").shape
    assert shape is not None and stiffening_key(shape, 0.48) == stiffening_key(
        replace(shape, width=shape.width + 1e-12), 0.48
    )
    assert (
        len(
            {
                stiffening_key(shape, 0.48),
                stiffening_key(shape, 0.47),
                stiffening_key(replace(shape, width=WIDTH), 0.48),
            }
        )
        == 3
    )


def worn(parameters: dict[str, object]) -> dict[str, object]:
    """Return the same scene's parameters, with a device that presses on the skin."""
    return {**parameters, "device": "pin_array_128"}


def test_a_bake_stiffens_without_a_table_and_says_what_devices_are_matched_on(
    cache: Cache, parameters: dict[str, object]
) -> None:
    felt, linear = baked(parameters, cache), baked({**parameters, "tissue": "linear"}, cache)
    assert not [f for f in felt.all_findings if f.code == "matched-linear"]  # nothing is worn
    assert felt.skins["Index"].normal_force[-1] > 1.03 * linear.skins["Index"].normal_force[-1]
    (finding,) = [f for f in baked(worn(parameters), cache).all_findings if f.code == "matched-linear"]
    assert finding.severity == "warning" and finding.where == "finger 'Index'" and "no table" in str(finding.value)
    table(cache)
    assert not [f for f in baked(worn(parameters), cache).all_findings if f.code == "matched-linear"]


def test_a_mesh_of_ones_own_stiffens_and_devices_are_matched_on_linear_skin(
    cache: Cache, parameters: dict[str, object], tmp_path: Path
) -> None:
    from tests.tissue import save_mesh

    path = tmp_path / "mine.npz"
    save_mesh(fingertip_skin(level="draft").mesh, path)
    own = {**parameters, "skin": {"mesh": str(path)}}
    bake, linear = baked(worn(own), cache), baked({**own, "tissue": "linear"}, cache)
    (finding,) = [f for f in bake.all_findings if f.code == "matched-linear"]
    assert "mesh of one's own" in str(finding.value)
    assert bake.skins["Index"].normal_force[-1] > 1.03 * linear.skins["Index"].normal_force[-1]


def test_a_bake_keeps_what_skin_gives_way_less_and_a_table_gives_it_a_name_of_its_own(
    cache: Cache, parameters: dict[str, object]
) -> None:
    before = baked(parameters, cache)
    table(cache)
    bake, again = baked(parameters, cache), baked(parameters, cache)
    felt = bake.skins["Index"]
    count = 3 * felt.model.pad_count
    assert felt.amounts is not None and felt.amounts.shape == (len(felt.contact), count)
    assert bake.content_hash != before.content_hash and bake.content_hash == again.content_hash
    assert felt.force.tobytes() == again.skins["Index"].force.tobytes() == before.skins["Index"].force.tobytes()
    assert felt.matched.amounts is not None and felt.matched.amounts.shape == (len(felt.contact), 5)
    assert before.skins["Index"].matched.amounts is None
    assert felt.slide is not None and len(felt.slide) == len(felt.times) and (felt.slide < 0.1e-3).all()


def test_devices_take_how_much_there_is_of_each_pattern_where_skin_lies() -> None:
    """Skin that lies in its patterns is told by them, and a light touch as linear skin tells it."""
    skin = of_tissue(fingertip_skin(level="draft"), NEO_HOOKEAN)
    force = np.zeros((skin.pad_count, 3))
    force[:8, 2] = 1e-3
    light = matched_amounts(Stimulus(skin, force, given=np.zeros(force.size)))
    assert light is not None
    np.testing.assert_allclose(light, skin.stiff.pad.T @ force.ravel() / skin.material.modulus, rtol=1e-12)
    q = 1e-5 * np.arange(1.0, len(light) + 1.0)
    beyond = skin.unit_compliance @ force.ravel() / skin.material.modulus - skin.stiff.pad @ q
    found = matched_amounts(Stimulus(skin, force, given=beyond))
    np.testing.assert_allclose(found, skin.stiff.bound @ q, atol=1e-9 * np.abs(q).max())


def test_a_script_asks_for_tissue_and_a_device_for_its_table(cache: Cache) -> None:
    made = fingertip(level="draft", width=WIDTH, tissue="neo_hookean", cache=cache)
    assert made.tissue == "neo_hookean" and "neo-Hookean" in repr(made)
    with pytest.raises(DermisError, match="no series") as caught:
        for_devices(made, "neo_hookean", "here")
    assert caught.value.code == "matched-linear"
    table(cache)
    assert for_devices(made, "neo_hookean", "here").stiffening is not None
    assert for_devices(made, "linear", "here").tissue == "linear"
    with pytest.raises(DermisError, match="tissue"):
        fingertip(level="draft", tissue="rubber")
    assert np.array_equal(made.compliance, fingertip(level="draft", width=WIDTH).compliance)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_skin_that_stiffens_holds_a_plane_that_is_drawn_across_it_as_far_as_friction_does() -> None:
    """1 mm deep and drawn to and fro by 3 mm: it sticks, then slips, and gives way to no drag in between."""
    skin = of_tissue(fingertip_skin(), NEO_HOOKEAN)
    solver = PathSolver(skin.compliance, skin.positions, areas=skin.areas, law=LawSkin.of(skin))
    touch, slipped = slide(80), 0
    for frame in range(60):
        step = solver.step(touch.bodies(frame))
        assert step.solution.converged
        force = step.solution.force.sum(axis=0)
        if step.solution.force.any() and not (step.solution.status == STICK).any():
            slipped += 1
            assert np.hypot(*force[:2]) >= 0.97 * touch.friction * force[2]
    assert slipped >= 3
