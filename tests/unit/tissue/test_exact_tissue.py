"""Skin of the exact law in a few fields, of the table that ships, against exact answers; and what is done with it."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from core.cache import Cache
from core.contact.skin_arrays import arrays_of, touch_of
from core.parameters.error_bands import LINEAR, NEO_HOOKEAN, NEO_HOOKEAN_EXACT
from core.pipeline.bake import Bake
from core.pipeline.render import run
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.skin.model import SkinModel, fingertip_skin
from core.skin.stimulus import Stimulus
from core.surface.gap import Surface
from core.tissue.finger_skin import of_tissue
from tests.benchmarks.nonlinear_reference import Reference
from tests.nonlinear import difference
from tests.stiff import on_nodes, press
from tests.touches import flat

Array = NDArray[np.float64]


@functools.cache
def skin(level: str = "draft", tissue: str = NEO_HOOKEAN_EXACT) -> SkinModel:
    """Return the standard finger of a tissue, whose table ships."""
    made = of_tissue(fingertip_skin(level=level), tissue)
    assert made.tissue == tissue
    return made


def felt(own: SkinModel, depth: float, slide: float = 0.0, tolerance: float = 1e-5) -> Stimulus:
    """Return what a plate does that is pressed so deep [m], then drawn."""
    touch, solver = press(own, flat(), depth, slide=slide, step=min(0.2e-3, depth)), on_nodes(own, tolerance)
    for i in range(len(touch.position)):
        step = solver.step(touch.bodies(i))
    assert step.solution.converged
    return Stimulus(own, step.solution.force, given=step.amounts)


def test_it_is_nearer_to_the_exact_finger_than_the_series() -> None:
    """Closed loop on a touch that no table has seen: pressed 2 mm and drawn."""
    truth = Reference()
    number = next(i for i, path in enumerate(truth.paths) if path.kind == "ball" and path.move == "shear")
    path, frames = truth.paths[number], {f.number: f for f in truth.frames(number)}
    off: dict[str, list[float]] = {}
    for tissue in (LINEAR, NEO_HOOKEAN, NEO_HOOKEAN_EXACT):
        own = skin("standard", tissue)
        solver = on_nodes(own, 3e-5)
        for i, bodies in enumerate(path.frames(own.positions)[: max(frames) + 1]):
            step = solver.step(bodies)
            if i in frames:
                stress = Stimulus(own, step.solution.force, given=step.amounts).stress
                off.setdefault(tissue, []).append(difference(stress, frames[i].stress, own.mesh.volumes))
    deep = slice(1, None)  # from 1 mm on: half as deep both are 2 % off
    assert (np.array(off[NEO_HOOKEAN_EXACT][deep]) < 0.75 * np.array(off[NEO_HOOKEAN][deep])).all()
    assert np.mean(off[NEO_HOOKEAN_EXACT]) < 0.4 * np.mean(off[LINEAR])


def test_light_touch_is_that_of_linear_skin() -> None:
    """What stiffening takes is of second order in the load."""
    own, linear = skin(), skin("draft", LINEAR)
    force = felt(own, 0.4e-3).force
    off = []
    for share in (0.2, 0.1):
        both = Stimulus(own, share * force), Stimulus(linear, share * force)
        off.append([
            float(np.linalg.norm(both[0].pad_displacement - both[1].pad_displacement)),
            float(np.linalg.norm(both[0].stress - both[1].stress)),
        ])  # fmt: skip
    ratio = np.array(off[:-1]) / np.array(off[1:])
    assert (ratio > 3.4).all() and (ratio < 4.8).all()


def test_only_force_over_stiffness_counts() -> None:
    soft = felt(skin(), 1.0e-3, tolerance=1e-7)
    hard = felt(skin().with_material(young=3.0 * skin().material.young), 1.0e-3, tolerance=1e-7)
    size = np.abs(hard.force).max()
    np.testing.assert_allclose(hard.force, 3.0 * soft.force, atol=1e-4 * size)
    np.testing.assert_allclose(hard.stress, 3.0 * soft.stress, atol=1e-4 * np.abs(hard.stress).max())


def test_forces_alone_tell_the_same_as_the_contact() -> None:
    """Amounts that are sought from rest are those that the contact found."""
    known = felt(skin(), 1.2e-3, 0.4e-3)
    sought = Stimulus(skin(), known.force)
    size = np.abs(known.stress).max()
    np.testing.assert_allclose(sought.stress, known.stress, atol=5e-3 * size)
    moved = np.abs(known.displacement).max()
    np.testing.assert_allclose(sought.displacement, known.displacement, atol=5e-3 * moved)
    assert known.energy == pytest.approx(sought.energy, rel=5e-3)


def scene(tissue: str, contact: str) -> TactileScene:
    """Return a finger with pins and a thimble, pressed 1.2 mm onto a table."""
    way = [(0.0, 0.0, 0.4e-3 - 0.1e-3 * i) for i in range(17)]
    block = Body("Table", Surface.block().mesh, Library().material("wood"))
    parameters = {"skin": Library().skin("index_medium"), "skin_level": "draft", "skin_shown": True}
    own = {**parameters, "tissue": tissue, "contact": contact}
    return scene_from_poses(
        100.0, [(Finger("Index", (DeviceUse("pin_array_128"),), own), way)], [(block, (0.0, 0.0, 0.0))]
    )


@functools.cache
def baked(tissue: str, contact: str) -> Bake:
    """Return its bake."""
    return run(scene(tissue, contact))


@pytest.mark.parametrize("contact", ["nodes", "points"])
def test_a_bake_follows_it_and_devices_the_series(contact: str) -> None:
    exact, series = (baked(tissue, contact) for tissue in (NEO_HOOKEAN_EXACT, NEO_HOOKEAN))
    touch, quick = exact.skins["Index"], series.skins["Index"]
    assert touch.model.tissue == NEO_HOOKEAN_EXACT and not [f for f in exact.all_findings if f.code == "tissue-series"]
    last = -1
    assert touch.normal_force[last] == pytest.approx(quick.normal_force[last], rel=0.05)
    assert touch.normal_force[last] != quick.normal_force[last]
    linear = baked(LINEAR, contact).skins["Index"].normal_force[last]
    assert touch.normal_force[last] > 1.03 * linear
    matched = touch.matched
    assert matched.model.tissue == NEO_HOOKEAN and matched.amounts is not None and quick.amounts is not None
    assert matched.amounts.shape[1:] == quick.amounts.shape[1:]
    off = np.linalg.norm(matched.amounts[last] - quick.amounts[last]) / np.linalg.norm(quick.amounts[last])
    assert off < 0.1
    pins = [b.outputs[0].track.values for b in (exact, series)]
    assert 0.0 < np.abs(pins[0] - pins[1]).max() < 0.1 * np.abs(pins[1]).max()
    assert exact.content_hash != series.content_hash


def test_the_same_scene_is_the_same_bytes_and_comes_back_from_arrays() -> None:
    first, second = (
        baked(NEO_HOOKEAN_EXACT, "nodes").skins["Index"],
        run(scene(NEO_HOOKEAN_EXACT, "nodes")).skins["Index"],
    )
    np.testing.assert_array_equal(first.force, second.force)
    assert first.amounts is not None and second.amounts is not None
    np.testing.assert_array_equal(first.amounts, second.amounts)
    again = touch_of(first.model, arrays_of(first), (), {})
    sample = int(first.contact[-1])
    np.testing.assert_array_equal(again.stimulus_at(sample).stress, first.stimulus_at(sample).stress)


def test_where_its_table_is_not_there_the_series_is_followed_and_told(tmp_path: Path) -> None:
    from core.pipeline.render import render
    from core.steps import drain
    from tests.made_up_tissue import kept

    made = scene(NEO_HOOKEAN_EXACT, "nodes")
    finger = made.fingers[0]
    finger.parameters["skin"] = {**Library().skin("index_medium"), "width": 15.9e-3}
    shape, cache = fingertip_shape(15.9e-3), Cache(tmp_path, 10**9)
    kept(cache, shape, 0.48)
    bake = drain(render(made, Library(), cache=cache))
    assert bake.skins["Index"].model.tissue == NEO_HOOKEAN
    assert [f.code for f in bake.all_findings].count("tissue-series") == 1


def fingertip_shape(width: float):  # type: ignore[no-untyped-def]
    """Return the preset's shape of another width."""
    from core.skin.shape import shape_from_parameters

    lengths = {n: v for n, v in Library().skin("index_medium").items() if n not in ("young", "poisson", "alpha")}
    return shape_from_parameters({**lengths, "width": width})
