"""How references are solved, against quadratic bricks of scikit-fem and another solver of contact.

`pip install scikit-fem` lets the judge speak (development only).
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.references.contact import Press
from tests.benchmarks.references.shapes import Ball, Edge, Flat, Ribs
from tests.benchmarks.references.tissue import MATERIAL, Tissue
from tests.unit.test_references import box

pytestmark = pytest.mark.one_line("3.11", "a tool of developers: the product does not use it")

PROBES = np.array([[0.2, 0.1, 0.5], [0.6, 0.1, 0.8], [0.2, 0.6, 1.2]])
ROUNDS, SETTLED = 200, 1e-5  # of linearisations, and the last change [mm]
FINER = 2  # than the judge, whose bricks are quadratic
TOWARDS = 1.5  # elements shrink so towards x = 0
CASES = {"plane": (Flat(), 0.2, 2), "ball": (Ball(2.0), 0.5, 3), "wedge": (Edge(90.0), 0.4, 2), "rib": (Ribs(), 0.2, 2)}


def axes(count):
    """Half a block of 3 x 3 x 2 mm, whose middle is at x = 0."""
    x = 1.5 * np.linspace(0.0, 1.0, 4 * count + 1) ** TOWARDS
    return x, np.linspace(-1.5, 1.5, 2 * count + 1), 2.0 * np.linspace(0.0, 1.0, 2 * count + 1) ** TOWARDS


def ours(shape, depth, count):
    """Force [N] on the whole, and zz of stress at the probes [Pa]."""
    mesh = box(*axes(count), half=True)
    tissue = Tissue(mesh, mesh.pad)
    press = Press(tissue.compliance, mesh.nodes[mesh.pad], shape, cut=mesh.cut[mesh.pad])
    [state] = press.depths(np.zeros(3), [depth], 0.1)
    return 2.0 * state.force[:, 2].sum(), tissue.stress(tissue.deformed(state.force)[0], PROBES)[:, 2]


def theirs(shape, depth, count):
    """The same by quadratic bricks with linear pressures, and least squares that are not negative."""
    import skfem
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import nnls
    from scipy.sparse import block_array
    from scipy.sparse.linalg import splu
    from skfem.helpers import ddot, div, sym_grad

    first, shear = (1e-6 * value for value in MATERIAL.lame)
    basis = skfem.Basis(skfem.MeshHex.init_tensor(*axes(count)), skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    linear = basis.with_element(skfem.ElementHex1())
    a = skfem.BilinearForm(lambda u, v, w: 2.0 * shear * ddot(sym_grad(u), sym_grad(v))).assemble(basis)
    b = skfem.BilinearForm(lambda u, q, w: div(u) * q).assemble(basis, linear)
    c = skfem.BilinearForm(lambda p, q, w: p * q / first).assemble(linear)
    place, axis = basis.doflocs, np.zeros(basis.N, int)
    for i in range(3):
        for dofs in (basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs):
            axis[dofs[i]] = i
    held = (place[2] > 2.0 - 1e-9) | ((axis == 0) & (place[0] < 1e-9))
    free = np.flatnonzero(~np.concatenate([held, np.zeros(linear.N, bool)]))
    factor = splu(block_array([[a, b.T], [b, -c]]).tocsc()[free][:, free])
    low = [np.flatnonzero((place[2] < 1e-9) & (axis == i)) for i in range(3)]
    low = [dofs[np.lexsort(place[:2, dofs].round(9))] for dofs in low]
    points, rows = place[:, low[0]].T, np.stack(low, axis=1)
    moves = ~held[rows.ravel()]
    right = np.zeros((len(free), moves.sum()))
    right[np.searchsorted(free, rows.ravel()[moves]), np.arange(moves.sum())] = 1.0
    every = np.zeros((basis.N + linear.N, moves.sum()))
    every[free] = factor.solve(right)
    compliance = np.zeros((rows.size, rows.size))
    compliance[:, moves] = np.where(moves[:, None], every[rows.ravel()], 0.0)

    moved = np.zeros_like(points)
    for _ in range(ROUNDS):
        gap, normal = shape.gap(points + moved - [0.0, 0.0, depth])
        jacobian = np.zeros((len(points), rows.size))
        jacobian[np.arange(len(points))[:, None], 3 * np.arange(len(points))[:, None] + np.arange(3)] = normal
        root = cholesky(jacobian @ compliance @ jacobian.T, lower=True)
        offset = gap - (normal * moved).sum(axis=1)
        force = jacobian.T @ nnls(root.T, -solve_triangular(root, offset, lower=True))[0]
        change, moved = moved, (compliance @ force).reshape(-1, 3)
        if np.abs(moved - change).max() < SETTLED:
            break
    else:
        raise ArithmeticError("the judge does not settle")
    found = every @ force[moves]
    strain = basis.interpolate(found[: basis.N]).grad[2, 2]
    stress = linear.project(2.0 * shear * strain + linear.interpolate(found[basis.N :]))
    return 2.0 * force[2::3].sum(), 1e6 * linear.interpolator(stress)(PROBES.T)


@pytest.mark.parametrize("name", CASES)
def test_graded_hexahedra_press_like_the_bricks_of_other_software(name):
    pytest.importorskip("skfem")
    shape, depth, count = CASES[name]
    force, stress = ours(shape, depth, FINER * count)
    judged, judged_stress = theirs(shape, depth, count)
    print(name, force, judged, stress, judged_stress)
    assert force == pytest.approx(judged, rel=0.015)
    np.testing.assert_allclose(stress, judged_stress, atol=0.05 * np.abs(judged_stress).max())
