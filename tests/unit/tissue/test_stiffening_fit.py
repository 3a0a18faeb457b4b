"""Which patterns are kept of what touches bring, and how far their series is followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.mesh import TetraMesh
from core.skin.model import fingertip_skin, mesh_skin
from core.tissue.mirror import MIRROR
from core.tissue.stiffening_fit import DRAGS, FARTHEST, RAREST, asked_of, main_patterns, main_press, mirror_of, reach_of
from core.tissue.touches import KEPT, PRESSES
from tests.problems import cube_mesh


def test_what_touches_bring_lies_within_reach_and_one_of_them_on_its_rim() -> None:
    amounts = np.random.default_rng(0).normal(size=(200, 5)) * [1.0, 0.5, 0.1, 0.02, 1e-6]
    far = np.linalg.norm(amounts / reach_of(amounts), axis=1)
    assert far.max() == pytest.approx(1.0) and far.min() > 0.0


def test_more_is_trusted_of_what_touches_bring_more_of_and_a_share_of_all_else() -> None:
    amounts = np.random.default_rng(1).normal(size=(200, 5)) * [1.0, 0.5, 0.1, 0.02, 1e-6]
    reach = reach_of(amounts)
    assert (np.diff(reach[:3]) < 0.0).all()
    assert reach[4] == pytest.approx(reach[3])  # both by the share
    assert reach[4] > 0.5 * RAREST * np.linalg.norm(amounts, axis=1).max()


def test_the_main_patterns_store_one_each_and_hold_the_loads_that_come_most() -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(12, 12))
    compliance = root @ root.T + np.eye(12)
    three = rng.normal(size=(3, 12))
    loads = rng.normal(size=(40, 3)) @ three
    found, even = main_patterns(compliance, loads, loads, 3)
    assert even == 3  # of what is not known to be its own mirror image
    np.testing.assert_allclose(found.T @ compliance @ found, np.eye(3), atol=1e-10)
    rest = loads.T - found @ (found.T @ compliance @ loads.T)
    assert np.abs(rest).max() <= 1e-9 * np.abs(loads).max()


def test_a_fingertip_is_its_own_mirror_image_and_its_patterns_are_even_or_odd() -> None:
    skin = fingertip_skin(level="draft")
    mirror = mirror_of(skin)
    assert mirror is not None
    np.testing.assert_allclose(skin.positions[mirror], skin.positions * MIRROR, atol=1e-9)
    loads = np.random.default_rng(3).normal(size=(30, 3 * skin.pad_count))
    found, even = main_patterns(skin.unit_compliance, loads, loads, 12, mirror)
    assert 0 < even < 12
    images = (found.T.reshape(12, -1, 3)[:, mirror] * MIRROR).reshape(12, -1).T
    signs = np.where(np.arange(12) < even, 1.0, -1.0)
    np.testing.assert_allclose(images, found * signs, atol=1e-6 * np.abs(found).max())
    np.testing.assert_allclose(found.T @ skin.unit_compliance @ found, np.eye(12), atol=1e-6)


def test_a_mesh_that_is_not_its_own_mirror_image_has_no_even_patterns() -> None:
    assert mirror_of(mesh_skin(skewed())) is None


def skewed() -> TetraMesh:
    """Return a block that leans over."""
    mesh = cube_mesh(3)
    nodes = mesh.nodes.copy()
    nodes[:, 0] += 0.3 * nodes[:, 1]
    return replace(mesh, nodes=nodes)


def test_the_law_is_asked_for_touches_and_for_drags_that_are_dragged_farther_but_not_beyond_its_limits() -> None:
    rng, reach = np.random.default_rng(4), np.linspace(1.0, 2.0, 6)
    pressed = PRESSES // KEPT
    slid = [0.3 * rng.normal(size=(pressed + len(DRAGS), 6)) for _ in range(5)]
    shares = [*slid, 0.3 * rng.normal(size=(pressed, 6)), np.full((pressed, 6), 40.0)]
    asked = asked_of(shares, reach, 1000)
    rows = np.concatenate(shares)
    far = np.linalg.norm(asked / reach, axis=1)
    touched, dragged = asked[: len(rows)], asked[len(rows) :]
    assert len(dragged) == 5 * len(DRAGS)
    np.testing.assert_allclose(touched[: pressed + len(DRAGS)], slid[0])
    assert far[: len(rows)].max() == pytest.approx(FARTHEST[0]) and far.max() <= FARTHEST[1] + 1e-12
    np.testing.assert_allclose(
        dragged[2], slid[0][pressed - 1] + DRAGS[2] * (slid[0][pressed + 2] - slid[0][pressed - 1])
    )
    assert len(asked_of(shares, reach, 8)) <= 10


def test_what_presses_bring_most_of_is_a_direction() -> None:
    way = np.array([0.6, 0.0, -0.8])
    rows = np.random.default_rng(5).normal(size=(50, 1)) * way + 1e-6
    found = main_press(rows)
    assert abs(found @ way) == pytest.approx(1.0, abs=1e-4) and np.linalg.norm(found) == pytest.approx(1.0)
