"""Compare Devices in Blender: the touch of the active finger, worked out by a child process, shown and saved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon.comparison import compared
from blender_addon.panels import compare
from blender_addon.results import store

from .build import keys, pressing

pytestmark = pytest.mark.shared_tests("the engine compares in a child")


@pytest.fixture
def touching() -> bpy.types.Scene:
    """Return a scene with a finger that presses and slides, and nothing baked."""
    scene, _ = pressing()
    return scene


def test_a_child_compares_and_two_files_are_written(touching: bpy.types.Scene, tmp_path: Path) -> None:
    devices = [d.preset for d in touching.objects["Finger"].dermis.finger.devices]
    assert not bpy.ops.dermis.save_comparison.poll()
    assert bpy.ops.dermis.compare_devices() == {"FINISHED"}
    made: Any = compared.current(touching)
    rows = {row["device"]: row for row in made.table["rows"]}
    assert "pin_array_128" in rows and made.table["finger"] == "Finger"
    assert [m["name"] for m in rows["pin_array_128"]["measures"]] == ["stress", "normal force", "shear force"]
    assert not any(row["floors"] for row in made.table["rows"])
    assert any("no touch screen" in s["why"] for s in made.table["skipped"])
    assert [d.preset for d in touching.objects["Finger"].dermis.finger.devices] == devices
    assert store.current(touching) is None and touching.frame_current == 1
    assert bpy.ops.dermis.save_comparison(directory=str(tmp_path)) == {"FINISHED"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["Finger.devices.csv", "Finger.devices.html"]
    assert (tmp_path / "Finger.devices.html").read_bytes() == made.html
    assert bpy.ops.dermis.open_comparison() == {"FINISHED"}


def test_a_reason_that_keeps_out_several_devices_is_told_once() -> None:
    unpressed = "the pad does not press into any object"
    left_out = [("Pins", unpressed), ("Coil", "this touch gives it nothing to render"), ("Thimble", unpressed)]
    words = compare.skipped_words([{"title": title, "why": why} for title, why in left_out])
    assert words == [
        "Pins, Thimble: the pad does not press into any object.",
        "Coil: this touch gives it nothing to render.",
    ]


@pytest.mark.one_line("3.11", "the engine searches in a child; the rest of this file runs on both lines")
def test_floors_are_found_where_they_are_asked_for(touching: bpy.types.Scene) -> None:
    touching.frame_end = 4
    steps = compared.find(touching, "Finger", floors=True)
    told = [step.done / step.total for step in steps if step.stage == "comparing"]
    assert told == sorted(told) and told[-1] <= 1.0, "no bar goes back"
    assert bpy.ops.dermis.compare_devices(floors=True) == {"FINISHED"}
    made: Any = compared.current(touching)
    floors = {row["device"]: row["floors"] for row in made.table["rows"]}
    assert [f["name"] for f in floors["thimble_3rrs"]] == ["whole stress", "154 cells", "electrodes"]
    assert all(0.0 < f["best"] <= f["off"] for f in floors["thimble_3rrs"][:1]) and not floors["pin_array_128"]
    assert b"best_found" in made.csv and b"best pose found" in made.html


def test_esc_ends_the_child_and_leaves_nothing(touching: bpy.types.Scene) -> None:
    steps = compared.find(touching, "Finger")
    stages = []
    for progress in steps:
        stages.append(progress.stage)
        if progress.stage == "comparing":
            break
    steps.close()
    assert "sampling" in stages and compared.current(touching) is None


def test_what_cannot_be_compared_is_refused_in_words(touching: bpy.types.Scene) -> None:
    keys(touching.objects["Finger"], "location", [1.0, 9.0], np.full((2, 3), 0.5))
    with pytest.raises(RuntimeError, match="no device fits this touch"):
        bpy.ops.dermis.compare_devices()
    bpy.context.view_layer.objects.active = touching.objects["Plate"]
    assert not bpy.ops.dermis.compare_devices.poll()
