"""Surfaces that deform: what is no number is held and told, what is doubtful told once, animated gaps are not cut."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.contact.pad_contact import PadContact
from core.contact.pad_sampler import PadSampler
from core.contact.search_radius import FASTEST_APPROACH
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

RATE, COUNT = 240.0, 60
T = np.arange(COUNT) / RATE
CORNERS = np.array([[i, j, k] for i in (-0.1, 0.1) for j in (-0.1, 0.1) for k in (-0.1, 0.1)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))], dtype=np.int32)


def growing(faces: np.ndarray = FACES) -> list[Mesh]:
    """A box whose top rises from 0.1 m by 0.01 m a second."""
    return [Mesh(CORNERS + [[0.0, 0.0, 0.01 * t * (z > 0)] for z in CORNERS[:, 2]], faces) for t in T]


def broken(meshes: list[Mesh], at: range) -> list[Mesh]:
    out = list(meshes)
    for i in at:
        vertices = out[i].vertices.copy()
        vertices[5, 1] = np.nan if i % 2 else np.inf
        out[i] = replace(out[i], vertices=vertices)
    return out


def touch(
    height: float, meshes: list[Mesh] | None = None, *, size: int = COUNT, distance: np.ndarray | None = None
) -> PadContact:
    """One pad that stands still above the middle of one box."""
    body = Body("box", None if meshes else Mesh(CORNERS, FACES))
    scene = TactileScene(
        "s", Fraction(24), (1, 25), RATE, (Finger("f", (), {"touch_distance": 0.0005}),), (body,), (), ()
    )
    sampler = PadSampler(scene)
    pad, still = np.tile(np.eye(4), (2, 1, COUNT, 1, 1))
    pad[0, :, 2, 3] = height
    for start in range(0, COUNT, size):
        k = slice(start, start + size)
        animated = {} if distance is None else {"finger/0/touch_distance": distance[k]}
        surfaces = {0: tuple(meshes[k])} if meshes else {}
        sampler.add(
            Chunk(1 + 24 * T[k], T[k], pad[:, k], still[:, k], np.zeros((0, len(T[k]), 4, 4)), surfaces, animated)
        )
    return sampler.finish()


@pytest.mark.parametrize("size", [7, 24, COUNT])
def test_a_surface_that_is_no_number_is_held_at_the_last_good_one_and_told(size: int) -> None:
    found = touch(0.12, broken(growing(), range(20, 30)), size=size)
    expected = 0.02 - 0.01 * T
    expected[20:30] = expected[19]
    assert found.pairs[0, 0].gap == pytest.approx(expected, abs=1e-12)
    (finding,) = found.findings
    assert (finding.severity, finding.code, finding.where) == ("error", "not-finite", "object 'box'")
    assert (finding.frame, finding.count) == (1 + 24 * 20 / RATE, 10)


def test_before_the_first_good_surface_that_one_stands_in() -> None:
    found = touch(0.12, broken(growing(), range(5)))
    expected = 0.02 - 0.01 * T
    expected[:5] = expected[5]
    assert found.pairs[0, 0].gap == pytest.approx(expected, abs=1e-12)
    assert [(f.code, f.frame, f.count) for f in found.findings] == [("not-finite", 1.0, 5)]


def test_a_surface_that_never_is_a_number_cannot_be_touched_and_is_told() -> None:
    found = touch(0.12, broken(growing(), range(COUNT)), size=24)
    assert all(np.isinf(pair.gap).all() for pair in found.pairs.values()) and np.isfinite(found.centres[0]).all()
    assert [(f.code, f.count) for f in found.findings] == [("not-finite", COUNT)]


def test_doubts_about_deforming_surfaces_are_told_once() -> None:
    assert touch(0.12, growing(), size=24).findings == ()
    inside_out = touch(0.12, growing(FACES[:, ::-1].copy()), size=24)
    assert [(f.code, f.where) for f in inside_out.findings] == [("inside-out", "object 'box'")]
    opened = [Mesh(m.vertices, FACES[2:].copy()) for m in growing()]  # new triangles each time, the same doubt
    assert [f.code for f in touch(0.12, opened, size=24).findings] == ["open-surface"]


@pytest.mark.parametrize("size", [7, COUNT])
def test_a_surface_whose_faces_are_cut_along_other_diagonals_moves_as_before(size: int) -> None:
    others = np.array([t for a, b, c, d in QUADS for t in ((a, b, d), (b, c, d))], dtype=np.int32)
    part = np.where(np.arange(12)[:, None] < 6, others, FACES)
    cuts = (FACES, others, part)
    flipping = [replace(mesh, triangles=cuts[i % 3]) for i, mesh in enumerate(growing())]
    one, other = (touch(0.12, meshes, size=size).pairs[0, 0] for meshes in (growing(), flipping))
    assert one.surface_velocity[1:, 2] == pytest.approx(np.full(COUNT - 1, 0.01), rel=1e-9)
    np.testing.assert_allclose(other.surface_velocity, one.surface_velocity, rtol=0, atol=1e-15)


@pytest.mark.parametrize("size", [7, 24, COUNT])
def test_a_touch_gap_that_grows_is_not_cut_at_its_first_value(size: int) -> None:
    distance = np.where(np.arange(COUNT) < 30, 0.0005, 0.15)
    margin = FASTEST_APPROACH / RATE
    assert 0.0005 + margin < 0.1 < 0.15 + margin
    found = touch(0.2, size=size, distance=distance)
    assert found.pairs[0, 0].gap[30:] == pytest.approx(np.full(30, 0.1), abs=1e-12)
    assert np.isinf(found.pairs[0, 0].gap[:30]).all()  # as the same samples would be alone
    assert not touch(0.2, size=size).pairs


def test_the_chunk_comes_back_mended_for_the_skin() -> None:
    body = Body("box", None)
    scene = TactileScene("s", Fraction(24), (1, 25), RATE, (Finger("f"),), (body,), (), ())
    still = np.tile(np.eye(4), (1, COUNT, 1, 1))
    pad = still.copy()
    pad[0, :, 2, 3] = 0.12
    pad[0, 40, 0, 0] = np.nan
    good, bad = growing(), broken(growing(), range(20, 30))
    none = np.zeros((0, COUNT, 4, 4))
    mended = PadSampler(scene).add(Chunk(1 + 24 * T, T, pad, still, none, {0: tuple(bad)}))
    assert np.isfinite(mended.fingers).all()
    expected = [good[19] if 20 <= i < 30 else good[i] for i in range(COUNT)]
    for mesh, want in zip(mended.surfaces[0], expected, strict=True):
        np.testing.assert_array_equal(mesh.vertices, want.vertices)
