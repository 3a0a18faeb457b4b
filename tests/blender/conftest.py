"""A fresh Blender for each test, with the add-on registered as `blender_addon` from the source checkout."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest

import blender_addon
from blender_addon import preferences
from blender_addon.streaming import agreed_paths, built_devices


@pytest.fixture(autouse=True)
def blender(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Give each test an empty factory scene, no built devices of other tests, and take the add-on away again."""
    devices = tmp_path_factory.mktemp("devices")
    folder = preferences.user_folder
    monkeypatch.setattr(
        built_devices,
        "user_folder",
        lambda name, **more: devices if name == built_devices.FOLDER else folder(name, **more),
    )
    built_devices.refresh()
    agreed_paths.forget()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        yield
    finally:
        blender_addon.unregister()
        bpy.ops.wm.read_factory_settings(use_empty=True)
