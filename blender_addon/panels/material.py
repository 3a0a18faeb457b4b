"""Haptic material of the active object: friction, effects, and when it counts as held."""

from typing import Any

import bpy

from .. import choices
from ..layouts import editable, preset, properties, role
from ..polls import needs
from .main import DermisPanel


@needs(lambda context: role(context) == "TOUCHABLE")
class DERMIS_PT_material(DermisPanel, bpy.types.Panel):
    """The haptic material of something touchable."""

    bl_idname = "DERMIS_PT_material"
    bl_label = "Touch: Material"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw preset and friction."""
        material = context.object.dermis.material
        title = choices.title("materials", material.preset)
        editable(self.layout, context.object)
        preset(self.layout, "materials", "dermis.choose_material", title)
        properties(self.layout, material, "friction", "surface_stiffness_mpa_m", "curved")


class _Effect(DermisPanel):
    """A part of the material with a switch in its header."""

    bl_parent_id = "DERMIS_PT_material"
    bl_options = {"DEFAULT_CLOSED"}
    switch = ""
    property_names: tuple[str, ...] = ()

    def draw_header(self, context: bpy.types.Context) -> None:
        """Draw the switch."""
        editable(self.layout, context.object)  # type: ignore[attr-defined]
        self.layout.prop(context.object.dermis.material, self.switch, text="")  # type: ignore[attr-defined]

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the values, greyed while the switch is off."""
        material = context.object.dermis.material
        editable(self.layout, context.object)  # type: ignore[attr-defined]
        column = properties(self.layout, material, *self.names(material))  # type: ignore[attr-defined]
        column.active = getattr(material, self.switch)

    def names(self, _material: Any) -> tuple[str, ...]:
        """Return the properties to show."""
        return self.property_names


class DERMIS_PT_transient(_Effect, bpy.types.Panel):
    """Contact transient."""

    bl_idname = "DERMIS_PT_transient"
    bl_label = "Contact Transient"
    switch = "transient_on"
    property_names = ("transient_amplitude", "transient_decay", "transient_frequency")


class DERMIS_PT_texture(_Effect, bpy.types.Panel):
    """Texture."""

    bl_idname = "DERMIS_PT_texture"
    bl_label = "Texture"
    switch = "texture_on"
    property_names = (
        "texture_amplitude_x",
        "texture_amplitude_y",
        "texture_period_x_mm",
        "texture_period_y_mm",
        "texture_speed_threshold_mm_s",
    )


class DERMIS_PT_weight(_Effect, bpy.types.Panel):
    """Weight."""

    bl_idname = "DERMIS_PT_weight"
    bl_label = "Weight"
    switch = "weight_on"
    property_names = ("weight_gravity", "weight_acceleration")


class DERMIS_PT_content(_Effect, bpy.types.Panel):
    """Content."""

    bl_idname = "DERMIS_PT_content"
    bl_label = "Content"
    switch = "content_on"

    def names(self, material: Any) -> tuple[str, ...]:
        """Return the properties that this kind of content has."""
        kind = material.content_kind
        return (
            "content_kind",
            "content_amplitude",
            *(("content_length_mm",) if kind in ("pendulum", "slosh") else ()),
            *(("content_size_mm",) if kind in ("slosh", "loose") else ()),
            *(("content_damping",) if kind != "child" else ()),
        )


class DERMIS_PT_held(DermisPanel, bpy.types.Panel):
    """When the object counts as held, and how heavy it is."""

    bl_idname = "DERMIS_PT_held"
    bl_label = "Holding"
    bl_parent_id = "DERMIS_PT_material"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the rule, its keyed switch, and the settings of the carried weight."""
        material = context.object.dermis.material
        editable(self.layout, context.object)
        column = properties(self.layout, material, "held_mode")
        if material.held_mode == "keyed":
            column.prop(material, "held")
        if material.held_mode != "never":
            properties(self.layout, material, "mass", "kink_time")


CLASSES: tuple[type, ...] = (
    DERMIS_PT_material,
    DERMIS_PT_transient,
    DERMIS_PT_texture,
    DERMIS_PT_weight,
    DERMIS_PT_content,
    DERMIS_PT_held,
)
