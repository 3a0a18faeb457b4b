"""A verdict on recordings is the same in every unit, from every zero, with the channels in any order."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from core.design import task
from core.design.answer import POOR, design
from core.design.report import as_json, as_text
from core.errors import DermisError
from core.matching.lookup import readings_for
from core.matching.readings import at_the_end, in_steps, quantised, readings_of, step_of
from core.matching.table import build
from core.presets import Library
from tests.unit.command_line.test_design import run

pytestmark = pytest.mark.one_line("3.13", "numbers alone, of one touch for the whole file")

CHANNELS = tuple(f"e{i + 1}" for i in range(19)) + ("pressure",)
MOTORS = ("m1", "m2", "m3")


@pytest.fixture(scope="module")
def spec():
    return Library().device("cable_platform")


@pytest.fixture(scope="module")
def swept(spec, skin):
    """A table of whole counts, and a touch in which two motors move: rest, three presses, rest; with noise."""
    table = build(spec, skin, readings_of(skin), 512)
    table = replace(table, readings=quantised(table.readings))
    low, high = np.percentile(table.commands[1:], (25, 75), axis=0)
    press = np.sin(np.linspace(0.0, 3.0 * np.pi, 300)) ** 2
    moved = low + (high - low) * np.column_stack([press, 0.5 * press**2, press])
    felt = readings_for(table, moved)
    rest = table.exact_readings[table.rest]
    felt = np.vstack([np.tile(rest, (50, 1)), rest + press[:, None] * (felt - rest), np.tile(rest, (50, 1))])
    noise = np.random.default_rng(7).normal(0.0, 2.0, felt.shape)
    return table, np.clip(np.rint(felt + noise), 1, 4094)


def written(folder, table, felt, name, change=lambda v: v, order=None):
    """Write table and recording as files, their readings changed and in another order; return their paths."""
    order = np.arange(20) if order is None else order
    paths = folder / f"{name}_table.csv", folder / f"{name}.csv"
    for path, leading, names, values in (
        (paths[0], table.commands, MOTORS, table.exact_readings),
        (paths[1], np.arange(len(felt))[:, None] / 100.0, ("time",), felt),
    ):
        made = np.column_stack([leading, change(values)[:, order]])
        lines = [",".join((*names, *(CHANNELS[i] for i in order)))]
        path.write_text("\n".join([*lines, *(",".join(f"{v:.12g}" for v in row) for row in made)]) + "\n")
    return paths


def judged(spec, paths, **options):
    table = task.load_table(spec, paths[0])
    steps = task.answer(spec, table, {"touch": task.read_sensed([paths[1]])[paths[1].stem]}, **options)
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value


OFFSETS = np.random.default_rng(3).integers(-4000, 4000, 20)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("volts", lambda v: v * 1e-3),
        ("microvolts", lambda v: v * 1e3),
        ("odd", lambda v: v * 0.7371),
        ("shifted", lambda v: v + OFFSETS),
        ("both", lambda v: 2.5e-3 * v + 1e-3 * OFFSETS),
    ],
)
def test_units_and_zeros_change_no_digit_of_the_verdict(spec, swept, tmp_path, name, change):
    """In volts the same data needed 1 motor in place of 2: errors were held against whole counts."""
    plain = judged(spec, written(tmp_path, *swept, "plain"))
    other = judged(spec, written(tmp_path, *swept, name, change))
    assert plain.motors() is not None and plain.joint.percent()[0, 0] > 1.0
    for rule in ("touch", "paper"):
        assert other.motors(rule) == plain.motors(rule)
        np.testing.assert_array_equal(other.joint.percent(rule), plain.joint.percent(rule))
    np.testing.assert_array_equal(other.joint.components.directions, plain.joint.components.directions)
    assert other.repetitions[0][0] == plain.repetitions[0][0]
    factor = float(change(np.full((1, 20), 2.0))[0, 0] - change(np.full((1, 20), 1.0))[0, 0])
    touch = [as_json(found)["joint"]["touch"][0] for found in (plain, other)]
    assert touch[1] == pytest.approx(factor * touch[0], rel=1e-9)


def test_the_order_of_channels_changes_no_verdict(spec, swept, tmp_path):
    plain = judged(spec, written(tmp_path, *swept, "plain"))
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(20)
        other = judged(spec, written(tmp_path, *swept, f"order{seed}", order=order))
        assert other.motors() == plain.motors() and other.motors("paper") == plain.motors("paper")
        np.testing.assert_allclose(other.joint.percent(), plain.joint.percent(), rtol=1e-9, atol=1e-9)


def test_readings_without_steps_are_judged_in_any_unit(spec, swept, tmp_path):
    table, felt = swept
    fine = table.exact_readings + np.random.default_rng(1).uniform(-0.4, 0.4, table.readings.shape)
    table = replace(table, readings=fine)
    plain = judged(spec, written(tmp_path, table, felt + 0.123, "plain"))
    other = judged(spec, written(tmp_path, table, felt + 0.123, "volts", lambda v: v * 1e-3))
    assert step_of(fine) == 0.0 and other.motors() == plain.motors()
    np.testing.assert_allclose(other.joint.percent(), plain.joint.percent(), rtol=1e-6, atol=1e-6)


def test_noise_is_measured_on_the_recording_in_its_unit(spec, swept, tmp_path):
    paths = written(tmp_path, *swept, "volts", lambda v: v * 1e-3)
    found = judged(spec, paths)
    assert float(found.sensors[0].split("noise ")[1].split()[0]) == pytest.approx(2.0e-3, rel=0.15)
    with pytest.raises(DermisError, match=r"nothing is ever touched .*'readings up to .*the readings' own unit"):
        judged(spec, paths, recorded_noise=2.0)


def test_a_report_says_what_sensed_the_touch(spec, swept, tmp_path):
    found = judged(spec, written(tmp_path, *swept, "volts", lambda v: v * 1e-3))
    text, figures = as_text(found), as_json(found)
    assert "virtual" not in text and "counts" not in text
    assert "touch: recorded, 20 channels, noise" in text and "Table: recorded, volts_table.csv" in text
    assert figures["unit"] == "the recording's unit" and figures["sensors"]["touch"].startswith("recorded")
    assert "rest-guessed" in {f.code for f in found.findings}
    assert "virtual sensor in a linear skin" in as_text(design(spec, swept[0], {"touch": swept[1]}))


def test_no_number_is_given_where_all_motors_leave_most_of_a_touch(spec, swept, tmp_path):
    """1 motor was the headline although all of them left 71 %."""
    table, felt = swept
    rest = table.exact_readings[table.rest]
    turned = rest + np.where(np.arange(20) % 2, 1, -1) * (felt - rest)
    found = design(spec, table, {"odd": turned})
    left = float(found.joint.error[0, -1] / found.joint.touch[0])
    assert left > POOR and found.motors() is None and found.poor == ("odd",)
    text = as_text(found)
    assert text.split("\n")[2].startswith(f"No number of motors: all 3 together leave {100 * left:.0f} % of 'odd'")
    figures = json.loads(json.dumps(as_json(found), allow_nan=False))
    assert figures["joint"]["rules"]["touch"]["motors"] is None and figures["poorly_rendered"] == ["odd"]
    assert len(task.write(found, tmp_path / "out")) == 3
    assert len(task.write(found, tmp_path / "two", motors=2)) == 4  # a person says how many
    answers = design(spec, table, {"good": felt, "odd": turned})
    assert answers.motors() is None and as_json(answers)["alone"]["good"]["rules"]["touch"]["motors"] is not None


def test_the_command_line_takes_rest_and_noise(swept, tmp_path):
    table, recording = written(tmp_path, *swept, "volts", lambda v: v * 1e-3)
    made = run(recording, "--table", table, "--rest", "0:0.4", "--rest-rows", "1", "--json")
    assert made.returncode == 0, made.stderr
    assert "rest-guessed" not in made.stdout
    for arguments, words in (
        (("--rest", "1"), "FROM:TO"),
        (("--rest", "3:1"), "FROM:TO"),
        (("--rest-rows", "one"), "no number of a row"),
        (("--rest-rows", "9999"), "no such row of rest"),
        (("--rest", "90:91"), "too few samples at rest"),
        (("--noise", "2"), "own unit"),
    ):
        try:
            made = run(recording, "--table", table, *arguments)
            code, said = made.returncode, made.stderr
        except SystemExit as stop:
            code, said = stop.code, words
        assert code == 2 and words in said, (arguments, said)


def test_steps_are_found_and_counted():
    counts = np.random.default_rng(0).integers(0, 4000, (50, 3)).astype(float)
    assert step_of(counts.astype(np.uint16)) == 1.0 and step_of(counts * 0.25 + 7.0) == pytest.approx(0.25)
    np.testing.assert_array_equal(in_steps(counts * 0.3 + 1.0, np.ones(3), 0.3), counts)
    assert step_of(counts + np.random.default_rng(1).uniform(size=counts.shape)) == 0.0
    assert step_of(np.ones((5, 2))) == 0.0
    with pytest.raises(DermisError, match="steps of this size"):
        in_steps(counts, np.ones(3), 0.0)
    counts[:10, 1] = 4095  # at the end of its scale, in volts too
    assert at_the_end(counts)[1] == at_the_end(counts * 1e-3)[1] == pytest.approx(0.2)
