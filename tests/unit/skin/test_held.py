"""Which tissue bone holds: judged by the stiffness matrix itself, and told by part, place and joint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.skin.assembly import degrees, stiffness
from core.skin.held import check_held, parts_by_face
from core.skin.material import Elastic
from core.skin.mesh import TetraMesh, boundary_faces
from core.skin.model import condensed_pad, skin_from_parameters
from core.skin.quality import check_mesh, unsolvable
from tests.problems import cube_mesh
from tests.tissue import save_mesh


def two_cubes(offset: tuple[float, float, float], fixed: str = "first") -> TetraMesh:
    """Return a cube of side one, fixed at x = 0, and another, joined where nodes coincide and, if both, fixed too."""
    cube = cube_mesh(2)
    nodes = np.concatenate([cube.nodes, cube.nodes + np.array(offset)])
    tetrahedra = np.concatenate([cube.tetrahedra, cube.tetrahedra + len(cube.nodes)])
    _, first, merged = np.unique(nodes.round(9), axis=0, return_index=True, return_inverse=True)
    merged = merged.reshape(-1)
    held = np.concatenate([cube.nodes[:, 0] == 0.0, (cube.nodes[:, 0] == 1.0) & (fixed == "both")])
    bone = np.unique(merged[held]).astype(np.int32)
    pad = np.setdiff1d(merged[cube.pad], bone).astype(np.int32)
    return TetraMesh(nodes[first], merged[tetrahedra].astype(np.int32), bone, pad, np.zeros((0, 3), np.int32), "pair")


def is_singular(mesh: TetraMesh) -> bool:
    free = degrees(mesh.free)
    matrix = stiffness(mesh, Elastic(1.0, 0.3))[free][:, free].toarray()
    values = np.linalg.eigvalsh(matrix)
    return bool(values[0] < 1e-10 * values[-1])


CASES = {
    "a face": ((1.0, 0.0, 0.0), "first", True),
    "a quarter of a face": ((1.0, 0.5, 0.5), "first", True),
    "an edge": ((1.0, 1.0, 0.0), "first", False),
    "an edge, both fixed": ((1.0, 1.0, 0.0), "both", True),
    "a node": ((1.0, 1.0, 1.0), "first", False),
    "nothing": ((3.0, 0.0, 0.0), "first", False),
    "nothing, both fixed": ((3.0, 0.0, 0.0), "both", True),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_held_is_what_can_be_solved(case: str) -> None:
    offset, fixed, held = CASES[case]
    mesh = two_cubes(offset, fixed)
    assert is_singular(mesh) is not held
    if held:
        check_held(mesh, "here")
    else:
        with pytest.raises(DermisError, match="not held"):
            check_held(mesh, "here")


def test_cubes_joined_by_whole_faces_are_one_part() -> None:
    assert parts_by_face(two_cubes((1.0, 0.0, 0.0))).max() == 0
    assert parts_by_face(two_cubes((1.0, 1.0, 0.0))).max() == 1


def test_a_loose_part_is_named_with_its_place_and_its_joint() -> None:
    with pytest.raises(DermisError) as caught:
        check_held(two_cubes((1.0, 1.0, 0.0)), "skin mesh 'pair'")
    told = str(caught.value)
    assert "40 elements about (1500.00, 1500.00, 500.00) mm: 0 of its nodes are fixed" in told
    assert "hangs on the rest by 3 nodes" in told and "whole faces" in caught.value.remedy


def test_bone_nodes_on_one_line_say_so() -> None:
    mesh = cube_mesh(2)
    line = np.flatnonzero((mesh.nodes[:, 1:] == 0).all(axis=1)).astype(np.int32)
    with pytest.raises(DermisError, match="3 of its nodes are fixed, on one line"):
        check_held(replace(mesh, fixed=line), "here")


def test_a_pad_node_whose_skin_faces_both_ways_is_refused() -> None:
    mesh = cube_mesh(2)
    double = np.concatenate([mesh.surface, mesh.surface[:, ::-1]])
    node = mesh.pad[:1]
    both = double[(double == node[0]).any(axis=1)]
    one_sided = mesh.surface[~(mesh.surface == node[0]).any(axis=1)]
    with pytest.raises(DermisError, match="faces both ways"):
        check_mesh(replace(mesh, surface=np.concatenate([one_sided, both])))


def test_what_cannot_be_solved_is_told_by_its_worst_element() -> None:
    mesh = cube_mesh(2)
    told = str(unsolvable(mesh, 0.4999))
    assert "of a regular one's volume" in told and "Poisson's ratio is 0.4999" in told
    with pytest.raises(DermisError, match=r"cannot be solved.*element \d+ at"):
        condensed_pad(replace(mesh, fixed=mesh.fixed[:0]), Elastic(1.0, 0.3), "anp")


def test_a_refused_skin_names_its_finger(tmp_path: Path) -> None:
    mesh = two_cubes((1.0, 1.0, 0.0))
    save_mesh(replace(mesh, surface=boundary_faces(mesh.tetrahedra)), tmp_path / "own.json")
    with pytest.raises(DermisError, match=r"^finger 'Index', skin, skin mesh '.*not held"):
        skin_from_parameters({"mesh": str(tmp_path / "own.json")}, where="finger 'Index', skin")
