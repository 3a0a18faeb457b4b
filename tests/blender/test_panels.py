"""What panels say: the next step, the presets at hand, figures with units; all that they name exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import bpy
import pytest

from blender_addon import choices, panels, quantities
from blender_addon.design import design_properties
from blender_addon.panels import summary
from blender_addon.properties import object_properties, scene_properties, skin_properties
from blender_addon.streaming import streaming_properties

from .build import cube, finger, screen

SOURCES = sorted(Path(panels.__file__).parent.glob("*.py"))


def strings(function: str, argument: int) -> set[str]:
    """Return the literal texts given to a layout function anywhere in the panels."""
    found = set()
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == function:
                if len(node.args) > argument and isinstance(node.args[argument], ast.Constant):
                    found.add(node.args[argument].value)
    return found


def test_every_button_has_an_operator() -> None:
    names = strings("operator", 0)
    assert {"dermis.bake", "dermis.export_tracks", "dermis.demo_scene"} <= names
    for name in names:
        group, _, operator = name.partition(".")
        assert getattr(getattr(bpy.ops, group), operator).get_rna_type().description, name


def test_remedies_name_panels_that_are_there() -> None:
    labels = {getattr(c, "bl_label", "") for c in panels.CLASSES}
    root = Path(panels.__file__).parents[2]
    named = {
        word
        for folder in ("blender_addon", "core")
        for path in (root / folder).rglob("*.py")
        for word in re.findall(r"in the Dermis tab under ([A-Z]\w+(?:: [A-Z]\w+)?)", path.read_text(encoding="utf-8"))
    }
    assert "Wear" in named and named <= labels


def test_every_property_that_is_drawn_exists() -> None:
    groups = (
        object_properties.DermisDevice,
        object_properties.DermisFinger,
        object_properties.DermisMaterial,
        object_properties.DermisScreen,
        scene_properties.DermisScene,
        skin_properties.DermisSkin,
        skin_properties.DermisSkinView,
        streaming_properties.DermisStream,
        streaming_properties.DermisStreamChannel,
        design_properties.DermisDesign,
        design_properties.DermisDesignTouch,
        scene_properties.DermisThimbleView,
    )
    known = {p.identifier for group in groups for p in group.bl_rna.properties}
    assert strings("prop", 1) and strings("prop", 1) <= known
    for effect in (c for c in panels.CLASSES if getattr(c, "switch", "")):
        assert {effect.switch, *effect.property_names} <= known


def test_every_setting_of_a_material_can_be_reached() -> None:
    shown = strings("prop", 1) | {
        "friction",
        "surface_stiffness_mpa_m",
        "held_mode",
        "mass",
        "kink_time",
        "content_kind",
        "content_amplitude",
        "content_length_mm",
        "content_size_mm",
        "content_damping",
    }
    for effect in (c for c in panels.CLASSES if getattr(c, "switch", "")):
        shown |= {effect.switch, *effect.property_names}
    names = {row.saved for row in object_properties.TABLES[object_properties.DermisMaterial].values()}
    assert names <= shown


def test_the_summary_follows_roles_and_devices() -> None:
    scene = bpy.context.scene
    assert summary.of(scene) == summary.Summary((), (), (), (), False, False, 0)
    hand = finger()
    cube()
    screen()
    assert summary.of(scene) == summary.Summary(("Finger",), ("Finger",), ("Cube",), ("Screen",), False, False, 0)
    hand.dermis.finger.skin.shown = True
    assert summary.of(scene).skins and summary.of(scene).idle == ()
    hand.dermis.finger.skin.shown = False
    device = hand.dermis.finger.devices.add()
    device.preset = "haptip"
    assert summary.of(scene).idle == ()
    device.enabled = False
    assert summary.of(scene).idle == ("Finger",)


def test_the_next_step_knows_whether_anything_moves() -> None:
    one, block = finger(), cube()
    block.dermis.role = "TOUCHABLE"
    scene = bpy.context.scene
    assert not summary.of(scene).moving
    hand = bpy.data.objects.new("Hand", None)
    scene.collection.objects.link(hand)
    one.parent = hand
    bpy.context.view_layer.update()
    assert not summary.of(scene).moving
    hand.keyframe_insert("location", frame=1)
    bpy.context.view_layer.update()
    assert summary.of(scene).moving


def test_a_file_of_a_newer_dermis_is_noticed() -> None:
    scene = bpy.context.scene
    scene.dermis.file_version = scene_properties.FILE_VERSION + 1
    cube()
    assert summary.of(scene).newer == scene_properties.FILE_VERSION + 1


def test_presets_are_read_on_demand_and_broken_ones_keep_their_reason(tmp_path, monkeypatch) -> None:
    from blender_addon import preferences

    monkeypatch.setattr(preferences, "presets_folder", lambda: tmp_path)
    (tmp_path / "devices").mkdir()
    (tmp_path / "devices" / "mine.json").write_text('{"schema": "dermis-device 1", "name": ', encoding="utf-8")
    assert not choices.known() and choices.entries("devices") == ()
    choices.refresh()
    assert choices.kind_of("haptip") == "shear_tactor"
    assert choices.first_of_kind("friction_screen") == "electrovibration"
    assert "not JSON" in choices.entry("devices", "mine").error
    assert choices.title("devices", "removed") == "removed"


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (0.00125, "m", "+1.250 mm"),
        (-0.5235987755982988, "rad", "-30.00°"),
        (234.04, "V", "234.0 V"),
        (60.0, "Hz", "60 Hz"),
    ],
)
def test_figures_have_the_units_that_people_use(value: float, unit: str, shown: str) -> None:
    assert quantities.quantity(value, unit) == shown


def test_the_tab_reads_from_top_to_bottom() -> None:
    tops = [c for c in panels.CLASSES if issubclass(c, bpy.types.Panel) and not getattr(c, "bl_parent_id", "")]
    assert [c.bl_label for c in tops] == [
        "Dermis",
        "Place",
        "Touch: Screen",
        "Touch: Material",
        "Touch: Skin",
        "Wear",
        "Preview",
        "Bake",
        "Export",
        "Film and Figure",
        "Compare Devices",
        "Stream",
        "How Many Motors?",
    ]
    folded = {c.bl_label for c in panels.CLASSES if "DEFAULT_CLOSED" in getattr(c, "bl_options", ())}
    assert {"Details", "Device Values", "Skin Values", "Settings", "Export", "Stream", "How Many Motors?"} <= folded


def test_a_preset_has_a_name_before_presets_were_read() -> None:
    choices.forget()
    assert choices.title("materials", "grill_plate") == "Grill Plate" and choices.description("devices", "haptip") == ""
    assert not choices.known() and choices.search("devices", "HapTip") == ["haptip"]  # a field that is typed into


def test_presets_are_read_again_only_when_a_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from blender_addon import preferences

    monkeypatch.setattr(preferences, "presets_folder", lambda: tmp_path)
    assert preferences.library() is preferences.library()
    (tmp_path / "materials").mkdir()
    path = tmp_path / "materials" / "mine.json"
    for friction in (0.5, 0.75):
        text = f'{{"schema": "dermis-material 1", "name": "Mine", "parameters": {{"friction": {friction}}}}}'
        path.write_text(text, encoding="utf-8")
        assert preferences.library().material("mine")["friction"] == friction
