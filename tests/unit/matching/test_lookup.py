"""Look-up against hand-made tables, brute force, and the bake of a whole scene."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError
from core.matching import lookup, nearest
from core.matching.lookup import commands_of, readings_for
from core.matching.nearest import NearestPoints
from core.matching.table import SkinTable
from core.presets import Library
from core.recent import Recent
from core.skin.model import fingertip_skin


def table(commands, readings, noise_floor=0.0):
    commands, readings = np.asarray(commands, float), np.asarray(readings)
    return SkinTable(commands, readings, 0, np.ones(commands.shape[1]), noise_floor)


def line(count=9):
    """Rows on a line: reading 10 i in one channel, command i."""
    i = np.arange(count)
    return table(i[:, None], np.column_stack([10 * i, np.zeros(count, int)]))


def averaged(distances, values, motors):
    """Weighted mean by hand: the inverse square of the distance, less that of the first row that is left out."""
    k, order = nearest.neighbours(motors), np.argsort(distances, kind="stable")
    d, own = np.asarray(distances, float)[order], np.asarray(values, float)[order]
    weights = 1 / d[:k] ** 2 - (1 / d[k] ** 2 if len(d) > k else 0.0)
    return (weights * own[:k]).sum() / weights.sum()


def test_neighbours_are_weighted_by_the_inverse_square_of_distance_less_that_of_the_next():
    """Of rows at 0, 10 .. 190, the 14 nearest to 63 are 0 .. 130; the next is 140."""
    d, i = np.abs(np.arange(0, 200, 10) - 63.0), np.arange(20)
    weights = 1 / d[:14] ** 2 - 1 / 77.0**2
    assert commands_of(line(20), np.array([[63, 0]]))[0, 0] == pytest.approx((i[:14] * weights).sum() / weights.sum())
    short = np.abs(np.arange(0, 90, 10) - 33.0)  # fewer rows than neighbours: none is left out
    assert commands_of(line(9), np.array([[33, 0]]))[0, 0] == pytest.approx(
        (i[:9] / short**2).sum() / (1 / short**2).sum()
    )


def test_distance_across_channels_counts():
    d = np.hypot(np.arange(0, 200, 10) - 63.0, 7.0)
    assert commands_of(line(20), np.array([[63, 7]]))[0, 0] == pytest.approx(averaged(d, np.arange(20), 1), rel=1e-12)


def test_averaged_rows_are_as_far_as_those_weighted_by_the_inverse_square_alone():
    """Mean square distance by the weights, of points evenly spread in a ball: that of eight plainly weighted points."""
    rng = np.random.default_rng(1)
    for dimensions in (3, 6):
        points = rng.uniform(-1.0, 1.0, (20_000, dimensions))
        found = NearestPoints(points).query(0.2 * rng.uniform(-1.0, 1.0, (2000, dimensions)), 100)
        k = nearest.neighbours(dimensions)
        d2 = found.distance**2
        plain = 8.0 / (1.0 / d2[:, :8]).sum(axis=1)  # the mean of d^2 by 1 / d^2
        weights = 1.0 / d2[:, :k] - 1.0 / d2[:, k : k + 1]
        tapered = (weights * d2[:, :k]).sum(axis=1) / weights.sum(axis=1)
        assert tapered.mean() == pytest.approx(plain.mean(), rel=0.1)  # whole numbers of points: half a point is 5 %


def test_an_exact_hit_returns_its_row():
    assert commands_of(line(), np.array([[50, 0]]))[0, 0] == 5.0
    assert readings_for(line(), np.array([[5.0]]))[0].tolist() == [50.0, 0.0]


def test_both_directions_use_the_same_weights():
    found = readings_for(line(20), np.array([[6.3]]))[0, 0]
    assert found == pytest.approx(averaged(np.abs(np.arange(20) - 6.3), 10 * np.arange(20), 1), rel=1e-12)


def test_motors_are_compared_over_their_ranges():
    commands = np.column_stack([np.arange(25) % 5, 1000.0 * (np.arange(25) // 5)])
    rows = replace(table(commands, np.arange(25)[:, None]), scale=np.array([4.0, 4000.0]))
    query = np.array([[1.1, 1130.0]])
    away = np.sqrt((((commands - query) / rows.scale) ** 2).sum(axis=1))
    assert readings_for(rows, query)[0, 0] == pytest.approx(averaged(away, np.arange(25), 2), rel=1e-12)


def test_of_equal_readings_the_pose_nearest_the_last_command_is_taken():
    """Two poses feel exactly alike: the one nearer to where the motors are is the answer."""
    readings = np.column_stack([np.r_[0, 50, 50, 100:107], np.zeros(10, int)])
    rows = table(np.r_[0.0, -3.0, 3.0, 10:17][:, None], readings)
    assert commands_of(rows, np.array([[50, 0]]), last=np.array([2.0]))[0, 0] == 3.0
    assert commands_of(rows, np.array([[50, 0]]), last=np.array([-1.0]))[0, 0] == -3.0


def test_of_equal_readings_with_commands_equally_near_the_lower_row_is_taken_whatever_rounding_says():
    readings = np.column_stack([np.r_[0, 50, 50, 100:107], np.zeros(10, int)])
    for off in (-1e-12, 0.0, 1e-12):
        rows = table(np.r_[0.0, -3.0 + off, 3.0, 10:17][:, None], readings)
        assert commands_of(rows, np.array([[50, 0]]))[0, 0] == pytest.approx(-3.0)


@pytest.mark.parametrize("motors", [3, 6])
def test_rounding_decides_nothing_even_where_every_row_is_one_of_several_equally_far(motors):
    """Rows and queries moved by 1e-9 change commands by no more than a million times that; on a lattice, mirror images
    of rows are equally far from the queries in its planes of symmetry.
    """
    rng = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(*[np.arange(-3.0, 4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    readings = 30.0 * np.column_stack([grid, grid[:, 0] ** 2, grid[:, 1] * grid[:, 2]])
    commands = np.column_stack([np.sin(grid), grid / 3.0])[:, :motors]
    queries = readings[rng.integers(0, len(readings), 200)]
    queries = 0.5 * (queries + readings[rng.integers(0, len(readings), 200)])
    plain = commands_of(table(commands, readings), queries)
    for _ in range(3):
        moved = [a + 1e-9 * rng.standard_normal(a.shape) for a in (readings, queries)]
        np.testing.assert_allclose(commands_of(table(commands, moved[0]), moved[1]), plain, atol=1e-3)


@pytest.mark.parametrize("motors", [3, 6])
def test_commands_do_not_leap_as_readings_change(motors):
    """The largest step along a line through a table falls with the length of the steps."""
    points, rng = sheet(2000)
    rows = table(rng.uniform(0.0, 1.0, (2000, motors)), points)
    low, high = points[3], points[3] + 0.2 * (points[8] - points[3])
    largest = [
        np.abs(np.diff(commands_of(rows, low + np.linspace(0.1, 1.0, n)[:, None] * (high - low)), axis=0)).max()
        for n in (100, 5000)
    ]
    assert largest[1] < 0.05 * largest[0]


def test_a_mirrored_reading_gives_the_mirrored_command():
    """Rows in mirrored pairs; the first channel and the first motor change their sign."""
    points, rng = sheet(1500)
    commands, mirror = rng.uniform(-1.0, 1.0, (1500, 3)), np.r_[-1.0, np.ones(19)]
    rows = table(np.vstack([commands, commands * [-1, 1, 1]]), np.vstack([points, points * mirror]))
    queries = points[rng.integers(0, 1500, 100)] + 20.0 * rng.standard_normal((100, 20))
    left, right = commands_of(rows, queries), commands_of(rows, queries * mirror)
    np.testing.assert_allclose(right, left * [-1, 1, 1], atol=1e-9)


def test_a_sequence_carries_its_last_command():
    readings = np.column_stack([np.r_[0, 50, 50, 200:207], np.zeros(10, int)])
    rows = table(np.r_[0.0, -3.0, 3.0, 10:17][:, None], readings)
    after = commands_of(rows, np.array([[200, 0], [50, 0]]))
    assert after[:, 0].tolist() == [10.0, 3.0]


def test_what_cannot_be_told_from_rest_is_rest():
    rows = replace(line(20), noise_floor=15.0)
    assert commands_of(rows, np.array([[14, 0]]))[0, 0] == 0.0
    assert commands_of(rows, np.array([[20, 0]]))[0, 0] == 2.0  # row 1, at 10, is not among the neighbours


def test_too_few_rows_are_refused():
    with pytest.raises(DermisError, match=r"too few rows .*found 7; allowed: >= 8"):
        line(7)
    with pytest.raises(DermisError, match="differ from rest"):
        commands_of(replace(line(9), noise_floor=25.0), np.array([[30, 0]]))


def test_queries_that_do_not_fit_are_refused():
    with pytest.raises(DermisError, match="different numbers of channels"):
        commands_of(line(), np.zeros((1, 3)))
    with pytest.raises(DermisError, match="not finite"):
        commands_of(line(), np.array([[np.nan, 0.0]]))


def sheet(count=6000, seed=0):
    """A curved sheet of three dimensions in twenty, in whole counts."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, (count, 3))
    first, second = rng.standard_normal((3, 20)), rng.standard_normal((3, 20))
    return np.rint(2000 + 400 * u @ first + 150 * (u**2) @ second), rng


@pytest.mark.parametrize("off", [0.0, 3.0, 60.0, 400.0])
@pytest.mark.parametrize("k", [1, 8])
def test_neighbours_are_those_of_brute_force_near_the_sheet_and_far_off_it(off, k):
    points, rng = sheet()
    queries = points[rng.integers(0, len(points), 150)] + off * rng.standard_normal((150, 20))
    searched = NearestPoints(points)
    found = searched.query(queries, k)
    for query, index, distance, reach in zip(queries, found.index, found.distance, found.reach, strict=True):
        every = np.sqrt(((points - query) ** 2).sum(axis=1))
        ranked = np.sort(every)
        np.testing.assert_allclose(np.append(distance, reach), ranked[: k + 1], atol=1e-8)
        np.testing.assert_allclose(every[searched.first[index]], distance, atol=1e-8)
        assert len(set(index.tolist())) == k


def test_a_single_query_is_answered_as_many_are():
    """The short way that one query takes gives what all give together, hits and repeated rows among them."""
    points, rng = sheet(2000)
    points[1000:1003] = points[0]
    rows = replace(table(rng.uniform(0.0, 1.0, (2000, 3)), points), noise_floor=15.0)
    queries = np.vstack([points[::100], points[::90] + 40.0 * rng.standard_normal((23, 20)), points[:1] + 1.0])
    together = np.vstack([commands_of(rows, q[None]) for q in queries])
    np.testing.assert_allclose(
        together, np.vstack([commands_of(rows, np.vstack([q, q]))[:1] for q in queries]), rtol=1e-9
    )
    searched = NearestPoints(points)
    sure = [searched.query_one(q, nearest.neighbours(3)) for q in queries]
    assert sure[0] is None and sum(found is not None for found in sure[20:43]) > 10
    assert searched.query_one(np.full(20, np.nan), 8) is None


def test_repeated_rows_are_one_point():
    searched = NearestPoints(np.array([[3.0], [1.0], [3.0], [2.0], [3.0]]))
    found = searched.query(np.array([[2.9]]), 8)
    assert searched.points[found.index[0], 0].tolist() == [3.0, 2.0, 1.0] and found.reach[0] == np.inf
    assert [searched.rows(int(i)).tolist() for i in found.index[0]] == [[0, 2, 4], [3], [1]]
    assert searched.repeated[found.index[0]].tolist() == [True, False, False]


def test_small_and_flat_tables_work():
    points = np.column_stack([np.arange(30.0), np.zeros(30)])
    assert NearestPoints(points).query(np.array([[11.2, 0.0]]), 3).index[0].tolist() == [11, 12, 10]
    alone = NearestPoints(np.zeros((9, 3))).query(np.zeros((1, 3)), 8)
    assert alone.distance.tolist() == [[0.0]] and alone.weights.tolist() == [[1.0]]
    even = NearestPoints(np.vstack([np.eye(5), -np.eye(5)])).query(np.zeros((1, 5)), 4)
    np.testing.assert_allclose(even.weights, [[0.25] * 4])


def test_a_saved_table_is_the_same(tmp_path):
    rows = line(20)
    rows.save(tmp_path / "a.npz")
    again = SkinTable.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.readings, rows.readings)
    np.testing.assert_array_equal(again.commands, rows.commands)
    rows.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_no_table_is_refused(tmp_path):
    (tmp_path / "x.npz").write_bytes(b"no")
    with pytest.raises(DermisError, match="not a look-up table"):
        SkinTable.load(tmp_path / "x.npz")
    with pytest.raises(DermisError, match="No such file"):
        SkinTable.load(tmp_path / "y.npz")


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("device", ["cable_platform", "hexapod"])
def test_a_scene_is_rendered_and_the_track_makes_the_skin_feel_alike(device):
    """Through the whole pipeline: rest where nothing touches, within the device's range, and felt as wanted."""
    from core.design.interactions import Wobble, interaction
    from core.matching.readings import readings_of
    from core.matching.table import press_of
    from core.pipeline import render
    from core.presets import Library
    from core.scene.tactile_scene import DeviceUse, Finger
    from core.skin.model import fingertip_skin

    skin = fingertip_skin(level="draft")
    scene = interaction("flat", skin.positions, wobble=Wobble(0, 0, 0, 0), repetitions=1)
    finger = Finger("Index", (DeviceUse(device),), {"skin_level": "draft"})
    bake = render.run(replace(scene, fingers=(finger,)))
    assert [f for f in bake.all_findings if f.severity == "error"] == []
    (output,) = bake.outputs
    spec = Library().device(device)
    values, contact = output.track.values, output.signals["contact"] > 0.5
    rest = press_of(skin, spec).carrier.rest
    np.testing.assert_allclose(values[0], rest, atol=1e-6)
    assert contact.any() and not contact.all()
    pressed = press_of(skin, spec).press(values[contact][::20])
    felt = readings_of(skin).counts(pressed.force)
    touch = bake.skins["Index"].force
    wanted = readings_of(skin).counts(touch[:: max(len(touch) // len(felt), 1)])
    # a table of some thousand rows is dense for three motors and coarse for six
    coarse = {"cable_platform": 0.1, "hexapod": 0.2}[device]
    assert abs(felt[:, -1].max() - wanted[:, -1].max()) < coarse * (wanted[:, -1].max() - 500)


def pressed_lightly(tilt=0.0, slide=1e-3, samples=60, rows=3375):
    """Commands of a cable platform for a tilted plate that presses 0.1 mm deep and slides to one side [m]."""
    from core.pipeline.render import run
    from core.scene.from_poses import scene_from_poses
    from core.scene.tactile_scene import Body, DeviceUse, Finger, Mesh
    from core.surface.gap import Surface

    flat = Surface.block(0.1, 0.1).mesh
    turn = np.array([[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]])
    plate = Body("Plate", Mesh(flat.vertices @ turn.T, flat.triangles), {"friction": 0.3})
    finger = Finger("Index", (DeviceUse("cable_platform", {"table_rows": rows}),), {"skin_level": "draft"})
    share = np.arange(samples) / (samples - 1)
    down, along = np.minimum(2.0 * share, 1.0), np.maximum(2.0 * share - 1.0, 0.0)
    way = [(slide * y, 0.0, 0.1e-3 - 0.2e-3 * d) for y, d in zip(along, down, strict=True)]
    bake = run(scene_from_poses(100.0, [(finger, way)], [(plate, (0.0, 0.0, 0.0))]))
    return bake.outputs[0].track.values[samples // 4 :]  # before, the servos are on the way to the finger


KERNELS = ("Haswell", "Prescott")  # of OpenBLAS, with and without fused multiplication and addition


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="these kernels are of another processor")
def test_two_blas_kernels_give_the_same_commands_for_a_plate_pressed_lightly():
    code = (
        "import json; from tests.unit.matching.test_lookup import pressed_lightly;"
        "print(json.dumps(pressed_lightly(samples=119, rows=1000).tolist()))"
    )
    children = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            cwd=Path(__file__).parents[3],
            env={**os.environ, "OPENBLAS_CORETYPE": kernel},
            stdout=subprocess.PIPE,
            text=True,
        )
        for kernel in KERNELS
    ]
    one, other = (np.array(json.loads(child.communicate()[0].splitlines()[-1])) for child in children)
    assert (one != other).any(), "both kernels are one and the same here"
    np.testing.assert_allclose(one, other, atol=1e-3 * np.abs(one).max())


def test_a_mirrored_touch_gives_the_mirrored_commands():
    """The plate is tilted to either side; motors 2 and 3 stand at the left and at the right. Rows of the table are
    settled to 2e-4 of their forces only, so mirrored rows differ by as much.
    """
    left, right = pressed_lightly(0.1), pressed_lightly(-0.1, -1e-3)
    assert np.abs(left[:, 1] - left[:, 2]).max() > 0.1
    np.testing.assert_allclose(right, left[:, [0, 2, 1]], atol=1e-3 * np.abs(left).max())


def test_a_platform_does_not_hop_in_a_slow_slide():
    """Between twice as many samples of one way, commands change by half as much at most."""
    half = [pressed_lightly(samples=n) for n in (60, 119)]
    steps = [np.abs(np.diff(values[len(values) // 3 :], axis=0)).max() for values in half]
    assert steps[1] < 0.75 * steps[0]


def test_skins_that_are_alike_have_one_table_in_a_process(monkeypatch):
    monkeypatch.setattr(lookup, "_TABLES", Recent(2))
    spec = Library().device("cable_platform")
    one, same, softer = (fingertip_skin(level="draft") for _ in range(3))
    softer = softer.with_material(young=0.5 * softer.material.young)
    made = lookup.table_of(one, spec, rows=64)
    assert lookup.table_at_hand(same, spec, rows=64) is made and lookup.table_of(same, spec, rows=64) is made
    assert lookup.table_at_hand(softer, spec, rows=64) is None and lookup.table_at_hand(one, spec, rows=125) is None
    for rows in (125, 216):
        lookup.keep_table(one, spec, rows, made)
    assert lookup.table_at_hand(one, spec, rows=64) is None, "room for two"


def test_values_whose_distances_are_not_finite_are_refused() -> None:
    points = np.arange(8.0).reshape(4, 2)
    with pytest.raises(DermisError, match="a point is too large for a distance.*1e\\+200"):
        NearestPoints(np.vstack([points, [1e200, 0.0]]))
    with pytest.raises(DermisError, match="a query is too large for a distance.*-?1e\\+200"):
        NearestPoints(points).query(np.array([[0.0, -1e200]]), 2)
    far = NearestPoints(np.vstack([points, [nearest.LARGEST, 0.0]])).query(np.array([[-nearest.LARGEST, 0.0]]), 5)
    assert sorted(far.index[0].tolist()) == [0, 1, 2, 3, 4] and np.isfinite(far.distance).all()
