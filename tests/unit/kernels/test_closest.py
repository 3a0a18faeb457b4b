"""Distances by the kernels against an oracle that tries every triangle."""

from __future__ import annotations

import copy
import ctypes
import gc
import pickle
import shutil
import subprocess
from collections.abc import Callable
from ctypes import byref
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.kernels import building, library, records
from core.surface.gap import Surface
from core.surface.gap_query import GapQuery
from core.surface.kernel_body import KernelBody
from core.surface.plain_triangles import PlainTriangles
from core.surface.triangle_tree import TriangleTree
from tests.closest_points import nearest
from tests.kernel_cases.bodies import Arrays, drawn
from tests.kernel_cases.case import address, gcc, opened


@pytest.mark.parametrize("seed", range(60))
def test_they_are_those_of_the_oracle(seed: int) -> None:
    """Slivers, duplicates, needles, points on corners and edges, all sizes: the same triangle, the same bytes."""
    arrays = drawn(seed)
    triangle, _, u, w = nearest(arrays.table, arrays.points, arrays.limit)
    own = opened(library.kernels().path)
    assert not any(arrays.call(own))
    for again in range(2):  # by the tree, then without one
        found = arrays.found
        near = triangle >= 0
        deep = ~near & (found["triangle"] >= 0)  # inside, beyond the limit
        assert not deep.any() or (arrays.topology.closed and (found["gap"][deep] < -arrays.limit).all())
        np.testing.assert_array_equal(found["triangle"][~deep], triangle[~deep])
        np.testing.assert_array_equal(found["weights"][near, 1:], np.stack([u, w], axis=1)[near])
        a, ab, ac = arrays.table.rows[:9].take(triangle[near], axis=1).reshape(3, 3, -1)
        np.testing.assert_array_equal(found["closest"][near].T, a + u[near] * ab + w[near] * ac)
        x, y, z = (arrays.points - found["closest"])[near].T
        np.testing.assert_array_equal(np.abs(found["gap"][near]), np.sqrt(x * x + z * z + y * y))
        assert np.isnan(found["closest"][~near & ~deep]).all() and np.isinf(found["gap"][~near & ~deep]).all()
        if not again:
            assert arrays.measure(own, packed=False) == 0


@pytest.mark.parametrize("seed", range(20))
def test_features_are_read_off_the_weights(seed: int) -> None:
    arrays = drawn(seed)
    arrays.call(opened(library.kernels().path))
    for feature, weights, triangle in zip(*(arrays.found[n] for n in ("feature", "weights", "triangle")), strict=True):
        on = set(np.flatnonzero(weights > 1e-9).tolist()) if triangle >= 0 else {0, 1, 2}
        edge = {int(feature) - 1, int(feature) % 3}
        assert on == ({0, 1, 2} if feature == 0 else edge if feature < 4 else {int(feature) - 4})


@pytest.mark.parametrize("seed", range(20))
def test_the_numpy_way_agrees(seed: int) -> None:
    """Devices without a skin use it where no library loads: the same distances, within rounding."""
    arrays = drawn(seed)
    plain = PlainTriangles(arrays.table, arrays.topology, arrays.vertices[arrays.triangles])
    plain = plain.query(arrays.points, arrays.limit)
    assert not any(arrays.call(opened(library.kernels().path)))
    gap, size = arrays.found["gap"], np.abs(arrays.table.rows[:9]).max()
    sure = np.abs(np.abs(gap) - arrays.limit) > 1e-12 * size
    np.testing.assert_array_equal(np.isfinite(plain.gap)[sure], np.isfinite(gap)[sure])
    both = np.isfinite(plain.gap) & np.isfinite(gap)
    np.testing.assert_allclose(np.abs(plain.gap[both]), np.abs(gap[both]), rtol=1e-9, atol=1e-12 * size)
    off = np.linalg.norm(plain.point[both] - arrays.points[both], axis=1)
    np.testing.assert_allclose(off, np.abs(gap[both]), rtol=1e-9, atol=1e-12 * size)
    if arrays.topology.closed:
        away = both & (np.abs(gap) > 1e-9)
        np.testing.assert_array_equal(np.sign(plain.gap[away]), np.sign(gap[away]))


def strayed(far: float, count: int) -> Surface:
    """Return a ball of 15 mm, some of whose vertices lie far away [m]."""
    ball = Surface.sphere(15e-3, facets=2000)
    vertices = ball.vertices.copy()
    apart = np.random.default_rng(count).normal(size=(count, 3))
    vertices[:count] = far * apart / np.linalg.norm(apart, axis=1)[:, None]
    return Surface.build(vertices, ball.triangles)


@pytest.mark.parametrize("count", [1, 3, 200])
@pytest.mark.parametrize("far", [0.1, 1e3, 1e7])
def test_beside_vertices_that_lie_far_apart_they_are_those_without_a_tree(far: float, count: int) -> None:
    """Near the ball, and beside the long triangles: the same gaps and triangles, to the bit."""
    surface, rng = strayed(far, count), np.random.default_rng(5)
    table, slabs = surface.table, np.zeros((0, 5))
    corners = surface.vertices[surface.triangles[rng.integers(0, len(surface.triangles), 300)]]
    weights = rng.dirichlet(np.ones(3), 300)
    on = (weights[:, :, None] * corners).sum(axis=1) + rng.normal(0.0, 1e-3, (300, 3))
    points = np.concatenate([on, rng.normal(0.0, 20e-3, (300, 3)), far * rng.normal(size=(20, 3))])
    found = []
    for topology in (None, surface.topology):
        tree = TriangleTree(table, topology)
        found.append(KernelBody(tree, None, surface.topology, slabs, 0, False).query(points, np.inf))
    for name in ("gap", "triangle", "point", "weights"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(found[1], name))


@pytest.mark.parametrize("far", [1.0, 1e3, 1e7])
def test_a_vertex_that_lies_far_apart_does_not_blur_the_boxes_of_the_others(far: float) -> None:
    """Rounding makes the boxes of triangles thicker, by less than a thousandth of their width: searches stay short."""
    surface = strayed(far, 1)
    tree = TriangleTree(surface.table, surface.topology)
    blocks = -(-tree.record.count // records.LANES)
    groups = np.ctypeslib.as_array(
        ctypes.cast(tree.record.boxes, ctypes.POINTER(ctypes.c_float)),
        ((4**tree.record.depth - 1) // 3 + blocks, 16, 4),
    )
    thick = groups[-blocks:, 12].ravel() * tree.record.scale  # flat boxes of single triangles
    wide = groups[-blocks:, 13].ravel() * tree.record.scale
    filled = thick >= 0.0
    assert np.median(thick[filled]) < 1e-3 * np.median(wide[filled]) < 1e-6


needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")


def fan(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return so many triangles about one corner: above it all of them are equally close."""
    angle = np.arange(count) * 2 * np.pi / count
    ring = np.stack([0.01 * np.cos(angle), 0.01 * np.sin(angle), np.full(count, -0.003)], axis=1)
    k = np.arange(count)
    return np.concatenate([[[0.0, 0.0, 0.0]], ring]), np.stack([0 * k, 1 + k, 1 + (k + 1) % count], axis=1)


@pytest.mark.parametrize("count", [3, 31, 32, 33, 400])
def test_of_many_that_are_equally_close_the_lowest_number_is_taken(count: int) -> None:
    """More than are remembered, too, in whatever order they come."""
    vertices, triangles = fan(count)
    order = np.random.default_rng(count).permutation(count)
    surface = Surface.build(vertices, triangles[order])
    points = np.array([[0.0, 0.0, 1e-3], [1e-7, 0.0, 2e-3], [0.0, 0.0, 0.0]])
    expected = nearest(surface.table, points)[0]
    assert expected[0] == 0
    np.testing.assert_array_equal(surface.query(np.tile(points, (4, 1))).triangle, np.tile(expected, 4))


def test_neither_batches_nor_order_change_a_byte() -> None:
    rng = np.random.default_rng(1)
    surface = Surface.sphere(5e-3, 3000)
    points = rng.normal(size=(400, 3)) * 5e-3 + [0.0, 0.0, -5e-3]
    points[::7] = surface.vertices[rng.integers(0, len(surface.vertices), len(points[::7]))]
    whole = surface.query(points, 2e-3)

    def same(found: GapQuery, which: np.ndarray) -> None:
        for name, expected in vars(whole).items():
            np.testing.assert_array_equal(getattr(found, name), expected[which])

    order = rng.permutation(len(points))
    same(surface.query(points[order], 2e-3), order)
    for size in (1, 3, 50):
        for first in range(0, len(points), size):
            part = np.arange(first, min(first + size, len(points)))
            same(surface.query(points[part], 2e-3), part)
    again = Surface.build(surface.vertices, surface.triangles.copy())
    same(again.query(points, 2e-3), np.arange(len(points)))


def hinted(folder: Path) -> ctypes.CDLL:
    """Return the library with a function that asks for distances as its own files do: point by point, with hints."""
    path, source = folder / "hinted.so", Path(__file__).with_name("hinted.c")
    subprocess.run(gcc(path, f"-I{building.FOLDER}", str(source), "-march=x86-64-v2"), check=True)
    own = opened(path)
    own.hinted.argtypes = (ctypes.c_void_p, ctypes.c_void_p)
    return own


@pytest.mark.one_line("3.11", "it is C")
@needs_gcc
def test_hints_change_no_byte(tmp_path: Path) -> None:
    """Those of the frame before, any others, and numbers that are no slots."""
    own = hinted(tmp_path)
    for seed in range(12):
        rng, arrays = np.random.default_rng(seed), drawn(seed)
        assert not any(arrays.call(own))
        wanted = {name: arrays.found[name].copy() for name in ("gap", "normal", "triangle")}
        _, query = arrays.fitted(own)
        slots = np.full(len(arrays.points), -1)
        for hints in (
            slots,
            slots,
            rng.integers(0, arrays.count, slots.size),
            rng.integers(-(2**62), 2**62, slots.size),
        ):
            own.hinted(ctypes.byref(query), address(hints))
            for name, expected in wanted.items():
                np.testing.assert_array_equal(arrays.found[name], expected)
            near = wanted["triangle"] >= 0
            np.testing.assert_array_equal(arrays.order[hints[near]], wanted["triangle"][near])
            assert (hints[~near] == -1).all()


@pytest.mark.one_line("3.11", "it is C")
@needs_gcc
def test_hints_change_no_byte_of_solids_that_run_through_each_other(tmp_path: Path) -> None:
    own, ball, rng = hinted(tmp_path), Surface.sphere(5e-3, 500), np.random.default_rng(0)
    vertices = np.concatenate([ball.vertices + shift for shift in ([0, 0, 0], [4e-3, 0, 0], [2e-3, 3e-3, 1e-3])])
    surface = Surface.build(vertices, np.concatenate([ball.triangles + k * len(ball.vertices) for k in range(3)]))
    points = rng.uniform(*surface.box, (300, 3))
    wanted, count = surface.query(points, 1e-3), len(surface.triangles)
    gap, normal, triangle = np.empty(300), np.empty((300, 3)), np.empty(300, np.int64)
    query = records.QueryRecord(ctypes.addressof(surface._body.record), 300, 1e-3, address(points))
    query.gap, query.normal, query.triangle = address(gap), address(normal), address(triangle)
    slots = np.full(300, -1)
    assert len(surface.solids) == 3
    for hints in (slots, slots, rng.integers(-1, count, 300), rng.integers(-(2**62), 2**62, 300)):
        own.hinted(ctypes.byref(query), address(hints))
        np.testing.assert_array_equal(gap, wanted.gap)
        np.testing.assert_array_equal(normal, wanted.normal)
        np.testing.assert_array_equal(triangle, wanted.triangle)
        assert ((hints >= 0) == np.isfinite(gap)).all() and hints.max() < count


def test_solids_that_are_left_out_by_their_boxes_change_no_byte() -> None:
    """With boxes without bounds, every solid is measured."""
    ball, rng = Surface.sphere(2e-3, 320), np.random.default_rng(1)
    vertices = np.concatenate([ball.vertices + [3e-3 * k, 0.5e-3 * (k % 3), 0.0] for k in range(7)])
    surface = Surface.build(vertices, np.concatenate([ball.triangles + k * len(ball.vertices) for k in range(7)]))
    points = rng.uniform(surface.box[0] - 2e-3, surface.box[1] + 2e-3, (2000, 3))
    points[:300] = surface.vertices[rng.integers(0, len(vertices), 300)] + [0.0, 0.0, 1e-3]
    assert len(surface.solids) == 7
    for limit in (0.0, 0.5e-3, np.inf):
        wanted, body = surface._body.query(points, limit), surface._body
        chain: KernelBody | None = body
        kept = []
        while chain is not None:
            kept.append((chain.record, list(chain.record.low), list(chain.record.high)))
            chain.record.low[:], chain.record.high[:] = [-np.inf] * 3, [np.inf] * 3
            chain = chain._other
        found = body.query(points, limit)
        for record, low, high in kept:
            assert np.isfinite(low).all() and np.isfinite(high).all()
            record.low[:], record.high[:] = low, high
        for name in ("gap", "triangle", "normal", "point", "weights"):
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))


def test_points_beyond_measure_and_tiny_and_huge_surfaces_are_answered() -> None:
    """Single precision bounds nothing there: every triangle is looked at."""
    vertices = Surface.sphere(5e-3, 500).vertices
    triangles = Surface.sphere(5e-3, 500).triangles
    points = np.random.default_rng(2).normal(size=(30, 3)) * 1e-2
    for scale in (1.0, 1e-30, 1e30):
        surface = Surface.build(vertices * scale, triangles)
        for far in (1.0, 1e14, 1e17):
            found = surface.query(points * scale * far)
            np.testing.assert_array_equal(found.triangle, nearest(surface.table, points * scale * far)[0])


def test_what_is_not_finite_is_refused() -> None:
    surface = Surface.sphere(5e-3, 500)
    points = np.zeros((5, 3))
    points[3, 1] = np.nan
    with pytest.raises(DermisError, match=r"not finite numbers \(found \[0\.0, nan, 0\.0\]\)"):
        surface._body.query(points, np.inf)
    with pytest.raises(DermisError, match="damaged"):
        surface._body.query(points[:1], np.nan)


def test_points_in_any_layout_are_measured_and_wrong_shapes_are_refused() -> None:
    """The kernels read memory by address: 8 bytes a number, row by row."""
    surface = Surface.sphere(5e-3, 500)
    points = np.float32(np.random.default_rng(4).normal(size=(20, 3)) * 1e-2)
    wanted = nearest(surface.table, points.astype(np.float64))[0]
    for layout in (
        points,
        np.asfortranarray(points, np.float64),
        np.repeat(points, 2, axis=0)[::2],
        points.astype(">f8"),
    ):
        np.testing.assert_array_equal(surface._body.query(layout, np.inf).triangle, wanted)
    for some in (points[:, :2], points[0]):
        with pytest.raises(DermisError, match="must have the shape"):
            surface._body.query(some, np.inf)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s))])
def test_a_copy_of_a_surface_with_a_tree_answers_as_the_surface(copied: Callable[[Surface], Surface]) -> None:
    """Its records hold addresses of its own arrays: the original may be gone."""
    points = np.random.default_rng(3).normal(size=(30, 3)) * 1e-2
    surface = Surface.sphere(5e-3, 500)
    expected = surface.query(points)
    other = copied(surface)
    assert "_body" in vars(other)
    del surface
    gc.collect()
    for name, value in vars(expected).items():
        np.testing.assert_array_equal(getattr(other.query(points), name), value)


@pytest.mark.parametrize("radius", [-1e-3, np.nan, -np.inf])
@pytest.mark.parametrize("flat", [False, True])
def test_a_search_radius_that_is_no_distance_is_refused(radius: float, flat: bool) -> None:
    surface = Surface.build(np.zeros((3, 3)), np.array([[0, 1, 2]])) if flat else Surface.sphere(5e-3, 500)
    with pytest.raises(DermisError, match=r"the search radius is not a distance .*allowed: 0 m or more, or inf"):
        surface.query(np.zeros((5, 3)), radius)


@pytest.mark.parametrize("size", [1e90, 1e-79])
@pytest.mark.parametrize("tree", [True, False])
def test_triangles_beyond_measure_are_refused(size: float, tree: bool) -> None:
    """The square of their area is no number: a corner would be taken for the closest point."""
    corners, triangles = np.eye(3) * size, np.array([[0, 1, 2]])
    with np.errstate(all="ignore"):
        surface = Surface.build(corners, triangles)
        assert surface.table.usable.all()
        with pytest.raises(DermisError, match=r"triangle 0: a triangle is too large or too small to measure"):
            surface.query(np.zeros((9 if tree else 1, 3)))


@pytest.mark.parametrize("damage", ["count", "depth", "total", "order", "vertices", "indices", "query", "limit"])
def test_records_that_none_can_be_are_refused(damage: str) -> None:
    own, arrays = opened(library.kernels().path), drawn(0)
    assert not any(arrays.call(own))
    if damage in ("count", "total", "depth"):
        for value in {"count": (0, -1, 2**40), "total": (0, arrays.count - 1), "depth": (-1, 16, 63)}[damage]:
            tree, _, _ = arrays.records()
            setattr(tree, damage, value)
            assert own.dermis_tree_split(byref(tree)) == own.dermis_tree_fit(byref(tree)) == records.BAD_RECORD
    elif damage == "order":
        arrays.order[0] = len(arrays.table.usable)
        tree, _, _ = arrays.records()
        assert own.dermis_tree_split(byref(tree)) == own.dermis_tree_fit(byref(tree)) == records.BAD_RECORD
    elif damage == "vertices":
        tree, body, _ = arrays.records()
        for name, value in (
            ("vertices", 0),
            ("parts", -1),
            ("slabs", -1),
            ("weld", -1.0),
            ("weld", np.nan),
            ("tree", None),
        ):
            tree, body, _ = arrays.records()
            setattr(body, name, value)
            assert own.dermis_body_fit(byref(body)) == records.BAD_RECORD, (name, tree)
    elif damage == "indices":
        count = len(arrays.vertices)
        for array, wrong in ((arrays.topology.corners, count), (arrays.topology.across, 2**40), (arrays.part, -1)):
            kept = array.flat[0]
            array.flat[0] = wrong
            tree, body, _ = arrays.records()
            assert own.dermis_body_fit(byref(body)) == records.BAD_RECORD, tree
            array.flat[0] = kept
    else:
        _, body, query = arrays.records()
        setattr(query, "count" if damage == "query" else "limit", -1)
        assert own.dermis_distances(byref(query)) == records.BAD_RECORD, body


def test_calls_leave_what_they_are_given(tmp_path: Path) -> None:
    arrays = drawn(2)
    before = arrays.points.copy(), arrays.table.rows.copy(), arrays.table.bounds.copy()
    assert isinstance(arrays, Arrays) and not any(arrays.call(opened(library.kernels().path)))
    for one, other in zip(before, (arrays.points, arrays.table.rows, arrays.table.bounds), strict=True):
        np.testing.assert_array_equal(one, other)


def rounded_wedge(facets: int) -> Surface:
    """Return the upper side of a wedge along X, an open sheet, whose edge is rounded by so many facets."""
    angle = np.linspace(-np.pi / 4, np.pi / 4, facets + 1)
    profile = 0.5e-3 * np.stack([np.sin(angle), np.cos(angle) - 1.0], axis=1)
    legs = 15e-3 * np.array([[-1.0, -1.0], [1.0, -1.0]])
    profile = np.concatenate([profile[:1] + legs[:1], profile, profile[-1:] + legs[1:]])
    count = len(profile)
    vertices = np.concatenate([np.column_stack([np.full(count, x), profile]) for x in (-20e-3, 20e-3)])
    k = np.arange(count - 1)
    return Surface.build(
        vertices, np.concatenate([np.stack([k, k + count, k + 1], 1), np.stack([k + 1, k + count, k + count + 1], 1)])
    )


def cut_block(cells: int) -> Surface:
    """Return a block whose faces are grids of so many squares a side."""
    side, corners = np.linspace(-10e-3, 10e-3, cells + 1), []
    for axis in range(3):
        for end in (0, cells):
            for i, j in np.ndindex(cells, cells):
                square = [
                    np.insert([side[i + a], side[j + b]], axis, side[end]) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))
                ]
                square = square if (end > 0) == (axis != 1) else square[::-1]
                corners += [[square[0], square[1], square[2]], [square[0], square[2], square[3]]]
    points = np.array(corners).reshape(-1, 3)
    vertices, index = np.unique(points, axis=0, return_inverse=True)
    return Surface.build(vertices, index.reshape(-1, 3))


CONVEX = {
    "ball": lambda: Surface.sphere(5e-3, 1280),
    "block": Surface.block,
    "edge": Surface.edge,
    "cut block": lambda: cut_block(6),
    "open sheet": lambda: rounded_wedge(12),
}


def placed(surface: Surface, noise: float, seed: int) -> Surface:
    """Return a surface turned and moved, its vertices in single precision and off by a noise [m]."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    vertices = surface.vertices @ turn.T + rng.normal(0.0, 20e-3, 3) + rng.normal(0.0, noise, surface.vertices.shape)
    return Surface.build(vertices.astype(np.float32).astype(np.float64), surface.triangles)


def about(surface: Surface, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return points above, in, on and below faces, edges and corners, one after the other along the surface."""
    weights = rng.dirichlet(np.ones(3), count)
    weights[::3, 0] = 0.0
    weights[1::9] = np.eye(3)[rng.integers(0, 3, len(weights[1::9]))]
    weights /= weights.sum(axis=1, keepdims=True)
    on = (
        weights[:, :, None] * surface.vertices[surface.triangles[rng.integers(0, len(surface.triangles), count)]]
    ).sum(axis=1)
    away = rng.normal(size=(count, 3))
    away *= (10.0 ** rng.uniform(-9.0, -2.0, count) / np.linalg.norm(away, axis=1))[:, None]
    points = np.asarray(on + away)
    points[::5] = on[::5]
    return points[np.argsort(points @ [1.0, 0.3, 0.1])]


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5])
@pytest.mark.parametrize("shape", CONVEX)
def test_a_walk_on_a_convex_body_finds_what_the_tree_finds(shape: str, noise: float) -> None:
    """The same triangle and the same bytes, however much the body is not quite convex."""
    surface = placed(CONVEX[shape](), noise, len(shape)) if noise else CONVEX[shape]()
    body = surface.kernel_body
    points = about(surface, 4000, np.random.default_rng(3))
    for limit in (np.inf, 0.5e-3):
        by_tree = body.query(points, limit)
        body.find_convexity()
        if not noise:
            assert body.record.convex
        by_walk = body.query(points, limit)
        for name in ("gap", "triangle", "normal", "point", "weights"):
            np.testing.assert_array_equal(getattr(by_walk, name), getattr(by_tree, name))
        body.record.convex = None


@pytest.mark.parametrize("degrees", [0.5, 2.0, 10.0, 60.0])
def test_a_walk_beside_the_edge_of_a_thin_wedge_finds_what_the_tree_finds(degrees: float) -> None:
    """Points on both faces in turn, so that each hint is on the other face; from there they may be below its plane."""
    slope = np.tan(np.radians(degrees))
    ends = [(0.0, 0.0), (10e-3, 0.0), (10e-3, 10e-3 * slope)]
    vertices = np.array([[x, y, z] for x, z in ends for y in (-5e-3, 5e-3)])
    triangles = np.array([[0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4], [2, 4, 3], [3, 4, 5], [0, 4, 2], [1, 3, 5]])
    surface, rng = Surface.build(vertices, triangles[:, ::-1]), np.random.default_rng(0)
    x, y = 10.0 ** rng.uniform(-12.0, -4.0, 20000), rng.uniform(-4e-3, 4e-3, 20000)
    points, body = np.stack([x, y, np.where(np.arange(len(x)) % 2, slope * x, 0.0)], axis=1), surface.kernel_body
    by_tree = body.query(points, np.inf)
    body.find_convexity()
    assert body.record.convex
    by_walk = body.query(points, np.inf)
    for name in ("gap", "triangle", "normal", "point", "weights"):
        np.testing.assert_array_equal(getattr(by_walk, name), getattr(by_tree, name))


def test_bodies_that_are_not_convex_are_left_to_the_tree() -> None:
    ball = Surface.sphere(5e-3, 1280)
    dented = ball.vertices.copy()
    dented[0] *= 0.99
    apart = np.concatenate([ball.vertices, ball.vertices + [11e-3, 0.0, 0.0]])
    two = np.concatenate([ball.triangles, ball.triangles + len(ball.vertices)])
    for vertices, triangles in ((dented, ball.triangles), (ball.vertices, ball.triangles[:, ::-1]), (apart, two)):
        body = Surface.build(vertices, triangles).kernel_body
        body.find_convexity()
        assert not body.record.convex


def test_a_surface_that_kernels_take_often_is_walked_on() -> None:
    """One that they take for a frame alone is not looked at, since that would take longer than it saves."""
    surface = Surface.sphere(5e-3, 1280)
    taken = [bool(surface.kernel_body.record.convex) for _ in range(20)]
    assert not taken[0] and taken[-1]
