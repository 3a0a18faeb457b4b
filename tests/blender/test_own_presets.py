"""Presets of one's own: kept, used again with the same values, and removed; those that come with Dermis stay."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest

from blender_addon import choices, preferences
from blender_addon.operators import presets
from blender_addon.properties import object_properties, skin_properties

from .build import cube, finger


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep presets of these tests in a folder of their own."""
    for module in (preferences, presets):
        monkeypatch.setattr(module, "presets_folder", lambda: tmp_path)
    choices.refresh()
    return tmp_path


def active(obj: bpy.types.Object) -> bpy.types.Object:
    bpy.context.view_layer.objects.active = obj
    return obj


def test_a_material_is_kept_and_given_to_another_object(folder: Path) -> None:
    one, other = active(cube()), cube("Other")
    bpy.ops.dermis.make_touchable(preset="rubber")
    one.dermis.material.friction = 0.55
    one.dermis.material.texture_period_x_mm = 3.25
    assert bpy.ops.dermis.save_preset(group="materials", name="Wet Rubber!") == {"FINISHED"}
    assert one.dermis.material.preset == "wet_rubber"
    assert [p.name for p in folder.rglob("*") if p.is_file()] == ["wet_rubber.json"]
    assert choices.entry("materials", "wet_rubber").user
    one.select_set(False)
    active(other)
    bpy.ops.dermis.make_touchable(preset="wet_rubber")
    left, right = (object_properties.parameters(o.dermis.material) for o in (one, other))
    assert left == right and right["friction"] == pytest.approx(0.55)


def test_a_fingertip_is_kept() -> None:
    one = active(finger())
    one.dermis.finger.skin.width_mm, one.dermis.finger.skin.young_kpa = 17.3, 80.0
    assert bpy.ops.dermis.save_preset(group="skins", name="Mine") == {"FINISHED"}
    wanted = skin_properties.shape_and_material(one.dermis.finger.skin)
    bpy.ops.dermis.apply_skin(preset="index_small")
    bpy.ops.dermis.apply_skin(preset="mine")
    assert skin_properties.shape_and_material(one.dermis.finger.skin) == wanted


@pytest.mark.parametrize("key", ["haptip", "electrovibration", "pin_array_128", "thimble_3rrs", "cable_platform"])
def test_a_device_is_kept_with_its_settings(key: str) -> None:
    one, other = active(finger()), finger("Other")
    bpy.ops.dermis.add_device(preset=key)
    device = one.dermis.finger.devices[0]
    before = object_properties.parameters(device)
    device.use_texture = not device.use_texture
    device.pin_fade_in *= 2.0
    assert bpy.ops.dermis.save_preset(group="devices", name="Mine") == {"FINISHED"}
    assert device.preset == "mine"
    one.select_set(False)
    active(other)
    bpy.ops.dermis.add_device(preset="mine")
    values = object_properties.parameters(other.dermis.finger.devices[0])
    kind = preferences.library().device("mine").kind
    settings = object_properties.core.devices.kinds.KINDS[kind].settings
    wanted = object_properties.parameters(device)
    assert {n: values[n] for n in settings} == {n: wanted[n] for n in settings}
    if "use_texture" in settings:
        assert values["use_texture"] != before["use_texture"]


def test_names_of_shipped_presets_are_refused(folder: Path) -> None:
    active(cube())
    bpy.ops.dermis.make_touchable(preset="rubber")
    for name, why in (("Rubber", "comes with Dermis"), ("...", "needs a name")):
        with pytest.raises(RuntimeError, match=why):
            bpy.ops.dermis.save_preset(group="materials", name=name)
    assert not [p for p in folder.rglob("*") if p.is_file()]


def test_shipped_presets_cannot_be_removed_and_own_ones_can(folder: Path) -> None:
    one = active(cube())
    bpy.ops.dermis.make_touchable(preset="rubber")
    with pytest.raises(RuntimeError, match="Rubber comes with Dermis and cannot be removed"):
        bpy.ops.dermis.remove_preset(group="materials")
    bpy.ops.dermis.save_preset(group="materials", name="Mine")
    assert bpy.ops.dermis.remove_preset(group="materials") == {"FINISHED"}
    assert one.dermis.material.preset == "" and choices.entry("materials", "mine") is None
    assert not [p for p in folder.rglob("*") if p.is_file()]


def test_a_device_whose_preset_is_removed_takes_the_shipped_one() -> None:
    one = active(finger())
    bpy.ops.dermis.add_device(preset="thimble_3rrs")
    bpy.ops.dermis.save_preset(group="devices", name="Mine")
    bpy.ops.dermis.remove_preset(group="devices")
    assert one.dermis.finger.devices[0].preset == "thimble_3rrs"


def test_settings_in_a_device_file_are_checked(folder: Path) -> None:
    preset = preferences.library().load("devices", "haptip")
    (folder / "devices").mkdir()
    for settings in ({"nonsense": 1}, {"use_texture": 3}, [], {"pin_fade_in": {"value": 1, "unit": "N"}}):
        (folder / "devices" / "bad.json").write_text(json.dumps({**preset, "settings": settings}), encoding="utf-8")
        choices.refresh()
        assert choices.entry("devices", "bad").error, settings


def test_a_device_button_says_what_the_device_is() -> None:
    props = type("Properties", (), {"preset": "haptip"})
    operator = bpy.types.DERMIS_OT_add_device
    said = operator.description(bpy.context, props)
    assert said.startswith("Wearable 2-DoF tactor") and ".md" not in said
    assert len({choices.icon(kind) for kind in ("shear_tactor", "friction_screen", "thimble", "hexapod")}) == 4


def test_a_preset_that_goes_while_the_menus_are_read_stops_nobody(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another Blender may remove its file between the listing and whatever is done with it."""
    obj = active(finger())
    obj.dermis.finger.devices.add().preset = "haptip"
    bpy.ops.dermis.save_preset(group="devices", name="Passing")
    (path,) = folder.rglob("passing.json")
    library = type(preferences.library())
    listed = library.list

    def list_and_lose(self: object, group: str) -> object:
        found = listed(self, group)
        path.unlink(missing_ok=True)
        return found

    monkeypatch.setattr(library, "list", list_and_lose)
    obj.dermis.finger.devices[0].preset = "haptip"
    choices.refresh()
    assert choices.kind_of("passing") in ("", "shear_tactor") and choices.kind_of("haptip") == "shear_tactor"
    assert choices.description("devices", "haptip")
