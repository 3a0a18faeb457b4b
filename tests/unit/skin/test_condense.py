"""Condensation against the full solve, to rounding; and what a compliance must be."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.errors import DermisError
from core.skin.assembly import degrees, stiffness
from core.skin.condense import condense
from core.skin.fingertip import fingertip_mesh
from core.skin.material import Elastic
from core.skin.mesh import TetraMesh
from core.skin.model import SkinModel, fingertip_skin
from tests.problems import cube_mesh


@pytest.fixture(scope="module", params=["anp", "p1"])
def skin(request: pytest.FixtureRequest) -> SkinModel:
    return fingertip_skin(material=Elastic(1e5, 0.48), level="draft", element=request.param)


def full_solve(model: SkinModel, force: np.ndarray) -> np.ndarray:
    from scipy.sparse.linalg import spsolve

    mesh = model.mesh
    free = degrees(mesh.free)
    matrix = stiffness(mesh, model.material, model.element)[free][:, free]
    load = np.zeros_like(mesh.nodes)
    load[mesh.pad] = force
    u = np.zeros(mesh.nodes.size)
    u[free] = spsolve(matrix.tocsc(), load.ravel()[free])
    return u.reshape(-1, 3)


def test_condensed_equals_full_solve(skin: SkinModel) -> None:
    force = np.random.default_rng(3).normal(size=(skin.pad_count, 3))
    exact = full_solve(skin, force)
    largest = np.abs(exact).max()
    assert skin.pad_displacement(force) == pytest.approx(exact[skin.mesh.pad], abs=1e-10 * largest)
    # the response of the other nodes is kept in single precision
    assert skin.displacement(force) == pytest.approx(exact, abs=2e-5 * largest)
    sparse = np.zeros_like(force)
    sparse[5] = [0.1, -0.2, 0.3]
    exact = full_solve(skin, sparse)
    assert skin.displacement(sparse) == pytest.approx(exact, abs=2e-5 * np.abs(exact).max())
    assert not skin.displacement(0 * force).any()


def test_standard_equals_full_solve() -> None:
    skin = fingertip_skin(level="standard")
    force = np.random.default_rng(4).normal(size=(skin.pad_count, 3))
    exact = full_solve(skin, force)[skin.mesh.pad]
    assert skin.pad_displacement(force) == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())


def test_symmetric_positive_definite(skin: SkinModel) -> None:
    compliance = skin.compliance
    assert np.array_equal(compliance, compliance.T)
    values = np.linalg.eigvalsh(compliance)
    assert values[0] > 1e-6 * values[-1]
    assert (np.linalg.cholesky(compliance).diagonal() > 0).all()


def test_modulus_only_scales() -> None:
    soft, stiff = (fingertip_skin(material=Elastic(e, 0.48), level="draft") for e in (1e3, 1e9))
    assert np.array_equal(soft.unit_compliance, stiff.unit_compliance)
    assert soft.compliance == pytest.approx(stiff.compliance * 1e6, rel=1e-14)
    personal = fingertip_skin(material=Elastic(1e5, 0.48, alpha=0.7), level="draft")
    force = np.random.default_rng(5).normal(size=(personal.pad_count, 3)) * 1e-2
    assert personal.pad_displacement(force) == pytest.approx(full_solve(personal, force)[personal.mesh.pad], rel=1e-8)
    again = soft.with_material(young=1e5, alpha=0.7)
    assert np.array_equal(again.compliance, personal.compliance) and again.unit_compliance is soft.unit_compliance


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_mirrored_load_gives_mirrored_answer() -> None:
    skin = fingertip_skin(level="standard")
    mesh = skin.mesh
    place = {tuple(p): i for i, p in enumerate(mesh.nodes[mesh.pad] + 0.0)}
    mirror = np.array([place[tuple(p)] for p in mesh.nodes[mesh.pad] * [-1.0, 1.0, 1.0] + 0.0])
    signs = np.tile([-1.0, 1.0, 1.0], len(mirror))
    chosen = (3 * mirror[:, None] + np.arange(3)).ravel()
    mirrored = signs[:, None] * skin.compliance[np.ix_(chosen, chosen)] * signs
    assert mirrored == pytest.approx(skin.compliance, abs=1e-12 * np.abs(skin.compliance).max())


def test_order_of_the_pad_is_the_callers() -> None:
    mesh = cube_mesh(4)
    free = degrees(mesh.free)
    matrix = stiffness(mesh, Elastic(1.0, 0.3))[free][:, free]
    pad = np.searchsorted(mesh.free, mesh.pad)
    shuffled = np.random.default_rng(6).permutation(len(pad))
    first, second = condense(matrix, pad, response=True), condense(matrix, pad[shuffled], response=True)
    chosen = (3 * shuffled[:, None] + np.arange(3)).ravel()
    inverse = np.linalg.inv(matrix.toarray())
    rows = degrees(pad)
    assert first.compliance == pytest.approx(inverse[np.ix_(rows, rows)], abs=1e-12 * inverse.max())
    assert second.compliance == pytest.approx(first.compliance[np.ix_(chosen, chosen)], abs=1e-12 * inverse.max())
    assert first.response == pytest.approx(inverse[rows], abs=1e-6 * inverse.max())
    assert second.response == pytest.approx(inverse[rows[chosen]], abs=1e-6 * inverse.max())


def test_separate_parts_do_not_feel_each_other() -> None:
    mesh = cube_mesh(2)
    n = len(mesh.nodes)
    both = TetraMesh(
        np.concatenate([mesh.nodes, mesh.nodes + 3.0]),
        np.concatenate([mesh.tetrahedra, mesh.tetrahedra + n]),
        np.concatenate([mesh.fixed, mesh.fixed + n]),
        np.concatenate([mesh.pad, mesh.pad + n]),
        mesh.surface,
    )
    free = degrees(both.free)
    matrix = stiffness(both, Elastic(1.0, 0.3))[free][:, free]
    compliance = condense(matrix, np.searchsorted(both.free, both.pad)).compliance
    half = len(compliance) // 2
    assert not compliance[:half, half:].any()
    assert compliance[:half, :half] == pytest.approx(compliance[half:, half:], rel=1e-12)


def test_reactions_balance_the_load(skin: SkinModel) -> None:
    """The fixed nodes hold exactly what is pushed: forces and moments."""
    mesh = skin.mesh
    force = np.random.default_rng(7).normal(size=(skin.pad_count, 3))
    u = full_solve(skin, force)
    reaction = (stiffness(mesh, skin.material, skin.element) @ u.ravel()).reshape(-1, 3)[mesh.fixed]
    assert reaction.sum(axis=0) == pytest.approx(-force.sum(axis=0), abs=1e-9)
    moment = np.cross(mesh.nodes[mesh.fixed], reaction).sum(axis=0)
    assert moment == pytest.approx(-np.cross(skin.positions, force).sum(axis=0), abs=1e-11)


def test_a_floating_body_is_refused() -> None:
    mesh = cube_mesh(2)
    with pytest.raises(DermisError, match="positive definite"):
        condense(stiffness(mesh, Elastic(1.0, 0.3)), mesh.pad)


def test_deterministic() -> None:
    first, second = (fingertip_skin(level="draft") for _ in range(2))
    assert first.unit_compliance.tobytes() == second.unit_compliance.tobytes()
    assert first.mesh.hash == fingertip_mesh(level="draft").hash
