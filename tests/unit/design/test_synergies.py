"""Components against SVD and planted couplings; errors, knee, report and the preset that is made."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from core.design import coupled_preset, report
from core.design import picture as picture
from core.design.answer import Design, design, scatter
from core.design.synergies import RULES, components, knee, reduce, rendering_error
from core.devices.coupling import coupling_of
from core.devices.spec import from_preset
from core.errors import DermisError
from core.matching.lookup import commands_of, readings_for
from core.matching.sweep import halton
from core.matching.table import SkinTable
from core.presets import Library
from core.stream.protocols.wire import Wire


def planted(seed=0, count=800, noise=0.001):
    """Commands of five motors driven by two, in mixed units, with a little noise."""
    rng = np.random.default_rng(seed)
    scale = np.array([0.01, 2.0, 0.5, 30.0, 1.0])
    directions, _ = np.linalg.qr(rng.standard_normal((5, 2)))
    amounts = rng.standard_normal((count, 2)) * [0.3, 0.1]
    scaled = 0.5 + amounts @ directions.T + noise * rng.standard_normal((count, 5))
    return scaled * scale, scale, directions


def test_components_are_those_of_an_svd():
    commands, scale, _ = planted()
    found = components(commands, scale)
    centred = (commands - commands.mean(axis=0)) / scale
    _, values, vectors = np.linalg.svd(centred, full_matrices=False)
    np.testing.assert_allclose(np.abs(found.directions.T @ vectors.T), np.eye(5), atol=1e-9)
    np.testing.assert_allclose(found.variance, values**2 / len(commands), rtol=1e-9)
    assert found.explained.sum() == pytest.approx(1.0)


def test_a_planted_coupling_of_two_motors_is_found_in_noise():
    commands, scale, directions = planted(noise=0.003)
    found = components(commands, scale)
    # the angle between the planted plane and the one found
    cosines = np.linalg.svd(directions.T @ found.directions[:, :2], compute_uv=False)
    assert np.degrees(np.arccos(np.clip(cosines.min(), -1, 1))) < 0.5
    assert found.explained[:2].sum() > 0.999
    left = (commands - found.reconstructed(commands, 2)) / scale
    assert left.std() < 0.0035


def test_all_components_reproduce_the_commands_to_rounding():
    commands, scale, _ = planted()
    found = components(commands, scale)
    np.testing.assert_allclose(found.reconstructed(commands, 5) / scale, commands / scale, atol=1e-12)


def test_errors_of_reconstruction_fall_with_the_number_of_motors():
    commands, scale, _ = planted(noise=0.02)
    found = components(commands, scale)
    errors = [np.linalg.norm((commands - found.reconstructed(commands, k)) / scale) for k in range(1, 6)]
    assert (np.diff(errors) < 0).all()


def test_units_do_not_matter():
    commands, scale, _ = planted()
    one = components(commands, scale)
    factor = np.array([1e3, 1e-2, 57.3, 1.0, 7.0])
    other = components(commands * factor, scale * factor)
    np.testing.assert_allclose(other.directions, one.directions, atol=1e-9)


def test_the_knee_is_the_fewest_motors_below_the_limit():
    assert knee(np.array([150.0, 9.99, 4.0, 0.0]), 0.1) == 2
    assert knee(np.array([9.0, 12.0, 0.0]), 0.1) == 1
    assert knee(np.array([10.0, 10.0, 0.0]), 0.1) == 3  # less than, not equal


def test_the_error_is_the_root_mean_square_of_norms():
    assert rendering_error(np.zeros((2, 2)), np.array([[3.0, 4.0], [0.0, 0.0]])) == pytest.approx(np.sqrt(12.5))


def synthetic(rows=3000, motors=3, seed=0):
    """A table whose readings are a smooth function of the commands."""
    rng = np.random.default_rng(seed)
    commands = halton(rows, motors)
    mix = rng.standard_normal((motors, 20))
    readings = np.rint(1500 + 600 * (commands @ mix) + 80 * np.sin(3 * commands) @ mix[::-1])
    return SkinTable(
        commands, readings, 0, np.ones(motors)
    ), lambda m: 1500 + 600 * (m @ mix) + 80 * np.sin(3 * m) @ mix[::-1]


def path(count=400, rank=1, seed=1, motors=3):
    rng = np.random.default_rng(seed)
    directions, _ = np.linalg.qr(rng.standard_normal((motors, motors)))
    t = np.linspace(0, 2 * np.pi, count)
    waves = np.stack([0.3 * np.sin((i + 1) * t + i) for i in range(motors)], axis=1)
    waves[:, rank:] = 0.0
    return 0.5 + 0.8 * waves @ directions.T


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_a_touch_of_known_rank_needs_that_many_motors(rank):
    """Readings of a table far denser than needed: the number of motors is that of the touch."""
    table, felt = synthetic(20_000)
    sensed = felt(path(rank=rank))
    found = reduce(table, [sensed], 0.1)
    assert (found.motors(), found.motors("paper")) == (rank, rank), found.percent()


def test_estimates_improve_with_the_tables_size():
    errors = []
    for rows in (200, 2000, 20_000):
        table, felt = synthetic(rows)
        moved = path(rank=3)
        errors.append(rendering_error(felt(moved), readings_for(table, moved)))
    assert errors[0] > 1.5 * errors[1] > 2.0 * errors[2]


def test_the_percentage_is_the_mean_of_percentages_not_the_ratio_of_means():
    table, felt = synthetic()
    found = reduce(table, [felt(path(rank=2)), felt(path(rank=3, seed=7))], 0.1)
    for rule, whole in (("paper", found.error[:, -1]), ("touch", found.touch)):
        each = 100 * (found.error - found.error[:, -1:]) / whole[:, None]
        np.testing.assert_allclose(found.mean_percent(rule), each.mean(axis=0))
        ratio = 100 * (found.error.mean(axis=0) - found.error[:, -1].mean()) / whole.mean()
        assert abs(found.mean_percent(rule)[0] - ratio[0]) > 1e-3


def test_rest_and_a_stronger_sensor_change_what_is_left_of_a_touch_and_the_touch_alike():
    table, felt = synthetic()
    sensed = felt(path(rank=2))
    alone = reduce(table, [sensed], 0.1)
    rested = reduce(table, [np.vstack([sensed, np.tile(table.exact_readings[table.rest], (len(sensed), 1))])], 0.1)
    assert rested.touch[0] == pytest.approx(alone.touch[0] / np.sqrt(2.0), rel=1e-12)
    commands = commands_of(table, sensed)
    stronger = replace(table, readings=4.0 * table.readings)
    twice = reduce(stronger, [4.0 * sensed], 0.1, commands=[commands])
    np.testing.assert_allclose(twice.percent(), reduce(table, [sensed], 0.1, commands=[commands]).percent(), rtol=1e-9)


def test_any_limit_between_those_that_are_told_gives_the_same_number():
    table, felt = synthetic()
    sensed = [felt(path(rank=3)), felt(path(rank=2, seed=4))]
    for rule in RULES:
        found = reduce(table, sensed, 0.1)
        low, high = found.limits(rule)
        assert low < 0.1 <= high
        for limit in np.linspace(low, min(high, 3.0), 7)[1:-1]:
            assert replace(found, limit=float(limit)).motors(rule) == found.motors(rule)
        assert replace(found, limit=low).motors(rule) != found.motors(rule) or low == 0.0
        if np.isfinite(high):
            assert replace(found, limit=1.0001 * high).motors(rule) < found.motors(rule)


def test_a_hand_that_wobbles_asks_for_no_motor_of_its_own():
    """A touch by one direction, off it by a twentieth: the paper's rule asks for motors that render that, too."""
    table, felt = synthetic(20_000)
    wobbling = path(rank=1) + 0.05 * (path(rank=3, seed=9) - 0.5)
    found = reduce(table, [felt(wobbling)], 0.1)
    assert found.motors() == 1 < found.motors("paper")


def test_repetitions_are_told_apart_by_rest_and_compared_at_one_length():
    wave = np.sin(np.linspace(0.0, np.pi, 50))[:, None] * [100.0, 0.0]
    rest = np.zeros((10, 2))
    rows = np.vstack([rest, wave, rest, 1.2 * wave, rest, 0.8 * wave[::-1], rest])
    count, apart = scatter(rows, np.abs(rows).max(axis=1) > 1e-9)
    inner = wave[1:-1, 0]  # the ends are at rest
    assert count == 3 and apart == pytest.approx(0.2 * np.sqrt((inner**2).mean()), rel=1e-6)
    single = scatter(rows[:70], np.abs(rows[:70]).max(axis=1) > 1e-9)
    assert single[0] == 1 and np.isnan(single[1])
    unlike = np.vstack([wave, rest, np.repeat(wave, 2, axis=0)])
    assert scatter(unlike, np.abs(unlike).max(axis=1) > 1e-9)[0] == 1
    assert scatter(rest, np.zeros(10, bool))[0] == 1


def test_motors_that_never_move_are_refused():
    with pytest.raises(DermisError, match="never move"):
        components(np.ones((10, 3)), np.ones(3))
    with pytest.raises(DermisError, match="at least two"):
        components(np.ones((1, 3)), np.ones(3))


@pytest.fixture(scope="module")
def answered() -> Design:
    spec = Library().device("cable_platform")
    table, felt = synthetic(20_000)
    ends = np.array([c.high for c in spec.channels])
    return design(
        spec,
        replace(table, commands=table.commands * ends, scale=ends),
        {"press": felt(path(rank=1)), "again": felt(path(rank=1, seed=1, count=300))},
    )


def test_noise_without_structure_is_not_called_low_rank():
    spec = Library().device("cable_platform")
    table, felt = synthetic(20_000)
    ends = np.array([c.high for c in spec.channels])
    anything = np.random.default_rng(0).uniform(0.1, 0.9, (400, 3))
    found = design(spec, replace(table, commands=table.commands * ends, scale=ends), {"any": felt(anything)})
    assert found.joint.motors() == 3 and not found.low_rank()
    assert "not of low rank" in report.as_text(found)


def test_the_report_says_it_in_words_numbers_and_a_picture(answered, tmp_path):
    assert answered.low_rank()
    text = report.as_text(answered)
    assert "\n1 motor: the fewest that lose less than 10 % of the touch" in text and "mean over interactions" in text
    figures = json.loads(json.dumps(report.as_json(answered), allow_nan=False))
    assert figures["format"] == 3 and figures["joint"]["rules"]["touch"]["motors"] == 1
    radii = np.array(figures["joint"]["pulley_radii_m"])
    assert radii.shape == (3, 1) and np.abs(radii).max() == pytest.approx(0.007)
    directions = answered.joint.components.directions[:, 0]
    np.testing.assert_allclose(radii[:, 0] / 0.007, directions / np.abs(directions).max())
    for name in ("a.png", "a.svg"):
        picture.write_picture(answered, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert b"how" in (tmp_path / "a.svg").read_bytes().lower()
    with pytest.raises(DermisError, match="kind of picture"):
        picture.write_picture(answered, tmp_path / "a.gif")
    error = answered.joint.error.copy()
    error[:, 1] = error[:, 2] - 0.002 * answered.joint.touch  # fewer motors may be a hair better than all
    picture.write_picture(replace(answered, joint=replace(answered.joint, error=error)), tmp_path / "b.svg")
    drawn = (tmp_path / "b.svg").read_text()
    assert ">0<" in drawn and ">-0<" not in drawn


def test_ranges_hold_all_that_the_interactions_command(answered):
    """Least below greatest, and both are reached: new motors and their limits are laid out from them."""
    low, high = answered.ranges
    assert (low < high).all() and answered.ranges.shape == (2, 3)
    ends = np.array([c.high for c in answered.spec.channels])
    table, felt = synthetic(20_000)
    table = replace(table, commands=table.commands * ends, scale=ends)
    targets = [felt(path(rank=1)), felt(path(rank=1, seed=1, count=300))]
    every = np.vstack([commands_of(table, values) for values in targets])
    np.testing.assert_array_equal(answered.ranges, [every.min(axis=0), every.max(axis=0)])
    amounts = answered.joint.components.amounts(every, 3)  # all components together are the commands again
    np.testing.assert_array_equal(answered.amounts, [amounts.min(axis=0), amounts.max(axis=0)])


def test_the_new_preset_drives_the_original_motors_through_its_coupling(answered):
    made = coupled_preset.preset(answered)
    spec = from_preset("made", json.loads(json.dumps(made)))
    assert spec.kind == "cable_platform" and len(spec.channels) == 1
    coupling = coupling_of(spec)
    assert coupling is not None
    commands = answered.ranges[:1] + np.linspace(0, 1, 5)[:, None] * (answered.ranges[1:] - answered.ranges[:1])
    parts = answered.joint.components
    kept = coupling.original(coupling.reduced(commands))
    np.testing.assert_allclose(kept, parts.reconstructed(commands, 1), rtol=1e-9)
    ends = coupling.original(np.array([[0.0], [1.0]]))
    direction = (ends[1] - ends[0]) / parts.scale
    np.testing.assert_allclose(np.abs(direction / np.linalg.norm(direction)), np.abs(parts.directions[:, 0]), rtol=1e-9)


def test_a_coupled_preset_lets_a_finger_go_as_the_original_does_or_says_that_it_cannot(answered):
    from core.devices.retraction import CLEAR, clearance
    from core.devices.safe_state import safe_findings

    all_motors = from_preset("all", coupled_preset.preset(answered, motors=3))
    wire = Wire.of(all_motors)
    np.testing.assert_allclose(coupling_of(all_motors).original(wire.safe), Wire.of(answered.spec).safe, atol=1e-9)
    assert clearance(all_motors, wire.safe) > CLEAR and not safe_findings(all_motors)
    held = from_preset("held", coupled_preset.preset(answered, motors=1))  # these touches never let go
    assert [f.code for f in safe_findings(held)] == ["no-safe-pose"]
    with pytest.raises(DermisError, match="states no safe pose"):
        Wire.of(held)


def test_a_preset_with_as_many_motors_as_the_device_changes_nothing(answered):
    coupling = coupling_of(from_preset("all", coupled_preset.preset(answered, motors=3)))
    assert coupling is not None
    commands = np.random.default_rng(0).uniform(0.2, 2.0, (20, 3))
    np.testing.assert_allclose(coupling.original(coupling.reduced(commands)), commands, rtol=1e-9)
    with pytest.raises(DermisError, match="1 to 3"):
        coupled_preset.preset(answered, motors=4)


def test_a_coupling_that_does_not_fit_is_refused(answered):
    made = coupled_preset.preset(answered)
    made["parameters"]["coupling"]["value"] = [[1.0], [1.0]]
    with pytest.raises(DermisError, match="does not fit the motors"):
        coupling_of(from_preset("bad", made))


def test_a_touch_that_never_touches_is_refused():
    spec = Library().device("cable_platform")
    table, _ = synthetic()
    rest = np.tile(table.readings[table.rest], (50, 1))
    with pytest.raises(DermisError, match="interaction 'air': nothing is ever touched"):
        design(spec, table, {"air": rest})
    with pytest.raises(DermisError, match="no interaction"):
        design(spec, table, {})
    assert commands_of(table, rest).tolist() == np.tile(table.commands[0], (50, 1)).tolist()
