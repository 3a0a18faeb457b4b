# mypy: disable-error-code="valid-type"
"""What a bake gave, as objects that a film or a figure can show: skins with their heat map, device twins."""

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty

from .. import jobs
from ..film import film_objects, heat_material, legend, skin_mesh
from ..polls import needs
from ..results import store
from .work import Work, chosen, counted

QUANTITIES = (
    ("stress", "Stress", "von Mises stress: how hard the tissue at the surface is strained"),
    ("pressure", "Pressure", "Force into the skin over its area"),
    ("displacement", "Displacement", "How far the skin is moved from its rest"),
)


def _baked_skins(context: bpy.types.Context) -> list[str]:
    """Return the selected fingers whose skin is in the last bake, or all of them where none is selected."""
    result = store.current(context.scene)
    felt = [] if result is None else [n for n in result.bake.skins if n in context.scene.objects]
    selected = {obj.name for obj in chosen(context)}
    return [n for n in felt if n in selected] or felt


def _coloured(context: bpy.types.Context, name: str, *, with_legend: bool) -> str:
    """Show an attribute on all skins; return what stands in the way of the view's colours, in words."""
    scene, view = context.scene, context.scene.dermis.skin_view
    end = skin_mesh.top(scene, name)
    heat_material.show(name, end, view.colours, view.fill)
    said = ""
    if with_legend and legend.draw(scene, name, skin_mesh.ATTRIBUTES[name], end, view.colours) is None:
        said = " The legend needs a camera."
    if scene.view_settings.view_transform != "Standard":
        said += f" View transform '{scene.view_settings.view_transform}' changes colours: 'Standard' does not."
    return said


@needs(lambda context: _baked_skins(context), "Switch Skin on for a finger, and bake")
class DERMIS_OT_film_skin(jobs.Job, bpy.types.Operator):
    """Make the skin of the last bake a mesh that deforms frame by frame, with stress [Pa], pressure [Pa] and
    displacement [m] as attributes and a material that shows them in renders; Esc cancels"""

    bl_idname = "dermis.film_skin"
    bl_label = "Skin as Mesh"
    bl_options = {"REGISTER", "UNDO"}
    job_title = "Skin as mesh"

    show: EnumProperty(name="Colours Show", items=QUANTITIES, default="stress")
    with_legend: BoolProperty(name="Legend", description="Put the colours' legend before the camera", default=True)
    hide_finger: BoolProperty(
        name="Hide Finger in Renders",
        description="Leave the finger's own shape, which does not give way, out of renders",
        default=True,
    )

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return skin_mesh.work_out(context.scene, _baked_skins(context))

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Make the objects, and colour them."""
        with film_objects.unnoticed(context):
            made = skin_mesh.place(context.scene, result, hide_finger=self.hide_finger)
            said = _coloured(context, self.show, with_legend=self.with_legend)
        frames = max((len(r.table.positions) for r in result), default=0)
        self.report({"INFO"}, f"{counted(len(made), 'skin')}, {counted(frames, 'frame')}.{said}")
        return {"FINISHED"}


@needs(lambda context: film_objects.of_kind(context.scene, "skin"), "Make Skin as Mesh first")
class DERMIS_OT_film_colours(Work, bpy.types.Operator):
    """Show something else in the colours of the skins, with the view's range and colour map"""

    bl_idname = "dermis.film_colours"
    bl_label = "Colours Show"
    bl_options = {"REGISTER", "UNDO"}

    show: EnumProperty(name="Colours Show", items=QUANTITIES, default="stress")
    with_legend: BoolProperty(name="Legend", description="Put the colours' legend before the camera", default=True)

    def work(self, context: bpy.types.Context) -> str | None:
        """Set the material."""
        with film_objects.unnoticed(context):
            if not self.with_legend:
                film_objects.remove(context.scene, "legend")
            said = _coloured(context, self.show, with_legend=self.with_legend)
        return said.strip() or None


class DERMIS_OT_film_remove(Work, bpy.types.Operator):
    """Remove these objects again; fingers are seen in renders as before"""

    bl_idname = "dermis.film_remove"
    bl_label = "Remove"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="What",
        items=(("skin", "Skins", "Skins, and their legend"), ("twin", "Twins", "Device twins")),
        default="skin",
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Remove them."""
        with film_objects.unnoticed(context):
            count = film_objects.remove(context.scene, self.kind)
            if self.kind == "skin":
                count += film_objects.remove(context.scene, "legend")
        return f"Removed {counted(count, 'object')}"


CLASSES: tuple[type, ...] = (DERMIS_OT_film_skin, DERMIS_OT_film_colours, DERMIS_OT_film_remove)
