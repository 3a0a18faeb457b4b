"""What the artist sets: names and units against the engine's contract, keys, drivers, and honest display."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from blender_addon.properties import fields, object_properties, scene_properties
from core.errors import DermisError
from core.parameters.device import DEVICE as DEVICE_ROWS
from core.parameters.material import BODY

from .build import empty, finger, keys, span

FINGER = {
    "touch_distance",
    "pattern",
    "pattern_play",
    "pattern_angle",
    "pattern_frequency",
    "pattern_amplitude",
    "pattern_repeat",
}
DEVICE = {
    "use_transient",
    "use_texture",
    "use_weight",
    "use_content",
    "use_pattern",
    "platform_method",
    "projection",
    "transient_axis",
    "weight_sign",
    "auto_range",
    "relief",
    "relief_formula",
    "profile",
    "downhill",
    "scale_mode",
    "scale",
    "carrier",
    "direction_window",
    "threshold",
    "pin_method",
    "pin_nodes",
    "pin_bounded",
    "pin_lead",
    "pin_fade_in",
    "pin_fade_out",
    "thimble_method",
    "thimble_surrogate",
    "thimble_hover",
    "thimble_calibrated",
    "thimble_felt_1",
    "thimble_felt_2",
    "thimble_felt_3",
    "table",
    "table_rows",
}
GROUPS = (
    object_properties.DermisDevice,
    object_properties.DermisFinger,
    object_properties.DermisMaterial,
    object_properties.DermisScreen,
    object_properties.DermisObject,
    scene_properties.DermisScene,
)


def own(group: type) -> list[bpy.types.Property]:
    """Return the properties that a group declares itself."""
    return [group.bl_rna.properties[name] for name in group.__annotations__]


def test_groups_give_exactly_the_engines_parameters() -> None:
    obj = empty("Thing")
    device = obj.dermis.finger.devices.add()
    assert set(object_properties.parameters(obj.dermis.material)) == set(BODY)
    assert set(object_properties.parameters(obj.dermis.finger)) == FINGER
    assert set(object_properties.parameters(device)) == DEVICE


def test_parameters_are_si_whatever_the_scene_unit() -> None:
    obj = empty("Thing")
    material = obj.dermis.material
    material.texture_period_x_mm, material.texture_speed_threshold_mm_s, material.mass = 2.0, 30.0, 0.25
    for scale in (1.0, 0.001, 0.3048):
        bpy.context.scene.unit_settings.scale_length = scale
        values = object_properties.parameters(material)
        assert values["texture_period_x"] == pytest.approx(0.002, rel=1e-12)
        assert values["texture_speed_threshold"] == pytest.approx(0.03, rel=1e-12)
        assert values["mass"] == 0.25


def test_no_length_is_shown_through_the_scene_scale() -> None:
    scaled = {"LENGTH", "AREA", "VOLUME", "MASS", "VELOCITY", "ACCELERATION"}
    for group in GROUPS:
        for prop in own(group):
            assert prop.unit not in scaled, prop.identifier
            if prop.identifier.endswith("_mm"):
                assert prop.unit == "CAMERA", prop.identifier  # millimetres in every scene
    assert bpy.utils.units.to_string("METRIC", "CAMERA", 0.5).strip() == "0.5 mm"


def test_material_values_go_in_and_come_back_in_si() -> None:
    material = empty("Thing").dermis.material
    given = {"friction": 0.75, "texture_period_y": 0.0035, "transient_on": False, "content_kind": "slosh"}
    assert object_properties.apply_parameters(material, {**given, "colour": 3}) == ["colour"]
    values = object_properties.parameters(material)
    for name, value in given.items():
        assert values[name] == (pytest.approx(value, rel=1e-6) if isinstance(value, float) else value), name


def test_what_can_change_in_time_can_be_keyed_and_driven() -> None:
    scene = span(1, 21)
    thing = finger()
    keys(thing, "dermis.finger.touch_distance_mm", [1, 11], [0.0, 10.0])
    curve = thing.driver_add("dermis.finger.pattern_angle")
    curve.driver.expression = "frame * 0.125"
    scene.frame_set(6, subframe=0.5)
    found = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).dermis.finger
    assert object_properties.parameters(found)["touch_distance"] == pytest.approx(0.0055, rel=1e-6)
    scene.frame_set(4)
    found = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).dermis.finger
    assert found.pattern_angle == pytest.approx(0.5, rel=1e-6)


def test_methods_and_kinds_cannot_be_keyed() -> None:
    for group in GROUPS[:4]:
        for prop in own(group):
            if prop.type == "ENUM":
                assert not prop.is_animatable, prop.identifier


def registered() -> dict[str, tuple[Any, list[Any]]]:
    """Return RNA and own properties of every operator and group of the add-on, and of types that carry a group."""
    found: dict[str, tuple[Any, list[Any]]] = {}

    def add(name: str, rna: Any, *, ours: bool) -> None:
        if name in found:
            return
        inherited = {"rna_type", *(rna.base.properties.keys() if rna.base is not None else ())}
        own = [p for p in rna.properties if p.identifier not in inherited]
        own = [p for p in own if ours or p.identifier.startswith("dermis")]
        found[name] = (rna, own)
        for prop in own:
            if prop.type in ("POINTER", "COLLECTION") and prop.fixed_type.identifier.startswith("Dermis"):
                add(prop.fixed_type.identifier, prop.fixed_type, ours=True)

    for name in dir(bpy.types):
        kind = getattr(bpy.types, name)
        if name.startswith("DERMIS_OT_"):  # an operator's properties are at the operator, not at the class
            add(name, getattr(bpy.ops.dermis, name.removeprefix("DERMIS_OT_")).get_rna_type(), ours=True)
        elif not name.startswith("DERMIS") and hasattr(kind, "bl_rna"):
            add(name, kind.bl_rna, ours=False)
    for kind in bpy.types.AddonPreferences.__subclasses__():
        if kind.__module__.startswith("blender_addon"):
            add(kind.__name__, kind.bl_rna, ours=True)
    return found


def test_every_operator_property_and_choice_has_a_name_and_a_tooltip() -> None:
    def tells(rna: Any) -> bool:
        return bool(rna.name and rna.description) and rna.description not in (rna.name, rna.identifier)

    lacking, seen = [], 0
    for name, (rna, properties) in registered().items():
        lacking += [name] if name.startswith("DERMIS_OT_") and not tells(rna) else []
        for prop in properties:
            seen += 1
            choices = prop.enum_items if prop.type == "ENUM" else ()
            lacking += [f"{name}.{prop.identifier}"] if not tells(prop) else []
            lacking += [f"{name}.{prop.identifier}: {c.identifier}" for c in choices if not tells(c)]
    assert not lacking, "\n".join(lacking)
    assert seen > 300  # the walk has found them


def test_a_file_without_dermis_has_no_version_and_a_stamp_survives_saving(tmp_path) -> None:
    scene = bpy.context.scene
    assert scene.dermis.file_version == 0
    finger()
    path = str(tmp_path / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert bpy.context.scene.dermis.file_version == scene_properties.FILE_VERSION


def test_an_edit_by_script_makes_a_bake_out_of_date() -> None:
    from blender_addon import changes

    thing = finger()
    changes.clear_dirty()
    thing.dermis.finger.touch_distance_mm = 0.7
    assert changes.dirty()


@pytest.mark.parametrize("end", [-1e30, 1e30])
def test_the_ends_of_the_window_are_values_that_the_engine_takes(end: float) -> None:
    """A property is held in single precision: its least and largest value are off the row's by a rounding."""
    tip, thing = finger("Tip"), empty("Thing")
    device = tip.dermis.finger.devices.add()
    groups = {
        object_properties.DermisFinger: tip.dermis.finger,
        object_properties.DermisDevice: device,
        object_properties.DermisMaterial: thing.dermis.material,
        object_properties.DermisScreen: thing.dermis.screen,
    }
    for kind, group in groups.items():
        for row in object_properties.TABLES[kind].values():
            if row.label and row.numeric and not row.whole:
                setattr(group, row.saved, end)
                row.check(fields.value_of(group, row), kind.__name__)
    device.thimble_hover_mm = float("nan")
    with pytest.raises(DermisError, match="'thimble_hover' must be a finite number"):
        DEVICE_ROWS["thimble_hover"].check(fields.values(device, DEVICE_ROWS)["thimble_hover"], "device")
