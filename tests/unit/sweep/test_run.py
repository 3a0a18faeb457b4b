"""Sweeps from rows to table: figures are those of the work done by itself, ended ones go on, refusals stop nobody."""

from __future__ import annotations

import csv
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.__main__ import main
from core.comparison.measures import judge, rms
from core.design.collect import collect
from core.design.interactions import NAMES, NOISE
from core.design.trial import Verdict, felt, sense
from core.design.trial import judge as judge_motors
from core.errors import DermisError
from core.pipeline.render import run
from core.presets import Library
from core.scene import scene_file
from core.scene.tactile_scene import DeviceUse
from core.skin.model import SkinModel
from core.skin.shape import FingertipShape
from core.steps import drain
from core.sweep import table
from core.sweep.motors import figures, verdict_of
from core.sweep.run import Swept, run_sweep
from core.sweep.spec import read
from core.work.child import command, environment
from core.work.executor import InlineExecutor, JobExecutor
from core.work.processes import ProcessExecutor
from tests.clusters import Cluster
from tests.unit.pipeline.test_shots import press

pytestmark = pytest.mark.shared_tests("rows are work of the executor, which runs on both lines")

ROOT = Path(__file__).resolve().parents[3]
DEVICES = """schema = "dermis-sweep 1"
study = "devices"
scenes = ["*.npz"]

[vary]
device = "pin_array_128"
"use.pin_method" = ["DM2", "FM2"]
"body.friction" = [0.2, 0.6]
"finger.skin_level" = "draft"
"""
MOTORS = """schema = "dermis-sweep 1"
study = "motors"
rows = 400

[vary]
device = ["cable_platform"]
touch = "flat"
seed = 3
"""


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    for number in range(2):
        scene_file.save(press(number), folder / f"shot_{number}.npz")
    (folder / "sweep.toml").write_text(DEVICES)
    return folder / "sweep.toml"


def swept(spec: Path, folder: Path, executor: JobExecutor | None = None, library: Library | None = None) -> Swept:
    return drain(run_sweep(read(spec), library or Library(), folder, executor or InlineExecutor()))


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "sweep.csv").open() as file:
        return list(csv.DictReader(line for line in file if not line.startswith("# ")))


@pytest.fixture(scope="module")
def done(spec: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("done")
    made = swept(spec, folder)
    assert (made.rows, made.done, made.kept, made.refused, made.lost) == (8, 8, 0, 0, ())
    return folder


def test_each_row_is_what_rendering_it_by_itself_gives(done: Path) -> None:
    found = rows_of(done)
    assert len({row["hash"] for row in found}) == 8 and {row["scene"] for row in found} == {"shot_0.npz", "shot_1.npz"}
    row = next(
        r for r in found if (r["scene"], r["use.pin_method"], r["body.friction"]) == ("shot_1.npz", "FM2", "0.6")
    )
    scene, use = press(1), DeviceUse("pin_array_128", {"pin_method": "FM2"})
    finger = replace(scene.fingers[0], devices=(use,))
    body = replace(scene.bodies[0], parameters={"friction": 0.6})
    bake = run(replace(scene, fingers=(finger,), bodies=(body,)))
    judged = judge(bake.outputs[0], bake.skins["Index"], use.parameters)
    assert judged is not None
    for measure in judged.measures:
        stem = measure.name.replace(" ", "_")
        assert float(row[f"{stem}_target"]) == rms(measure.target) and float(row[f"{stem}_off"]) == measure.off
    assert int(row["samples"]) == len(bake.outputs[0].track.times) and row["method"] == "FM2"


def test_friction_moves_what_it_should(done: Path) -> None:
    """Pressed straight, more friction keeps the skin from spreading: the stress that is asked for differs."""
    pins = [r for r in rows_of(done) if r["use.pin_method"] == "DM2" and r["scene"] == "shot_1.npz"]
    assert len(pins) == 2 and pins[0]["stress_target"] != pins[1]["stress_target"]


@pytest.mark.parametrize("who", ["processes", "cluster"])
def test_whoever_does_the_rows_the_table_is_the_same_bytes(
    who: str, spec: Path, done: Path, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    if who == "processes":
        with ProcessExecutor(2) as executor:
            swept(spec, tmp_path, executor)
    else:
        cluster: Cluster = request.getfixturevalue("cluster")
        words = ["sweep", str(spec), "--out", str(tmp_path), "--scheduler", cluster.address, "--quiet"]
        assert main(words) == 0
    assert (tmp_path / "sweep.csv").read_bytes() == (done / "sweep.csv").read_bytes()


def test_what_is_there_is_not_done_again_and_what_is_missing_is(spec: Path, done: Path, tmp_path: Path) -> None:
    before = {path.name: path.stat().st_mtime_ns for path in (done / "rows").iterdir()}
    made = swept(spec, done)
    assert (made.done, made.kept) == (0, 8)
    victim, damaged, *_ = sorted((done / "rows").iterdir())
    victim.unlink()
    damaged.write_bytes(damaged.read_bytes()[:-2])
    text = (done / "sweep.csv").read_bytes()
    made = swept(spec, done)
    assert (made.done, made.kept) == (2, 6) and (done / "sweep.csv").read_bytes() == text
    after = {path.name: path.stat().st_mtime_ns for path in (done / "rows").iterdir()}
    assert {name for name in before if before[name] != after[name]} == {victim.name, damaged.name}


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
@pytest.mark.real_time
def test_a_killed_sweep_goes_on_where_it_stood(spec: Path, done: Path, tmp_path: Path) -> None:
    words = command("sweep", str(spec), "--out", str(tmp_path), "--workers", "1", "--quiet")
    running = subprocess.Popen(words, env=environment(), stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60.0
    while len(list((tmp_path / "rows").glob("*.json"))) < 3:
        assert running.poll() is None and time.monotonic() < end
        time.sleep(0.01)
    running.send_signal(signal.SIGKILL)
    running.wait()
    there = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "rows").glob("*.json")}
    assert 3 <= len(there) < 8
    made = swept(spec, tmp_path)
    assert made.kept == len(there) and made.done == 8 - len(there)
    assert all((tmp_path / "rows" / name).stat().st_mtime_ns == at for name, at in there.items())
    assert (tmp_path / "sweep.csv").read_bytes() == (done / "sweep.csv").read_bytes()


def test_a_refused_row_says_why_stops_nobody_and_is_not_tried_again(spec: Path, tmp_path: Path) -> None:
    one = tmp_path / "one.toml"
    scenes = f"scenes = ['{spec.parent / 'shot_0.npz'}']"
    text = DEVICES.replace('scenes = ["*.npz"]', scenes).replace("[0.2, 0.6]", "[0.2, -3.0]")
    one.write_text(
        text.replace('"use.pin_method" = ["DM2", "FM2"]\n', "")
        .replace('"pin', '["haptip", "pin')
        .replace('128"', '128"]')
    )
    made = swept(one, tmp_path / "out")
    assert (made.rows, made.refused) == (4, 3)
    found = rows_of(tmp_path / "out")
    for row in found:
        assert ("friction" in row["refused"]) == (row["body.friction"] == "-3.0")
        assert bool(row["refused"]) != bool(row["samples"])
    assert "this touch gives the device nothing to render" in found[0]["refused"] and not found[2]["refused"]
    assert swept(one, tmp_path / "out").done == 0
    assert main(["sweep", str(one), "--out", str(tmp_path / "out"), "--quiet"]) == 1


class Failing(InlineExecutor):
    """Loses one row as if its worker had died."""

    lose = True

    def submit(self, name: str, arrays: Any = None, parameters: Any = None) -> Any:
        future = super().submit(name, arrays, parameters)
        if name == "sweep-row" and self.lose:
            self.lose = False
            made = type(future)()
            made.set_exception(DermisError("workers died of the job", code="job-crashed"))
            return made
        return future


def test_a_row_whose_worker_died_is_done_by_the_next_run(spec: Path, done: Path, tmp_path: Path) -> None:
    made = swept(spec, tmp_path, Failing())
    assert len(made.lost) == 1 and made.done == 7 and "died" in made.lost[0]
    assert sum(row["hash"] != "" and not row["samples"] for row in rows_of(tmp_path)) == 1
    assert swept(spec, tmp_path).done == 1
    assert (tmp_path / "sweep.csv").read_bytes() == (done / "sweep.csv").read_bytes()


def test_leaving_early_writes_the_table_of_what_is_there(spec: Path, tmp_path: Path) -> None:
    steps = run_sweep(read(spec), Library(), tmp_path, InlineExecutor())
    while next(steps) is None or len(list((tmp_path / "rows").glob("*.json"))) < 2:
        pass
    steps.close()
    found = rows_of(tmp_path)
    assert len(found) == 8 and sum(bool(row["samples"]) for row in found) == 2


# -- motors


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_the_trial_through_a_sweep_is_the_trial_to_the_bit(
    skin: SkinModel, tmp_path: Path, short_touches: None
) -> None:
    (tmp_path / "s2.toml").write_text(MOTORS)
    made = swept(tmp_path / "s2.toml", tmp_path / "out")
    assert (made.rows, made.done, made.refused) == (1, 1, 0)
    device = Library().device("cable_platform")
    own = drain(collect(device, FingertipShape(), tmp_path / "parts", level="draft", rows=400))
    sensed = sense(felt(skin, "flat", 3), seed=300 + NAMES.index("flat"))  # as `trial` does
    wanted = judge_motors(own.heard_with(NOISE), sensed, "flat", 3)
    found = [verdict_of({k: number(v) for k, v in row.items()}) for row in rows_of(tmp_path / "out")]
    assert found == [wanted]


def number(text: str) -> Any:
    try:
        return float(text) if "." in text or "e" in text else int(text)
    except ValueError:
        return text


def test_a_verdict_goes_there_and_back() -> None:
    verdict = Verdict("tip", 7, 2, (2, 3), ((9.5, 1e-3, 0.0), (80.0, 12.5, 0.0)), 11.25, 301.5)
    assert verdict_of({"touch": "tip", "seed": 7, **figures(verdict)}) == verdict
    assert set(NAMES) >= {"tip"}


# -- the table


def test_a_table_has_every_column_once_and_words_with_commas_whole(tmp_path: Path) -> None:
    from core.sweep.row import Row

    rows = [Row(f"{i:032x}", {"device": name, "seed": i}, {}) for i, name in enumerate(("a,b", 'c"d', "e"))]
    found = {rows[0].key: {"off": 0.1 + 0.2, "n": 3}, rows[1].key: {"refused": "no, never"}}
    table.write(tmp_path, rows, found, "devices")
    lines = rows_of(tmp_path)
    assert list(lines[0]) == ["hash", "device", "seed", "off", "n", "refused"]
    assert [line["device"] for line in lines] == ["a,b", 'c"d', "e"] and float(lines[0]["off"]) == 0.1 + 0.2
    assert lines[1]["refused"] == "no, never" and lines[2]["off"] == lines[2]["refused"] == ""
    assert "# rows: 3\n# done: 2\n" in (tmp_path / "sweep.csv").read_text()


def test_parquet_says_the_same_where_pyarrow_is_there(tmp_path: Path) -> None:
    parquet = pytest.importorskip(
        "pyarrow.parquet", reason="PARQUET IS NOT TESTED: there is no pyarrow for this numpy", exc_type=ImportError
    )
    from core.sweep.row import Row

    rows = [Row(f"{i:032x}", {"device": "a", "mixed": (1, "x")[i % 2], "on": bool(i % 2)}, {}) for i in range(3)]
    found = {rows[0].key: {"off": 0.1, "n": 3}, rows[1].key: {"off": 2, "refused": "no"}}
    paths = table.write(tmp_path, rows, found, "devices")
    assert [path.name for path in paths] == ["sweep.csv", "sweep.parquet"]
    back = parquet.read_table(paths[1]).to_pydict()
    assert back["off"] == [0.1, 2.0, None] and back["n"] == [3, None, None] and back["refused"] == [None, "no", None]
    assert back["mixed"] == ["1", "x", "1"] and back["on"] == [False, True, False]
    assert list(back) == (tmp_path / "sweep.csv").read_text().splitlines()[6].split(",")


# -- the verb


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["sweep", "gone.toml", "--out", "OUT"], "cannot be read"),
        (["sweep", "SPEC"], "a table needs a folder"),
        (["sweep", "--workers", "2"], "workers can only be used for a table"),
        (["sweep", "SPEC", "--out", "OUT", "--workers", "-1"], "too small"),
    ],
)
def test_the_verb_refuses_in_words(
    words: list[str], why: str, spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([w.replace("SPEC", str(spec)).replace("OUT", str(tmp_path / "out")) for w in words]) == 2
    assert why in capsys.readouterr().err
    assert not np.any([p.suffix == ".json" for p in tmp_path.rglob("*")])


def test_the_figures_of_the_trial_are_read_from_its_table(tmp_path: Path) -> None:
    """By wobble and platform, seed by seed, to the bit; columns of six motors are empty for three."""
    from core.sweep.row import Row
    from tests.benchmarks.figures_s2 import DEVICES as PLATFORMS
    from tests.benchmarks.figures_s2 import SHARES, of_seeds, swept_verdicts

    asked = read(ROOT / "presets" / "devices" / "s2_trial.toml")
    assert asked.values("device") == PLATFORMS and set(asked.values("wobble")) == {1.0, *SHARES}
    assert asked.values("touch") == NAMES and asked.values("seed") == tuple(range(20, 40))
    rows, found, wanted = [], {}, {}
    for i, columns in enumerate(asked.variants()):
        motors = 3 if columns["device"] == "cable_platform" else 6
        percent = tuple(100.0 / (i + k + 3) for k in range(motors))
        name, seed = str(columns["touch"]), int(columns["seed"])
        verdict = Verdict(name, seed, 2, (i % 4, 1), (percent, percent[::-1]), 1.0 / (i + 1), i / 7)
        rows.append(Row(f"{i:032x}", columns, {}))
        found[rows[-1].key] = figures(verdict)
        wanted.setdefault(float(columns["wobble"]), {}).setdefault(str(columns["device"]), []).append(verdict)
    table.write(tmp_path, rows, found, "motors")
    made = swept_verdicts(tmp_path / "sweep.csv")
    assert made == wanted and len(made[1.0]["hexapod"]) == 120
    assert [v.seed for v in of_seeds(made[0.5], [20, 21])["hexapod"]] == [20] * 6 + [21] * 6
