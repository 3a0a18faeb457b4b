"""That touches told otherwise are the same touches, and told otherwise indeed: what `invariance_*` judges by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.solver.path_solver import PathSolver
from core.pipeline import shares
from core.scene.tactile_scene import Mesh
from core.surface.gap import Surface
from tests.stress import remade, retellings, retimed
from tests.stress.placed import Touch
from tests.stress.setups import Setup, computed
from tests.stress.solids import SHAPES, parts_of
from tests.unit.test_invariances import BALL, EDGE, PLANE, touch_positions

pytestmark = pytest.mark.one_line("3.13", "its equations decide; tests/unit/contact runs on both lines")


def test_the_finger_is_its_own_mirror_image_and_a_mirrored_scene_is_another() -> None:
    positions = touch_positions()
    apart = np.linalg.norm(positions[:, None] * [-1.0, 1.0, 1.0] - positions, axis=2)
    assert apart.min(axis=1).max() < 1e-9 and np.ptp(positions[:, 0]) > 10e-3
    touch = Touch(EDGE)
    setup = touch.setup()
    (other,) = retellings.mirrored(touch, setup)
    assert np.allclose(points_of(other), points_of(setup) * [-1.0, 1.0, 1.0], rtol=0.0, atol=1e-15)
    assert not np.allclose(points_of(other), points_of(setup), rtol=0.0, atol=1e-4)


def points_of(setup: Setup) -> np.ndarray:
    """Return the corners of the bodies at every sample, in the finger's frame [m], shape (n, c, 3)."""
    found = []
    for body, way in setup.bodies:
        mesh = remade.mesh_of(body)
        found.append(mesh.vertices @ way[:, :3, :3].transpose(0, 2, 1) + way[:, None, :3, 3])
    return np.concatenate(found, axis=1)


def test_caches_are_used_and_hold_what_other_touches_left() -> None:
    touch, stores = Touch(PLANE), list[tuple[int, int]]()
    for setup in retellings.caches(touch, touch.setup()):
        if setup.kept is not None and setup.cache is not None:
            before, files = setup.kept.found, setup.cache.size()
            setup.bake()
            stores.append((setup.kept.found - before, len(setup.kept)))
            assert bool(files) == (len(stores) > 1)  # the first one finds no skin
    assert stores == [(0, 1), (1, 1), (0, 5)]


def test_other_touches_feel_otherwise() -> None:
    touch = Touch({**EDGE, "devices": 0})
    setup, first = touch.setup(), force_of(touch.setup())
    for other in retellings.unlike(touch, setup):
        assert np.abs(force_of(other) - first).max() > 1e-2 * np.abs(first).max()


def force_of(setup: Setup) -> np.ndarray:
    """Return the forces that are felt [N], shape (n, 3)."""
    return computed(setup).channels["force"].values


def test_a_process_of_its_own_renders_the_finger_that_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    touch, fingers, made_of = Touch(PLANE), list[list[int]](), shares.made_of

    def made(arrays: object, *more: object) -> object:
        share = made_of(arrays, *more)  # type: ignore[arg-type]
        fingers.append([*share.felt])
        return share

    monkeypatch.setattr(shares, "made_of", made)
    setup = retellings.with_finger(touch.setup())
    for other in retellings.processes(touch, setup):
        computed(other)
    assert fingers == [[0]] and other.name == setup.scene().fingers[0].name


def test_a_finger_beside_the_finger_touches_elsewhere() -> None:
    touch = Touch(PLANE)
    *_, setup = retellings.order(touch, touch.setup())
    felt = setup.bake().skins
    assert [*felt] == ["another", "finger"]
    ours, others = (np.asarray(felt[name].force) for name in ("finger", "another"))
    assert others.shape != ours.shape or not np.allclose(others, ours, rtol=0.0, atol=1e-3 * np.abs(ours).max())


def test_other_triangles_are_the_same_surface() -> None:
    (mesh,) = parts_of("block")
    points = np.random.default_rng(3).uniform(-30e-3, 30e-3, (200, 3))
    gaps = Surface.build(mesh.vertices, mesh.triangles).query(points).gap
    changes = retellings.flipped, retellings.quartered, retellings.shuffled, retellings.unwelded
    for change in changes:
        other = change(mesh, np.random.default_rng(0))
        assert faces(other) != faces(mesh) or change is not retellings.flipped
        assert np.abs(Surface.build(other.vertices, other.triangles).query(points).gap - gaps).max() < 1e-15
    assert len(retellings.quartered(mesh, np.random.default_rng(0)).triangles) == 4 * len(mesh.triangles)
    assert len(retellings.unwelded(mesh, np.random.default_rng(0)).vertices) == 3 * len(mesh.triangles)


def test_litter_leaves_the_surface_where_it_is() -> None:
    (mesh,) = parts_of("edge_90")
    outside = above(mesh)
    gaps = Surface.build(mesh.vertices, mesh.triangles).query(outside).gap
    for change in (remade.with_loose_corners, remade.with_faces_without_area, remade.with_faces_twice):
        other = change(mesh)
        assert np.abs(Surface.build(other.vertices, other.triangles).query(outside).gap - gaps).max() < 1e-15
        assert len(other.vertices) + len(other.triangles) > len(mesh.vertices) + len(mesh.triangles)


def above(mesh: Mesh) -> np.ndarray:
    """Return points outside a solid, about its highest point [m], shape (n, 3)."""
    points = np.random.default_rng(3).uniform(-5e-3, 5e-3, (400, 3))
    return points[Surface.build(mesh.vertices, mesh.triangles).query(points).gap > 0.0]


def test_what_is_scaled_in_the_matrix_is_the_same_in_the_world() -> None:
    touch = Touch(EDGE)
    setup = touch.setup()
    others = [*remade.scaled(touch, setup)]
    assert len(others) == len(remade.SCALES)
    for other, scale in zip(others, remade.SCALES, strict=True):
        assert np.allclose(points_of(other), points_of(setup), rtol=0.0, atol=1e-15)
        determinant = np.linalg.det(other.bodies[0][1][0, :3, :3])
        assert determinant == pytest.approx(np.linalg.det(scale)) and determinant != pytest.approx(1.0)
        assert volume(remade.mesh_of(other.bodies[0][0])) > 0.0


def volume(mesh: Mesh) -> float:
    """Return what faces that look outwards bound [m^3]."""
    corners = mesh.vertices[mesh.triangles]
    return float(np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2])) / 6.0


@pytest.mark.parametrize("name", SHAPES)
def test_halves_are_closed_and_together_the_solid(name: str) -> None:
    parts = parts_of(name)
    cut = [remade.halves(part, 0.4, 0.1e-3) for part in parts]
    assert max(map(len, cut)) == 2
    for part, halves in zip(parts, cut, strict=True):
        assert sum(map(volume, halves)) == pytest.approx(volume(part), rel=1e-9)
        built = [Surface.build(half.vertices, half.triangles) for half in halves]
        assert all(surface.closed and not surface.findings() for surface in built)
        outside = above(part)
        apart = np.min([surface.query(outside).gap for surface in built], axis=0)
        assert np.abs(apart - Surface.build(part.vertices, part.triangles).query(outside).gap).max() < 1e-12
        assert volume(remade.joined(halves)) == pytest.approx(volume(part), rel=1e-9)


def test_samples_at_other_times_are_the_same_samples() -> None:
    setup = replace(Touch(BALL).setup(), devices=())
    told = [*retimed.pace(setup), *retimed.span(setup)]
    assert len(told) == 6 and any(other.rate != setup.rate for other, _ in told)
    for other, rows in told:
        same = (rows >= 0).nonzero()[0]
        assert other.count == len(rows)
        assert np.array_equal(other.bodies[0][1][same], setup.bodies[0][1][rows[same]])
        looked = np.isin(rows, np.rint(setup.looked * setup.rate)).nonzero()[0]
        assert np.isin(looked, np.rint(other.looked * other.rate)).all()
    earlier, rows = told[-1]
    heights = earlier.bodies[0][1][:, 2, 3]
    assert (rows[: retimed.EARLIER] == -1).all() and (np.diff(heights[: retimed.EARLIER + 1]) > 0.0).all()


def faces(mesh: Mesh) -> set[frozenset[int]]:
    """Return the corners of each triangle."""
    return {frozenset(face) for face in mesh.triangles.tolist()}


def test_with_the_broad_phase_off_every_body_comes_to_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    setup, seen, looked = retellings.beside(Touch(PLANE).setup()), [], PathSolver.look

    def look(self: PathSolver, bodies: object) -> object:
        seen.append(sum(not body.away for body in bodies))  # type: ignore[attr-defined]
        return looked(self, bodies)  # type: ignore[arg-type]

    monkeypatch.setattr(PathSolver, "look", look)
    setup.bake()
    usually, seen[:] = list(seen), []
    next(retellings.broad_phase(Touch(PLANE), setup)).bake()
    assert max(usually) == 1 and set(seen) == {2} and len(seen) >= setup.count


def test_starts_are_others_and_leave_the_engine_as_it_was() -> None:
    usually, begun = PathSolver._extrapolated, []
    touch = Touch(PLANE)
    for setup in retellings.start(touch, touch.setup()):
        with setup.engine():
            assert PathSolver._extrapolated is not usually
        begun.append(setup.bake().skins["finger"].force)
    assert PathSolver._extrapolated is usually
    assert not np.array_equal(begun[0], begun[1]) and not np.array_equal(begun[0], begun[2])
