"""Many scenes side by side: the bytes of one machine, one process, one scene at a time; refusals, deaths, the verb."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from core.__main__ import main
from core.errors import DermisError
from core.pipeline.shot import Wanted, library_in, presets_of
from core.pipeline.shots import Rendered, put_together, render_shots, skins_of
from core.presets import Library
from core.scene import scene_file
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene
from core.surface.gap import Surface
from core.work.cluster import ClusterExecutor
from core.work.executor import InlineExecutor, JobExecutor
from core.work.processes import ProcessExecutor
from tests import reader_examples as ex
from tests.clusters import Cluster

RATE, COUNT = 60, 24
WANTED = Wanted(formats=("json",))


def press(number: int) -> TactileScene:
    """Return a finger that presses a block, deeper in each scene: pins that follow its skin, and a shear tactor."""
    times = np.arange(COUNT) / RATE
    pose = np.tile(np.eye(4), (1, COUNT, 1, 1))
    pose[0, :, 2, 3] = 20e-3 - (0.4e-3 + 0.1e-3 * number) * np.sin(np.pi * np.arange(COUNT) / (COUNT - 1))
    block = Surface.block(30e-3, 30e-3, 20e-3).mesh
    lifted = replace(block, vertices=block.vertices + [0.0, 0.0, 20e-3 - block.vertices[:, 2].max()])
    devices = (DeviceUse("pin_array_128"), DeviceUse("haptip"))
    finger = Finger("Index", devices, {"skin_level": "draft"})
    body = Body("Block", lifted, {"friction": 0.3 + 0.02 * number})
    chunk = Chunk(times * RATE, times, pose, np.tile(np.eye(4), (1, COUNT, 1, 1)), pose[:0])
    return TactileScene(f"shot {number}", Fraction(RATE), (0, COUNT - 1), RATE, (finger,), (body,), (), [chunk])


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("scenes")
    for number in range(3):
        scene_file.save(press(number), folder / f"shot_{number}.npz")
    return sorted(folder.glob("*.npz"))


@pytest.fixture(scope="module")
def alone(scenes: list[Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What the verb makes of each scene by itself."""
    folder = tmp_path_factory.mktemp("alone")
    for scene in scenes:
        words = ["render", str(scene), "--out", str(folder / scene.stem), "--format", "json", "--workers", "1"]
        assert main([*words, "--quiet"]) == 0
    made = files(folder)
    assert len(made) == 3 * 2 * 2
    return made


def files(folder: Path) -> dict[str, bytes]:
    """Return what is in a folder, by path."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def rendered(scenes: list[Path], folder: Path, executor: JobExecutor, library: Library | None = None) -> list[Rendered]:
    steps = render_shots(scenes, library or Library(), folder, WANTED, executor)
    return [step for step in steps if isinstance(step, Rendered)]


@pytest.fixture(params=["inline", "processes", "cluster"])
def executor(request: pytest.FixtureRequest) -> Iterator[JobExecutor]:
    if request.param == "cluster":
        with ClusterExecutor(request.getfixturevalue("cluster").address) as made:
            yield made
    else:
        with InlineExecutor() if request.param == "inline" else ProcessExecutor(2) as made:
            yield made


def test_whoever_renders_the_shots_the_bytes_are_those_of_one_machine(
    scenes: list[Path], alone: dict[str, bytes], executor: JobExecutor, tmp_path: Path
) -> None:
    found = rendered(scenes, tmp_path / "out", executor)
    assert sorted(each.scene for each in found) == scenes and not any(each.error for each in found)
    assert files(tmp_path / "out") == alone
    assert {p.read_bytes() for each in found for p in each.paths} == set(alone.values())


def test_a_refused_scene_takes_no_other_down(
    scenes: list[Path], alone: dict[str, bytes], executor: JobExecutor, tmp_path: Path
) -> None:
    broken, gone, bare = tmp_path / "broken.npz", tmp_path / "gone.npz", tmp_path / "bare.npz"
    broken.write_bytes(scenes[0].read_bytes()[:-99])
    scene_file.save(replace(press(0), fingers=(Finger("Index"),)), bare)
    found = {each.scene: each for each in rendered([broken, scenes[1], gone, bare], tmp_path / "out", executor)}
    assert found[scenes[1]].error is None
    for path in (broken, gone, bare):
        error = found[path].error
        assert isinstance(error, DermisError) and path.name in str(error) and "dermis-" not in str(error)
    assert files(tmp_path / "out") == {k: v for k, v in alone.items() if k.startswith("shot_1/")}


def test_presets_of_ones_own_travel_along(scenes: list[Path], executor: JobExecutor, tmp_path: Path) -> None:
    own = tmp_path / "own" / "devices"
    own.mkdir(parents=True)
    text = ex.preset("devices", "haptip").decode().replace('"HapTip', '"Mine, HapTip', 1)
    (own / "haptip.json").write_text(text)
    (found,) = rendered(scenes[:1], tmp_path / "out", executor, Library(tmp_path / "own"))
    assert found.error is None
    track = (tmp_path / "out" / "shot_0" / "Index.haptip.csv").read_text()
    assert Library(tmp_path / "own").device("haptip").hash in track
    assert Library().device("haptip").hash not in track


def test_presets_go_there_and_back_and_nowhere_else(tmp_path: Path) -> None:
    (tmp_path / "own" / "skins").mkdir(parents=True)
    (tmp_path / "own" / "skins" / "mine.json").write_bytes(b"\xff{")
    texts = presets_of(Library(tmp_path / "own"))
    made = library_in(tmp_path / "made", texts)
    assert files(tmp_path / "made") == files(tmp_path / "own") and made.folders[1] == tmp_path / "made"
    assert presets_of(Library()) == {} and len(library_in(tmp_path / "none", {}).folders) == 1
    for name in ("../a.json", "skins/../../a.json", "/a/b.json", "skins", "skins/"):
        with pytest.raises(DermisError):
            library_in(tmp_path / "made", {name: "{}"})
    assert {p.name for p in tmp_path.iterdir()} == {"own", "made"}


def test_skins_are_those_that_rendering_makes() -> None:
    plain = replace(press(0), fingers=(Finger("Index", (DeviceUse("haptip"),)),))
    assert list(skins_of(plain, Library())) == []
    shown = Finger("Thumb", (), {"skin_shown": True, "skin_level": "draft", "skin": Library().skin("thumb_small")})
    both = list(skins_of(replace(press(0), fingers=(*press(0).fingers, shown)), Library()))
    assert len(both) == 2 and '"level": "draft"' in both[0]


def test_files_of_a_new_folder_appear_together_and_others_stay(tmp_path: Path) -> None:
    put_together(tmp_path / "a" / "b", {"x.csv": b"1", "y.csv": b"2"})
    assert files(tmp_path) == {"a/b/x.csv": b"1", "a/b/y.csv": b"2"}
    (tmp_path / "a" / "b" / "mine.txt").write_text("z")
    put_together(tmp_path / "a" / "b", {"x.csv": b"3"})
    assert files(tmp_path) == {"a/b/mine.txt": b"z", "a/b/x.csv": b"3", "a/b/y.csv": b"2"}
    (tmp_path / "file").touch()
    with pytest.raises(DermisError, match="cannot be written"):
        put_together(tmp_path / "file" / "b", {"x.csv": b"1"})


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_a_worker_that_dies_in_the_middle_loses_nothing(
    scenes: list[Path], alone: dict[str, bytes], cluster: Cluster, tmp_path: Path
) -> None:
    many = [tmp_path / "in" / f"{n}_{path.stem}.npz" for n in range(4) for path in scenes]
    many[0].parent.mkdir()
    for path in many:
        path.write_bytes((scenes[0].parent / f"{path.stem.partition('_')[2]}.npz").read_bytes())
    with ClusterExecutor(cluster.address) as executor:
        executor._client.wait_for_workers(2)
        victims = iter(sorted(executor._client.run(os.getpid).values()))
        found = []
        for step in render_shots(many, Library(), tmp_path / "out", WANTED, executor):
            if isinstance(step, Rendered):
                found.append(step)
                if len(found) in (2, 5):
                    os.kill(next(victims), signal.SIGKILL)
    assert len(found) == len(many) and not any(each.error for each in found)
    for path in many:
        stem = path.stem.partition("_")[2]
        assert files(tmp_path / "out" / path.stem) == {
            k.partition("/")[2]: v for k, v in alone.items() if k.startswith(f"{stem}/")
        }


def test_leaving_in_the_middle_leaves_whole_shots_alone(
    scenes: list[Path], alone: dict[str, bytes], tmp_path: Path
) -> None:
    with ProcessExecutor(2) as executor:
        steps = render_shots(scenes, Library(), tmp_path / "out", WANTED, executor)
        while not isinstance(next(steps), Rendered):
            pass
        steps.close()
        assert not executor._open, "a job went on"
    made = files(tmp_path / "out")
    assert 0 < len(made) < len(alone) and made == {k: alone[k] for k in made} and len(made) % 4 == 0


# -- the verb


def test_the_verb_renders_many_and_says_of_each_what_became_of_it(
    scenes: list[Path], alone: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["render", *map(str, scenes), "--format", "json", "--workers", "2", "--out", str(tmp_path)]
    assert main(words) == 0
    said = capsys.readouterr()
    assert files(tmp_path) == alone and "shots: 3 of 3" in said.err and "skins: 1 of 1" in said.err
    assert set(said.out.split()) == {str(tmp_path / name) for name in alone}
    assert main(["render", str(tmp_path / "gone.npz"), *words[1:], "--quiet"]) == 1
    assert "gone.npz" in capsys.readouterr().err
    assert main(["render", "gone.npz", "also_gone.npz", "--out", str(tmp_path), "--quiet"]) == 2


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--workers", "-1"], "--workers: too small"),
        (["--tls-ca", "a"], "keys can only be used with a scheduler"),
        (["--scheduler", "tcp://127.0.0.1:9", "--workers", "2"], "workers of its own"),
        (["--scheduler", "tls://127.0.0.1:9", "--tls-ca", "a"], "three files"),
        (["--scheduler", "tls://127.0.0.1:9"], "TLS needs both"),
    ],
)
def test_who_shall_do_it_is_judged_first(
    words: list[str], why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", "gone.npz", "--out", str(tmp_path), *words]) == 2
    assert why in capsys.readouterr().err


def test_ctrl_c_ends_it_and_drops_what_is_under_way(scenes: list[Path], cluster: Cluster, tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("needs POSIX signals")
    many = [*scenes] * 20

    def interrupt() -> None:
        while not over.wait(0.02):
            if any(not path.name.startswith(".") for path in tmp_path.iterdir()):
                os.kill(os.getpid(), signal.SIGINT)
                return

    over = threading.Event()
    waiting = threading.Thread(target=interrupt)
    waiting.start()
    words = ["render", *map(str, many), "--out", str(tmp_path), "--scheduler", cluster.address, "--quiet"]
    try:
        assert main(words) == 130
    finally:
        over.set()
        waiting.join()
    made = files(tmp_path)
    assert made and len(made) % 2 == 0 and len(made) < 2 * len(many), "whole shots, and not all of them"
