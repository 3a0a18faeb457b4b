"""The command line as a person runs it: in a process of its own, judged by what it prints, writes and returns."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import wave
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import core
from core.devices.spec import Channel, DeviceSpec
from core.errors import SEVERITIES
from core.presets import Library
from core.scene.scene_file import load as load_scene
from core.scene.scene_file import save as save_scene
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene, sample_frames
from core.surface.shapes import sphere
from core.track import csv
from core.track.command_track import CommandTrack

pytestmark = pytest.mark.shared_tests("verbs of the engine; each line tries half of them")

ROOT = Path(core.__file__).parents[1]
SPEC = DeviceSpec("dev", "A device", "thimble", 100.0, (Channel("x", "m", -1.0, 1.0, actuator="a"),), stated_hash="0")
TRACK = CommandTrack(SPEC, np.arange(5) / 100, np.array([[0.0], [0.5], [1.0], [0.5], [0.0]]), {"finger": "F"})


def run(
    *arguments: str | Path, cwd: Path | None = None, before: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `python -m core`; scipy may come from wherever the tests take it, or from a folder that goes before."""
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}
    paths = [str(before or ""), str(ROOT), os.environ.get("PYTHONPATH", "")]
    env["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    return subprocess.run(
        [sys.executable, "-m", "core", *map(str, arguments)],
        cwd=cwd,
        env=env,
        capture_output=True,
        encoding="utf-8",
        timeout=120,
    )


def tap(fingers: tuple[Finger, ...]) -> TactileScene:
    """Return a finger that slides 5 cm in half a second over a screen, on a plane."""
    frames, times = sample_frames(Fraction(24), (1, 13), 240.0)
    poses = np.tile(np.eye(4), (len(fingers), len(times), 1, 1))
    poses[:, :, 0, 3] = np.linspace(-0.025, 0.025, len(times))
    still = np.tile(np.eye(4), (1, len(times), 1, 1))
    plane = Mesh(np.array([[-1, -1, -1], [1, -1, -1], [0, 1, -1]], dtype=float), np.array([[0, 1, 2]], dtype=np.int32))
    ramp = np.tile(np.linspace(0, 1, 64, dtype=np.float32), (48, 1))
    screen = Screen("Panel", (0.1, 0.075), ramp, 0.001)
    chunk = Chunk(frames, times, poses, still, still)
    return TactileScene("Tap", Fraction(24), (1, 13), 240.0, fingers, (Body("Plane", plane),), (screen,), (chunk,))


@pytest.mark.parametrize("command", [(), ("render",), ("check",), ("work",)])
def test_help_everywhere(command: tuple[str, ...]) -> None:
    done = run(*command, "--help")
    assert done.returncode == 0 and done.stdout.startswith("usage: python -m core") and not done.stderr


def test_version() -> None:
    done = run("--version")
    assert done.returncode == 0 and done.stdout == f"dermis {core.__version__}\n"


def test_no_command_is_refused() -> None:
    done = run()
    assert done.returncode == 2 and "COMMAND" in done.stderr and "Traceback" not in done.stderr


def test_check_of_a_good_track(tmp_path: Path) -> None:
    device = Library().device("haptip")
    still = np.tile([c.rest for c in device.channels], (5, 1))
    core.write_csv(CommandTrack(device, np.arange(5) / device.rate, still), tmp_path / "t.csv")
    done = run("check", "t.csv", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "t.csv: HapTip shear tactor, 4 channels, 5 samples, 0.004 s at 1000 Hz\nno findings\n"


def test_check_of_a_bad_track(tmp_path: Path) -> None:
    bad = replace(TRACK, values=TRACK.values * 3, limited={"x.slew": 2})
    core.write_csv(bad, tmp_path / "t.csv")
    done = run("check", tmp_path / "t.csv")
    assert done.returncode == 1
    lines = done.stdout.splitlines()
    assert lines[1] == (
        "error: finger 'F', dev, x, first at 0.01 s: outside the channel's range (found 3.0; allowed: -1 to 1 m)."
    )
    assert lines[2].startswith("warning: ") and "2 of 5 samples were limited" in lines[2]
    assert lines[3].startswith("info: device preset 'dev': there is no such preset here")


def test_a_warning_is_no_failure(tmp_path: Path) -> None:
    core.write_csv(replace(TRACK, limited={"x.slew": 2}), tmp_path / "t.csv")
    assert run("check", tmp_path / "t.csv").returncode == 0


def test_a_refusal_as_json_has_a_code(tmp_path: Path) -> None:
    done = run("check", "--json", tmp_path / "gone.csv")
    error = json.loads(done.stdout)["error"]
    assert done.returncode == 2 and error["code"] == "refused" and "gone.csv" in error["where"]
    assert error["what"] in done.stderr


def test_check_as_json(tmp_path: Path) -> None:
    core.write_csv(replace(TRACK, values=TRACK.values * 3), tmp_path / "t.csv")
    done = run("check", "--json", tmp_path / "t.csv")
    report = json.loads(done.stdout)
    assert done.returncode == 1 and report["worst"] == "error" and report["samples"] == 5 and report["device"] == "dev"
    found = [(f["code"], f["value"], f["count"]) for f in report["findings"]]
    assert found == [("no-preset", None, 1), ("out-of-range", 3.0, 3)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "the file cannot be read"),
        (b"t_s,x\n0,0\n", "line 1: not a Dermis command track"),
        (b"\xff\xfe", "line 1: not a Dermis command track"),
    ],
)
def test_check_refuses_without_a_traceback(tmp_path: Path, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / "t.csv").write_bytes(content)
    done = run("check", tmp_path / "t.csv")
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("error: ") and message in done.stderr and "Traceback" not in done.stderr


def test_render_writes_tracks_and_plots_and_twice_the_same_bytes(tmp_path: Path) -> None:
    core.save_scene(tap((Finger("Index", (DeviceUse("electrovibration", {}, "Panel"),)),)), tmp_path / "s.npz")
    first = run("render", tmp_path / "s.npz", "--out", tmp_path / "a", "--plots")
    second = run("render", tmp_path / "s.npz", "--out", tmp_path / "b", "--plots", "--quiet")
    assert first.returncode == second.returncode == 0, first.stderr
    names = ["Index.electrovibration.csv", "Index.electrovibration.png"]
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == names
    assert first.stdout.split() == [str(tmp_path / "a" / n) for n in names]
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    track = core.read_csv(tmp_path / "a" / names[0])
    assert track.meta["finger"] == "Index" and track.meta["fps"] == "24/1" and track.meta["scene"] == "Tap"
    assert track.times[-1] == 0.5 and track.spec.hash == core.Library().device("electrovibration").hash
    assert "sampling: " in first.stderr and "sampling: " not in second.stderr


def test_curve_rounds_a_ball_and_says_by_how_much(tmp_path: Path) -> None:
    points, triangles = sphere(6e-3, 320)
    scene = tap((Finger("Index"),))
    ball = Body("Ball", Mesh(points, triangles.astype(np.int32)))
    save_scene(replace(scene, bodies=(ball,)), tmp_path / "flat.npz")
    done = run("curve", tmp_path / "flat.npz", "--out", tmp_path / "round.npz", "--object", "Ball")
    assert done.returncode == 0 and "0.101 mm" in done.stderr, done.stderr
    mesh = load_scene(tmp_path / "round.npz").bodies[0].mesh
    assert mesh is not None and len(mesh.triangles) > 4000
    done = run("curve", tmp_path / "flat.npz", "--out", tmp_path / "flat.npz")
    assert done.returncode == 2 and "replace itself" in done.stderr
    done = run("curve", tmp_path / "flat.npz", "--out", tmp_path / "o.txt")
    assert done.returncode == 2 and "NAME.npz" in done.stderr and not (tmp_path / "o.txt").exists()
    done = run("curve", tmp_path / "flat.npz", "--out", tmp_path / "x.npz", "--sharp", "200")
    assert done.returncode == 2 and "0 to 180 degrees" in done.stderr


@pytest.mark.parametrize("verb", ["render", "compare", "design", "stream", "thimble"])
def test_presets_from_nowhere_are_refused(tmp_path: Path, verb: str) -> None:
    (tmp_path / "file").write_text("{}")
    arguments = {
        "render": ("render", "s.npz", "--out", "a"),
        "compare": ("compare", "s.npz"),
        "design": ("design", "tip", "--out", "a"),
        "thimble": ("thimble", "reach"),
        "stream": ("stream", "play", "t.csv", "--url", "virtual:"),
    }[verb]
    for folder, words in (("none", "no such folder"), ("file", "not a folder")):
        done = run(*arguments, "--presets", tmp_path / folder, cwd=tmp_path)
        assert done.returncode == 2 and not done.stdout
        assert done.stderr == f"error: {tmp_path / folder}: {words}. Check the path.\n"


def test_a_screen_is_exported_as_wav_and_options_of_other_formats_are_refused(tmp_path: Path) -> None:
    spec = Library().device("electrovibration")
    values = np.column_stack([np.full(101, 200.0), np.full(101, 60.0)])
    csv.write(CommandTrack(spec, np.arange(101) / 1000, values, {"finger": "F"}), tmp_path / "s.csv")
    done = run("export", "s.csv", "--format", "wav", "--wav-rate", "192000", "--wav-gain", "150", cwd=tmp_path)
    assert done.returncode == 0 and "open loop" in done.stderr
    with wave.open(str(tmp_path / "s.wav")) as file:
        assert (file.getframerate(), file.getsampwidth(), file.getnframes()) == (192_000, 3, 19_201)
    done = run("export", "s.csv", "--format", "wav", "--wav-full-scale", "100", cwd=tmp_path)
    assert done.returncode == 2 and "beyond full scale" in done.stderr
    done = run("export", "s.csv", "--format", "wav", "--wav-full-scale", "100", "--wav-clip", cwd=tmp_path)
    assert done.returncode == 0 and "clipped at full scale" in done.stderr
    done = run("export", "s.csv", "--format", "json", "--wav-clip", cwd=tmp_path)
    assert done.returncode == 2 and "--wav-clip" in done.stderr


@pytest.mark.parametrize("rate", ["1e12", "1e300"])
def test_a_rate_beyond_memory_is_refused_with_its_limit(tmp_path: Path, rate: str) -> None:
    core.write_csv(TRACK, tmp_path / "t.csv")
    done = run("export", "t.csv", "--format", "json", "--rate", rate, cwd=tmp_path)
    assert done.returncode == 2 and not (tmp_path / "t.json").exists()
    assert "more samples than a track can hold" in done.stderr and "allowed: 3.35544e+09 Hz" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_rate_that_is_not_the_rows_fails_the_check(tmp_path: Path) -> None:
    core.write_csv(TRACK, tmp_path / "t.csv")
    text = (tmp_path / "t.csv").read_text()
    (tmp_path / "t.csv").write_text(text.replace("# rate: 100.0", "# rate: 5.0"))
    done = run("check", "t.csv", cwd=tmp_path)
    assert done.returncode == 1 and "the stated rate is not that of the samples" in done.stdout
    assert "found 5 Hz" in done.stdout or "found '5 Hz'" in done.stdout


def test_render_goes_on_without_a_device_that_is_gone_and_says_so(tmp_path: Path) -> None:
    uses = (DeviceUse("electrovibration", {}, "Panel"), DeviceUse("no_such_device"))
    core.save_scene(tap((Finger("Index", uses),)), tmp_path / "s.npz")
    done = run("render", tmp_path / "s.npz", "--out", tmp_path / "a")
    assert done.returncode == 1 and (tmp_path / "a" / "Index.electrovibration.csv").is_file()
    assert "error: finger 'Index': " in done.stderr and "no_such_device" in done.stderr


def test_render_says_why_the_only_device_gave_nothing(tmp_path: Path) -> None:
    core.save_scene(tap((Finger("Index", (DeviceUse("no_such_device"),)),)), tmp_path / "s.npz")
    done = run("render", tmp_path / "s.npz", "--out", tmp_path / "a")
    assert done.returncode == 2 and "no tracks to export" in done.stderr
    assert "error: finger 'Index': " in done.stderr and "no_such_device" in done.stderr


def test_render_goes_on_where_one_finger_s_track_is_refused(tmp_path: Path) -> None:
    preset = json.loads((ROOT / "presets/devices/electrovibration.json").read_text(encoding="utf-8"))
    for channel in preset["channels"]:
        channel["actuator"] = ""  # a C header has nothing to write
    (tmp_path / "own/devices").mkdir(parents=True)
    (tmp_path / "own/devices/bare.json").write_text(json.dumps(preset), encoding="utf-8")
    uses = [("Index", "bare"), ("a b", "electrovibration"), ("a_b", "electrovibration")]
    fingers = tuple(Finger(name, (DeviceUse(key, {}, "Panel"),)) for name, key in uses)
    core.save_scene(tap(fingers), tmp_path / "s.npz")
    done = run(
        "render",
        tmp_path / "s.npz",
        "--out",
        tmp_path / "a",
        "--format",
        "c",
        "--format",
        "json",
        "--presets",
        tmp_path / "own",
    )
    stems = ["a_b.electrovibration", "a_b.electrovibration-2"]
    wanted = [s + end for s in ("Index.bare", *stems) for end in (".csv", ".json")] + [s + ".h" for s in stems]
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == sorted(wanted)
    assert done.returncode == 1 and "error: Index, bare, c: " in done.stderr and "no channel drives" in done.stderr


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fingers": ()}, "no finger"),
        ({"frame_range": (5, 5)}, "the frame range has no duration"),
        ({"bodies": (), "screens": ()}, "nothing to touch"),
        ({"fingers": (Finger("F"),)}, "no tracks to export"),
    ],
)
def test_render_refuses_without_a_traceback(tmp_path: Path, change: dict[str, object], message: str) -> None:
    core.save_scene(replace(tap((Finger("F"),)), **change), tmp_path / "s.npz")  # type: ignore[arg-type]
    done = run("render", tmp_path / "s.npz", "--out", tmp_path / "a")
    assert done.returncode == 2 and message in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "a").exists()


def test_a_python_without_scipy_is_told_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "scipy.py").write_text("raise ModuleNotFoundError('no module', name='scipy')")
    done = run("design", "tip", "--rows", "27", "--out", tmp_path, "--quiet", before=tmp_path)
    assert done.returncode == 2 and not done.stdout and "Traceback" not in done.stderr
    assert done.stderr.startswith("error: this needs scipy, which this Python")
    assert f"{sys.executable} -m pip install scipy" in done.stderr


def test_render_into_a_file(tmp_path: Path) -> None:
    core.save_scene(tap((Finger("Index", (DeviceUse("electrovibration", {}, "Panel"),)),)), tmp_path / "s.npz")
    (tmp_path / "a").write_text("in the way")
    done = run("render", tmp_path / "s.npz", "--out", tmp_path / "a")
    assert done.returncode == 2 and "the file cannot be written" in done.stderr and "Traceback" not in done.stderr


def test_the_public_names_exist_and_are_listed() -> None:
    assert set(core.__all__) == set(core._PUBLIC) and core.__all__ == sorted(core.__all__)
    for name in core.__all__:
        assert getattr(core, name).__module__.startswith("core."), name
    assert set(core.__all__) <= set(dir(core)) and "error" in SEVERITIES
    with pytest.raises(AttributeError, match="module 'core' has no attribute 'nothing'"):
        core.nothing  # noqa: B018
