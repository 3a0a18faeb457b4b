"""An adaptive table: the same rows twice, where touches begin and bend, and as good as a grid of twice as many rows."""

from __future__ import annotations

import numpy as np
import pytest

from core.__main__ import main
from core.matching.adaptive_sweep import build_adaptive
from core.matching.lookup import commands_of
from core.matching.readings import FULL_SCALE, quantised, readings_of
from core.matching.table import SkinTable, build, press_of
from core.presets import Library
from tests import touches

pytestmark = pytest.mark.one_line("3.13", "numbers alone")
NOISE = 2.0


def drain(steps):
    seen = []
    while True:
        try:
            seen.append(next(steps))
        except StopIteration as stop:
            return stop.value, seen


@pytest.fixture(scope="module")
def spec():
    return Library().device("cable_platform")


@pytest.fixture(scope="module")
def made(spec, skin):
    return drain(build_adaptive(spec, skin, readings_of(skin), 600, NOISE))


def test_the_same_rows_come_twice_and_progress_is_told(spec, skin, made):
    table, seen = made
    again, _ = drain(build_adaptive(spec, skin, readings_of(skin), 600, NOISE))
    np.testing.assert_array_equal(again.commands, table.commands)
    np.testing.assert_array_equal(again.readings, table.readings)
    assert len(seen) == 7 and seen == sorted(seen) and seen[-1][1] == 600
    pressed = len(table.commands) - 1 + table.meta["rest_rows"]
    assert pressed + table.meta["unbalanced_rows"] + table.meta["unreached_rows"] == 600
    assert table.meta["spread"] == "adaptive"


def test_rows_are_denser_where_a_touch_begins(spec, skin, made):
    """There readings bend most for how strong they are: nothing, and then a slope."""
    even = build(spec, skin, readings_of(skin), 512)
    light = [np.mean(t.from_rest(t.readings[1:]) < 400.0) for t in (even, made[0])]
    assert light[1] > 2.0 * light[0]


def test_half_the_rows_render_edge_and_ball_as_well(spec, skin):
    sensor, press = readings_of(skin), press_of(skin, spec)
    sensed = np.vstack([quantised(sensor.counts(touch.forces(skin, points=True))) for touch in
                        (touches.edge_press(40), touches.ball_roll(40))])  # fmt: skip

    def left(table: SkinTable) -> float:
        heard = table.heard_with(NOISE)
        loud = sensed[heard.from_rest(sensed) > heard.noise_floor]
        played = np.clip(sensor.counts(press.press(commands_of(heard, loud)).force), 0, FULL_SCALE)
        return float(np.median(np.linalg.norm(played - loud, axis=1) / heard.from_rest(loud)))

    grid = left(build(spec, skin, sensor, 3375))
    assert left(drain(build_adaptive(spec, skin, sensor, 1687, NOISE))[0]) < grid


def test_six_legs_are_swept_so_too(skin):
    legs = Library().device("hexapod")
    table, _ = drain(build_adaptive(legs, skin, readings_of(skin), 200, NOISE))
    assert table.commands.shape[1] == 6 and len(table.commands) > 100


def test_the_verb_makes_one(tmp_path, capsys):
    words = ["design", "--device", "cable_platform", "--adaptive", "--save-table", str(tmp_path / "t.npz"), "--quiet"]
    assert main([*words, "--rows", "200"]) == 0
    assert SkinTable.load(tmp_path / "t.npz").meta["spread"] == "adaptive"
    capsys.readouterr()
    for more, said in (
        (["--rows", "0"], "--adaptive"),
        (["--rows", "127"], "too few rows for an adaptive table (found 127; allowed: >= 128)"),
        (["--rows", "100000000000"], "too many rows for a table"),
        (["--rows", "200", "--workers", "2"], "--workers: an adaptive table is computed in this process"),
        (["--rows", "200", "--save-table", str(tmp_path / "t.csv")], "kept as .npz"),
    ):
        assert main([*words, *more]) == 2 and said in capsys.readouterr().err, said
    assert main(["design", "--rows", "100000000000", "--save-table", str(tmp_path / "u.npz")]) == 2
    assert "too many rows for a table" in capsys.readouterr().err and not (tmp_path / "u.npz").exists()


def test_so_many_rows_are_pressed_as_are_asked_for(spec, skin):
    table, seen = drain(build_adaptive(spec, skin, readings_of(skin), 128, NOISE))
    left = sum(table.meta[name] for name in ("rest_rows", "unbalanced_rows", "unreached_rows"))
    assert seen[-1] == (128 - table.meta["unbalanced_rows"] - table.meta["unreached_rows"], 128)
    assert len(table.commands) - 1 + left == 128


def test_what_the_noise_hides_is_not_what_rows_are_spent_on(tmp_path):
    """The noise of the command line was not the one by which the rows were chosen."""
    words = ["design", "--adaptive", "--rows", "200", "--quiet", "--save-table"]
    made = []
    for name, more in (("a", []), ("b", ["--noise", "2"]), ("c", ["--noise", "60"])):
        assert main([*words, str(tmp_path / f"{name}.npz"), *more]) == 0
        made.append(SkinTable.load(tmp_path / f"{name}.npz").commands)
    np.testing.assert_array_equal(made[0], made[1])
    assert made[2].shape != made[0].shape or not np.array_equal(made[2], made[0])
