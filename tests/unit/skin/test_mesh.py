"""The fingertip's mesh: closed, positive, symmetric to the bit, graded; and meshes that must be refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.errors import DermisError
from core.presets import Library
from core.skin.fingertip import LEVELS, Level, fingertip_mesh
from core.skin.mesh import TetraMesh, boundary_faces, tetra_volumes
from core.skin.model import skin_from_parameters
from core.skin.quality import check_mesh
from core.skin.shape import FingertipShape
from tests.problems import cube_mesh
from tests.tissue import dihedral_angles

SIZES = {"draft": 1560, "standard": 6400, "fine": 26460, "reference": 88000}


@pytest.fixture(scope="module")
def mesh() -> TetraMesh:
    return fingertip_mesh(level="standard")


@pytest.mark.parametrize("level", ["draft", "standard", "fine"])
def test_levels_have_their_size_and_positive_elements(level: str) -> None:
    mesh = fingertip_mesh(level=level)
    assert len(mesh.tetrahedra) == SIZES[level] == LEVELS[level].tetrahedra
    assert tetra_volumes(mesh.nodes, mesh.tetrahedra).min() > 0
    assert np.degrees(dihedral_angles(mesh.nodes, mesh.tetrahedra).min()) > 2.5
    assert LEVELS["reference"].tetrahedra == SIZES["reference"]


def test_conforming_and_closed(mesh: TetraMesh) -> None:
    faces = np.sort(mesh.tetrahedra[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3), axis=1)
    count = np.unique(faces, axis=0, return_counts=True)[1]
    assert set(count) == {1, 2}
    border = boundary_faces(mesh.tetrahedra)
    edges = np.concatenate([border[:, [0, 1]], border[:, [1, 2]], border[:, [2, 0]]])
    # each edge once in each direction: closed and consistently oriented
    assert sorted(map(tuple, edges)) == sorted(map(tuple, edges[:, ::-1]))
    a, b, c = (mesh.nodes[border[:, i]] for i in range(3))
    assert np.einsum("ij,ij->", np.cross(a, b), c) / 6 == pytest.approx(mesh.volumes.sum(), rel=1e-12)
    # a shell between bone and skin that is open at the cut end is a ball: Euler characteristic 2
    assert len(np.unique(border)) - len(np.unique(np.sort(edges, axis=1), axis=0)) + len(border) == 2


def test_mirror_is_exact(mesh: TetraMesh) -> None:
    index = {tuple(p): i for i, p in enumerate(mesh.nodes + 0.0)}
    mirror = np.array([index[tuple(p)] for p in mesh.nodes * [-1.0, 1.0, 1.0] + 0.0])
    assert {tuple(sorted(t)) for t in mirror[mesh.tetrahedra].tolist()} == {
        tuple(sorted(t)) for t in mesh.tetrahedra.tolist()
    }
    assert set(mirror[mesh.pad]) == set(mesh.pad)
    assert set(mirror[mesh.fixed]) == set(mesh.fixed)


def test_frame_and_pad(mesh: TetraMesh) -> None:
    shape = FingertipShape()
    assert mesh.nodes[mesh.pad, 2].min() >= -1e-15  # the pad's centre touches a plate first
    assert shape.skin(np.array([0j]))[0] == pytest.approx([0, 0, 0], abs=1e-15)
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    assert high[1] == pytest.approx(shape.tip, rel=0.01)
    assert low[1] == pytest.approx(shape.tip - shape.length, rel=1e-12)
    assert high[0] - low[0] == pytest.approx(shape.width, rel=0.02)
    assert high[2] == pytest.approx(shape.thickness, rel=0.02)
    nearest = np.argmin(np.linalg.norm(mesh.nodes[mesh.pad], axis=1))
    assert mesh.pad_normals[nearest] == pytest.approx([0, 0, -1], abs=0.1)
    assert (mesh.pad_normals[:, 2] < 0).all()
    assert not np.intersect1d(mesh.pad, mesh.fixed).size
    assert mesh.pad_areas.sum() == pytest.approx(fingertip_mesh(level="fine").pad_areas.sum(), rel=0.06)


def test_graded_towards_the_pad(mesh: TetraMesh) -> None:
    centres = mesh.nodes[mesh.tetrahedra].mean(axis=1)
    near = np.linalg.norm(centres, axis=1) < 3e-3
    back = centres[:, 2] > 11e-3
    assert np.median(mesh.volumes[near]) < 0.5 * np.median(mesh.volumes[back])


def test_volume_converges_with_second_order() -> None:
    volumes = [fingertip_mesh(level=Level(4 * k, 6 * k, 2 * k, 2 * k)).volumes.sum() for k in (1, 2, 4)]
    assert (volumes[1] - volumes[0]) / (volumes[2] - volumes[1]) == pytest.approx(4.0, rel=0.25)


def test_deterministic(mesh: TetraMesh) -> None:
    assert fingertip_mesh(level="standard").hash == mesh.hash
    assert fingertip_mesh(FingertipShape(width=16.1e-3)).hash != mesh.hash


def test_every_preset_makes_a_mesh() -> None:
    library = Library()
    entries = library.list("skins")
    assert {"index_small", "index_medium", "index_large", "thumb_medium"} <= {e.key for e in entries}
    for entry in entries:
        assert entry.error is None
        parameters = library.skin(entry.key)
        model = skin_from_parameters(parameters, level="draft")
        assert model.material.young == 1e5 and model.material.poisson == 0.48
        assert np.ptp(model.mesh.nodes[:, 1]) == pytest.approx(parameters["length"], rel=0.02)


def test_dihedral_angles_of_known_tetrahedra() -> None:
    regular = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    cells = np.array([[0, 1, 2, 3]])
    assert dihedral_angles(regular, cells)[0] == pytest.approx(np.full(6, np.arccos(1 / 3)), abs=1e-14)
    expected = [np.pi / 2] * 3 + [np.arccos(1 / np.sqrt(3))] * 3
    assert np.sort(dihedral_angles(corner, cells)[0])[::-1] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"width": -1e-3}, "above zero"),
        ({"bone_width": 16e-3}, "bone_width"),
        ({"bone_thickness": 11e-3}, "thickness"),
        ({"nail_width": 20e-3}, "nail_width"),
        ({"tip": 24e-3}, "tip"),
        ({"bone_bed": 0.1e-3}, "bone_bed"),
        ({"nail_length": 30e-3}, "nail_length"),
        ({"thickness": float("nan")}, "above zero"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(change: dict[str, float], what: str) -> None:
    with pytest.raises(DermisError, match=what):
        FingertipShape(**change)


@pytest.mark.parametrize("thickness", [20e-3, 50e-3])
def test_a_shape_whose_tissue_folds_is_refused_in_the_words_of_its_lengths(thickness: float) -> None:
    with pytest.raises(DermisError, match=f"tissue .* folds.*thickness {1e3 * thickness:.2f}.*bone's lengths"):
        fingertip_mesh(FingertipShape(thickness=thickness), "draft")


def test_levels_that_cannot_be_symmetric_are_refused() -> None:
    for level in (Level(5, 8, 3, 3), Level(4, 7, 3, 3), Level(4, 8, 0, 3), Level(4, 8, 3, 0)):
        with pytest.raises(DermisError):
            fingertip_mesh(level=level)
    with pytest.raises(DermisError, match="unknown accuracy"):
        fingertip_mesh(level="ultra")


def broken(kind: str) -> TetraMesh:
    mesh = cube_mesh(2)
    if kind == "inverted":
        return replace(mesh, tetrahedra=np.concatenate([mesh.tetrahedra[:1, [1, 0, 2, 3]], mesh.tetrahedra[1:]]))
    if kind == "flat":
        nodes = mesh.nodes.copy()
        a, b, c, d = mesh.tetrahedra[3]
        nodes[d] = nodes[[a, b, c]].mean(axis=0)
        return replace(mesh, nodes=nodes)
    if kind == "hanging nodes":
        return replace(mesh, nodes=np.concatenate([mesh.nodes, [[0.5, 0.5, 2.0]]]))
    if kind == "not a finite":
        nodes = mesh.nodes.copy()
        nodes[4] = np.nan
        return replace(mesh, nodes=nodes)
    if kind == "does not exist":
        return replace(mesh, tetrahedra=mesh.tetrahedra + 1)
    if kind == "more than two":
        return replace(mesh, tetrahedra=np.concatenate([mesh.tetrahedra, mesh.tetrahedra[:1]]))
    if kind == "too few fixed":
        return replace(mesh, fixed=mesh.fixed[:2])
    if kind == "on one line":
        line = np.flatnonzero((mesh.nodes[:, 1:] == 0).all(axis=1)).astype(np.int32)
        return replace(mesh, fixed=line)
    if kind == "no pad":
        return replace(mesh, pad=mesh.pad[:0])
    if kind == "pad node is fixed":
        return replace(mesh, pad=np.sort(np.append(mesh.pad, mesh.fixed[0])))
    if kind == "not on the surface":
        return replace(mesh, pad=np.array([13], np.int32), fixed=mesh.fixed)
    if kind == "not held":
        other = cube_mesh(2)
        return replace(
            mesh,
            nodes=np.concatenate([mesh.nodes, other.nodes + 5.0]),
            tetrahedra=np.concatenate([mesh.tetrahedra, other.tetrahedra + len(mesh.nodes)]),
        )
    assert kind == "hangs on"
    # a small tetrahedron outside whose corner lies in the middle of an edge of the cube, where the cube has no node
    a = mesh.nodes[mesh.tetrahedra[0]]
    edge = [(i, j) for i, j in boundary_edges(mesh) if np.ptp(mesh.nodes[[i, j], 2]) == 0 and mesh.nodes[i, 2] == 1][0]
    middle = mesh.nodes[list(edge)].mean(axis=0)
    extra = middle + np.array([[0, 0, 0], [0.1, 0, 0.3], [0, 0.1, 0.3], [0, 0, 0.4]])
    n = len(mesh.nodes)
    cell = np.array([[n, n + 1, n + 2, n + 3]])
    assert tetra_volumes(extra, cell - n)[0] > 0 and len(a) == 4
    return replace(
        mesh,
        nodes=np.concatenate([mesh.nodes, extra]),
        tetrahedra=np.concatenate([mesh.tetrahedra, cell]),
        fixed=np.concatenate([mesh.fixed, np.arange(n, n + 4)]),
    )


def boundary_edges(mesh: TetraMesh) -> list[tuple[int, int]]:
    faces = boundary_faces(mesh.tetrahedra)
    return sorted({(min(e), max(e)) for f in faces.tolist() for e in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0]))})


@pytest.mark.parametrize(
    "kind",
    [
        "inverted",
        "flat",
        "hanging nodes",
        "not a finite",
        "does not exist",
        "more than two",
        "too few fixed",
        "on one line",
        "no pad",
        "pad node is fixed",
        "not on the surface",
        "not held",
        "hangs on",
    ],
)
def test_bad_meshes_are_refused(kind: str) -> None:
    check_mesh(cube_mesh(2))
    with pytest.raises(DermisError, match=kind):
        check_mesh(broken(kind))
