"""`python -m core thimble adapt`: fingers side by side, by processes or a cluster, give the files of one by itself."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from core.__main__ import main
from core.npz import read_npz
from tests.clusters import Cluster

FEW = ("--movements", "24", "--quiet")


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    pytest.importorskip("onnxruntime")
    out = tmp_path_factory.mktemp("one")
    assert main(["thimble", "adapt", "--out", str(out), *FEW]) == 0
    return files(out)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_an_adaptation_is_two_files_and_says_how_good_it_is(
    one: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sorted(Path(name).suffix for name in one) == [".npz", ".onnx"]
    assert main(["thimble", "adapt", "--out", str(tmp_path), *FEW]) == 0
    told = capsys.readouterr().out
    assert "12 movements held out: polynomial" in told and "in use, 2 movements held out" in told
    assert files(tmp_path) == one, "the same finger, the same bytes"
    assert "by the neo-Hookean law" not in told


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_neo_hookean_finger_is_learned_by_its_law(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--level", "draft", "--tissue", "neo_hookean"]
    assert main(["thimble", "adapt", "--out", str(tmp_path), *words, *FEW]) == 0
    told = capsys.readouterr().out
    assert " movements by the neo-Hookean law\n" in told and "in use, 2 movements held out: polynomial " in told
    (path,) = tmp_path.glob("*.npz")
    assert json.loads(read_npz(path)["meta"].tobytes())["tissue"] == "neo_hookean"


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_several_fingers_on_a_cluster(
    one: dict[str, bytes], cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["thimble", "adapt", "--out", str(tmp_path / "out"), *FEW]
    assert main([*words, "--skin", "index_medium", "gone", "--scheduler", cluster.address]) == 2
    assert "gone" in capsys.readouterr().err and not (tmp_path / "out").exists(), "read before the first is begun"
    assert main([*words, "--skin", "index_medium", "thumb_medium", "--scheduler", cluster.address]) == 0
    made = files(tmp_path / "out")
    assert len(made) == 4 and one.items() <= made.items()
    said = capsys.readouterr().out
    assert "index_medium: learned from" in said and "thumb_medium: learned from" in said
