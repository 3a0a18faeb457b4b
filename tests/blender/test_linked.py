"""Linked fingers and objects: what would not be saved is refused, and greyed out."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from blender_addon import layouts
from blender_addon.operators import presets, work

from .build import cube, finger


@pytest.fixture
def linked(tmp_path: Path) -> bpy.types.Object:
    """Return a linked finger, active and selected, beside a linked cube."""
    finger("Index").dermis.finger.devices.add().preset = "haptip"
    cube("Block")
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, to):
        to.objects = ["Index", "Block"]
    for obj in to.objects:
        bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = to.objects[0]
    return to.objects[0]


class Layout:
    enabled = True


def test_panels_grey_out_what_would_not_be_saved(linked: bpy.types.Object) -> None:
    layout = Layout()
    layouts.editable(layout, linked)
    assert not layout.enabled
    layouts.editable(layout, finger("Own"))
    assert layout.enabled


def test_operators_leave_linked_objects_alone(linked: bpy.types.Object) -> None:
    linked.select_set(True)
    assert work.chosen(bpy.context) == [] and presets.chosen(bpy.context, "devices") is None
    cube("Own").select_set(True)  # a surface to be placed on
    bpy.context.view_layer.objects.active = linked
    for call in (
        lambda: bpy.ops.dermis.set_role(role="NONE"),
        lambda: bpy.ops.dermis.remove_device(),
        lambda: bpy.ops.dermis.add_device(preset="haptip"),
        lambda: bpy.ops.dermis.apply_skin(preset="index_small"),
        bpy.ops.dermis.place_on_surface,
        bpy.ops.dermis.add_gesture,
    ):
        with pytest.raises(RuntimeError):
            call()
    assert [d.preset for d in linked.dermis.finger.devices] == ["haptip"] and linked.animation_data is None


def test_an_override_can_be_edited(linked: bpy.types.Object) -> None:
    own = linked.override_create(remap_local_usages=True)
    bpy.context.view_layer.objects.active = own
    assert own.is_editable
    assert bpy.ops.dermis.add_device(preset="electrovibration") == {"FINISHED"}
    assert len(own.dermis.finger.devices) == 2
