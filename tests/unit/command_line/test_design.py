"""`python -m core design` as a person runs it, and what the trial of the six interactions stands on."""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import core
from core.__main__ import main
from core.command_line import design as verb
from core.design import trial
from core.design.interactions import NAMES, NOISE, interaction
from core.design.trial import felt, sense
from core.devices.coupling import coupling_of
from core.devices.retraction import CLEAR, clearance
from core.matching.lookup import commands_of, readings_for
from core.matching.platforms import mechanism
from core.matching.readings import FULL_SCALE, readings_of
from core.matching.sweep import sweep
from core.matching.table import SkinTable, build, press_of
from core.presets import Library
from core.stream.protocols.wire import Wire
from tests.clusters import Cluster

ROOT = Path(core.__file__).parents[1]


def run(*arguments, cwd=None):
    """Do what the verb does in this process, where imports and skins are there already."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), contextlib.chdir(cwd or Path.cwd()):
        code = main(["design", *map(str, arguments)])
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def run_apart(*arguments, cwd=None):
    """Do it as a person does, in a process of its own."""
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}
    env["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [sys.executable, "-m", "core", "design", *map(str, arguments)],
        cwd=cwd,
        env=env,
        capture_output=True,
        encoding="utf-8",
        timeout=300,
    )


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("design")
    made = run_apart(
        "flat", "--rows", 512, "--out", folder / "out", "--save-table", folder / "table.npz", "--motors", 2, "--quiet"
    )
    assert made.returncode == 0, made.stderr
    return folder, made


@pytest.mark.one_line("3.13", "numbers alone; the other line runs the verb on a cluster")
def test_the_report_comes_as_text_json_picture_and_preset(reported):
    folder, made = reported
    out = folder / "out"
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert (out / "report.txt").read_text(encoding="utf-8") == made.stdout
    assert (out / "report.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    joint = report["joint"]
    percent = joint["rules"]["touch"]["percent"][0]
    assert report["interactions"] == ["flat"] and len(percent) == 3 and percent[2] == 0.0
    assert report["repetitions"] == [3] and 0.0 < report["scatter"][0] < 0.2 * joint["touch"][0]
    assert sum(joint["explained"]) == pytest.approx(1.0)
    radii = np.array(joint["pulley_radii_m"])
    assert np.abs(radii).max(axis=0) == pytest.approx(7e-3)  # the largest is the original pulley
    assert report["reversed_sweep"]["rms"] > 0.0
    preset = json.loads((out / "cable_platform_2_motors.json").read_text(encoding="utf-8"))
    from core.devices.spec import from_preset

    spec = from_preset("new", preset)
    assert coupling_of(spec).matrix.shape == (3, 2)
    assert clearance(spec, Wire.of(spec).safe) >= CLEAR, "it lets a finger go"


@pytest.mark.one_line("3.13", "numbers alone; the other line runs the verb on a cluster")
def test_a_saved_table_gives_the_same_answer_as_json(reported):
    folder, made = reported
    again = run("flat", "--table", folder / "table.npz", "--json", "--quiet")
    assert again.returncode == 0, again.stderr
    first = json.loads((folder / "out" / "report.json").read_text(encoding="utf-8"))
    assert json.loads(again.stdout)["joint"] == first["joint"]
    assert len(SkinTable.load(folder / "table.npz").commands) == first["table"]["rows"]


@pytest.mark.one_line("3.13", "numbers alone; the other line runs the verb on a cluster")
def test_mistakes_are_said_and_not_traced(reported, tmp_path):
    folder, _ = reported
    (tmp_path / "bad.csv").write_text("time\n0\n1\n")
    (tmp_path / "other.csv").write_text("time,e1\n0,1\n1,2\n")
    (tmp_path / "own" / "devices").mkdir(parents=True)
    coupled = (folder / "out" / "cable_platform_2_motors.json").read_text(encoding="utf-8")
    (tmp_path / "own" / "devices" / "two.json").write_text(coupled, encoding="utf-8")
    for arguments, words in (
        ((), "nothing to do"),
        (("flat", "flat", "--table", folder / "table.npz"), "two touches have one name"),
        ((tmp_path / "bad.csv", "--table", folder / "table.npz"), "channels are missing"),
        ((tmp_path / "other.csv", "--table", folder / "table.npz"), "different numbers of channels"),
        (("flat", "--device", "hexapod", "--table", folder / "table.npz"), "another device"),
        (("flat", "--device", "haptip", "--rows", 64), "haptip"),
        (("flat", "--rows", 5), "too few rows"),
        (("flat", "--device", "two", "--presets", tmp_path / "own"), "coupled already"),
    ):
        made = run(*arguments, "--quiet", cwd=tmp_path)
        assert made.returncode != 0 and words in made.stderr and "Traceback" not in made.stderr, made.stderr


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_the_trial_prints_every_exception_of_the_skin_that_was_asked_for(
    reported, tmp_path, short_touches, monkeypatch
):
    """A softer skin under the same table: the numbers that are printed must change with it."""
    (tmp_path / "skins").mkdir()
    given = json.loads(json.dumps(dict(Library().load("skins", "index_medium"))))
    given["parameters"]["young"]["value"] = 0.5 * given["parameters"]["young"]["value"]
    (tmp_path / "skins" / "soft.json").write_text(json.dumps(given))
    folder, said = reported[0], []
    for name, touches in (("index_medium", NAMES[:3]), ("soft", NAMES[:1])):
        for module in (trial, verb):
            monkeypatch.setattr(module, "NAMES", touches)
        words = ("--trial", 1, "--table", folder / "table.npz", "--skin", name, "--presets", tmp_path, "--quiet")
        made = run(*words)
        lines = made.stdout.splitlines()
        table = [line for line in lines if " by " in line and not line.startswith("exception")]
        assert made.returncode == 0 and len(table) == 2 * len(touches), made.stderr
        wrong = [line for line in table if f"{{{line.split('expected ')[1][0]}: 1}}" not in line]
        assert len([line for line in lines if line.startswith("exception: ")]) == len(wrong)
        said.append(table[:2])
    assert said[0] != said[1]


@pytest.mark.parametrize("device", ["cable_platform", "hexapod"])
def test_the_interactions_own_poses_are_not_in_the_table(skin, device):
    """A table that held the very poses would look itself up."""
    spec = Library().device(device)
    known, _ = sweep(spec, skin.positions)
    carrier, span = mechanism(spec), np.ptp(known, axis=0)
    from scipy.spatial import cKDTree

    from core.devices.poses import Poses

    tree = cKDTree(known / span)
    for name in NAMES:
        poses = interaction(name, skin.positions, seed=0).chunks[0].bodies[0]
        own = carrier.commands(Poses(poses[:, :3, :3], poses[:, :3, 3]))
        assert tree.query(own / span)[0].min() > 1e-5, name


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_the_estimate_is_what_the_simulation_plays_back(skin, short_touches):
    """Source: [S2] V.B: 1.3 % of full scale on the built device; 1.5 % is asked of ours, here with 3,375 rows."""
    spec = Library().device("cable_platform")
    sensor = readings_of(skin)
    table = build(spec, skin, sensor, 3375).heard_with(NOISE)
    sensed = sense(felt(skin, "back", 1), NOISE, 1)
    loud = sensed[table.from_rest(sensed) > table.noise_floor][::5]
    commands = commands_of(table, loud)
    played = np.clip(sensor.counts(press_of(skin, spec).press(commands).force), 0, FULL_SCALE)
    off = np.abs(readings_for(table, commands) - played)
    assert 0.0 < off.mean() < 0.015 * FULL_SCALE
    assert np.abs(played - loud).mean() < 0.015 * FULL_SCALE  # and the touch itself is rendered as well


@pytest.mark.one_line("3.11", "bytes alone; the other line runs the verb without a cluster")
def test_a_cluster_sweeps_the_same_table(tmp_path: Path, cluster: Cluster) -> None:
    """More rows than a part has, so that both workers have some."""
    words = ["design", "--rows", "1500", "--quiet", "--save-table"]
    assert main([*words, str(tmp_path / "one.npz"), "--out", str(tmp_path / "a"), "--workers", "1"]) == 0
    far = ["--out", str(tmp_path / "b"), "--scheduler", cluster.address]
    assert main([*words, str(tmp_path / "two.npz"), *far]) == 0
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
