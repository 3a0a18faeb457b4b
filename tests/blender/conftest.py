"""A fresh Blender for each test, with the add-on registered as `blender_addon` from the source checkout."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest

import blender_addon


@pytest.fixture(autouse=True)
def blender() -> Iterator[None]:
    """Give each test an empty factory scene, and take the add-on away again."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        yield
    finally:
        blender_addon.unregister()
        bpy.ops.wm.read_factory_settings(use_empty=True)
