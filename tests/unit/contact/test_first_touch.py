"""Where a body first meets the undeformed skin: against its upper envelope, minimised over the skin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize

from core.arrays import Array
from core.contact.first_touch import CLOSE, first_touch
from core.contact.solver.bodies import ContactBody
from core.errors import DermisError
from core.experiment import fingertip, press
from core.skin.model import SkinModel
from core.skin.pad_chart import PadChart
from core.surface import shapes
from core.surface.gap import Surface

RADIUS, ROUNDING = 3e-3, 1e-6
Envelope = Callable[[Array], Array]  # how far the body's upper surface lies below its origin, by X and Y beside it [m]


def flat(_: Array) -> Array:
    return np.zeros(len(_))


def round_ball(beside: Array) -> Array:
    inside = np.maximum(RADIUS**2 - (beside**2).sum(axis=1), 0.0)
    return np.where(inside > 0.0, RADIUS - np.sqrt(inside), np.inf)


def right_edge(beside: Array) -> Array:
    return np.abs(beside[:, 0])


BODIES: dict[str, tuple[Surface, Envelope]] = {
    "plate": (Surface.block(0.1, 0.1), flat),
    "ball": (Surface.sphere(RADIUS, 50_000), round_ball),
    "edge": (Surface.build(*shapes.edge(np.pi / 2, ROUNDING, length=0.06, height=0.02)), right_edge),
}


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip(level="draft")


def height_over_smooth_skin(skin: SkinModel, envelope: Envelope, at: tuple[float, float]) -> float:
    """Minimise, over the chart, the height at which the body's envelope reaches the skin."""
    assert skin.shape is not None
    chart = PadChart.of(skin.shape)

    def height(places: Array) -> Array:
        points = chart.points(np.atleast_2d(places))
        return points[:, 2] + envelope(points[:, :2] - at)

    grid = chart.places[chart.starts[-2] : chart.starts[-1]]
    starts = grid[np.argsort(height(grid))[:20]]
    return min(
        float(
            minimize(lambda x: height(x)[0], start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).fun
        )
        for start in starts
    )


def height_over_mesh(skin: SkinModel, envelope: Envelope, at: tuple[float, float]) -> float:
    """Take the lowest of many points of every triangle of the pad."""
    mesh = skin.mesh
    corners = mesh.nodes[mesh.surface[np.isin(mesh.surface, mesh.pad).all(axis=1)]]
    i, j = np.divmod(np.arange(121**2), 121)
    shares = np.stack([i, j, 120 - i - j], axis=1)[i + j <= 120] / 120
    points = np.einsum("sk,tkc->tsc", shares, corners).reshape(-1, 3)
    return float((points[:, 2] + envelope(points[:, :2] - at)).min())


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("at", [(0.0, 0.0), (0.7e-3, 1.1e-3), (-2.3e-3, -3.0e-3)])
@pytest.mark.parametrize("name", sorted(BODIES))
def test_it_touches_where_its_envelope_does(name: str, at: tuple[float, float], skin: SkinModel) -> None:
    surface, envelope = BODIES[name]
    body = ContactBody(surface, translation=np.array([*at, 0.01]))  # where it stands along Z does not matter
    assert first_touch(skin, body) == pytest.approx(height_over_smooth_skin(skin, envelope, at), abs=2 * CLOSE)


@pytest.mark.parametrize("contact", ["points", "nodes"])
def test_a_sheet_is_touched_from_either_side(contact: str, skin: SkinModel) -> None:
    corners = 0.05 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    front, behind = (press(skin, Surface.build(corners, t), contact=contact) for t in (triangles, triangles[:, ::-1]))
    assert behind.place[2] == pytest.approx(front.place[2], abs=2 * CLOSE)
    assert behind.normal_force == pytest.approx(front.normal_force, rel=0.01) and front.normal_force > 0.5
    assert not [f for f in behind.findings if f.code == "smaller-than-mesh"]


@pytest.mark.parametrize("crack", [1e-9, 1e-6, 1e-5])
def test_a_ridge_of_a_sheet_that_is_not_welded_is_felt_from_either_side(crack: float, skin: SkinModel) -> None:
    """What lies above the slit is beside a rim, and outside of either side: from behind it was taken for inside."""
    ends = np.array([[-0.014, -0.02, -0.014], [0.0, -0.02, 0.0], [0.014, -0.02, -0.014]])
    corners = np.concatenate([ends, ends * [1, -1, 1]])
    triangles = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    parted = corners[triangles]
    inward = parted.mean(axis=1, keepdims=True) - parted
    parted = (parted + crack * inward / np.linalg.norm(inward, axis=2, keepdims=True)).reshape(-1, 3)
    wanted = press(skin, Surface.build(corners, triangles)).normal_force
    for numbers in (np.arange(12).reshape(-1, 3), np.arange(12).reshape(-1, 3)[:, ::-1]):
        found = press(skin, Surface.build(parted, numbers)).normal_force
        assert found == pytest.approx(wanted, rel=0.01) and wanted > 0.1


@pytest.mark.parametrize("name", sorted(BODIES))
def test_on_a_mesh_it_touches_between_nodes_too(name: str, skin: SkinModel) -> None:
    surface, envelope = BODIES[name]
    at = (0.7e-3, 1.1e-3)
    body = ContactBody(surface, translation=np.array([*at, 0.0]))
    sampled = 1.5 * 1.2e-3 / 120  # of the triangles' sides, between two points, on a slope of 45 degrees
    found = first_touch(skin.on_nodes, body)
    assert -2 * CLOSE - sampled <= found - height_over_mesh(skin, envelope, at) <= 2 * CLOSE


def test_a_floor_far_below_something_beside_it_is_met(skin: SkinModel) -> None:
    floor, high = Surface.block(0.04, 0.01), Surface.block(0.01, 0.4)
    vertices = np.concatenate([floor.vertices, high.vertices + [0.024, 0.0, 0.3]])
    triangles = np.concatenate([floor.triangles, high.triangles + len(floor.vertices)])
    alone, beside = (ContactBody(s) for s in (floor, Surface.build(vertices, triangles)))
    assert first_touch(skin, beside) == pytest.approx(first_touch(skin, alone), abs=2 * CLOSE)


def test_a_surface_beside_the_pad_is_refused(skin: SkinModel) -> None:
    body = ContactBody(Surface.block(2e-3, 2e-3), translation=np.array([0.05, 0.0, 0.0]))
    with pytest.raises(DermisError, match="does not meet the pad"):
        first_touch(skin, body)
