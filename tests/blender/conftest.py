"""A fresh Blender for each test, with the add-on registered as `blender_addon` from the source checkout."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest

import blender_addon
from blender_addon import preferences
from blender_addon.streaming import agreed_paths, built_devices


@pytest.fixture(scope="session", autouse=True)
def factory_preferences() -> None:
    """Start with factory preferences, whatever the profile holds."""
    read_factory_preferences()


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
    read_empty_scene()
    blender_addon.register()
    try:
        yield
    finally:
        blender_addon.unregister()


def read_empty_scene() -> None:
    """Read the empty factory scene, and factory preferences where a test has changed them.

    To read preferences takes four times as long as the scene alone: Blender's own add-ons start again. Blender marks
    them as changed at every assignment, at every add-on that is enabled, and when they are read.
    """
    if bpy.context.preferences.is_dirty:
        read_factory_preferences()
    else:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def read_factory_preferences() -> None:
    """Read factory preferences and the empty factory scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.is_dirty = False
