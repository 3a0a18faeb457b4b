"""Values of elements at points: quadratic fields come back, next to the skin too, and faults are not enlarged."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.fingertip import fingertip_mesh
from core.skin.mesh import TetraMesh
from core.skin.recovery import AROUND, GAIN, fitted
from core.skin.stress import RECEPTOR_DEPTHS, receptor_probes
from tests.problems import cube_mesh


def quadratic(points: np.ndarray) -> np.ndarray:
    """Return two quadratic fields at points [m], shape (k, 2)."""
    x, y, z = 1e3 * points.T
    return np.stack([1.0 + x - 2.0 * y + 0.3 * z * z - 0.2 * x * y, x * x + y * z - 3.0 * z], axis=1)


@pytest.mark.parametrize("level", ["draft", "standard"])
def test_a_quadratic_field_comes_back_at_the_receptors(level: str) -> None:
    mesh = fingertip_mesh(level=level)
    probes = receptor_probes(mesh)
    values = quadratic(mesh.nodes[mesh.tetrahedra].mean(axis=1))
    wanted = quadratic(probes.points)
    firm = np.abs(probes.reading).sum(axis=1) > 1.0 + 1e-9  # a constant fit has weights above zero alone
    assert firm.mean() > 0.99
    off = np.abs(probes.read(values) - wanted).max(axis=1)
    assert np.quantile(off, 0.9) < 1e-6 * np.abs(wanted).max()
    assert set(np.unique(probes.depth)) == set(RECEPTOR_DEPTHS)


def test_what_elements_are_off_by_is_not_enlarged_and_constants_stay() -> None:
    mesh = fingertip_mesh(level="draft")
    reading = fitted(mesh, mesh.nodes)
    assert reading.sum(axis=1) == pytest.approx(np.ones(len(mesh.nodes)), abs=1e-9)
    assert np.abs(reading).sum(axis=1).max() <= GAIN + 1e-9


@pytest.mark.parametrize("count", [1, 3, 9, 30])
def test_few_elements_have_a_fit_of_lower_order(count: int) -> None:
    cube = cube_mesh(2)
    mesh = TetraMesh(cube.nodes, cube.tetrahedra[:count], cube.fixed, cube.pad, cube.surface)
    points = mesh.nodes[mesh.tetrahedra].mean(axis=1)
    reading = fitted(mesh, points)
    assert reading.shape == (count, count) and count < AROUND
    assert reading @ np.ones(count) == pytest.approx(np.ones(count))
    assert np.isfinite(reading.toarray()).all()


def test_no_points_have_no_values() -> None:
    mesh = cube_mesh(2)
    assert fitted(mesh, np.zeros((0, 3))).shape == (0, len(mesh.tetrahedra))
