"""A bake as objects for films and figures: skins and twins."""

import bpy

from ..film import film_objects, heat_material
from ..layouts import paragraph
from ..polls import needs
from ..results import store
from .main import DermisPanel


@needs(lambda context: store.current(context.scene) is not None or film_objects.of_kind(context.scene, "skin"))
class DERMIS_PT_film(DermisPanel, bpy.types.Panel):
    """Objects that renders show."""

    bl_idname = "DERMIS_PT_film"
    bl_label = "Film and Figure"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw for each kind the button that makes objects, and one that removes them."""
        layout, scene = self.layout, context.scene
        if store.state(scene) == "stale":
            paragraph(layout, context, "The bake is out of date: objects made from it now are, too.", "ERROR")
        column = layout.column(align=True)
        skins, twins = (film_objects.of_kind(scene, kind) for kind in ("skin", "twin"))
        for verb, kind, icon, there in (
            ("dermis.film_skin", "skin", "MESH_UVSPHERE", skins),
            ("dermis.film_twins", "twin", "CON_KINEMATIC", twins),
        ):
            row = column.row(align=True)
            row.operator(verb, icon=icon)
            if there:
                row.operator("dermis.film_remove", text="", icon="X").kind = kind
        if skins:
            row = layout.row(align=True)
            for name in ("stress", "pressure", "displacement"):
                button = row.operator("dermis.film_colours", text=name.title(), depress=heat_material.shown() == name)
                button.show = name
        if skins and scene.view_settings.view_transform != "Standard":
            text = f"View transform '{scene.view_settings.view_transform}' changes the colours in renders."
            paragraph(layout, context, text, "INFO")
            button = layout.operator("wm.context_set_enum", text="Use Standard")
            button.data_path, button.value = "scene.view_settings.view_transform", "Standard"


CLASSES: tuple[type, ...] = (DERMIS_PT_film,)
