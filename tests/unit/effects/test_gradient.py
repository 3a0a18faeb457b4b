"""[S4] eq. 2 to 6 against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.effects.gradient import bilinear, check_map, gradient, metres_of, steepest
from core.effects.slide import (
    STEEPEST_NORMAL,
    directions,
    friction_of_normal,
    friction_of_normal_printed,
    friction_of_slope,
    without_downhill,
)
from core.errors import DermisError

RATE = 1000.0


def centres(rows, columns, size):
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * size[0]
    y = ((np.arange(rows) + 0.5) / rows - 0.5) * size[1]
    return np.meshgrid(x, y)


def field(heights, size, height_unit):
    """Return the slopes of a map on a screen, shape (2, rows, columns)."""
    spacing = (size[0] / heights.shape[1], size[1] / heights.shape[0])
    return gradient(heights, spacing, scale=metres_of(size, height_unit))


def test_plane_has_its_slope_everywhere_with_pixels_that_are_not_square():
    size = (0.3, 0.1)
    x, y = centres(40, 50, size)
    millimetres = 1e3 * (0.2 * x - 0.7 * y)
    slopes = field(millimetres, size, 1e-3)
    np.testing.assert_allclose(slopes[0], 0.2, rtol=2e-5)
    np.testing.assert_allclose(slopes[1], -0.7, rtol=2e-5)


def test_map_without_a_unit_counts_one_as_the_screens_width():
    size = (0.2, 0.1)
    ramp = np.tile(np.linspace(0, 1, 11), (5, 1))  # ten steps of 0.1 over pixels of 0.2/11 m
    assert field(ramp, size, 0.0)[0, 2, 5] == pytest.approx(0.1 * 0.2 / (0.2 / 11), rel=1e-6)


def test_agrees_with_numpy_to_single_precision():
    rng = np.random.default_rng(3)
    heights = rng.normal(size=(37, 53)).astype(np.float32)
    along_y, along_x = np.gradient(heights.astype(float), 0.02, 0.05)
    found = gradient(heights, (0.05, 0.02))
    np.testing.assert_allclose(found[0], along_x, atol=1e-4)
    np.testing.assert_allclose(found[1], along_y, atol=1e-4)
    assert steepest(found) == pytest.approx(np.hypot(along_x, along_y).max(), rel=1e-5)


def test_interior_converges_with_order_two():
    errors = []
    for n in (32, 64, 128, 256):
        x, y = centres(n, n, (1.0, 1.0))
        found = gradient(np.sin(3 * x) * np.cos(2 * y), (1 / n, 1 / n))
        exact_x, exact_y = 3 * np.cos(3 * x) * np.cos(2 * y), -2 * np.sin(3 * x) * np.sin(2 * y)
        inner = np.s_[1:-1, 1:-1]
        errors.append(max(np.abs(found[0] - exact_x)[inner].max(), np.abs(found[1] - exact_y)[inner].max()))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(rates - 2.0) < 0.1), rates


@pytest.mark.parametrize("run", [1, 3, 7, 100])
def test_length_of_a_run_changes_nothing(monkeypatch, run):
    heights = np.random.default_rng(6).normal(size=(6, 5)).astype(np.float32)
    whole = gradient(heights, (0.5, 0.25))
    monkeypatch.setattr("core.effects.gradient.RUN", run)
    np.testing.assert_array_equal(gradient(heights, (0.5, 0.25)), whole)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_single_rows_and_columns(shape):
    heights = np.arange(shape[0] * shape[1], dtype=np.float32).reshape(shape)
    slopes = field(heights, (1.0, 1.0), 1.0)
    expected_x = shape[1] if shape[1] > 1 else 0.0
    expected_y = shape[1] * shape[0] if shape[0] > 1 else 0.0
    np.testing.assert_allclose(slopes[0], expected_x, rtol=1e-6)
    np.testing.assert_allclose(slopes[1], expected_y, rtol=1e-6)
    x, y = bilinear(slopes, (1.0, 1.0), np.array([0.0, 0.49]), np.array([0.1, -0.49]))
    np.testing.assert_allclose(x, expected_x, rtol=1e-6)
    np.testing.assert_allclose(y, expected_y, rtol=1e-6)


def test_border_never_exceeds_the_surfaces_own_steepest_slope():
    x, _ = centres(16, 16, (1.0, 1.0))
    curved = (x + 0.5) ** 3  # steepest at the border: 3
    assert steepest(gradient(curved, (1 / 16, 1 / 16))) <= 3.0


def test_bilinear_is_exact_on_bilinear_functions_and_goes_on_flat_outside():
    rng = np.random.default_rng(1)
    size = (0.4, 0.2)
    gx, gy = centres(30, 20, size)
    plane = (2 + 3 * gx - 5 * gy + 7 * gx * gy).astype(np.float32)
    x, y = rng.uniform(-0.18, 0.18, 40000), rng.uniform(-0.09, 0.09, 40000)  # more than two chunks
    found = bilinear(plane[None], size, x, y)[0]
    np.testing.assert_allclose(found, 2 + 3 * x - 5 * y + 7 * x * y, rtol=3e-6)
    corner = bilinear(plane[None], size, np.array([9.0, -9.0]), np.array([9.0, -9.0]))[0]
    np.testing.assert_array_equal(corner, [plane[-1, -1], plane[0, 0]])
    np.testing.assert_array_equal(bilinear(plane[None], size, gx.ravel(), gy.ravel())[0], plane.ravel())


def test_both_components_agree_with_each_other():
    rng = np.random.default_rng(2)
    slopes = rng.normal(size=(2, 8, 9)).astype(np.float32)
    x, y = rng.uniform(-0.5, 0.5, 50), rng.uniform(-0.5, 0.5, 50)
    grad_x, grad_y = bilinear(slopes, (1.0, 1.0), x, y)
    np.testing.assert_array_equal(grad_x, bilinear(slopes[:1], (1.0, 1.0), x, y)[0])
    np.testing.assert_array_equal(grad_y, bilinear(slopes[1:], (1.0, 1.0), x, y)[0])


@pytest.mark.parametrize(
    ("heights", "size", "unit", "message"),
    [
        (np.zeros((0, 0)), (1, 1), 1, "no pixels"),
        (np.zeros((0, 5)), (1, 1), 1, "no pixels"),
        (np.zeros((2, 2)), (0, 1), 1, "no area"),
        (np.zeros((2, 2)), (1, -1), 1, "no area"),
        (np.zeros((2, 2)), (math.nan, 1), 1, "no area"),
        (np.zeros((2, 2)), (1, 1), -1, "height unit"),
        (np.zeros((2, 2)), (1, 1), math.inf, "height unit"),
        (np.array([[0, math.nan], [0, 0]]), (1, 1), 1, "not finite"),
        (np.array([[0, math.inf], [0, 0]]), (1, 1), 1, "not finite"),
    ],
)
def test_refuses(heights, size, unit, message):
    with pytest.raises(DermisError, match=message):
        check_map(heights, size, unit)


# --- direction, eq. 4


def test_direction_is_the_unit_step():
    x, y = np.array([0, 3e-3, 3e-3, 0]), np.array([0, 4e-3, 9e-3, 9e-3])
    found = directions(x, y, np.ones(4, bool), RATE, 0.0)
    np.testing.assert_allclose(found, [[0, 0], [0.6, 0.8], [0, 1], [-1, 0]], atol=1e-12)


def test_direction_averages_the_window():
    # Steps along x, then along y: with a window of four steps the mean turns by (3,1), (2,2), (1,3), (0,4).
    x = np.concatenate([np.arange(5.0), np.full(4, 4.0)]) * 1e-3
    y = np.concatenate([np.zeros(5), np.arange(1.0, 5.0)]) * 1e-3
    found = directions(x, y, np.ones(9, bool), RATE, 4e-3)
    expected = np.array([[1, 0], [3, 1], [2, 2], [1, 3], [0, 4]], float)
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    np.testing.assert_allclose(found[4:], expected, atol=1e-12)


def test_direction_is_held_at_rest_and_zero_before_the_first_movement():
    x = np.array([0, 0, 0, 1, 2, 2, 2, 2 + 1e-8, 1]) * 1e-3
    found = directions(x, np.zeros(9), np.ones(9, bool), RATE, 0.0)[:, 0]
    np.testing.assert_array_equal(found, [0, 0, 0, 1, 1, 1, 1, 1, -1])


def test_direction_is_held_where_the_average_vanishes():
    x = np.array([0, 1, 2, 1, 0]) * 1e-3
    found = directions(x, np.zeros(5), np.ones(5, bool), RATE, 2e-3)[:, 0]
    np.testing.assert_array_equal(found, [0, 1, 1, 1, -1])


def test_direction_of_a_new_touch_starts_afresh():
    x = np.arange(8) * 1e-3
    touching = np.array([1, 1, 1, 0, 0, 1, 1, 0], bool)
    found = directions(x, np.zeros(8), touching, RATE, 10e-3)[:, 0]
    np.testing.assert_array_equal(found, [0, 1, 1, 0, 0, 0, 1, 0])


def test_directions_of_a_short_track():
    assert directions(np.zeros(1), np.zeros(1), np.ones(1, bool), RATE, 0.0).tolist() == [[0.0, 0.0]]
    assert directions(np.zeros(0), np.zeros(0), np.ones(0, bool), RATE, 0.0).shape == (0, 2)


# --- friction, eq. 5 and 6


def test_friction_is_the_cosine_of_the_angle():
    slope, angle = 0.8, np.radians(np.arange(0, 360, 15))
    direction = np.stack([np.cos(angle + 0.3), np.sin(angle + 0.3)], axis=1)
    found = friction_of_slope(slope * np.cos(0.3) * np.ones(24), slope * np.sin(0.3) * np.ones(24), direction, 50.0)
    np.testing.assert_allclose(found, 50 * 0.8 * np.cos(angle), atol=1e-12)


def surface_normals(x, y):
    """z = 0.3 sin(4x) cos(3y): slopes and unit normals by closed form."""
    fx, fy = 1.2 * np.cos(4 * x) * np.cos(3 * y), -0.9 * np.sin(4 * x) * np.sin(3 * y)
    normal = np.stack([-fx, -fy, np.ones_like(fx)], axis=1)
    return fx, fy, normal / np.linalg.norm(normal, axis=1)[:, None]


def test_mesh_form_equals_the_gradient_form():
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-0.4, 0.4, (2, 500))
    fx, fy, normal = surface_normals(x, y)
    angle = rng.uniform(0, 2 * np.pi, 500)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    by_normal, limited = friction_of_normal(normal, direction, 60.0)
    exact = friction_of_slope(fx, fy, direction, 60.0)
    np.testing.assert_allclose(by_normal, exact, rtol=1e-12, atol=1e-12)
    assert limited == 0
    # The same through a sampled map: the whole chain within 1e-3 of the steepest.
    gx, gy = centres(1024, 1024, (1.0, 1.0))
    slopes = field(0.3 * np.sin(4 * gx) * np.cos(3 * gy), (1.0, 1.0), 1.0)
    by_map = friction_of_slope(*bilinear(slopes, (1.0, 1.0), x, y), direction, 60.0)
    assert np.abs(by_map - by_normal).max() < 1e-3 * 60 * 1.2


def test_printed_mesh_form_is_reversed_and_compressed():
    fx, fy, normal = surface_normals(np.array([0.1]), np.array([0.2]))
    direction = np.array([[0.6, 0.8]])
    printed = friction_of_normal_printed(normal, direction, 60.0)[0]
    ours = friction_of_slope(fx, fy, direction, 60.0)[0]
    assert printed == pytest.approx(-ours / math.sqrt(1 + fx[0] ** 2 + fy[0] ** 2), rel=1e-12)


def test_steep_normals_are_limited_and_counted():
    normal = np.array([[-1.0, 0, 0], [-0.8, 0, -0.6], [-0.6, 0, 0.8]])
    found, limited = friction_of_normal(normal, np.tile([1.0, 0.0], (3, 1)), 10.0)
    np.testing.assert_allclose(found, [10 / STEEPEST_NORMAL, 8 / STEEPEST_NORMAL, 7.5])
    assert limited == 2


def test_downhill():
    friction = np.array([-100.0, -40, 0, 60, 100])
    np.testing.assert_array_equal(without_downhill(friction, "rectify"), [0, 0, 0, 60, 100])
    np.testing.assert_array_equal(without_downhill(friction, "offset"), [0, 30, 50, 80, 100])
    np.testing.assert_array_equal(without_downhill(friction, "absolute"), [100, 40, 0, 60, 100])
    with pytest.raises(DermisError, match="downhill"):
        without_downhill(friction, "free")


# --- a bump


def test_gaussian_bump_as_a_map_has_the_slope_of_the_closed_form():
    size, sigma, height = (0.1, 0.06), 0.008, 0.002
    gx, gy = centres(600, 1000, size)
    slopes = field(1e3 * height * np.exp(-(gx**2 + gy**2) / (2 * sigma**2)), size, 1e-3)
    assert steepest(slopes) == pytest.approx(height / (sigma * math.sqrt(math.e)), rel=1e-3)
    x = np.linspace(-0.04, 0.04, 81)
    found, across = bilinear(slopes, size, x, np.zeros(81))
    exact = -x / sigma**2 * height * np.exp(-0.5 * (x / sigma) ** 2)
    assert np.abs(found - exact).max() < 1e-3 * np.abs(exact).max()
    assert np.abs(across).max() < 1e-3 * np.abs(exact).max()
