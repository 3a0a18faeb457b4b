"""Compare with Stored Tracks: the files of an earlier export against the bake of now."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import pytest

from blender_addon import reporting
from core.track import csv

from .build import pressing

pytestmark = pytest.mark.shared_tests("tracks are compared with files")


@pytest.fixture
def exported(tmp_path: Path) -> Path:
    """Return the folder of a scene's exported tracks; the scene is baked."""
    _, hand = pressing()
    hand.dermis.finger.devices.add().preset = "cable_platform"
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    assert bpy.ops.dermis.export_tracks(directory=str(tmp_path), form="csv") == {"FINISHED"}
    return tmp_path


def test_what_was_exported_from_this_bake_has_not_changed(exported: Path) -> None:
    assert bpy.ops.dermis.migrate_report(directory=str(exported)) == {"FINISHED"}
    assert {finding.code for finding in reporting.findings()} <= {"no-track"}, "the forces on the skin are no track"
    assert "cable_platform" in bpy.data.texts["Migration Report"].as_string()


def test_a_changed_command_is_a_warning_that_names_finger_device_and_frame(exported: Path) -> None:
    for path in (path for path in exported.glob("*.csv") if not path.name.endswith(".skin.csv")):
        track = csv.read(path)
        csv.write(replace(track, values=track.values * 0.95), path)
    assert bpy.ops.dermis.migrate_report(directory=str(exported)) == {"FINISHED"}
    (finding,) = [f for f in reporting.findings() if f.code == "other-commands"]
    assert "cable_platform" in finding.where and "at frame" in finding.value
    assert reporting.source().startswith("Stored tracks of ")


def test_a_folder_without_tracks_is_refused_in_words(exported: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(RuntimeError, match="no tracks to compare with"):
        bpy.ops.dermis.migrate_report(directory=str(tmp_path / "empty"))


def test_it_needs_a_bake() -> None:
    assert not bpy.ops.dermis.migrate_report.poll()
