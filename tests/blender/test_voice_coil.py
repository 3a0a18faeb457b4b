"""A voice coil in Blender: added to a finger, drawn, baked, shown, and exported as CSV and WAV."""

from __future__ import annotations

import sys
import wave
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import choices
from blender_addon.preview import device_preview
from blender_addon.results import store
from blender_addon.viewport import shown
from core.track import export as track_export
from tests.unit.track.clip_readers import READERS

from .build import cube, finger, keys, span
from .stand_in import Anything, draw, draw_callbacks, draw_panels, graphics_card


@pytest.fixture
def stroke() -> bpy.types.Scene:
    """Return a scene of a second in which a finger with a voice coil slides over a plate at 0.2 m/s."""
    choices.refresh()
    scene, hand = span(1, 25), finger("Index", (0.0, 0.0, 0.0))
    plate = cube("Plate", 1.0, (0.0, 0.0, -0.5))
    material = plate.dermis.material
    material.texture_on, material.texture_amplitude_x, material.texture_period_x_mm = True, 0.4, 1.0
    keys(hand, "location", (1, 25), [(-0.1, 0.0, 0.0002), (0.1, 0.0, 0.0002)])
    bpy.context.view_layer.objects.active = hand
    hand.select_set(True)
    assert bpy.ops.dermis.add_device(preset="voice_coil") == {"FINISHED"}
    return scene


def test_a_voice_coil_is_added_baked_shown_and_exported(
    stroke: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = bpy.data.objects["Index"].dermis.finger.devices[0]
    assert choices.kind_of(device.preset) == "voice_coil" and choices.icon("voice_coil") == "OUTPUT"
    layout = Anything()
    draw_panels(layout)
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    track = store.current(stroke).bake.outputs[0].track
    assert track.spec.kind == "voice_coil" and 0.5 < np.abs(track.column("voltage")).max() <= 3.0

    card, modules = graphics_card()
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    callbacks: Any = draw_callbacks()
    stroke.frame_set(15)
    device_preview.step(bpy.context)
    shown.work()
    draw(callbacks, layout)
    assert any("V peak of ±3 V" in words for words in card.words), card.words

    for form in ("csv", "wav", *READERS):
        assert bpy.ops.dermis.export_tracks(directory=str(tmp_path), form=form) == {"FINISHED"}
    for form, read in READERS.items():
        assert read(tmp_path / f"Index.voice_coil.{form}").amplitude[1].max() > 0.05
    assert np.allclose(track_export.read(tmp_path / "Index.voice_coil.csv").values, track.values, atol=1e-9)
    with wave.open(str(tmp_path / "Index.voice_coil.wav")) as file:
        raw = np.frombuffer(file.readframes(file.getnframes()), np.uint8).reshape(-1, 3)
        assert file.getframerate() == 48_000
    counts = (raw.astype(np.int32) << np.array([8, 16, 24])).sum(axis=1, dtype=np.int32) >> 8
    assert np.abs(counts).max() / (2**23 - 1) * 3.0 == pytest.approx(np.abs(track.column("voltage")).max(), rel=0.02)
    assert (np.abs(counts[::6][: len(track.times)] / (2**23 - 1) * 3.0 - track.column("voltage")) < 1e-6).all()
