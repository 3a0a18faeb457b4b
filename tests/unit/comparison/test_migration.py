"""The migration report: an earlier track against the one of now, by finger, device and frame."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.comparison import migration
from core.errors import DermisError
from core.pipeline.bake import Bake
from core.pipeline.outputs import export
from core.pipeline.render import run
from core.scene import scene_file
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, TactileScene
from core.surface.gap import Surface
from core.track import csv
from core.version import ENGINE, made_by

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def scene() -> TactileScene:
    """A finger with two devices that comes down onto a plate, 1 mm in 40 frames."""
    way = [(0.0, 0.0, 0.2e-3 - 1e-3 * min(i / 30, 1.0)) for i in range(40)]
    finger = Finger("Index", (DeviceUse("haptip"), DeviceUse("cable_platform")), {"skin_level": "draft"})
    plate = Body("Plate", Surface.block(0.1, 0.1).mesh, {"friction": 0.4})
    return scene_from_poses(60.0, [(finger, way)], [(plate, (0.0, 0.0, 0.0))])


@pytest.fixture(scope="module")
def bake(scene: TactileScene) -> Bake:
    return run(scene)


def stored(bake: Bake) -> dict[str, object]:
    return {f"{k}.csv": output.track for k, output in enumerate(bake.outputs)}


def test_every_track_names_the_engine_that_made_it(bake: Bake) -> None:
    for output in bake.outputs:
        assert output.track.meta["generator"] == made_by() and made_by().endswith(f"engine {ENGINE}")


def test_the_same_engine_changes_nothing(bake: Bake) -> None:
    found, doubts = migration.migrations(bake, stored(bake))
    assert len(found) == len(bake.outputs) == 2 and not doubts
    for one in found:
        assert one.share.max() == 0.0 and one.changed_frames == (0, 40) and one.finding(0.0) is None
    assert migration.text(found).count("\n") == 3, "its head alone"


def test_a_change_is_told_with_its_size_and_its_frame(bake: Bake) -> None:
    """One command of one sample was 3 % of its range less."""
    output = bake.outputs[0]
    values, channel = output.track.values.copy(), output.track.channels[0]
    size = 0.03 * (channel.high - channel.low)
    sample = int(np.argmin(np.abs(output.track.times - 17.5 / 60.0)))
    values[sample, 0] -= size
    before = replace(output.track, values=values, meta={**output.track.meta, "generator": "dermis 0.1.0"})
    (one,), (left,) = migration.migrations(bake, {"old/a.csv": before})
    assert left.code == "not-stored"
    assert one.difference[sample, 0] == pytest.approx(size) and one.share[0] == pytest.approx(0.03)
    assert one.frame_of(sample) == pytest.approx(one.first + 17.5, abs=0.1) and one.changed_frames == (1, 40)
    told = one.finding(0.02)
    assert told is not None and told.code == "other-commands" and one.finding(0.04) is None
    assert "3.00%" in told.value and f"frame {one.frame_of(sample):.6g}" in told.value and "dermis 0.1.0" in told.remedy
    lines = migration.text([one]).splitlines()
    assert len(lines) == 4 and lines[3].startswith(f"Index,{output.device},{one.frame_of(sample):.9g},")
    assert "3.000%" in migration.table([one]) and "dermis 0.1.0" in migration.table([one])


def test_a_track_of_another_rate_is_compared_at_its_own_times(bake: Bake) -> None:
    track = bake.outputs[0].track
    few = replace(track, times=track.times[::3], values=track.values[::3])
    (one,), _ = migration.migrations(bake, {"a.csv": few})
    assert len(one.difference) == len(few.times) and one.share.max() == pytest.approx(0.0, abs=1e-12)


def test_what_does_not_belong_is_refused_in_words(bake: Bake) -> None:
    track = bake.outputs[0].track
    strange = replace(track, meta={**track.meta, "finger": "Thumb"})
    with pytest.raises(DermisError, match=r"no stored track belongs to this scene.*a\.csv.*finger 'Index'"):
        migration.migrations(bake, {"a.csv": strange})
    _, doubts = migration.migrations(bake, {**stored(bake), "b.csv": strange})
    assert [d.code for d in doubts] == ["not-of-this-scene"] and "Thumb" in doubts[0].value
    late = replace(track, times=track.times + 1.0)
    with pytest.raises(DermisError, match=r"a\.csv: the stored track is longer than the scene"):
        migration.migrations(bake, {"a.csv": late})


def test_the_command_line_reports_and_writes(scene: TactileScene, bake: Bake, tmp_path: Path) -> None:
    scene_file.save(scene, tmp_path / "scene.npz")
    _, first, *_ = export(bake, tmp_path / "old")
    (tmp_path / "old" / "notes.json").write_text(json.dumps({"what": "no track"}))
    track = csv.read(first)
    csv.write(replace(track, values=track.values * 0.9), first)
    command = [sys.executable, "-m", "core", "migrate-report", "scene.npz", "old", "--out", "changed.csv", "--quiet"]
    done = subprocess.run(
        command, cwd=tmp_path, env={"PYTHONPATH": ":".join([str(ROOT), *sys.path])}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "differs from that of the stored track" in done.stderr and "is no track" in done.stderr
    assert made_by() in done.stdout
    rows = (tmp_path / "changed.csv").read_text().splitlines()
    assert rows[2].startswith("finger,device,frame") and len(rows) > 10
    assert np.isfinite([float(v) for v in rows[3].split(",")[6:]]).all()
