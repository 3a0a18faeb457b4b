"""What the add-on reads of its own folders, damaged: said in words, and nothing else."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from blender_addon import reporting
from blender_addon.devices import thimble_adaptation, thimble_devices
from blender_addon.results import owners, store
from blender_addon.streaming import built_devices
from core.errors import DermisError
from core.files import write_npz
from tests.damage import Damager

from .build import cube, empty, finger, keys, span

pytestmark = pytest.mark.shared_tests("files are read by the engine")


def stored(tmp_path: Path) -> Path:
    bpy.ops.dermis.add_finger()
    finger = bpy.context.object
    finger.location = (0.0, 0.0, 0.001)
    bpy.ops.dermis.add_screen(width=120.0, depth=75.0)
    bpy.context.view_layer.objects.active = finger
    device = finger.dermis.finger.devices.add()
    device.preset = "haptip"
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 4
    bpy.ops.dermis.bake()
    path = tmp_path / "result"
    store._write(path, store.current(bpy.context.scene))
    return path


def test_damaged_owners_of_a_bake_are_refused_in_words() -> None:
    whole = owners.dumps(
        {"Index": owners.Owner("0" * 32, (("haptip", "1" * 32),)), "Thumb": owners.Owner("2" * 32, ())}
    )
    assert owners.dumps(owners.loads(whole)) == whole and owners.loads("") == {}
    damager, refused = Damager(5), 0
    for text in ("[" * 100_000, "{}", '{"Index": 3}', '{"Index": ["x", []]}'):
        with contextlib.suppress(DermisError):
            owners.loads(text)
    for _ in range(400):
        try:
            owners.loads(damager.damage(whole.encode()).decode("utf-8", "replace"))
        except DermisError as error:
            refused += 1
            assert error.what and error.where
    assert refused > 200


@pytest.mark.filterwarnings("ignore")
def test_a_damaged_result_is_refused_in_words(tmp_path: Path) -> None:
    path = stored(tmp_path)
    whole = path.read_bytes()
    assert store._read(path).bake.outputs
    damager, refused = Damager(3), 0
    for _ in range(400):
        path.write_bytes(damager.damage(whole))
        try:
            store._read(path)
        except DermisError as error:
            refused += 1
            assert error.what and error.where
    assert refused > 200
    path.unlink()
    if hasattr(os, "mkfifo"):
        os.mkfifo(path)
    with pytest.raises(DermisError, match="cannot be read"):
        store._read(path)


@pytest.mark.filterwarnings("ignore")
def test_skins_whose_result_is_damaged_meanwhile_are_missing_and_said(tmp_path: Path) -> None:
    hand = finger()
    hand.dermis.finger.skin.shown, hand.dermis.finger.skin.level = True, "draft"
    cube("Plate", 0.04, (0.0, 0.0, -0.02))
    keys(hand, "location", [1, 3], [[0.0, 0.0, 0.02], [0.0, 0.0, -1e-3]])
    span(1, 3)
    bpy.context.scene.dermis.sample_rate = 24.0
    bpy.ops.dermis.bake()
    path = tmp_path / "result"
    store._write(path, store.current(bpy.context.scene))
    whole, damager, missing = path.read_bytes(), Damager(6), 0
    assert set(store._read(path).bake.skins) == {"Finger"}
    for _ in range(200):
        path.write_bytes(whole)
        skins = store._read(path).bake.skins
        path.write_bytes(damager.damage(whole))
        reporting.forget()
        if not dict(skins):
            missing += 1
            assert [f.severity for f in reporting.findings()] == ["error"]
    assert missing > 50


def test_a_result_of_a_device_at_rest_comes_back_whatever_it_packs_to(tmp_path: Path) -> None:
    path = stored(tmp_path)
    result = store.current(bpy.context.scene)
    (output, *_) = result.bake.outputs
    output.signals["magnitude"] = np.zeros(1 << 25, np.float32)  # pins of five fingers that touch nothing
    store._write(path, result)
    assert path.stat().st_size * 200 < output.signals["magnitude"].nbytes
    assert len(store._read(path).bake.outputs[0].signals["magnitude"]) == 1 << 25


@pytest.mark.filterwarnings("ignore")
def test_a_damaged_adaptation_says_nothing_and_the_bake_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    write_npz(path, {"meta": np.frombuffer(b'{"network_error": 0.1}', np.uint8)})
    monkeypatch.setattr(thimble_devices, "adapted", lambda device, model: path)
    place = SimpleNamespace(object=empty("place"))
    assert thimble_adaptation.status(place, None) == {"network_error": 0.1}
    whole, damager = path.read_bytes(), Damager(4)
    for i in range(200):
        path.write_bytes(damager.damage(whole))
        os.utime(path, (i, i))
        assert isinstance(thimble_adaptation.status(place, None), dict)


def test_a_damaged_table_of_who_wears_what_is_refused_in_words_and_kept() -> None:
    built_devices.choose("finger-1", "Index", "haptip", "left.json")
    built_devices.choose("finger-2", "Thumb", "thimble_3rrs", "red.json")
    path = built_devices.user_folder(built_devices.FOLDER) / built_devices.TABLE
    whole, damager, refused = path.read_bytes(), Damager(5), 0
    for _ in range(300):
        path.write_bytes(damaged := damager.damage(whole))
        built_devices.refresh()
        try:
            built_devices.choice("finger-1", "haptip")
        except DermisError as error:
            refused += 1
            assert error.what and str(path) in str(error.where)
            with pytest.raises(DermisError):
                built_devices.choose("finger-3", "Ring", "haptip", "new.json")
            assert path.read_bytes() == damaged, "what cannot be read is not written over"
    assert refused > 150
