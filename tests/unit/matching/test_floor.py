"""Floors and trajectories: never worse than the search they go beyond, exact where the device made the touch itself."""

from __future__ import annotations

import numpy as np
import pytest

from core.errors import DermisError
from core.matching.description import describe
from core.matching.felt_errors import COUNT, MEASURES, FeltErrors, _cells
from core.matching.floor import MOST, Floor, floor_of, looked_at
from core.matching.stress import StressMatcher
from core.matching.thimble_use import prepare
from core.matching.trajectory import trajectory
from core.presets import Library
from core.skin.model import fingertip_skin
from core.skin.stimulus import Stimulus
from core.steps import drain
from core.surrogate.store import contact_of
from tests import touches

FRAMES = 14


@pytest.fixture(scope="module")
def skin():
    return fingertip_skin(level="draft")


@pytest.fixture(scope="module")
def edge(skin):
    return touches.edge_press(FRAMES).forces(skin, points=True)


@pytest.fixture(scope="module")
def matching(skin, device):
    return StressMatcher(device, contact_of(device, skin, 0.6), describe(device, skin, 0.6).observation_matrix)


def left(frames, targets):
    return np.array([float(np.square(f.stimulus - t).sum()) for f, t in zip(frames, targets, strict=True)])


def test_a_search_of_a_frame_comes_near_the_best_of_several_ways(skin, matching):
    """Within 3 points of most touches of an edge, though friction holds the disc to the side of its first frame.

    Of 20, 26, 30, 34 and 40 frames of this touch, only 30 are felt worse than the best by more than 0.1 points, by 3.1.
    """
    apart = []
    for count in (26, 30, 34):
        edge = touches.edge_press(count).forces(skin, points=True)
        targets = edge.reshape(count, -1) @ matching.direct.observation_matrix.T
        matching.reset()
        before = matching.save()
        plain = [matching.step(target) for target in targets]
        matching.restore(before)
        many = drain(trajectory(matching, targets))
        assert matching.save()[0] is before[0]  # it ends as it began
        best, own = (np.sqrt(left(frames, targets).sum()) for frames in (many.best, plain))
        apart.append((own - best) / np.linalg.norm(targets))
        assert (left(many.best, targets) <= left(many.frames, targets) + 1e-12).all()
    assert np.median(apart) <= 0.03 and max(apart) <= 0.05
    matching.restore(before)
    one = drain(trajectory(matching, targets, ways=1, starts=0))
    np.testing.assert_array_equal([f.x for f in one.frames], [f.x for f in plain])  # one way is the search itself
    again = drain(trajectory(matching, targets))
    np.testing.assert_array_equal([f.x for f in many.frames], [f.x for f in again.frames])


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_several_ways_leave_less_than_one(skin):
    """Six legs can get round a ball by more ways than a search of a frame looks at.

    In frames so short that it rolls little in each: they leave 0.18 times as much in 24, and 0.88 times in 14.
    """
    count = 24
    use = prepare(Library().device("hexapod"), skin, {"platform_method": "stress"})
    matrix = describe(use.device, skin, 0.6).observation_matrix
    legs = StressMatcher(use.device, contact_of(use.device, skin, 0.6), matrix)
    targets = touches.ball_roll(count).forces(skin, points=True).reshape(count, -1) @ matrix.T
    plain = [legs.step(target) for target in targets]
    legs.reset()
    many = drain(trajectory(legs, targets, ways=4, starts=4))
    assert left(many.frames, targets).sum() < 0.8 * left(plain, targets).sum()


def test_a_way_keeps_the_servos_speed(matching, edge):
    targets = edge.reshape(FRAMES, -1) @ matching.direct.observation_matrix.T
    matching.change = 0.03
    try:
        found = drain(trajectory(matching, targets, ways=4, starts=4, every=2))
    finally:
        matching.change = None
    angles = np.array([f.angles for f in found.frames])
    assert np.abs(np.diff(angles, axis=0)).max() <= 0.03 + 1e-12


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_the_floor_of_a_thimble(spec, skin, edge):
    use = prepare(spec, skin, {})
    found = drain(floor_of(use, edge))
    assert found.samples == int(edge.any(axis=(1, 2)).sum()) and found.lateral is not None
    assert found.lateral[0] < 0.9 * found.best[0] < found.rendered[0] < 1.0
    assert drain(floor_of(use, edge)) is found  # kept for the same touch
    assert not found.findings("here") or found.beyond
    told = found.as_dict()
    assert set(told["best_found"]) == set(MEASURES) and told["touched_samples"] == found.samples
    words = " ".join(found.words())
    assert f"{100 * found.best[0]:.0f} %" in words and f"{100 * found.lateral[0]:.0f} %" in words


def test_a_floor_above_the_touch_is_said_plainly():
    floor = Floor((1.4, 1.3, 1.2), (1.1, 1.0, 0.9), None, 10, 7)
    (finding,) = floor.findings("finger 'Index'")
    assert finding.severity == "warning" and finding.code == "floor-above-touch" and "110 %" in str(finding)
    some = Floor((0.9, 0.9, 0.9), (0.8, 0.7, 0.6), None, 10, 2).findings("finger 'Index'")
    assert [f.severity for f in some] == ["info"] and some[0].count == 2
    assert Floor((0.9, 0.9, 0.9), (0.8, 0.7, 0.6), None, 10, 0).findings("here") == ()


def test_no_touch_has_no_floor(spec, skin):
    with pytest.raises(DermisError, match="touches nothing"):
        drain(floor_of(prepare(spec, skin, {}), np.zeros((3, skin.pad_count, 3))))


def test_the_three_measures(skin, edge):
    judge = FeltErrors(skin)
    pressed = edge[edge.any(axis=(1, 2))]
    np.testing.assert_allclose(judge.of(pressed, pressed), 0.0, atol=1e-12)
    np.testing.assert_allclose(judge.of(pressed, 0.0 * pressed), 1.0)
    np.testing.assert_allclose(judge.of(pressed, 1.25 * pressed), 0.25)  # skin is linear, and so is every measure
    turned = pressed[::-1]
    whole, cells, _ = judge.of(pressed, turned)
    norm = skin.stress_components()
    a, b = (f.reshape(len(f), -1) @ norm.T for f in (pressed, turned))
    assert whole == pytest.approx(np.linalg.norm(b - a) / np.linalg.norm(a))
    assert 0.0 < cells < 2.0
    with pytest.raises(DermisError, match="errors are of a touch"):
        judge.of(pressed, pressed[:-1])


def test_cells_share_out_the_whole_tissue(skin, edge):
    cell, share, root = _cells(skin)
    assert np.bincount(cell, minlength=COUNT).min() >= 1 and len(root) == COUNT
    np.testing.assert_allclose(np.bincount(cell, share, COUNT), 1.0)
    assert float(np.square(root).sum()) == pytest.approx(float(skin.mesh.volumes.sum()))
    stress = Stimulus(skin, edge[FRAMES // 2]).stress
    mean = np.stack([np.bincount(cell, share * s, COUNT) for s in stress.T], axis=1)
    total = (np.square(root)[:, None] * mean).sum(axis=0)
    np.testing.assert_allclose(total, (skin.mesh.volumes[:, None] * stress).sum(axis=0))


def test_samples_of_a_long_touch_are_spread_evenly():
    assert looked_at(5).tolist() == [0, 1, 2, 3, 4]
    chosen = looked_at(10 * MOST)
    assert len(chosen) == MOST and chosen[0] == 0 and chosen[-1] == 10 * MOST - 1
    assert np.ptp(np.diff(chosen)) <= 1
