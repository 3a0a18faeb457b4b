"""`python -m core design` on the tissue of its scenes, or of --tissue."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("scipy")

from core.__main__ import main
from core.design.interactions import interaction
from core.matching.table import SkinTable
from core.parameters.skin import DEFAULT_SKIN
from core.presets import Library
from core.scene import scene_file
from core.skin.model import SkinModel, skin_from_parameters
from core.skin.observation import skin_key

ROWS = "96"
LIGHTER = 0.8e-3  # of 1.3 mm [m]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of tables are kept where the verb runs."""
    monkeypatch.chdir(tmp_path)


def designed(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run the verb; return its status, and what it prints."""
    status = main(["design", *map(str, arguments), "--quiet"])
    return (status, *capsys.readouterr())


def usual_skin() -> SkinModel:
    """Return the skin of somebody who names none."""
    return skin_from_parameters(dict(Library().skin(DEFAULT_SKIN)), level="draft")


def saved(path: Path, tissue: str) -> Path:
    """Write a scene of light touches, whose finger has a tissue."""
    scene = interaction("flat", usual_skin().positions, seed=0, repetitions=1)
    (chunk,), (finger,) = scene.chunks, scene.fingers
    lighter = chunk.bodies.copy()
    lighter[..., 2, 3] -= LIGHTER
    parameters: dict[str, Any] = {**finger.parameters, "tissue": tissue}
    chunks, fingers = (replace(chunk, bodies=lighter),), (replace(finger, parameters=parameters),)
    scene_file.save(replace(scene, chunks=chunks, fingers=fingers), path)
    return path


@pytest.mark.one_line("3.13", "numbers alone; the command runs on both lines in test_design.py")
def test_table_and_touch_are_of_the_tissue_that_the_scene_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, table = saved(tmp_path / "press.npz", "neo_hookean"), tmp_path / "table.npz"
    status, out, err = designed(capsys, scene, "--rows", ROWS, "--save-table", table, "--out", tmp_path / "out")
    assert status == 0 and "virtual sensor in a neo-Hookean skin" in out, err
    assert "counts differently on linear skin" in out
    assert "tissue-linear" not in err and "made for another skin" not in err
    meta = SkinTable.load(table).meta
    assert meta["tissue"] == "neo_hookean" and meta["skin"] == skin_key(usual_skin().with_law())
    linear = saved(tmp_path / "linear.npz", "linear")
    status, _, err = designed(capsys, linear, "--table", table)
    assert status == 0 and "made for another skin" in err  # its touch is on linear skin, the table is not
    status, out, err = designed(capsys, linear, "--rows", ROWS)
    assert status == 0 and "virtual sensor in a linear skin" in out, err


def test_another_tissue_than_the_scenes_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenes = [saved(tmp_path / f"{tissue}.npz", tissue) for tissue in ("linear", "neo_hookean")]
    for arguments in ((scenes[0], "--tissue", "neo_hookean"), scenes):
        status, _, err = designed(capsys, *arguments, "--rows", ROWS)
        assert status != 0 and "another tissue than" in err and "Traceback" not in err
