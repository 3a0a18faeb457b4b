"""Other programs on the same press: scikit-fem's elements with a direct solve, and MuJoCo's flex, on our meshes.

Neither knows contact as ours does. scikit-fem gets linear tissue, plain elements (P1) or quadratic ones (P2), the exact
shape's gap and a penalty at whatever lies in it: which places these are is sought again until they stay, and each time
the whole is factorised. Quadratic elements are held at the middles of edges, which integrate a face exactly. MuJoCo
gets a plate and its own solver, a step for a sample; its stress is read from its nodes by our elements (held there
after the press, it drifts farther off). Times are of the last samples of the press, after which stress is compared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from core.arrays import Array

from .. import one_blas_thread, timing
from ..bench_shapes import STEP
from .measured import Point, clocked
from .on_shapes import DEPTH, PROBED, RATE, skin_of

if TYPE_CHECKING:
    from ..references.shapes import Shape

TIMED = 3  # samples, the last of the press
PENALTY = 100.0  # times the stiffest node
ROUNDS = 30  # in search of what touches
WAYS = (("P1", "draft"), ("P1", "standard"), ("P2", "draft"))
MM = 1e-3


def skfem_points(shape: Shape, place: Array, probes: Array, truth: Array) -> list[Point]:
    """Return the points of scikit-fem, none where it is not installed.

    Args:
        shape: with an exact gap [mm]. place: its origin at first contact [m]. probes: where stress is read [m].
        truth: the reference's stress there [Pa].
    """
    try:
        import skfem  # noqa: F401
    except ImportError:  # a development dependency
        return []
    from ..references.results import difference

    points = []
    for element, level in WAYS:
        with one_blas_thread():
            stress, times = _pressed(element, level, shape, place, probes)
        found, off = timing(times), difference(stress, truth, 3)[PROBED]
        points.append(Point(f"scikit-fem, direct, {element}", level, found.median, found.p95, off))
    return points


def _pressed(element: str, level: str, shape: Shape, place: Array, probes: Array) -> tuple[Array, list[float]]:
    import skfem
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    skin = skin_of(level)
    mesh = skfem.MeshTet(skin.mesh.nodes.T.copy(), skin.mesh.tetrahedra.T.copy())
    scalar = {"P1": skfem.ElementTetP1, "P2": skfem.ElementTetP2}[element]()
    basis = skfem.Basis(mesh, skfem.ElementVector(scalar))
    material = skin.material
    stiff = linear_elasticity(*lame_parameters(material.modulus, material.poisson)).assemble(basis).tocsr()
    places, dofs = _skin_places(basis, element, np.unique(skin.mesh.pad))
    held = basis.nodal_dofs[:, skin.mesh.fixed].ravel()
    if element == "P2":
        both = np.isin(mesh.edges, skin.mesh.fixed).all(axis=0)
        held = np.concatenate([held, basis.edge_dofs[:, both].ravel()])
    free = np.setdiff1d(np.arange(basis.N), held)
    penalty, u, times = PENALTY * float(stiff.diagonal().max()), np.zeros(basis.N), list[float]()
    samples = round(DEPTH / STEP)
    for sample in range(samples - TIMED, samples + 1):
        origin = place + [0.0, 0.0, sample * STEP]

        def solve(origin: Array = origin, u: Array = u) -> Array:
            before = u[dofs]
            gap, normal = shape.gap((places + before - origin) / MM)
            gap = gap * MM - np.einsum("ij,ij->i", normal, before)  # linear about the sample before
            touching = np.zeros(len(places), bool)
            for _ in range(ROUNDS):
                inside = gap + np.einsum("ij,ij->i", normal, u[dofs]) < 0.0
                if np.array_equal(inside, touching) and touching.any():
                    break
                touching = inside
                n, d = normal[inside], dofs[inside]
                rows, columns = np.repeat(d, 3, axis=1).ravel(), np.tile(d, (1, 3)).ravel()
                more = penalty * (n[:, :, None] * n[:, None, :]).ravel()
                whole = stiff + coo_array((more, (rows, columns)), shape=stiff.shape).tocsr()
                load = np.zeros(len(u))
                np.add.at(load, d.ravel(), (-penalty * gap[inside, None] * n).ravel())
                u = np.zeros(len(u))
                u[free] = splu(whole[free][:, free].tocsc()).solve(load[free])
            return u

        u, taken = clocked(solve)
        times += [taken] if sample > samples - TIMED else []
    return _stress(basis, u, probes, material), times


def _skin_places(basis: Any, element: str, pad: Any) -> tuple[Array, Any]:
    """Return where skin may be held [m], shape (p, 3), and the degrees of freedom there, shape (p, 3)."""
    mesh = basis.mesh
    if element == "P1":
        return mesh.p[:, pad].T, basis.nodal_dofs[:, pad].T
    faces = mesh.boundary_facets()
    faces = faces[np.isin(mesh.facets[:, faces], pad).all(axis=0)]
    corners = mesh.facets[:, faces]
    pairs = np.sort(np.concatenate([corners[[0, 1]], corners[[1, 2]], corners[[0, 2]]], axis=1), axis=0)
    lookup = {tuple(edge): k for k, edge in enumerate(np.sort(mesh.edges, axis=0).T.tolist())}
    edges = np.array(sorted({lookup[tuple(pair)] for pair in pairs.T.tolist()}))
    return mesh.p[:, mesh.edges[:, edges]].mean(axis=1).T, basis.edge_dofs[:, edges].T


def _stress(basis: Any, u: Array, probes: Array, material: Any) -> Array:
    """Return stress at points [Pa], shape (k, 6), made continuous.

    Of plain elements by means over each node's, by volume, as ours are (projection follows their locking); of quadratic
    ones, whose stress is linear in each, by projection.
    """
    import skfem
    from skfem.helpers import sym_grad, trace

    strain = sym_grad(basis.interpolate(u))
    e, nu = material.modulus, material.poisson
    lame, shear = e * nu / ((1 + nu) * (1 - 2 * nu)), e / (2 * (1 + nu))
    stress = 2.0 * shear * strain + lame * trace(strain) * np.eye(3)[:, :, None, None]
    smooth = basis.with_element(skfem.ElementTetP1())
    around = skfem.LinearForm(lambda v, w: w["s"] * v)
    volume = around.assemble(smooth, s=np.ones_like(stress[0, 0]))
    plain = isinstance(basis.elem.elem, skfem.ElementTetP1)
    read = smooth.probes(probes.T)
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
    nodal = [around.assemble(smooth, s=stress[p]) / volume if plain else smooth.project(stress[p]) for p in pairs]
    return np.stack([read @ values for values in nodal], axis=1)


def flex_points(place: Array, probes: Array, truth: Array) -> list[Point]:
    """Return the point of MuJoCo's flex pressed on a plate, none where it is not installed or unstable; as above."""
    try:
        import mujoco
    except ImportError:  # a development dependency
        return []
    from core.skin.stress import locate, nodal_average

    from ..bench_contact import flex_model
    from ..references.results import difference

    points = []
    for level in ("draft", "standard"):
        skin = skin_of(level)
        mesh = skin.mesh
        mujoco.set_mju_user_warning(lambda _: None)  # else it writes a file into the working folder
        try:
            model = mujoco.MjModel.from_xml_string(flex_model(mesh, 1.0 / RATE, 0.0))
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
            rest = np.array(data.flexvert_xpos)
            times = []
            for sample in range(round(DEPTH / STEP) + 1):
                data.mocap_pos[0] = place + [0.0, 0.0, sample * STEP]
                times.append(clocked(lambda m=model, d=data: mujoco.mj_step(m, d))[1])
        except ValueError:
            continue
        finally:
            mujoco.set_mju_user_warning(None)
        moved = np.array(data.flexvert_xpos) - rest
        if not np.isfinite(moved).all() or not data.ncon:
            continue
        element, weights = locate(mesh, probes)
        felt = nodal_average(mesh, skin.operator.stress(moved))
        stress = np.einsum("kj,kjc->kc", weights, felt[mesh.tetrahedra[element]])
        found = timing(times[-TIMED:])
        off = difference(np.asarray(stress), truth, 3)[PROBED]
        points.append(Point("MuJoCo flex", level, found.median, found.p95, off))
    return points
