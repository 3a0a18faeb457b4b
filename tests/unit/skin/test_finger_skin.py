"""A finger's skin of the tissue that it wants, and devices that follow it on any fingertip and mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.cache import Cache
from core.contact.solver.cone import STICK
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.errors import DermisError
from core.experiment import fingertip
from core.parameters.error_bands import NEO_HOOKEAN
from core.pipeline.bake import Bake
from core.pipeline.render import render
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.skin.finger_skin import finger_skin, of_tissue
from core.skin.model import fingertip_skin
from core.steps import drain
from core.surface.gap import Surface
from tests.tissue import save_mesh
from tests.touches import slide

WIDTH = 15.93e-3  # that no preset has


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    """Return an empty cache."""
    return Cache(tmp_path, 10**9)


@pytest.fixture
def parameters() -> dict[str, object]:
    """Return a finger's parameters, of lengths that no preset has."""
    own = Library().skin("index_medium") | {"width": WIDTH}
    return {"skin": own, "skin_level": "draft", "skin_shown": True, "tissue": "neo_hookean", "contact": "nodes"}


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


def test_a_skin_has_the_tissue_that_is_asked_for(cache: Cache, parameters: dict[str, object]) -> None:
    made = finger_skin(parameters, {}, cache=cache)
    assert made.follows_law and made.tissue == "neo_hookean" and of_tissue(made, "neo_hookean") is made
    assert made.linear.tissue == "linear" and made.linear.linear is made.linear and made.linear.with_law().follows_law
    assert made.with_material(young=5e4).law is made.law
    assert of_tissue(made, "linear") is made.linear
    assert finger_skin({**parameters, "tissue": "linear"}, {}, cache=cache).tissue == "linear"


def test_what_older_files_call_exact_follows_the_law(cache: Cache, parameters: dict[str, object]) -> None:
    assert finger_skin({**parameters, "tissue": "neo_hookean_exact"}, {}, cache=cache).follows_law


@pytest.mark.parametrize("own_mesh", [False, True])
def test_devices_follow_the_law_on_any_lengths_and_on_a_mesh_of_ones_own(
    cache: Cache, parameters: dict[str, object], tmp_path: Path, own_mesh: bool
) -> None:
    """Nothing has to be made for them, and what they are told is not linear skin's."""
    if own_mesh:
        save_mesh(fingertip_skin(level="draft").mesh, tmp_path / "mine.npz")
        parameters = {**parameters, "skin": {"mesh": str(tmp_path / "mine.npz")}}
    worn = {**parameters, "device": "pin_array_128"}
    felt, linear = baked(worn, cache), baked({**worn, "tissue": "linear"}, cache)
    assert felt.skins["Index"].normal_force[-1] > 1.03 * linear.skins["Index"].normal_force[-1]
    assert not {f.code for f in felt.all_findings} & {"matched-linear", "law-unsettled"}
    (own,), (other,) = felt.outputs, linear.outputs
    assert np.abs(own.track.values - other.track.values).max() > 0.01 * own.track.values.max()
    assert 0.0 < own.signals["stress_error"].max() < 1.5


def test_a_bake_keeps_what_skin_gives_way_less(cache: Cache, parameters: dict[str, object]) -> None:
    bake, again = baked(parameters, cache), baked(parameters, cache)
    felt = bake.skins["Index"]
    count = 3 * felt.model.pad_count
    assert felt.amounts is not None and felt.amounts.shape == (len(felt.contact), count)
    assert bake.content_hash == again.content_hash
    assert felt.force.tobytes() == again.skins["Index"].force.tobytes()
    assert felt.slide is not None and len(felt.slide) == len(felt.times) and (felt.slide < 0.1e-3).all()


def test_a_script_asks_for_tissue() -> None:
    made = fingertip(level="draft", width=WIDTH, tissue="neo_hookean")
    assert made.tissue == "neo_hookean" and "neo-Hookean" in repr(made)
    with pytest.raises(DermisError, match="tissue"):
        fingertip(level="draft", tissue="rubber")
    assert np.array_equal(made.compliance, fingertip(level="draft", width=WIDTH).compliance)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_skin_that_stiffens_holds_a_plane_that_is_drawn_across_it_as_far_as_friction_does() -> None:
    """1 mm deep and drawn to and fro by 3 mm: it sticks, then slips, and gives way to no drag in between."""
    skin = of_tissue(fingertip_skin(), NEO_HOOKEAN)
    solver = PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance), law=LawSkin.of(skin))
    touch, slipped = slide(80), 0
    for frame in range(60):
        step = solver.step(touch.bodies(frame))
        assert step.solution.converged
        force = step.solution.force.sum(axis=0)
        if step.solution.force.any() and not (step.solution.status == STICK).any():
            slipped += 1
            assert np.hypot(*force[:2]) >= 0.97 * touch.friction * force[2]
    assert slipped >= 3
