"""Discriminability in Blender: two touches of the active finger, worked out by a child process, and saved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon.comparison import told
from blender_addon.results import store

from .build import cube, finger, keys, span
from .stand_in import Anything, draw_panels

pytestmark = pytest.mark.shared_tests("the engine works in a child")


def pressing(deep: list[float]) -> bpy.types.Scene:
    """Return a scene with a finger that presses a plate as deep as asked [mm], once after the other."""
    scene = span(1, 1 + 12 * len(deep))
    hand = finger()
    hand.dermis.finger.skin.level = "draft"
    cube("Plate", 0.04, (0.0, 0.0, 0.0))
    frames, z = [1], [0.022]
    for k, depth in enumerate(deep):
        at = 12 * k
        frames += [at + 4, at + 8, at + 10]
        z += [0.02 - 1e-3 * depth, 0.02 - 1e-3 * depth, 0.022]
    keys(hand, "location", frames, np.column_stack([0.0 * np.array(z), 0.0 * np.array(z), z]))
    scene.dermis.sample_rate = 48.0
    bpy.context.view_layer.objects.active = hand
    return scene


def test_a_child_tells_two_touches_apart_and_a_table_is_written(tmp_path: Path) -> None:
    scene = pressing([0.4, 1.0])
    devices = [d.preset for d in scene.objects["Finger"].dermis.finger.devices]
    assert not bpy.ops.dermis.save_told.poll()
    assert bpy.ops.dermis.tell_apart() == {"FINISHED"}
    made: Any = told.current(scene)
    assert made.table["finger"] == "Finger" and made.table["pairs"] == [[1, 2]]
    real, *rows = made.table["rows"]
    assert real["right"][0] > 0.9 and {row["device"] for row in rows} >= {"pin_array_128", "thimble_3rrs"}
    assert [d.preset for d in scene.objects["Finger"].dermis.finger.devices] == devices
    assert store.current(scene) is None and scene.frame_current == 1
    layout = Anything()
    draw_panels(layout)
    assert "1 or 2" in layout.words and f"{100 * real['right'][0]:.0f} %" in layout.words
    thimble = layout.words.index("Thimble 3-RRS")
    assert layout.words[thimble + 1].strip() in ("stress", "force", "geometry")
    assert layout.words.count("Thimble 3-RRS") == 1 and "    geometry" in layout.words
    assert bpy.ops.dermis.save_told(directory=str(tmp_path)) == {"FINISHED"}
    assert (tmp_path / "Finger.told-apart.csv").read_bytes() == made.csv


def test_a_single_touch_is_refused_before_its_devices_are_worked_out(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = pressing([0.6])
    scene.objects["Finger"].dermis.finger.skin.shown = True
    monkeypatch.setattr(told, "find", lambda *_: pytest.fail("it was begun"))
    with pytest.raises(RuntimeError, match=r"(?s)compared in pairs.*found '1 touch'"):
        bpy.ops.dermis.tell_apart()
    assert store.state(scene) == "fresh"


def test_a_single_touch_is_refused_in_words() -> None:
    pressing([0.6])
    with pytest.raises(RuntimeError, match="compared in pairs"):
        bpy.ops.dermis.tell_apart()
