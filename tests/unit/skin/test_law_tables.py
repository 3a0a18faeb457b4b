"""States of the law under given forces: their balance in double precision, their limit, and what is kept of them."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")

from core.skin import law_tables
from core.skin.assembly import degrees
from core.skin.law_tables import KEPT, LawTables
from core.skin.mesh import TetraMesh
from core.skin.model import SkinModel, fingertip_skin, mesh_skin
from core.skin.stimulus import Stimulus
from tests.exact.neo_hookean import NeoHookean
from tests.problems import cube_mesh

Floats32 = NDArray[np.float32]
HEAVY = 2e-5  # of a spread force over E [m^2], 2 N at 100 kPa: it presses draft skin about 1.5 mm


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip_skin(level="draft").with_law()


@pytest.fixture
def close(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let states be found as closely as single precision lets them."""
    monkeypatch.setattr(law_tables, "TOLERANCE", 1e-5)


def spread(skin: SkinModel, size: float, aside: float = 0.3) -> Floats32:
    """Return a force over E on the middle of the pad, upwards and a part of it aside [m^2], shape (3 m,)."""
    far = np.linalg.norm(skin.positions[:, :2], axis=1)
    weight = skin.areas * np.exp(-((far / 4e-3) ** 2))
    out = (weight / weight.sum())[:, None] * np.array([aside, -0.2 * aside, 1.0]) * size
    return np.ascontiguousarray(out, np.float32).reshape(-1)


def unbalanced(tables: LawTables, moved: Floats32, force: Floats32, poisson: float) -> float:
    """Return what the law in double precision leaves of all forces, over them."""
    mesh = tables.mesh
    exact = NeoHookean(mesh, poisson)
    left = exact.forces(exact.response(tables.nodes(moved).astype(np.float64)[None, None]).piola)[0, 0]
    left[mesh.pad] -= force.reshape(-1, 3)
    return float(np.linalg.norm(left[mesh.free]) / np.linalg.norm(force))


@pytest.mark.parametrize("size", [1e-10, 1e-7, HEAVY / 4, HEAVY])
def test_what_is_loaded_balances(skin: SkinModel, size: float, close: None) -> None:
    force, tables = spread(skin, size), skin.law
    beyond = tables.loaded(force)
    moved = tables.state(force, beyond)
    assert unbalanced(tables, moved, force, skin.material.poisson) <= 1e-4
    assert np.linalg.norm(tables.pulled(force)[tables.pad] - beyond - moved[tables.pad]) <= 1e-6 * np.linalg.norm(moved)
    held = tables.miss(moved, tables.pulled(force), force)
    assert held.left <= 1e-4 and held.way.shape == held.pull.shape == (tables.size,)


def test_what_is_not_asked_for_so_closely_balances_to_its_tolerance(skin: SkinModel) -> None:
    force, tables = spread(skin, HEAVY), LawTables(skin.mesh, skin.material.poisson, lambda: skin.unit_response)
    moved = tables.state(force, tables.loaded(force))
    assert tables.miss(moved, tables.pulled(force), force).left <= law_tables.TOLERANCE
    assert unbalanced(tables, moved, force, skin.material.poisson) <= 10.0 * law_tables.TOLERANCE


@pytest.mark.parametrize("size", [1e-7, HEAVY])
def test_a_state_is_found_again_from_what_a_touch_keeps(skin: SkinModel, size: float, close: None) -> None:
    force, tables = spread(skin, size), skin.law
    beyond = tables.loaded(force)
    kept = tables.state(force, beyond)
    tables._states.clear()
    again = tables.state(force, beyond)
    assert again is not kept and tables.state(force, beyond) is again
    assert np.linalg.norm(again - kept) <= 2e-5 * np.linalg.norm(kept)
    stress = tables.stress(kept)
    assert np.linalg.norm(tables.stress(again) - stress) <= 1e-4 * np.linalg.norm(stress)
    assert tables.energy(again) == pytest.approx(tables.energy(kept), rel=1e-4)


def test_states_whose_pad_gives_way_less_by_the_same_are_told_apart_by_their_forces(skin: SkinModel) -> None:
    """Light touches of all kinds are linear: the c of each is none at all."""
    tables = LawTables(skin.mesh, skin.material.poisson, lambda: skin.unit_response)
    none = np.zeros(3 * skin.pad_count, np.float32)
    one, other = spread(skin, 1e-10), spread(skin, 1e-10, aside=-2.0)
    for force in (none, one, other, one):
        state = tables.state(force, none)
        assert np.linalg.norm(state - tables.pulled(force)) <= 1e-4 * np.linalg.norm(tables.pulled(one))
    for force in (one, other):
        tables.remember(force, none, tables.pulled(force))
    assert np.array_equal(tables.state(one, none), tables.pulled(one))


def test_two_fingers_of_one_skin_are_told_their_own_states_in_turns(skin: SkinModel) -> None:
    stiff = skin.with_material(alpha=3.0)
    assert stiff.law is skin.law
    force = skin.material.modulus * spread(skin, HEAVY / 2).reshape(-1, 3).astype(np.float64)
    fingers = [Stimulus(skin, force), Stimulus(stiff, force), Stimulus(stiff, 3.0 * force), Stimulus(skin, 0.5 * force)]
    alone = [Stimulus(SkinModel(**vars_of(f.skin)), f.force).displacement for f in fingers]
    for felt, expected in zip(fingers, alone, strict=True):
        assert np.linalg.norm(felt.displacement - expected) <= 1e-5 * np.linalg.norm(expected)
    assert np.linalg.norm(alone[2] - alone[0]) <= 1e-5 * np.linalg.norm(alone[0])
    assert np.linalg.norm(alone[1] - alone[0]) > 0.5 * np.linalg.norm(alone[0])


def vars_of(skin: SkinModel) -> dict[str, Any]:
    """Return what a skin is made from, without its tables."""
    return {name: getattr(skin, name) for name in SkinModel.__dataclass_fields__}


def test_no_more_states_are_kept_than_it_says(skin: SkinModel) -> None:
    tables = LawTables(skin.mesh, skin.material.poisson, lambda: skin.unit_response)
    for n in range(3 * KEPT):
        tables.loaded(spread(skin, 1e-8 * (n + 1)))
    assert len(tables._states) == KEPT


def test_stiffness_only_scales(skin: SkinModel) -> None:
    force = skin.material.modulus * spread(skin, HEAVY).reshape(-1, 3).astype(np.float64)
    soft = Stimulus(skin, force)
    for alpha in (1e-5, 1e4):
        other = skin.with_material(young=skin.material.young * alpha, alpha=1.0)
        felt = Stimulus(other, alpha * force)
        assert np.linalg.norm(felt.displacement - soft.displacement) <= 1e-5 * np.linalg.norm(soft.displacement)
        assert np.linalg.norm(felt.stress - alpha * soft.stress) <= 1e-4 * alpha * np.linalg.norm(soft.stress)
        assert felt.energy == pytest.approx(alpha * soft.energy, rel=1e-5)


def test_what_stiffening_takes_falls_with_the_load(skin: SkinModel, close: None) -> None:
    tables = skin.law
    shares = []
    for halvings in range(3, 8):
        force = spread(skin, HEAVY / 2**halvings)
        shares.append(np.linalg.norm(tables.loaded(force)) / np.linalg.norm(tables.pulled(force)[tables.pad]))
    ratios = np.array(shares[:-1]) / shares[1:]
    assert np.abs(ratios - 2.0).max() <= 0.15 and abs(ratios[-1] - 2.0) <= 0.05


def test_energy_is_the_work_of_the_press(skin: SkinModel, close: None) -> None:
    tables, work, last = skin.law, 0.0, None
    for share in np.linspace(0.0, 1.0, 25)[1:]:
        force = spread(skin, share * HEAVY)
        moved = tables.pulled(force)[tables.pad] - tables.loaded(force)
        before = (np.zeros_like(force), np.zeros_like(moved)) if last is None else last
        work += 0.5 * float((force + before[0]).astype(np.float64) @ (moved - before[1]))
        last = force, moved
    stored = tables.energy(tables.state(force, tables.loaded(force)))
    assert stored == pytest.approx(work, rel=1e-4)


def test_nothing_is_nothing(skin: SkinModel) -> None:
    tables, none = skin.law, np.zeros(3 * skin.pad_count, np.float32)
    assert not tables.loaded(none).any() and not tables.state(none, none).any()
    assert tables.energy(tables.state(none, none)) == 0.0 and not tables.stress(tables.state(none, none)).any()


def thin() -> TetraMesh:
    """Return a slab all of whose free nodes lie on the pad."""
    mesh = cube_mesh(4, 0.02)
    held = np.setdiff1d(np.arange(len(mesh.nodes)), mesh.pad).astype(np.int32)
    return TetraMesh(mesh.nodes, mesh.tetrahedra, held, mesh.pad, mesh.surface)


def test_a_mesh_with_nothing_beneath_its_pad_has_states_too(close: None) -> None:
    slab = mesh_skin(thin()).with_law()
    force = 1e-5 * np.random.default_rng(1).normal(size=3 * slab.pad_count).astype(np.float32)
    beyond = slab.law.loaded(force)
    moved = slab.law.state(force, beyond)
    slab.law._states.clear()
    assert np.linalg.norm(slab.law.state(force, beyond) - moved) <= 1e-5 * np.linalg.norm(moved)
    assert unbalanced(slab.law, moved, force, slab.material.poisson) <= 1e-4


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e6])
def test_under_loads_beyond_all_sense_what_comes_is_a_number(skin: SkinModel, size: float) -> None:
    force = spread(skin, size)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        beyond = skin.law.loaded(force)
        state = skin.law.state(force, beyond)
    assert np.isfinite(beyond).all() and np.isfinite(state).all()


def test_what_forces_do_to_linear_skin_does_not_depend_on_what_was_asked_before(skin: SkinModel) -> None:
    tables, rng = LawTables(skin.mesh, skin.material.poisson, lambda: skin.unit_response), np.random.default_rng(4)
    for count in (3, 3, skin.pad_count, 5, 0, 1, skin.pad_count // 2, 5):
        force = np.zeros((skin.pad_count, 3), np.float32)
        force[rng.permutation(skin.pad_count)[:count]] = rng.normal(size=(count, 3))
        for scale in (1.0, 2.0):  # of the same nodes
            flat = np.float32(scale) * force.reshape(-1)
            expected = skin.unit_response.T.astype(np.float64) @ flat
            assert np.linalg.norm(tables.pulled(flat) - expected) <= 1e-6 * np.linalg.norm(expected)


def test_degrees_are_those_of_the_pad(skin: SkinModel) -> None:
    tables, mesh = skin.law, skin.mesh
    moved = np.arange(tables.size, dtype=np.float32)
    nodes = tables.nodes(moved)
    assert np.array_equal(nodes.reshape(-1)[degrees(mesh.pad)], moved[tables.pad])
    assert not nodes[mesh.fixed].any()


def test_the_product_with_the_tangent_is_that_of_the_law_in_double_precision(skin: SkinModel) -> None:
    force, tables, rng = spread(skin, HEAVY), skin.law, np.random.default_rng(5)
    moved = tables.state(force, tables.loaded(force))
    free = degrees(skin.mesh.free)
    exact = NeoHookean(skin.mesh, skin.material.poisson).tangent(tables.nodes(moved).astype(np.float64))[free][:, free]
    for way in (moved, tables.yielded(rng.normal(size=tables.size).astype(np.float32))):
        expected = exact @ way.astype(np.float64)
        assert np.linalg.norm(tables.stiffened(moved, way) - expected) <= 1e-3 * np.linalg.norm(expected)


def test_linear_tissue_yields_to_forces_inside_it_too(skin: SkinModel) -> None:
    tables, rng = skin.law, np.random.default_rng(6)
    force, other = (rng.normal(size=tables.size).astype(np.float32) for _ in range(2))
    on_pad = np.zeros(tables.size, np.float32)
    on_pad[tables.pad] = force[tables.pad]
    pulled = tables.pulled(force[tables.pad])
    assert np.linalg.norm(tables.yielded(on_pad) - pulled) <= 1e-4 * np.linalg.norm(pulled)
    one, two = float(tables.yielded(force) @ other), float(tables.yielded(other) @ force)
    assert one == pytest.approx(two, rel=1e-3)
