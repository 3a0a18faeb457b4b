"""The table of stress below the pad, against what it stands for: every force by itself."""

from __future__ import annotations

import numpy as np
import pytest

from core.skin.model import fingertip_skin
from core.skin.stress_table import StressTable
from core.skin.surface_compliance import SurfaceCompliance
from core.skin.surface_store import smooth_pad
from tests.pad_cells import descendants

DEPTH = 0.3e-3


@pytest.fixture(scope="module")
def pad() -> SurfaceCompliance:
    found = smooth_pad(fingertip_skin(level="draft"))
    assert found is not None
    return found


def table(pad: SurfaceCompliance) -> StressTable:
    chart = pad.chart
    near = chart.base[np.linalg.norm(pad.cells.positions[chart.base], axis=1) < 6e-3]
    return StressTable(pad, pad.probes(chart.places[near], DEPTH))


def largest(pad: SurfaceCompliance) -> np.ndarray:
    """The coarsest cells about the pad's centre."""
    base = pad.chart.base
    return base[np.linalg.norm(pad.cells.positions[base], axis=1) < 3e-3]


def forces(count: int) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(count, 3)) * 0.01


def exact(pad: SurfaceCompliance, made: StressTable, cells: np.ndarray, force: np.ndarray) -> np.ndarray:
    return pad.beneath(made.probes, cells, force)[1]


def test_the_coarsest_cells_are_exact_and_any_of_the_probes_may_be_asked(pad: SurfaceCompliance) -> None:
    made, cells = table(pad), largest(pad)
    force = forces(len(cells))
    wanted = exact(pad, made, cells, force)
    np.testing.assert_allclose(made.stress(cells, force), wanted, atol=1e-6 * np.abs(wanted).max())
    some = np.array([3, 40, 7])
    np.testing.assert_allclose(made.stress(cells, force, some), wanted[some], atol=1e-6 * np.abs(wanted).max())


@pytest.mark.parametrize("level", [1, 2, 3])
def test_an_edge_on_finer_cells_is_three_hundredths_off_at_most(pad: SurfaceCompliance, level: int) -> None:
    """All the force is on a line along the finger, so each coarsest cell carries it at one side."""
    made, chart = table(pad), pad.chart
    fine, _ = descendants(chart, largest(pad), level)
    across = np.abs(pad.cells.positions[fine, 0] - 0.1e-3)
    cells = fine[across < 0.5 * np.sqrt(pad.cells.areas[fine]).max()]
    force = np.tile([2e-3, 0.0, 5e-3], (len(cells), 1))
    wanted = exact(pad, made, cells, force)
    assert np.abs(made.stress(cells, force) - wanted).max() < 0.03 * np.abs(wanted).max()


def test_stress_does_not_depend_on_stiffness_and_without_force_there_is_none(pad: SurfaceCompliance) -> None:
    stiff, cells = pad.with_material(alpha=2.0), largest(pad)
    force = forces(len(cells))
    np.testing.assert_array_equal(table(stiff).stress(cells, force), table(pad).stress(cells, force))
    assert not table(pad).stress(cells, 0.0 * force).any()
    assert not table(pad).stress(cells[:0], force[:0]).any()
