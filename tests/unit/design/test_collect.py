"""Data collection: the paper's counts, one rest row, going on after a stop, and the same table from any worker."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from core.design import collect as collecting
from core.design import interactions
from core.design.answer import knee_of
from core.design.collect import collect, reversed_spread
from core.design.interactions import EXPECTED, NAMES, Wobble, interaction, plane_poses
from core.design.trial import Verdict, exceptions, felt, sense
from core.errors import DermisError
from core.matching.platforms import original_key
from core.matching.readings import quantised, readings_of
from core.matching.sweep import halton, sweep
from core.matching.table import press_of
from core.presets import Library
from core.skin.model import fingertip_skin
from core.skin.shape import FingertipShape
from core.work.processes import ProcessExecutor

SHAPE = FingertipShape()


@pytest.fixture(scope="module")
def spec():
    return Library().device("cable_platform")


@pytest.fixture(scope="module")
def skin():
    return fingertip_skin(SHAPE, level="draft")


def drain(steps):
    said = []
    while True:
        try:
            said.append(next(steps))
        except StopIteration as stop:
            return stop.value, said


def test_the_sweep_is_the_papers(spec, skin):
    commands, unreached = sweep(spec, skin.positions)
    assert unreached == 0
    assert commands.shape == (166_375, 3) and 55**3 == 166_375
    low, high = np.array([(c.low, c.high) for c in spec.channels]).T
    assert ((commands >= low) & (commands <= high)).all()
    assert len(np.unique(commands.round(9), axis=0)) == len(commands)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_rows_that_touch_nothing_are_one_rest_row(spec, skin, tmp_path):
    table, _ = drain(collect(spec, SHAPE, tmp_path, rows=512))
    assert table.meta["asked"] == 512 and table.meta["rest_rows"] >= 64  # the first of eight depths is above the skin
    left_out = sum(table.meta[name] for name in ("unreached_rows", "rest_rows", "unbalanced_rows"))
    assert len(table.commands) == 1 + 512 - left_out and table.meta["unreached_rows"] < 16
    rest = readings_of(skin).rest
    assert (table.readings == rest).all(axis=1).sum() == 1
    np.testing.assert_array_equal(table.readings[table.rest], rest)
    np.testing.assert_allclose(table.commands[table.rest], press_of(skin, spec).carrier.rest, atol=1e-7)
    assert (table.readings != np.rint(table.readings)).any() and table.readings.max() < 4095


def test_a_stopped_collection_goes_on_where_it_was(spec, tmp_path, monkeypatch):
    monkeypatch.setattr(collecting, "PART", 80)
    whole, _ = drain(collect(spec, SHAPE, tmp_path / "a", rows=216))
    steps, pressed = collect(spec, SHAPE, tmp_path / "b", rows=216), 216 - whole.meta["unreached_rows"]
    assert next(steps) == (0, pressed)
    assert next(steps) == (80, pressed)
    steps.close()
    (folder,) = (tmp_path / "b").iterdir()
    assert len(list(folder.iterdir())) == 1
    stamp = next(folder.iterdir()).stat().st_mtime_ns
    again, said = drain(collect(spec, SHAPE, tmp_path / "b", rows=216))
    assert said[0] == (80, pressed) and said[-1] == (pressed, pressed)
    assert sorted(folder.iterdir())[0].stat().st_mtime_ns == stamp
    np.testing.assert_array_equal(again.commands, whole.commands)
    np.testing.assert_array_equal(again.readings, whole.readings)


def test_a_damaged_part_is_pressed_again(spec, tmp_path):
    whole, _ = drain(collect(spec, SHAPE, tmp_path, rows=216))
    (part,) = tmp_path.rglob("*.npz")
    part.write_bytes(part.read_bytes()[:1000])
    again, said = drain(collect(spec, SHAPE, tmp_path, rows=216))
    assert said[0] == (0, 216 - whole.meta["unreached_rows"])
    np.testing.assert_array_equal(again.readings, whole.readings)


def test_worker_processes_make_the_same_table(spec, tmp_path, monkeypatch):
    monkeypatch.setattr(collecting, "PART", 108)
    here, _ = drain(collect(spec, SHAPE, tmp_path / "here", rows=216))
    with ProcessExecutor(2) as executor:
        there, said = drain(collect(spec, SHAPE, tmp_path / "there", rows=216, executor=executor))
    assert said[-1] == (216 - here.meta["unreached_rows"],) * 2
    np.testing.assert_array_equal(there.commands, here.commands)
    # two BLAS builds, or thread counts, may round a product otherwise: contact is settled to 2e-4 of its forces
    touch = here.from_rest(here.readings)[:, None]
    assert (np.abs(there.readings - here.readings) <= 1e-3 * touch).all()
    here.save(tmp_path / "a.npz")
    here.save(tmp_path / "b.npz")
    assert os.path.getsize(tmp_path / "a.npz") < 100 * len(here.commands) + 4000  # 23 numbers of 4 bytes a row
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_another_device_or_skin_has_another_collection(spec):
    other = replace(spec, parameters={**spec.parameters, "spring_stiffness": 160.0})
    assert original_key(other) != original_key(spec)
    renamed = replace(spec, key="mine", name="Mine", parameters={**spec.parameters, "knee_error": 0.2})
    assert original_key(renamed) == original_key(spec)


def test_too_small_a_sweep_is_refused(spec, skin):
    with pytest.raises(DermisError, match="too few rows"):
        sweep(spec, skin.positions, 7)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_friction_is_what_makes_the_reversed_sweep_differ(spec, skin):
    smooth = replace(spec, parameters={**spec.parameters, "friction": 0.0})
    spread, none = reversed_spread(spec, skin, 125), reversed_spread(smooth, skin, 125)
    assert spread["rms"] > 1.0 and spread["worst"] >= spread["rms"]
    assert none["rms"] < 0.5  # rounding to whole counts


def test_halton_is_the_sequence_of_van_der_corput():
    np.testing.assert_allclose(halton(4, 2), [[1 / 2, 1 / 3], [1 / 4, 2 / 3], [3 / 4, 1 / 9], [1 / 8, 4 / 9]])


def test_the_sensor_reads_whole_counts_within_its_scale(skin):
    sensor = readings_of(skin)
    nothing = np.zeros((1, skin.pad_count, 3))
    np.testing.assert_array_equal(sensor.sense(nothing)[0], sensor.rest)
    assert quantised(np.array([[-5.0, 5000.0, 7.5]])).tolist() == [[0, 4095, 8]]
    push = nothing.copy()
    push[0] = -1e-3 * skin.normals
    one, two = sensor.counts(push) - sensor.rest, sensor.counts(2 * push) - sensor.rest
    np.testing.assert_allclose(two, 2 * one)  # linear
    total = 1e-3 * skin.pad_count / skin.areas.sum()  # all along the normals: the force over the area
    assert one[0, -1] == pytest.approx(0.12 * total)
    noisy = sensor.sense(np.zeros((4000, skin.pad_count, 3)), 2.0, np.random.default_rng(1)) - sensor.rest
    assert noisy.std() == pytest.approx(np.hypot(2.0, np.sqrt(1 / 12)), rel=0.02)


def test_interactions_press_where_they_say(skin):
    """Without wobble the surface's depth along its own normal is exactly the one asked for."""
    times = np.arange(0, 13, 0.01)
    still = Wobble(0.0, 0.0, 0.0, 0.0)
    for name in NAMES:
        poses = plane_poses(name, times, skin.positions, np.random.default_rng(0), still)
        normal = poses[:, :3, 2]
        height = np.einsum("ni,ni->n", normal, poses[:, :3, 3])
        depth = height - (normal @ skin.positions.T).min(axis=1)
        assert depth.max() == pytest.approx(1.2e-3) and depth.min() == pytest.approx(-1e-3)
        tilt = np.degrees(np.arccos(np.clip(normal[:, 2], -1, 1))).max()
        assert tilt == pytest.approx(0.0 if name == "flat" else 20.0, abs=1e-6)
    back = plane_poses("back", times, skin.positions, np.random.default_rng(0), still)[0, :3, 2]
    left = plane_poses("left", times, skin.positions, np.random.default_rng(0), still)[0, :3, 2]
    assert back[1] > 0.3 and left[0] > 0.3  # higher at the back, higher at the left


@pytest.mark.parametrize("at_once", [1, 7, 10**6])
def test_poses_do_not_hang_on_how_many_samples_are_held_at_once(skin, monkeypatch, at_once):
    times, wobble = np.arange(50) / 10.0, Wobble()
    wanted = plane_poses("complex", times, skin.positions, np.random.default_rng(1), wobble)
    monkeypatch.setattr(interactions, "_AT_ONCE", at_once)
    poses = plane_poses("complex", times, skin.positions, np.random.default_rng(1), wobble)
    np.testing.assert_allclose(poses, wanted, rtol=0.0, atol=1e-15)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_where_an_interaction_touches_is_where_its_name_says(skin, short_touches):
    for name, axis, sign in (("back", 1, -1), ("tip", 1, 1), ("left", 0, -1), ("right", 0, 1)):
        touch = felt(skin, name, 0, Wobble(0.0, 0.0, 0.0, 0.0))
        first = touch.force[0, :, 2].astype(float)
        centre = first @ skin.positions / first.sum()
        assert sign * centre[axis] > 1e-3, name


def test_every_seed_wobbles_differently_and_the_same_seed_alike(skin, short_touches):
    def poses(seed):
        (chunk,) = interaction("tip", skin.positions, seed=seed).chunks
        return chunk.bodies

    np.testing.assert_array_equal(poses(1), poses(1))
    assert np.abs(poses(1) - poses(2)).max() > 1e-5
    touch = felt(skin, "flat", 0)
    np.testing.assert_array_equal(sense(touch, seed=3), sense(touch, seed=3))
    assert (sense(touch, seed=3) != sense(touch, seed=4)).any()


def test_an_unknown_interaction_is_refused(skin):
    with pytest.raises(DermisError, match="no such interaction"):
        interaction("upside down", skin.positions)


def test_the_rule_and_the_expected_numbers_stand_fixed(spec):
    assert knee_of(spec) == 0.1 and knee_of(Library().device("hexapod")) == 0.1
    assert list(EXPECTED.values()) == [1, 2, 2, 2, 2, 3]


def test_every_exception_is_told():
    good = Verdict("flat", 0, 1, (1, 1), ((5.0, 0.0), (5.0, 0.0)), 50.0, 900.0)
    bad = Verdict("tip", 3, 2, (3, 2), ((50.0, 12.0, 0.0), (50.0, 8.0, 0.0)), 50.0, 900.0)
    (line,) = exceptions([good, bad])
    assert line == "tip, seed 3, by touch: 3 instead of 2 (50.0, 12.0, 0.0 %)"
