"""The command line, called as Blender calls it, and once in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import commands, handlers
from tests.blender import build

ROOT = Path(__file__).parents[2]


@pytest.fixture
def blend(tmp_path) -> Path:
    build.span(1, 13)
    build.cube("Cube", 0.2)
    tip = build.finger("Finger", (0, 0, 0.3))
    build.keys(tip, "location", [1, 7, 13], [(0, 0, 0.2), (0, 0, 0.1), (0.05, 0, 0.1)])
    tip.dermis.finger.devices.add().preset = "haptip"
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_render_writes_tracks(blend, tmp_path, capsys):
    out = tmp_path / "out"
    assert commands.main(["render", str(blend), "--out", str(out)]) == 0
    assert [p.name for p in out.iterdir()] == ["Finger.haptip.csv"]
    assert str(out / "Finger.haptip.csv") in capsys.readouterr().out
    from core.track import csv

    track = csv.read(out / "Finger.haptip.csv")
    assert track.times[-1] == pytest.approx(0.5, abs=2e-3)
    assert track.meta["frame_range"] == "1 13"


def test_range_scene_and_two_runs_give_the_same_bytes(blend, tmp_path):
    for name in ("a", "b"):
        assert (
            commands.main(["render", str(blend), "--out", str(tmp_path / name), "--range", "1:7", "--scene", "Scene"])
            == 0
        )
    one, two = ((tmp_path / n / "Finger.haptip.csv").read_bytes() for n in ("a", "b"))
    assert one == two and b"frame_range: 1 7" in one


@pytest.mark.parametrize("given", [["--range", "-5:10"], ["--range=-5:10"]])
def test_a_range_may_begin_below_zero(blend, tmp_path, given):
    assert commands.main(["render", str(blend), "--out", str(tmp_path / "a"), *given]) == 0
    from core.track import csv

    track = csv.read(tmp_path / "a" / "Finger.haptip.csv")
    assert track.meta["frame_range"] == "-5 10" and track.times[-1] == pytest.approx(15 / 24, abs=1e-3)


def test_a_sampled_scene_renders_to_the_same_track(blend, tmp_path):
    from core import export, load_scene, run
    from core.presets import Library

    assert commands.main(["sample", str(blend), "--out", str(tmp_path / "scene.npz")]) == 0
    assert commands.main(["render", str(blend), "--out", str(tmp_path / "direct")]) == 0
    export(run(load_scene(tmp_path / "scene.npz"), Library(None)), tmp_path / "through")
    direct, through = ((tmp_path / n / "Finger.haptip.csv").read_bytes() for n in ("direct", "through"))
    assert direct == through


def test_findings_of_severity_error_give_status_1_and_the_tracks_all_the_same(blend, tmp_path, capsys):
    hollow = build.mesh_object("Hollow", [(0, 0, 0)], [])
    hollow.dermis.role = "TOUCHABLE"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert commands.main(["render", str(blend), "--out", str(tmp_path / "out")]) == 1
    assert "Hollow" in capsys.readouterr().err
    assert (tmp_path / "out" / "Finger.haptip.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (["--help"], 0, "render"),
        (["render", "--help"], 0, "--range"),
        ([], 2, "COMMAND"),
        (["render", "x.blend"], 2, "--out"),
        (["render", "gone.blend", "--out", "x"], 2, "no such file"),
        (["render", "BLEND", "--out", "x", "--range", "1-7"], 2, "1-7"),
        (["render", "BLEND", "--out", "x", "--range", "7:1"], 2, "no duration"),
        (["render", "BLEND", "--out", "x", "--range", "0:99999999999"], 2, "allowed: -1048574 to 1048574"),
        (["sample", "BLEND", "--out", "x", "--range", "-99999999999:0"], 2, "allowed: -1048574 to 1048574"),
        (["render", "BLEND", "--out", "x", "--range", "-5:-9"], 2, "no duration"),
        (["render", "BLEND", "--out", "x", "--range", "--quiet"], 2, "expected one argument"),
        (["render", "BLEND", "--out", "x", "--presets", "/does/not/exist"], 2, "/does/not/exist: no such folder"),
        (["render", "BLEND", "--out", "x", "--scene", "Nowhere"], 2, "no such scene"),
        (["render", "BROKEN", "--out", "x"], 2, "cannot open"),
    ],
)
def test_statuses(arguments, status, text, blend, tmp_path, capsys):
    (tmp_path / "broken.blend").write_bytes(b"not a blend file")
    replace = {"BLEND": str(blend), "BROKEN": str(tmp_path / "broken.blend")}
    assert commands.main([replace.get(a, a) for a in arguments]) == status
    captured = capsys.readouterr()
    assert text in captured.out + captured.err


@pytest.fixture
def mapped(blend, tmp_path) -> Path:
    """Add a touch screen whose map has a patch of -9999 in it."""
    heights = np.rint(200 + 3 * np.add.outer(np.arange(30.0), np.arange(40.0))).astype(np.int16)
    heights[5:10, 8:20] = -9999
    np.save(tmp_path / "heights.npy", heights)
    settings = build.screen("Panel").dermis.screen
    settings.source, settings.filepath, settings.map_unit = "FILE", str(tmp_path / "heights.npy"), "mm"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    return blend


@pytest.mark.parametrize("verb", ["render", "sample"])
def test_a_question_about_no_data_ends_the_work_and_names_the_option(mapped, tmp_path, capsys, verb):
    out = tmp_path / "out.npz"
    assert commands.main([verb, str(mapped), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "--no-data -9999" in said and "--no-data none" in said and not out.exists()
    for answer in ("-9999", "none", "Panel=-9999"):
        assert commands.main([verb, str(mapped), "--out", str(out), "--no-data", answer]) == 0, answer
    assert commands.main([verb, str(mapped), "--out", str(out), "--no-data", "Other=1"]) == 2
    assert commands.main([verb, str(mapped), "--out", str(out), "--no-data", "far"]) == 2


def test_a_second_number_is_asked_about_once_the_first_is_answered(mapped, tmp_path, capsys):
    """One answer was taken as the answer to all."""
    heights = np.load(tmp_path / "heights.npy")
    heights[20:22, 3:30] = -32768
    np.save(tmp_path / "heights.npy", heights)
    sample = ["sample", str(mapped), "--out", str(tmp_path / "out.npz")]
    assert commands.main(sample) == 2
    assert "--no-data -32768 or --no-data none" in capsys.readouterr().err
    for options in (["--no-data", "-32768"], ["--no-data", "Panel=-32768"]):
        assert commands.main([*sample, *options]) == 2
        assert "--no-data -32768 --no-data -9999 or --no-data -32768 --no-data none" in capsys.readouterr().err
    answers = ["-32768", "-9999"], ["-32768", "none"], ["Panel=-32768", "-9999"], ["Panel=-32768; -9999"]
    for options in answers:
        assert commands.main([*sample, *(part for text in options for part in ("--no-data", text))]) == 0, options
    bpy.ops.wm.open_mainfile(filepath=str(mapped))
    bpy.data.objects["Panel"].dermis.screen.no_data = "-32768"  # what the file says of the first
    bpy.ops.wm.save_as_mainfile(filepath=str(mapped))
    assert commands.main(sample) == 2
    assert commands.main([*sample, "--no-data", "-9999"]) == 0


def test_the_option_makes_holes_of_no_data(mapped, tmp_path):
    from core import load_scene

    for answer, lowest in (("-9999", 0.2), ("none", -9.999)):
        assert commands.main(["sample", str(mapped), "--out", str(tmp_path / "s.npz"), "--no-data", answer]) == 0
        (screen,) = load_scene(tmp_path / "s.npz").screens
        assert screen.height_map.min() * screen.height_unit == pytest.approx(lowest, abs=1e-3)


def test_another_process_gives_the_same_bytes(blend, tmp_path):
    """Blender would call the registered function; the child finds it where Blender keeps it."""
    assert commands.main(["render", str(blend), "--out", str(tmp_path / "here")]) == 0
    program = (
        "import os, sys, bpy, blender_addon\n"
        "bpy.ops.wm.read_factory_settings(use_empty=True)\n"
        "blender_addon.register()\n"
        "from blender_addon import commands\n"
        "status = commands.main(sys.argv[1:])\n"
        "sys.stdout.flush(); sys.stderr.flush()\n"
        "os._exit(status)\n"
    )
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        "BLENDER_USER_RESOURCES": str(tmp_path / "profile"),
    }
    done = subprocess.run(
        [sys.executable, "-c", program, "render", str(blend), "--out", str(tmp_path / "there")],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    here, there = ((tmp_path / n / "Finger.haptip.csv").read_bytes() for n in ("here", "there"))
    assert here == there


def test_the_command_is_registered_and_taken_back(capfd):
    """Blender warns of a second command of one name, and of none where the first is gone."""

    def duplicates() -> int:
        handle = bpy.utils.register_cli_command(handlers.COMMAND, commands.main)
        bpy.utils.unregister_cli_command(handle)
        return capfd.readouterr().err.count("duplicate")

    for _ in range(3):
        assert duplicates() == 1
        handlers.unregister()
        assert duplicates() == 0
        handlers.register()


def test_the_track_follows_the_scene_in_feet(blend, tmp_path):
    """The same movement in other units gives the same track: positions in feet, and a scale that says so."""
    assert commands.main(["render", str(blend), "--out", str(tmp_path / "metres")]) == 0
    scene = bpy.context.scene
    scene.unit_settings.system, scene.unit_settings.scale_length = "IMPERIAL", 0.3048
    feet = 1 / 0.3048
    for vertex in bpy.data.objects["Cube"].data.vertices:
        vertex.co *= feet
    build.keys(
        bpy.data.objects["Finger"], "location", [1, 7, 13], np.array([(0, 0, 0.2), (0, 0, 0.1), (0.05, 0, 0.1)]) * feet
    )
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert commands.main(["render", str(blend), "--out", str(tmp_path / "feet")]) == 0
    from core.track import csv

    one, two = (csv.read(tmp_path / n / "Finger.haptip.csv") for n in ("metres", "feet"))
    assert np.abs(one.values).max() > 1e-4
    np.testing.assert_allclose(two.values, one.values, atol=1e-5)
