"""Look-up against hand-made tables, brute force, and the bake of a whole scene."""

from __future__ import annotations

from dataclasses import replace

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


def test_eight_neighbours_weighted_by_the_inverse_square_of_distance():
    """Nine rows at 0, 10 .. 80; from 33 the farthest, 80, is left out. Weights 1/d^2 by hand."""
    d = np.abs(np.arange(0, 80, 10) - 33.0)
    expected = (np.arange(8) / d**2).sum() / (1 / d**2).sum()
    assert commands_of(line(), np.array([[33, 0]]))[0, 0] == pytest.approx(expected, rel=1e-14)


def test_distance_across_channels_counts():
    d2 = (np.arange(0, 80, 10) - 33.0) ** 2 + 49.0
    expected = (np.arange(8) / d2).sum() / (1 / d2).sum()
    assert commands_of(line(), np.array([[33, 7]]))[0, 0] == pytest.approx(expected, rel=1e-14)


def test_an_exact_hit_returns_its_row():
    assert commands_of(line(), np.array([[50, 0]]))[0, 0] == 5.0
    assert readings_for(line(), np.array([[5.0]]))[0].tolist() == [50.0, 0.0]


def test_both_directions_use_the_same_weights():
    d = np.abs(np.arange(9) - 3.3)
    near = np.argsort(d)[:8]
    expected = (10 * near / d[near] ** 2).sum() / (1 / d[near] ** 2).sum()
    assert readings_for(line(), np.array([[3.3]]))[0, 0] == pytest.approx(expected, rel=1e-12)


def test_motors_are_compared_over_their_ranges():
    commands = np.column_stack([np.arange(16) % 4, 1000.0 * (np.arange(16) // 4)])
    rows = replace(table(commands, np.arange(16)[:, None]), scale=np.array([3.0, 3000.0]))
    query = np.array([[1.1, 1100.0]])
    away = ((commands - query) / rows.scale) ** 2
    d2 = away.sum(axis=1)
    near = np.argsort(d2, kind="stable")[:8]
    expected = (near / d2[near]).sum() / (1 / d2[near]).sum()
    assert readings_for(rows, query)[0, 0] == pytest.approx(expected, rel=1e-12)


def test_of_equal_readings_the_pose_nearest_the_last_command_is_taken():
    """Two poses feel exactly alike: the one nearer to where the motors are is the answer."""
    readings = np.column_stack([np.r_[0, 50, 50, 100:107], np.zeros(10, int)])
    rows = table(np.r_[0.0, -3.0, 3.0, 10:17][:, None], readings)
    assert commands_of(rows, np.array([[50, 0]]), last=np.array([2.0]))[0, 0] == 3.0
    assert commands_of(rows, np.array([[50, 0]]), last=np.array([-1.0]))[0, 0] == -3.0


def test_a_tie_for_the_last_place_goes_to_the_pose_nearest_the_last_command():
    """Seven rows near, two equally far as eighth: only one of them may count."""
    first = np.column_stack([100 + np.arange(7), np.zeros(7, int)])
    both = np.array([[120, 0], [86, 0]])  # 17 from 103 on either side
    rows = table(np.r_[np.arange(7.0), 50.0, -50.0][:, None], np.vstack([first, both]))
    query = np.array([[103, 1]])  # no exact hit
    d2 = np.r_[(np.arange(7) - 3.0) ** 2 + 1, 17.0**2 + 1]
    for last, eighth in ((40.0, 50.0), (-40.0, -50.0)):
        values = np.r_[np.arange(7.0), eighth]
        expected = (values / d2).sum() / (1 / d2).sum()
        assert commands_of(rows, query, last=np.array([last]))[0, 0] == pytest.approx(expected, rel=1e-12)


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
    queries = np.rint(points[rng.integers(0, len(points), 150)] + off * rng.standard_normal((150, 20)))
    found = NearestPoints(points).query(queries, k)
    for query, index, squared, tied in zip(queries, found.index, found.squared, found.tied, strict=True):
        every = ((points - query) ** 2).sum(axis=1)
        ranked = np.sort(every)
        assert squared.tolist() == ranked[:k].tolist()  # whole numbers: exact
        assert (every[index] == squared).all()
        assert len(set(index.tolist())) == k
        assert tied == (ranked[k] == ranked[k - 1] or (k > 1 and ranked[1] == 0.0))


@pytest.mark.parametrize("scale", [1.0, 0.37])
def test_turning_decides_nothing_that_rounding_could(scale):
    """On a lattice nearly every neighbour is one of several equally far: the answer is that of the points as given."""
    points = scale * np.array([(x, y, z, x + y) for x in range(9) for y in range(9) for z in range(9)], float)
    rng = np.random.default_rng(5)
    queries = np.vstack([points[::31], points[::37] + 0.5 * scale, scale * rng.integers(-3, 12, (20, 4))])
    found = NearestPoints(points).query(queries, 8)
    for query, index, squared, tied in zip(queries, found.index, found.squared, found.tied, strict=True):
        every = ((points - query) ** 2).sum(axis=1)
        order = np.lexsort((np.arange(len(points)), every))
        assert squared == pytest.approx(every[order[:8]].tolist(), rel=1e-12)
        assert (squared[0] == 0.0) == (every.min() == 0.0)
        assert every[index] == pytest.approx(squared.tolist(), rel=1e-12)
        if scale == 1.0:  # whole numbers: ties are exact
            assert tied == (every[order[8]] == every[order[7]])


def test_a_single_query_is_answered_as_many_are():
    """The short way that one query takes gives what all give together, ties and hits and fractions among them."""
    points, rng = sheet(2000)
    rows = replace(table(rng.uniform(0.0, 1.0, (2000, 3)), points.astype(np.uint16)), noise_floor=15.0)
    queries = np.vstack([points[::100], points[::90] + 40.0 * rng.standard_normal((23, 20)), points[:1] + 1.0])
    together = np.vstack([commands_of(rows, q[None]) for q in queries])
    np.testing.assert_allclose(together, commands_of(rows, queries), rtol=1e-9)
    sure = [NearestPoints(points).query_one(q, 8) for q in queries]
    assert all(found is None for found in sure[:20]) and all(found is not None for found in sure[20:43])
    assert NearestPoints(points).query_one(np.full(20, np.nan), 8) is None


def test_within_finds_all_points_of_a_ball():
    points, _ = sheet(3000, 3)
    every = ((points - points[7]) ** 2).sum(axis=1)
    radius = float(np.sort(every)[40])
    assert NearestPoints(points).within(points[7], radius).tolist() == np.flatnonzero(every <= radius).tolist()


def test_small_and_flat_tables_work():
    points = np.column_stack([np.arange(30.0), np.zeros(30)])
    assert NearestPoints(points).query(np.array([[11.2, 0.0]]), 3).index[0].tolist() == [11, 12, 10]
    assert nearest.NearestPoints(np.zeros((9, 3))).query(np.zeros((1, 3)), 8).squared.tolist() == [[0.0] * 8]


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
