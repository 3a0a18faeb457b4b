"""Corners and rims of surfaces: those of the shape, whatever its triangles."""

from __future__ import annotations

import numpy as np
import pytest

from core.scene.tactile_scene import Mesh
from core.surface import shapes
from core.surface.gap import Surface
from core.surface.sharp_places import CORNER, SharpPlaces
from tests.stress.sharp import draw, solid


def places(mesh: Mesh | shapes.Shape) -> SharpPlaces:
    vertices, triangles = (mesh.vertices, mesh.triangles) if isinstance(mesh, Mesh) else mesh
    return Surface.build(vertices, triangles).sharp_places


def cut(shape: shapes.Shape) -> shapes.Shape:
    """Put a vertex into the middle of each triangle."""
    vertices, triangles = shape
    new = np.arange(len(triangles)) + len(vertices)
    a, b, c = triangles.T
    parts = [np.stack(t, axis=1) for t in ((a, b, new), (b, c, new), (c, a, new))]
    return np.vstack([vertices, vertices[triangles].mean(axis=1)]), np.vstack(parts)


def test_a_block_has_eight_corners_however_it_is_cut_and_a_room_has_none() -> None:
    vertices, triangles = block = shapes.block(20e-3, 10e-3, 5e-3)
    for shape in (block, cut(block), cut(cut(block))):
        found = places(shape)
        assert sorted(map(tuple, found.corners)) == sorted(map(tuple, vertices))
        assert not len(found.rims)
    room = places((vertices, triangles[:, ::-1]))
    assert not len(room.corners)


@pytest.mark.parametrize("more", [-0.01, 0.01])
def test_a_corner_begins_at_the_solid_angle_of_its_normals(more: float) -> None:
    angle = np.degrees(np.pi - CORNER - more)  # two right angles and this one lack so much of a full turn
    found = places(solid({**draw("corner", 0.0, 0), "angle": angle}))
    assert (np.abs(found.corners).max(axis=1) < 1e-12).any() == (more > 0.0)


def test_smooth_shapes_have_no_sharp_places_and_a_sheet_has_its_rim() -> None:
    ball = places(shapes.sphere(5e-3, 1_000))
    assert [len(some) for some in ball] == [0, 0]
    sheet = places(solid(draw("rim", 0.0, 0)))
    assert len(sheet.rims) == 4 and not len(sheet.corners)
    assert np.linalg.norm(sheet.rims[:, 1] - sheet.rims[:, 0], axis=1).sum() == pytest.approx(4 * 24e-3)
