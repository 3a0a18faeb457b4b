"""Words of the window: whole names with their units, papers by authors, devices by name, panels where they belong."""

from __future__ import annotations

import re
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from blender_addon import choices, layouts, panels, reporting
from blender_addon._core import Finding, core
from blender_addon.demos import demo_pins, touches
from blender_addon.properties import fields
from blender_addon.sampling import scene_content
from blender_addon.viewport import shown as views

from .build import cube, finger
from .stand_in import Anything, Panel


class Noting(Anything):
    """Notes each property that is drawn, with whether its name stands beside the field."""

    def __init__(self, noted: list[tuple[str, bool]] | None = None, beside: bool = False) -> None:
        super().__init__()
        self.__dict__["noted"], self.__dict__["beside"] = [] if noted is None else noted, beside

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        if name == "use_property_split":
            self.__dict__["beside"] = value

    def column(self, **_: Any) -> Noting:
        return Noting(self.noted, self.beside)

    row = column

    def prop(self, _group: Any, name: str, **_: Any) -> None:
        self.noted.append((name, self.beside))


def groups() -> Iterator[Any]:
    """Yield the RNA of every group of properties of ours."""
    for cls in bpy.types.PropertyGroup.__subclasses__():
        if cls.__name__.startswith("Dermis") and cls.is_registered:
            yield cls.bl_rna


def test_a_name_that_would_be_cut_off_stands_in_its_field() -> None:
    material, skin = cube().dermis.material, finger().dermis.finger.skin
    names = ("friction", "transient_amplitude", "transient_decay", "weight_acceleration", "weight_gravity")
    layout = Noting()
    layouts.properties(layout, material, *names, "texture_speed_threshold_mm_s", "content_amplitude", "held_mode")
    layouts.properties(layout, skin, "young_kpa", keys=False)
    beside = dict(layout.noted)
    assert [name for name, split in beside.items() if not split] == [
        "transient_amplitude",
        "weight_acceleration",
        "texture_speed_threshold_mm_s",
        "content_amplitude",
    ]
    held = {item.name for item in material.bl_rna.properties["held_mode"].enum_items}
    assert max(map(len, held)) <= 15  # "By Opposed Fing..." was cut off


def test_the_methods_of_pins_have_a_whole_row(worn: Any) -> None:
    layout = Noting()
    Panel(panels.object.DERMIS_PT_device, layout).draw(bpy.context)
    assert dict(layout.noted)["pin_method"] is False and dict(layout.noted)["pin_nodes"] is True


def test_no_tooltip_calls_a_paper_by_a_key() -> None:
    assert fields.cited("[S2] III; [S0] 5") == "Pacchierotti et al. 2018, III; Verschoor et al. 2020, 5"
    texts = []
    for rna in groups():
        for prop in rna.properties:
            texts += [prop.description, *(item.description for item in getattr(prop, "enum_items", ()))]
    assert any("Girard et al. 2016, eq. 3" in text for text in texts) and any("Kim et al. 2013" in t for t in texts)
    assert not [text for text in texts if re.search(r"\[S\d\]", text)]


def test_names_of_devices_are_written_alike() -> None:
    choices.refresh()
    names = [entry.name for entry in choices.entries("devices") if not entry.user]
    assert len(names) == 7
    assert not [name for name in names if re.search(r"\s[A-Z][a-z]", name)]  # a sentence's capitals: 'Voice coil'


@pytest.fixture
def worn() -> Any:
    """Return a finger with a tactor, a pin array and a thimble, shown."""
    choices.refresh()
    scene = demo_pins.build(1.5e-3, 0.5, 0.0)
    bpy.context.window.scene = scene
    obj = scene.objects["Index"]
    obj.dermis.finger.skin.level = "draft"
    for preset in ("haptip", "thimble_3rrs"):
        obj.dermis.finger.devices.add().preset = preset
    bpy.context.view_layer.objects.active = obj
    views.renew(scene)
    return obj


def test_panels_of_a_device_are_shown_with_the_device(worn: Any) -> None:
    own = {"Pattern": panels.object.DERMIS_PT_pattern, "Pins": panels.pins.DERMIS_PT_pins}
    own |= {"Thimble": panels.thimble.DERMIS_PT_thimble, "Platform": panels.design.DERMIS_PT_platform}
    for i, name in enumerate(("Pins", "Pattern", "Thimble")):
        worn.dermis.finger.active_device = i
        assert [key for key, panel in own.items() if panel.poll(bpy.context)] == [name]


def test_the_number_of_the_press_test_has_a_name(worn: Any) -> None:
    layout = Anything()
    Panel(panels.pins.DERMIS_PT_pins, layout).draw(bpy.context)
    assert "" not in layout.words


def test_exaggeration_is_offered_for_a_tactor_alone(worn: Any) -> None:
    layout = Noting()
    for tactor in (True, False):
        worn.dermis.finger.devices[1].enabled = tactor
        layout.noted.clear()
        Panel(panels.preview.DERMIS_PT_preview, layout).draw(bpy.context)
        assert ("twin_exaggeration" in dict(layout.noted)) == tactor


def test_a_finding_is_told_in_whole_sentences() -> None:
    row = Finding("warning", "pad", "a pad is off", "armature 'Arm'", "index 2 mm off", "1 mm", remedy="Move it")
    reporting.show([row], "Attach", bpy.context.scene)
    layout = Anything()
    Panel(panels.bake.DERMIS_PT_findings, layout).draw(bpy.context)
    text = " ".join(filter(None, layout.words))
    assert "Arm': a pad is off. Found: index 2 mm off. Allowed: 1 mm. Move it." in text


def test_a_device_is_shown_and_chosen_by_its_name(worn: Any) -> None:
    choices.refresh()
    worn.dermis.finger.active_device = 0
    device = worn.dermis.finger.devices[0]
    for key, name in (("hexapod", "Six-leg platform (6 motors)"), ("haptip", "HapTip shear tactor")):
        device.preset_name = name
        assert (device.preset, device.preset_name) == (key, name)
        layout = Noting()
        Panel(panels.object.DERMIS_PT_device, layout).draw(bpy.context)
        assert "preset" not in dict(layout.noted) and "preset_name" in dict(layout.noted)
    assert "preset_name" not in {
        name for name, _ in scene_content._plan(type(device))
    }  # it changes as presets are read
    assert bpy.ops.dermis.add_device("EXEC_DEFAULT", True, preset="haptip") == {"FINISHED"}
    done = bpy.context.window_manager.operators[-1]
    assert (done.preset, done.device_name) == ("haptip", "HapTip shear tactor")
    own = bpy.ops.dermis.add_device.get_rna_type().properties
    assert own["preset"].is_hidden and not own["device_name"].is_hidden


def test_a_platform_is_chosen_by_its_name() -> None:
    own = bpy.context.scene.dermis_design
    choices.refresh()
    assert (own.device, own.device_name) == ("cable_platform", "Cable platform (3 motors)")
    own.device_name = "Six-leg platform (6 motors)"
    assert own.device == "hexapod"
    own.device_name = "mine"
    assert own.device == own.device_name == "mine"  # without a preset, the text stands for itself
    layout = Noting()
    Panel(panels.design.DERMIS_PT_design, layout).draw(bpy.context)
    assert dict(layout.noted)["device_name"] is False  # beside a label it would be cut off
    assert bpy.ops.dermis.demo_motors_scene(touch="flat", device="hexapod") == {"FINISHED"}
    assert [d.preset for d in bpy.data.objects["Index"].dermis.finger.devices] == ["hexapod"]


def test_listed_scenes_have_their_whole_names() -> None:
    for touch in list(touches.MOTORS)[:2]:
        scene = bpy.data.scenes.new(f"Dermis Motors: {touches.MOTORS[touch][0]}")
        bpy.context.scene.dermis_design.touches.add().scene = scene
    layout = Anything()
    Panel(panels.design.DERMIS_PT_design, layout).draw(bpy.context)
    first, second = (touches.MOTORS[touch][0] for touch in list(touches.MOTORS)[:2])
    assert f"Not baked: Dermis Motors: {first}, Dermis Motors: {second}." in " ".join(layout.words)


def test_a_report_fits_the_status_bar_and_the_console_has_all_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    said: list[Any] = []
    finding = Finding("warning", "x", "pins miss the skin", "finger 'Index', pin array", "12", "0", "Move the array")
    operator: Any = SimpleNamespace(report=lambda level, text: said.append((level, text)))
    reporting.report_findings(operator, [finding, Finding("warning", "y", "more")], "Bake of Scene", "Baked 1 track")
    assert said == [({"WARNING"}, "Baked 1 track; warning: finger 'Index', pin array: pins miss the skin; 1 more")]
    assert str(finding) in capsys.readouterr().out and reporting.findings()[0] == finding


def test_only_findings_of_frames_count_samples() -> None:
    reporting.show(
        [
            Finding(
                "info", "pins-at-limit", "pins are at their limit", "finger 'Index', pin array", frame=3.0, count=9
            ),
            Finding("warning", "pin-misses", "pins miss the skin", "finger 'Index', pin array", count=2),
        ]
    )
    layout = Anything()
    Panel(panels.bake.DERMIS_PT_findings, layout).draw(bpy.context)
    words = " ".join(layout.words)
    assert "(count: 2)" in words and "(9 samples)" in words and "(2 samples)" not in words


def test_details_wrap_their_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    bake = SimpleNamespace(skipped={"skin_frames_between": 360}, stage_seconds={})
    monkeypatch.setattr(panels.bake.store, "current", lambda _scene: SimpleNamespace(bake=bake))
    layout = Anything()
    Panel(panels.bake.DERMIS_PT_result_details, layout).draw(bpy.context)
    (words,) = [words for _, words in core.pipeline.skipping.told(bake.skipped)]
    assert f"frames: {words}" in " ".join(layout.words) and max(map(len, layout.words)) < 50
