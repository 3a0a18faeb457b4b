"""The compliance between free points: its symmetry and scale, against meshes, and the stress beneath."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")

from core.cache import Cache
from core.errors import DermisError
from core.presets import Library
from core.recent import Recent
from core.shipped import BUILT_IN
from core.skin import surface_store
from core.skin.assembly import degrees, stiffness
from core.skin.fingertip import fingertip_mesh
from core.skin.half_space import surface_kernel
from core.skin.material import Elastic
from core.skin.mesh import TetraMesh
from core.skin.model import condensed_pad, fingertip_skin, shape_and_material
from core.skin.nodal_forces import NodalForces
from core.skin.pad_chart import PadChart, Patches
from core.skin.remainder import STEPS, Remainder
from core.skin.shape import FingertipShape
from core.skin.stress import StressOperator, locate
from core.skin.surface_compliance import SurfaceCompliance
from core.skin.surface_store import (
    find_remainder,
    make_remainder,
    remainder_key,
    shipped_name,
    smooth_pad,
    surface_compliance,
)
from core.steps import drain
from core.work.jobs import JOBS, Job
from tests.pad_cells import descendants
from tests.tissue import probes_at

Array = NDArray[np.float64]
SHIPPED = Path(BUILT_IN) / "skins"


def of_preset(key: str) -> SurfaceCompliance:
    found = surface_compliance(Library().skin(key), shipped=SHIPPED)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def pad() -> SurfaceCompliance:
    return of_preset("index_medium")


def leaves(chart: PadChart, random: np.random.Generator) -> NDArray[np.int64]:
    """Return cells that cover the pad, finer around a random place, down to the finest level."""
    found = chart.base
    centre = chart.cells.positions[random.integers(len(found))]
    for reach in (3e-3, 1.5e-3, 0.8e-3):
        near = np.linalg.norm(chart.cells.positions[found] - centre, axis=1) < reach
        found = np.concatenate([found[~near], chart.children(found[near]).ravel()])
    return found


def normal_press(pad: SurfaceCompliance, height: float) -> tuple[NDArray[np.int64], Array]:
    """Return cells and forces [N] on them under a plate that lifts the pad to a height, without friction."""
    cells = np.flatnonzero(pad.cells.positions[: pad.chart.starts[1], 2] < height)
    gap, kernel = pad.cells.positions[cells, 2] - height, pad.block(cells, cells)[:, 2, :, 2]
    active, force = gap < 0, np.zeros(len(cells))
    for _ in range(50):
        force[:] = 0.0
        force[active] = np.linalg.solve(kernel[np.ix_(active, active)], -gap[active])
        if (force >= 0).all():
            break
        active &= force > 0
    return cells, force[:, None] * np.array([0.0, 0.0, 1.0])


def test_rows_and_blocks_agree(pad: SurfaceCompliance) -> None:
    random = np.random.default_rng(0)
    members = random.permutation(leaves(pad.chart, random))[:300]
    block = pad.block(members, members).reshape(900, 900)
    assert np.abs(block - block.T).max() < 1e-7 * block.max()
    rows = pad.rows(members[:40], members)
    assert rows.dtype == np.float32 and np.abs(rows - block[:120]).max() < 2e-6 * block.max()
    matrix = np.zeros((130, 990), np.float32)
    pad.rows(members[:40], members, matrix[10:, 90:])
    assert np.array_equal(matrix[10:, 90:], rows) and not matrix[:10].any() and not matrix[:, :90].any()
    force = random.normal(size=(300, 3))
    assert pad.apply(members, force).ravel() == pytest.approx(block @ force.ravel(), rel=1e-9, abs=1e-12)
    assert pad.apply(members, force, at=members[5:9]) == pytest.approx(pad.apply(members, force)[5:9])
    assert len(pad.apply(members, force, at=members[:0])) == 0


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_it_stores_energy_whatever_cells_carry_it() -> None:
    """Positive definite on any leaves of every skin that ships: the smallest eigenvalue is a quarter of a self term."""
    for number, entry in enumerate(Library().list("skins")):
        pad, random = of_preset(entry.key), np.random.default_rng(number)
        some = leaves(pad.chart, random)
        for cells in (pad.chart.base, random.permutation(some)[:400]):
            kernel = pad.block(cells, cells).reshape(3 * len(cells), -1)
            scale = 1.0 / np.sqrt(np.diag(kernel))
            np.linalg.cholesky(kernel * scale * scale[:, None] - 0.25 * np.eye(len(scale)))  # raises where it is less


def test_stiffness_and_a_spring_scale_as_they_should(pad: SurfaceCompliance) -> None:
    cells = pad.chart.base[:60]
    soft = pad.with_material(young=5e4, alpha=0.5)
    assert soft.block(cells, cells) == pytest.approx(4 * pad.block(cells, cells))
    assert soft.rows(cells, cells) == pytest.approx(4 * pad.rows(cells, cells), rel=1e-6)
    sprung = pad.with_spring(np.array([0.0, 0.0, 1.0]), 500.0)
    force = np.random.default_rng(2).normal(size=(60, 3))
    extra = sprung.apply(cells, force) - pad.apply(cells, force)
    assert extra == pytest.approx(np.tile([0, 0, force[:, 2].sum() / 500.0], (60, 1)), abs=1e-12)
    assert sprung.rows(cells, cells) == pytest.approx(sprung.block(cells, cells).reshape(180, 180), abs=2e-6)
    probes = pad.probes(pad.chart.places[cells], 1e-3)
    moved, stress = pad.beneath(probes, cells, force)
    softer, same = soft.beneath(probes, cells, force)
    assert same == pytest.approx(stress, rel=1e-12, abs=1e-9 * np.abs(stress).max())
    assert softer == pytest.approx(4 * moved)
    assert sprung.beneath(probes, cells, force)[0] - moved == pytest.approx(extra)


def test_a_plate_is_pressed_as_the_mesh_says(pad: SurfaceCompliance) -> None:
    """1 and 2 mm: within 4 % of the standard mesh's force, which is as far as meshes agree."""
    skin = fingertip_skin()
    for depth in (1e-3, 2e-3):
        force = normal_press(pad, depth)[1][:, 2].sum()
        heights, kernel = skin.positions[:, 2] - depth, skin.compliance[2::3, 2::3]
        active, nodal = heights < 0, np.zeros(skin.pad_count)
        for _ in range(50):
            nodal[:] = 0.0
            nodal[active] = np.linalg.solve(kernel[np.ix_(active, active)], -heights[active])
            if (nodal >= 0).all():
                break
            active &= nodal > 0
        assert force == pytest.approx(nodal.sum(), rel=0.04)


def far_errors(pad: SurfaceCompliance, level: str) -> tuple[float, float, float]:
    """Return errors against a condensed mesh, of forces across the middle of the pad that lie more than 1.5 mm away.

    Relative root mean squares of pairs 1.5 to 3 mm and 3 to 12 mm apart, and the mean error of normal displacement.
    """
    mesh = fingertip_mesh(level=level)
    middle = np.flatnonzero((mesh.pad_normals[:, 2] < -0.6) & (np.abs(mesh.nodes[mesh.pad][:, 1]) < 7e-3))
    mesh = replace(mesh, pad=mesh.pad[middle])
    exact = condensed_pad(mesh, pad.material, "anp").compliance.reshape(len(middle), 3, len(middle), 3)
    nodes = pad.chart.surface(pad.chart.project(mesh.nodes[mesh.pad])[0])
    nodes = Patches(nodes.positions, nodes.normals, 1e-6 * nodes.sides, 1e-12 * nodes.areas)
    phi = pad.remainder.functions(nodes.positions).astype(np.float64)
    found = surface_kernel(nodes, nodes, pad.material.poisson)
    found += np.einsum("ik,kalb,jl->iajb", phi, pad.remainder.surface, phi, optimize=True)
    apart = np.linalg.norm(nodes.positions[:, None] - nodes.positions[None], axis=2)
    errors = []
    for low, high in ((1.5e-3, 3e-3), (3e-3, 12e-3)):
        pairs = np.nonzero((apart > low) & (apart < high))
        one, other = (kernel.transpose(0, 2, 1, 3)[pairs] for kernel in (exact, found))
        errors.append(float(np.linalg.norm(other - one) / np.linalg.norm(one)))
        if high < 4e-3:
            mean = float((other[:, 2, 2].sum() - one[:, 2, 2].sum()) / one[:, 2, 2].sum())
    return errors[0], errors[1], mean


def test_far_forces_act_as_on_a_mesh(pad: SurfaceCompliance) -> None:
    """6.4k tetrahedra, which are too stiff: single nodes move 9 % less near each other, as a mean."""
    near, far, mean = far_errors(pad, "standard")
    assert near < 0.13 and far < 0.08 and abs(mean) < 0.11


@pytest.mark.long
def test_far_forces_act_as_on_a_fine_mesh(pad: SurfaceCompliance) -> None:
    """26k tetrahedra, which the tables were not made from: 6 % of single pairs near, 2.4 % far, 2 % as a mean."""
    near, far, mean = far_errors(pad, "fine")
    assert near < 0.07 and far < 0.03 and abs(mean) < 0.025


def test_stress_below_a_plate_is_the_meshs(pad: SurfaceCompliance) -> None:
    """The same forces on cells and on the nodes of 26k tetrahedra, 1.2 and 2 mm below: 10 and 5 %, displacement 5 %."""
    mesh = fingertip_mesh(level="fine")
    cells, force = normal_press(pad, 1e-3)
    middle = np.linalg.norm(pad.cells.positions[pad.chart.base], axis=1) < 4e-3
    places = pad.chart.places[pad.chart.base[middle]]
    nodal = NodalForces(mesh, pad.chart).spread(cells, force)
    moved = solved(mesh, pad.material, nodal)
    stresses = StressOperator(mesh, pad.material).stress(moved)
    for depth, allowed in ((1.2e-3, 0.10), (2e-3, 0.05)):
        probes = pad.probes(places, depth)
        inside = probes_at(mesh, probes.points)
        exact = inside.read(stresses)
        found_moved, found = pad.beneath(probes, cells, force)
        assert np.linalg.norm(found - exact) < allowed * np.linalg.norm(exact)
        element, weights = locate(mesh, probes.points)
        shift = np.einsum("kj,kjc->kc", weights, moved[mesh.tetrahedra[element]])
        assert np.linalg.norm(found_moved - shift) < 0.05 * np.linalg.norm(shift)


def solved(mesh: TetraMesh, material: Elastic, nodal: Array) -> Array:
    """Return the displacement of all nodes for forces on the pad."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import cg

    free, load = degrees(mesh.free), np.zeros((len(mesh.nodes), 3))
    load[mesh.pad] = nodal
    matrix = stiffness(mesh, material)[free][:, free].tocsr()
    moved = np.zeros(3 * len(mesh.nodes))
    moved[free], failed = cg(matrix, load.ravel()[free], rtol=1e-6, M=diags_array(1.0 / matrix.diagonal()))
    assert failed == 0
    return moved.reshape(-1, 3)


def test_the_force_of_a_large_cell_is_spread_above_a_probe(pad: SurfaceCompliance) -> None:
    """Stress 0.3 mm below the skin does not show the size of the cells, and far below it is the same force."""
    chart = pad.chart
    cells = chart.base[np.linalg.norm(pad.cells.positions[chart.base], axis=1) < 2.5e-3]
    force = -1e-3 * pad.cells.normals[cells]
    fine, owner = descendants(chart, cells, 2)
    share = pad.cells.areas[fine] / np.bincount(owner, pad.cells.areas[fine])[owner]
    for depth, allowed in ((0.3e-3, 0.015), (2e-3, 0.015)):
        probes = pad.probes(chart.places[cells], depth)
        coarse, spread = (
            pad.beneath(probes, *pair)[1] for pair in ((cells, force), (fine, share[:, None] * force[owner]))
        )
        assert np.abs(coarse - spread).max() < allowed * np.abs(spread).max()


def test_a_fit_is_kept_and_read(tmp_path: Path) -> None:
    """The whole way, on the standard mesh: progress, cache, bytes, and a damaged file that is made again."""
    cache, parameters = Cache(tmp_path, 10**9), {"width": 15e-3, "poisson": 0.45}
    shape, tissue = shape_and_material(parameters)
    assert shape is not None and surface_compliance(parameters, shipped=SHIPPED, cache=cache) is None
    told: list[tuple[int, int]] = []
    wanted = {"skin": parameters, "folder": str(tmp_path), "limit": 10**9, "level": "standard"}
    Job("pad", {}, wanted, JOBS).run(lambda *step: told.append(step))
    assert told == [(done, STEPS) for done in range(STEPS + 1)]
    pad = surface_compliance(parameters, cache=cache)
    made = drain(make_remainder(shape, tissue.poisson, "standard"))
    assert pad is not None and pad.remainder.surface.tobytes() == made.surface.tobytes()
    middle = pad.chart.base[np.abs(pad.cells.positions[pad.chart.base, 1]) < 8e-3]
    kernel = pad.block(middle, middle)
    assert np.linalg.eigvalsh(kernel.reshape(3 * len(middle), -1))[0] > 0
    path = cache.get(remainder_key(shape, tissue.poisson))
    assert path is not None
    path.write_bytes(path.read_bytes()[:-3000])
    assert surface_compliance(parameters, cache=cache) is None
    assert surface_compliance({"mesh": "mine.npz"}, shipped=SHIPPED) is None
    with pytest.raises(DermisError, match="no smooth pad"):
        Job("pad", {}, wanted | {"skin": {"mesh": "mine.npz"}}, JOBS).run(lambda *step: None)


def test_every_standard_skin_ships_its_table() -> None:
    for entry in Library().list("skins"):
        shape, tissue = shape_and_material(Library().skin(entry.key))
        assert shape is not None
        path = SHIPPED / shipped_name(shape, tissue.poisson)
        assert path.is_file() and path.stat().st_size < 500_000, entry.key
        assert find_remainder(shape, tissue.poisson, shipped=SHIPPED) is not None
    other = replace(FingertipShape(), width=16.1e-3)
    assert shipped_name(other, 0.48) != shipped_name(FingertipShape(), 0.48) != shipped_name(FingertipShape(), 0.47)


def test_arrays_that_do_not_fit_are_refused(pad: SurfaceCompliance, tmp_path: Path) -> None:
    whole = pad.remainder
    spoiled = whole.surface.copy()
    spoiled[0, 0, 0, 0] = np.nan
    for change in ({"mixing": whole.mixing[:, :-1]}, {"surface": spoiled}, {"beneath": whole.beneath[:, :, :8]}):
        replace(whole, **change).write(tmp_path / "wrong.npz")
        with pytest.raises(DermisError, match="do not fit"):
            Remainder.read(tmp_path / "wrong.npz")


def test_a_pad_does_not_depend_on_who_asked_for_it_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lengths that were read in millimetres differ in the last digit; so do rows by what was asked for before."""
    shape, rng = FingertipShape(), np.random.default_rng(3)
    nearly = replace(shape, width=shape.width * (1 + 1e-12), thickness=shape.thickness * (1 - 1e-12))
    cells, force = rng.choice(400, 60, replace=False), rng.normal(size=(60, 3))
    found = []
    for first, before in ((shape, cells[:7]), (nearly, cells[20:33]), (shape, cells[::-1])):
        monkeypatch.setattr(surface_store, "_pads", Recent(10))
        skins = {one: fingertip_skin(one, level="draft") for one in (shape, nearly)}
        smooth_pad(skins[first]).coarse[before]
        pad = smooth_pad(skins[shape])
        assert pad is not None
        found.append((pad.coarse[cells].tobytes(), pad.functions(cells).tobytes(), pad.apply(cells, force).tobytes()))
    assert len(set(found)) == 1


def test_the_chart_is_kept_with_the_skin_to_the_last_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache, found = Cache(tmp_path, 10**9), []
    for _ in range(2):
        monkeypatch.setattr(surface_store, "_pads", Recent(1))
        made = smooth_pad(fingertip_skin(level="draft", cache=cache))
        assert made is not None
        found.append(made.chart)
        monkeypatch.setattr(PadChart, "of", None)  # nobody makes one any more
    monkeypatch.undo()
    expected = PadChart.of(FingertipShape())
    tables = expected.tables()
    for chart in found:
        assert (chart.shape, chart.starts) == (expected.shape, expected.starts)
        assert chart.beside.dtype == expected.beside.dtype
        assert {name: array.tobytes() for name, array in chart.tables().items()} == {
            name: array.tobytes() for name, array in tables.items()
        }
