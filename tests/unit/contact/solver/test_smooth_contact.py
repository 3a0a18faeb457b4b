"""What points see of bodies: shortcuts of the compiled look, and hollows, where two faces are equally close."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest

from core.contact.single_touch import SingleTouch
from core.contact.solver import smooth_contact
from core.contact.solver.bodies import ContactBody
from core.contact.solver.pad_points import REACH, PadPoints
from core.contact.solver.path_solver import BONE
from core.contact.solver.smooth_contact import SmoothContact
from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.model import fingertip_skin
from core.skin.surface_compliance import SurfaceCompliance
from core.skin.surface_store import surface_compliance
from core.surface.gap import Surface
from core.surface.plane import Plane
from tests.steps import step


@pytest.fixture(scope="module")
def pad() -> SurfaceCompliance:
    made = surface_compliance(Library().skin("index_medium"), shipped=Path(BUILT_IN) / "skins")
    assert made is not None
    return made


@pytest.mark.parametrize("x", np.arange(-8, 9, 2).tolist())
def test_a_point_over_one_flat_face_sees_from_one_place_what_it_sees_from_all(pad: SurfaceCompliance, x: float) -> None:
    """The edge of a block is under the pad, at other distances from the points for each x [mm]."""
    points = PadPoints(pad)
    places = pad.cells.positions[: pad.chart.starts[1]]
    low = np.flatnonzero(places[:, 2] < places[:, 2].min() + 1.5e-3)
    points.change(np.zeros(0, dtype=np.int64), low)
    block = ContactBody(Surface.block(0.02, 0.02), translation=np.array([1e-3 * x, 0.01, places[:, 2].min() + 0.5e-3]))
    contact, still = SmoothContact(REACH, BONE), np.zeros((len(low), 3))
    seen = contact.look(points, [block], still)
    all_places = contact._prepared(points, [block], still)
    all_places.record.thorough = 1
    smooth_contact._call(all_places.record)
    wanted = smooth_contact._gaps(all_places.found, [block])
    near = np.flatnonzero(wanted.clearance < 0.1e-3)  # points farther away look but once at first
    assert len(near) > 20
    np.testing.assert_allclose(seen.clearance[near], wanted.clearance[near], atol=1e-12)
    np.testing.assert_allclose(seen.normal[near], wanted.normal[near], atol=1e-9)


def test_what_is_left_in_a_kept_workspace_changes_no_byte(pad: SurfaceCompliance) -> None:
    """A workspace of more points, full of NaN, beside a new one."""
    points, places = PadPoints(pad), pad.cells.positions[: pad.chart.starts[1]]
    low = np.flatnonzero(places[:, 2] < places[:, 2].min() + 1.5e-3)
    points.change(np.zeros(0, dtype=np.int64), low)
    zero, found = np.zeros((len(low), 3)), []
    edge = ContactBody(Surface.edge(), translation=np.array([1e-4, 0.0, places[:, 2].min() + 1e-3]), friction=0.3)
    for kept in (False, True):
        contact = SmoothContact(REACH, BONE)
        if kept:
            contact._room = np.full(40 * len(low) ** 2, np.nan)
        gaps = contact.look(points, [edge], zero)
        near = np.where(gaps.body >= 0, gaps.gap, 0.0)
        solved = contact.solve(points, near[:, None] * gaps.normal, gaps, zero, None, 3e-6, 3e-5)
        found.append((gaps.clearance, solved.solution.force, solved.image, solved.solution.status))
    assert found[0][1].any()
    for one, other in zip(*found, strict=True):
        assert one.tobytes() == other.tobytes()


def test_arrays_of_a_look_exist_until_its_solution(pad: SurfaceCompliance) -> None:
    """The kernel has their addresses alone."""
    points = PadPoints(pad)
    points.change(np.zeros(0, dtype=np.int64), np.arange(9))
    contact, names = SmoothContact(REACH, BONE), ("positions", "inward", "spread", "areas")
    gaps = contact.look(points, walls(0.0), np.zeros((9, 3)))
    seen = [weakref.ref(getattr(points, name)) for name in names]
    for name in names:
        setattr(points, name, getattr(points, name).copy())
    gc.collect()
    assert all(array() is not None for array in seen)
    contact.solve(points, np.zeros((9, 3)), gaps, np.zeros((9, 3)), None, 3e-6, 3e-5)
    assert all(array() is None for array in seen)


def walls(*angles: float) -> list[ContactBody]:
    """Return planes through the Y axis, whose normals have these angles to Z [degrees]."""
    normals = [np.array([np.sin(a), 0.0, np.cos(a)]) for a in np.radians(angles)]
    return [ContactBody(Plane(normal, np.zeros(3))) for normal in normals]


def gaps_of(pad: SurfaceCompliance, bodies: list[ContactBody], where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return gap and normal of one cell at given places [m], shape (n, 3)."""
    points, cell = PadPoints(pad), np.abs(pad.cells.positions[: pad.chart.starts[1], :2]).sum(axis=1).argmin()
    points.change(np.zeros(0, dtype=np.int64), np.array([cell]))
    contact, found = SmoothContact(REACH, BONE), []
    for place in where:
        seen = contact.look(points, bodies, (place - points.positions[0])[None])
        found.append((seen.clearance[0], seen.normal[0]))
    return np.array([gap for gap, _ in found]), np.array([normal for _, normal in found])


@pytest.mark.parametrize("angle", [60.0, 90.0, 120.0], ids=["60", "90", "120"])
def test_the_gap_turns_steadily_where_two_faces_meet_in_a_hollow(pad: SurfaceCompliance, angle: float) -> None:
    """Of 60 to 120 degrees, the steps left are those of the upper look, which counts a fifth; kinks of the lower one
    would turn the normal by 0.2 to 0.3 at once."""
    bodies = walls(0.0, -angle)
    x = np.linspace(-1.2e-3, 0.3e-3, 601)
    _, normals = gaps_of(pad, bodies, np.column_stack([x, 0.0 * x, 0.1e-3 + 0.0 * x]))
    turns = np.linalg.norm(np.diff(normals, axis=0), axis=1)
    assert np.linalg.norm(normals[-1] - normals[0]) > 0.5
    assert turns.max() < 0.08


@pytest.mark.parametrize("x", [-0.6e-3, -0.3e-3, -0.2e-3, -0.1e-3, -0.03e-3])
def test_where_the_gap_is_closed_in_a_hollow_the_normal_is_its_gradient(pad: SurfaceCompliance, x: float) -> None:
    """Otherwise contact without friction would do work."""
    bodies, h, low, high = walls(0.0, -90.0), 1e-7, -0.2e-3, 1e-3
    for _ in range(40):
        middle = 0.5 * (low + high)
        closed = gaps_of(pad, bodies, np.array([[x, 0.0, middle]]))[0][0] < 0.0
        low, high = (middle, high) if closed else (low, middle)
    place = np.array([x, 0.0, low])
    gap, _ = gaps_of(pad, bodies, place + h * np.vstack([np.eye(3), -np.eye(3)]))
    _, normal = gaps_of(pad, bodies, place[None])
    np.testing.assert_allclose((gap[:3] - gap[3:]) / (2.0 * h), normal[0], atol=0.02)


def test_a_second_face_below_the_first_changes_nothing(pad: SurfaceCompliance) -> None:
    """A step's upper edge is convex: high above the floor it is felt as that of a block."""
    high, block = step(8e-3), Surface.block(0.06, 0.06, 5e-3)
    one = ContactBody(high, translation=np.array([-1e-3, 0.0, 0.0]))
    other = ContactBody(block, translation=np.array([-1e-3 + 0.03, 0.0, 8e-3 - block.vertices[:, 2].max()]))
    x = np.linspace(-2e-3, 1e-3, 61)
    places = np.column_stack([x, 0.0 * x, 8.05e-3 + 0.0 * x])
    for seen, wanted in zip(gaps_of(pad, [one], places), gaps_of(pad, [other], places), strict=True):
        np.testing.assert_allclose(seen, wanted, atol=1e-9)


def quartered(surface: Surface, times: int) -> Surface:
    """Cut each triangle into four."""
    vertices, triangles = surface.vertices, surface.triangles
    for _ in range(times):
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        middles = np.concatenate([(a + b) / 2, (b + c) / 2, (c + a) / 2])
        ab, bc, ca = (len(vertices) + k * len(triangles) + np.arange(len(triangles)) for k in range(3))
        corners = triangles.T
        parts = [(corners[0], ab, ca), (ab, corners[1], bc), (ca, bc, corners[2]), (ab, bc, ca)]
        vertices, triangles = np.concatenate([vertices, middles]), np.vstack([np.stack(t, axis=1) for t in parts])
    return Surface.build(vertices, triangles.astype(np.int32))


def test_a_hollow_is_that_of_the_shape_whatever_its_triangles(pad: SurfaceCompliance) -> None:
    """The search leaves out what is far or below the closest face: 20 triangles and 5,120 give the same gaps."""
    plain, rng = step(0.3e-3), np.random.default_rng(3)
    places = np.array([-0.2e-3, 0.0, 0.2e-3]) + rng.uniform(-0.4e-3, 0.4e-3, (60, 3))
    bodies = [[ContactBody(surface, rotation=turn(0.1))] for surface in (plain, quartered(plain, 4))]
    (one, facing), (other, also) = (gaps_of(pad, some, places) for some in bodies)
    np.testing.assert_allclose(other, one, atol=1e-9)
    np.testing.assert_allclose(also, facing, atol=1e-6)
    alone = gaps_of(pad, [ContactBody(Surface.block(0.06, 0.06, 5e-3), rotation=turn(0.1))], places)
    assert np.abs(alone[0] - one).max() > 0.02e-3  # the second face counts at some of them


def bumps(seed: int, closed: bool) -> Surface:
    """Return a field of random heights up to 0.5 mm over squares of 1.2 mm, alone or as the top of a slab."""
    size, rng = 7, np.random.default_rng(seed)
    i, j = np.divmod(np.arange(size * size), size)
    flat = 1.2e-3 * np.column_stack([i - size // 2, j - size // 2])
    vertices = np.column_stack([flat, 0.5e-3 * rng.random(size * size)])
    own = np.arange(size * size).reshape(size, size)
    a, b, c, d = (part.ravel() for part in (own[:-1, :-1], own[1:, :-1], own[1:, 1:], own[:-1, 1:]))
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    if closed:
        rim = np.concatenate([own[:-1, 0], own[-1, :-1], own[:0:-1, -1], own[0, :0:-1]])
        after, count = np.roll(rim, -1), len(vertices)
        vertices = np.vstack([vertices, vertices * [1.0, 1.0, 0.0] - [0.0, 0.0, 3e-3]])
        sides = np.vstack(
            [np.column_stack([rim, rim + count, after]), np.column_stack([after, rim + count, after + count])]
        )
        triangles = np.vstack([triangles, triangles[:, ::-1] + count, sides])
    return Surface.build(vertices, triangles)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_hollows_of_all_angles_are_those_of_the_shape_whatever_its_triangles(
    pad: SurfaceCompliance, seed: int, closed: bool
) -> None:
    """Of a face that is cut, only the place that is closest counts."""
    plain, rng = bumps(seed, closed), np.random.default_rng(seed)
    assert plain.closed == closed
    places = np.array([0.0, 0.0, 0.3e-3]) + rng.uniform(-1.0, 1.0, (120, 3)) * [2e-3, 2e-3, 0.3e-3]
    (one, facing), (other, also) = (
        gaps_of(pad, [ContactBody(surface)], places) for surface in (plain, quartered(plain, 2))
    )
    assert np.isfinite(one).sum() > 100
    np.testing.assert_allclose(other, one, atol=1e-9)
    np.testing.assert_allclose(also, facing, atol=1e-6)


def turn(angle: float) -> np.ndarray:
    """Return a rotation about X and Z [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@pytest.mark.parametrize(("bend", "hollow"), [(0.05, 1), (-0.05, 0), (0.0, 0)])
def test_a_body_is_hollow_where_faces_bend_towards_each_other_by_little(bend: float, hollow: int) -> None:
    """A fillet consists of many bends: what one of them turns says nothing of the whole."""
    block = quartered(Surface.block(0.02, 0.02, 0.01), 1)
    vertices, top = block.vertices.copy(), block.vertices[:, 2] == 0.0
    vertices[top, 2] += np.tan(bend) * np.abs(vertices[top, 0])
    assert Surface.build(vertices, block.triangles).kernel_body.record.hollow == hollow


@pytest.mark.parametrize("surface", [Surface.block(0.02, 0.02), Surface.edge(), Surface.sphere(5e-3, 2000)])
def test_a_body_without_hollows_is_seen_alike_where_a_second_face_is_looked_for(
    pad: SurfaceCompliance, surface: Surface
) -> None:
    """That such a body skips the search changes nothing."""
    body, rng = ContactBody(surface, rotation=turn(0.2)), np.random.default_rng(5)
    places = rng.uniform(-0.6e-3, 0.6e-3, (80, 3)) + [0.0, 0.0, 0.1e-3]
    assert surface.kernel_body.record.hollow == 0
    plain = gaps_of(pad, [body], places)
    surface.kernel_body.record.hollow = 1
    searched = gaps_of(pad, [body], places)
    surface.kernel_body.record.hollow = 0
    assert np.isfinite(plain[0]).sum() > 60
    np.testing.assert_allclose(searched[0], plain[0], atol=1e-9)
    np.testing.assert_allclose(searched[1], plain[1], atol=1e-6)


def dragged(friction: float, shift: float) -> tuple[np.ndarray, int]:
    """Return the force on a finger of draft skin that crosses a low step there and back [N], and the most sweeps."""
    body = ContactBody(step(0.3e-3), translation=np.array([2.5e-3 + shift, 0.0, 0.0]), friction=friction)
    touch, forces, sweeps = SingleTouch(fingertip_skin(level="draft"), body, "finger"), [], 0
    touch.move((0.0, 0.0, 1.2e-3))
    for way in [-0.1e-3] * 30 + [0.1e-3] * 30:
        found = touch.move((way, 0.0, 0.0))
        forces.append(found.nodal.sum(axis=0))
        sweeps = max(sweeps, found.solution.iterations)
    return np.array(forces), sweeps


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_finger_at_the_foot_of_a_step_does_not_feel_a_nanometre(friction: float) -> None:
    """Where a point sees one of two faces alone, the faces take turns, and frames do not converge."""
    (plain, sweeps), (shifted, _) = dragged(friction, 0.0), dragged(friction, 1e-9)
    largest = np.linalg.norm(plain, axis=1).max()
    assert sweeps < smooth_contact.MOST_SWEEPS
    assert np.linalg.norm(shifted - plain, axis=1).max() < 0.01 * largest
    if friction == 0.0:
        assert np.linalg.norm(plain[:29] - plain[30:-1][::-1], axis=1).max() < 0.01 * largest
