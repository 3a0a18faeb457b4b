"""RestFactor against a direct solve in double precision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")

from core.skin.assembly import degrees, stiffness
from core.skin.fingertip import fingertip_mesh
from core.skin.material import Elastic
from core.skin.mesh import TetraMesh
from core.skin.rest_factor import RestFactor
from tests.problems import cube_mesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def own() -> TetraMesh:
    """Return a slab that no preset has, cut in two where it is held: its stiffness falls into parts."""
    mesh = cube_mesh(5, 0.02, 0.1, kuhn=True)
    held = np.union1d(mesh.fixed, np.flatnonzero(np.abs(mesh.nodes[:, 0] - 0.008) < 1.5e-3)).astype(np.int32)
    return TetraMesh(mesh.nodes, mesh.tetrahedra, held, np.setdiff1d(mesh.pad, held).astype(np.int32), mesh.surface)


MESHES = {
    "fingertip": lambda: fingertip_mesh(level="draft"),
    "cube": lambda: cube_mesh(4),
    "own": own,
    "smallest": lambda: cube_mesh(2),
}


def system(mesh: TetraMesh, poisson: float = 0.48) -> csr_array:
    free = degrees(mesh.free)
    return stiffness(mesh, Elastic(1.0, poisson, 1.0))[free][:, free].tocsr()


@pytest.fixture(scope="module", params=MESHES)
def made(request: pytest.FixtureRequest) -> tuple[csr_array, NDArray[np.int64]]:
    mesh = MESHES[request.param]()
    return system(mesh), np.searchsorted(mesh.free, mesh.pad)


def loads(size: int, count: int = 5) -> NDArray[np.float32]:
    return np.random.default_rng(2).normal(size=(count, size)).astype(np.float32)


def test_it_is_what_a_direct_solve_gives(made: tuple[csr_array, NDArray[np.int64]]) -> None:
    from scipy.sparse.linalg import splu

    matrix, pad = made
    factor, exact = RestFactor(matrix, pad), splu(matrix.tocsc())
    for load in loads(matrix.shape[0]):
        expected = exact.solve(load.astype(np.float64))
        got = factor.solve(load)
        assert got.dtype == np.float32 and got.shape == load.shape
        assert np.linalg.norm(got - expected) <= 1e-5 * np.linalg.norm(expected)


def test_a_force_on_one_node_moves_another_as_the_other_moves_it(made: tuple[csr_array, NDArray[np.int64]]) -> None:
    matrix, pad = made
    factor = RestFactor(matrix, pad)
    whole = np.array([factor.solve(row) for row in np.eye(matrix.shape[0], dtype=np.float32)[: 3 * len(pad)]])
    square = whole[:, : 3 * len(pad)].astype(np.float64)
    assert np.abs(square - square.T).max() <= 2e-5 * np.abs(square).max()


def test_it_is_linear_and_the_same_each_time(made: tuple[csr_array, NDArray[np.int64]]) -> None:
    matrix, pad = made
    one, other = RestFactor(matrix, pad), RestFactor(matrix.copy(), pad)
    a, b = loads(matrix.shape[0], 2)
    kept = a.copy()
    first = one.solve(a)
    assert np.array_equal(first, one.solve(a)) and np.array_equal(first, other.solve(a))
    assert np.array_equal(a, kept)
    both = one.solve(np.float32(4.0) * a + b)
    assert np.linalg.norm(both - 4.0 * first - one.solve(b)) <= 1e-5 * np.linalg.norm(both)
    assert np.array_equal(one.solve(np.float32(2.0**-60) * a), np.float32(2.0**-60) * first)  # by size it only scales
    assert not one.solve(np.zeros_like(a)).any()


@pytest.mark.parametrize("poisson", [0.3, 0.499])
def test_of_tissue_that_is_hardly_compressible_it_is_as_good(poisson: float) -> None:
    from scipy.sparse.linalg import splu

    mesh = fingertip_mesh(level="draft")
    matrix = system(mesh, poisson)
    load = loads(matrix.shape[0], 1)[0]
    expected = splu(matrix.tocsc()).solve(load.astype(np.float64))
    got = RestFactor(matrix, np.searchsorted(mesh.free, mesh.pad)).solve(load)
    assert np.linalg.norm(got - expected) <= 1e-5 * np.linalg.norm(expected)
