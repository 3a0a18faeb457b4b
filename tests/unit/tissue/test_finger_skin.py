"""A finger's skin of the tissue that it wants: where its table is at hand, and what is said where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.cache import Cache
from core.contact.solver.cone import STICK
from core.contact.solver.path import PathSolver
from core.contact.solver.stiff_skin import StiffSkin
from core.errors import DermisError
from core.experiment import fingertip
from core.parameters.error_bands import NEO_HOOKEAN
from core.pipeline.bake import Bake
from core.pipeline.render import render
from core.presets import Library
from core.recent import Recent
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, Finger, TactileScene
from core.skin.model import fingertip_skin
from core.skin.shape import shape_from_parameters
from core.steps import drain
from core.surface.gap import Surface
from core.tissue import stiffening_store
from core.tissue.finger_skin import finger_skin, of_tissue
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
    """Return a finger that is pressed onto a table by a millimetre."""
    way = [(0.0, 0.0, 1e-3 - 0.2e-3 * i) for i in range(11)]
    block = Body("Table", Surface.block().mesh, Library().material("wood"))
    return scene_from_poses(100.0, [(Finger("Index", parameters=parameters), way)], [(block, (0.0, 0.0, 0.0))])


def baked(parameters: dict[str, object], cache: Cache) -> Bake:
    """Return the bake of that press."""
    return drain(render(scene(parameters), Library(), cache=cache))


def test_tissue_is_linear_until_its_table_is_there(cache: Cache, parameters: dict[str, object]) -> None:
    assert finger_skin(parameters, {}, cache=cache).tissue == "linear"
    key = table(cache)
    made = finger_skin(parameters, {}, cache=cache)
    assert made.tissue == "neo_hookean" and made.stiffening is not None and made.stiffening.key == key
    # fingers of one shape share it, whatever their stiffness and mesh
    other = finger_skin(parameters, {}, level="standard", cache=cache).with_material(young=5e4)
    assert other.stiffening is made.stiffening and other.tissue == "neo_hookean"
    assert finger_skin({**parameters, "tissue": "linear"}, {}, cache=cache).tissue == "linear"
    assert of_tissue(made, "linear").tissue == "linear" and of_tissue(made, "neo_hookean") is made


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


def test_a_bake_without_the_table_says_so_and_is_that_of_linear_skin(
    cache: Cache, parameters: dict[str, object]
) -> None:
    missing, linear = baked(parameters, cache), baked({**parameters, "tissue": "linear"}, cache)
    (finding,) = [f for f in missing.all_findings if f.code == "tissue-linear"]
    assert finding.severity == "warning" and finding.where == "finger 'Index'" and "no table" in str(finding.value)
    assert missing.skins["Index"].force.tobytes() == linear.skins["Index"].force.tobytes()
    assert missing.skins["Index"].amounts is None
    assert "tissue-linear" not in {f.code for f in linear.all_findings}


def test_a_bake_on_a_mesh_of_ones_own_says_so(cache: Cache, parameters: dict[str, object], tmp_path: Path) -> None:
    from tests.tissue import save_mesh

    path = tmp_path / "mine.npz"
    save_mesh(fingertip_skin(level="draft").mesh, path)
    bake = baked({**parameters, "skin": {"mesh": str(path)}}, cache)
    (finding,) = [f for f in bake.all_findings if f.code == "tissue-linear"]
    assert "mesh of one's own" in str(finding.value)


def test_a_bake_with_the_table_stiffens_and_has_a_name_of_its_own(cache: Cache, parameters: dict[str, object]) -> None:
    before = baked(parameters, cache)
    table(cache)
    bake, again = baked(parameters, cache), baked(parameters, cache)
    felt = bake.skins["Index"]
    assert "tissue-linear" not in {f.code for f in bake.all_findings}
    assert felt.amounts is not None and felt.amounts.shape == (len(felt.contact), 5)
    assert felt.normal_force[-1] > 1.1 * before.skins["Index"].normal_force[-1]
    assert bake.content_hash != before.content_hash and bake.content_hash == again.content_hash
    assert felt.force.tobytes() == again.skins["Index"].force.tobytes()
    assert felt.stimulus_at(int(felt.contact[-1])).given is not None
    assert felt.slide is not None and len(felt.slide) == len(felt.times) and (felt.slide < 0.1e-3).all()


def test_a_script_asks_for_tissue_and_is_refused_where_there_is_no_table(cache: Cache) -> None:
    with pytest.raises(DermisError, match="no table") as caught:
        fingertip(level="draft", width=WIDTH, tissue="neo_hookean", cache=cache)
    assert caught.value.code == "tissue-linear"
    table(cache)
    made = fingertip(level="draft", width=WIDTH, tissue="neo_hookean", cache=cache)
    assert made.tissue == "neo_hookean" and "neo-Hookean" in repr(made)
    with pytest.raises(DermisError, match="tissue"):
        fingertip(level="draft", tissue="rubber")
    assert np.array_equal(made.compliance, fingertip(level="draft", width=WIDTH).compliance)


def test_skin_that_stiffens_holds_a_plane_that_is_drawn_across_it_as_far_as_friction_does() -> None:
    """1 mm deep and drawn to and fro by 3 mm: it sticks, then slips, and gives way to no drag in between."""
    skin = of_tissue(fingertip_skin(), NEO_HOOKEAN)
    solver = PathSolver(skin.compliance, skin.positions, areas=skin.areas, stiff=StiffSkin.of(skin))
    assert skin.stiffening is not None
    touch, slipped, least = slide(80), 0, np.inf
    for frame in range(60):
        step = solver.step(touch.bodies(frame))
        assert step.solution.converged
        if step.amounts is None or not step.solution.force.any():
            continue
        least = min(least, float(np.linalg.eigvalsh(skin.stiffening.energy.stiffness(step.amounts))[0]) + 1.0)
        force = step.solution.force.sum(axis=0)
        if not (step.solution.status == STICK).any():
            slipped += 1
            assert np.hypot(*force[:2]) >= 0.97 * touch.friction * force[2]
    assert slipped >= 3
    assert least > 0.0  # tissue is stable all the way
