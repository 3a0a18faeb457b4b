# mypy: disable-error-code="valid-type"
"""A bake as objects for a film or a figure: skins with their heat map, device twins."""

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty

from .. import jobs, reporting
from ..film import film_objects, heat_material, legend, skin_mesh, twin_objects
from ..polls import needs
from ..results import store
from .work import Work, chosen, counted

QUANTITIES = (
    ("stress", "Stress", "von Mises stress: how hard the tissue at the surface is strained"),
    ("pressure", "Pressure", "Force into the skin over its area"),
    ("displacement", "Displacement", "How far the skin is moved from its rest"),
)


def _with_skin(context: bpy.types.Context, *, selected: bool = False) -> list[str]:
    """Return the fingers whose skin is in the last bake, all or those selected."""
    result = store.current(context.scene)
    return [] if result is None else _there(context, list(result.bake.skins), selected)


def _with_device(context: bpy.types.Context, *, selected: bool = False) -> list[str]:
    """Return the fingers with a device in the last bake, all or those selected."""
    result = store.current(context.scene)
    return [] if result is None else _there(context, [o.finger for o in result.bake.outputs], selected)


def _there(context: bpy.types.Context, names: list[str], selected: bool) -> list[str]:
    wanted = {obj.name_full for obj in (chosen(context) if selected else context.scene.objects)}
    return [name for name in dict.fromkeys(names) if name in wanted]


def _coloured(context: bpy.types.Context, name: str, *, with_legend: bool) -> str:
    """Show an attribute on all skins; return remarks on colours and legend, or ''."""
    scene, view = context.scene, context.scene.dermis.skin_view
    end = skin_mesh.top(scene, name)
    heat_material.show(name, end, view.colours, view.fill)
    said = ""
    if with_legend and legend.draw(scene, name, skin_mesh.ATTRIBUTES[name], end, view.colours) is None:
        said = " The legend needs a camera."
    if scene.view_settings.view_transform != "Standard":
        said += f" View transform '{scene.view_settings.view_transform}' changes colours: 'Standard' does not."
    return said


@needs(lambda context: _with_skin(context), "Switch Skin on for a finger, and bake")
class DERMIS_OT_film_skin(jobs.Job, bpy.types.Operator):
    """Make the skin of the last bake a mesh that deforms frame by frame, with stress [Pa], pressure [Pa] and
    displacement [m] as attributes and a material that shows them in renders; Esc cancels"""

    bl_idname = "dermis.film_skin"
    bl_label = "Skin as Mesh"
    bl_options = {"REGISTER", "UNDO"}
    job_title = "Skin as mesh"

    selected: BoolProperty(
        name="Selected Only", description="Only the selected fingers instead of all fingers of the bake"
    )
    show: EnumProperty(
        name="Colours Show", description="Quantity that colours the skin", items=QUANTITIES, default="stress"
    )
    with_legend: BoolProperty(
        name="Legend", description="Place a legend of the colours in front of the camera", default=True
    )
    hide_finger: BoolProperty(
        name="Hide Finger in Renders", description="Hide the finger's undeformed shape in renders", default=True
    )

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return skin_mesh.work_out(context.scene, _with_skin(context, selected=self.selected))

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
    """Colour the skins by another quantity, with the range and colour map of the view"""

    bl_idname = "dermis.film_colours"
    bl_label = "Colours Show"
    bl_options = {"REGISTER", "UNDO"}

    show: EnumProperty(
        name="Colours Show", description="Quantity that colours the skin", items=QUANTITIES, default="stress"
    )
    with_legend: BoolProperty(
        name="Legend", description="Place a legend of the colours in front of the camera", default=True
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Set the material."""
        with film_objects.unnoticed(context):
            if not self.with_legend:
                film_objects.remove(context.scene, "legend")
            said = _coloured(context, self.show, with_legend=self.with_legend)
        return said.strip() or None


@needs(lambda context: _with_device(context), "Give a finger a device, and bake")
class DERMIS_OT_film_twins(jobs.Job, bpy.types.Operator):
    """Make objects of the devices of the last bake on their fingers, with a key at every frame. Esc cancels"""

    bl_idname = "dermis.film_twins"
    bl_label = "Twin as Objects"
    bl_options = {"REGISTER", "UNDO"}
    job_title = "Twins"

    selected: BoolProperty(
        name="Selected Only", description="Only the selected fingers instead of all fingers of the bake"
    )

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return twin_objects.work_out(context.scene, _with_device(context, selected=self.selected))

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Make the objects."""
        made, refused = result
        with film_objects.unnoticed(context):
            roots = twin_objects.place(context.scene, made)
        done = f"{counted(len(roots), 'twin')}, {counted(max((len(m.frames) for m in made), default=0), 'frame')}."
        times = context.scene.dermis.twin_exaggeration
        if times != 1.0 and any(p.name == "Tactor" for m in made for p in m.pieces):
            done += f" The tactor moves {times:g} times as far as it will."
        if refused:  # otherwise the list keeps the findings of the bake
            reporting.report_findings(self, refused, self.bl_label, done)
        else:
            self.report({"INFO"}, done)
        return {"FINISHED"}


class DERMIS_OT_film_remove(Work, bpy.types.Operator):
    """Remove these objects. Fingers are shown in renders again"""

    bl_idname = "dermis.film_remove"
    bl_label = "Remove"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="What",
        description="Objects that are removed",
        items=(("skin", "Skins", "Skins and their legend"), ("twin", "Twins", "Device twins")),
        default="skin",
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Remove them."""
        with film_objects.unnoticed(context):
            count = film_objects.remove(context.scene, self.kind)
            if self.kind == "skin":
                count += film_objects.remove(context.scene, "legend")
        return f"Removed {counted(count, 'object')}"


CLASSES: tuple[type, ...] = (DERMIS_OT_film_skin, DERMIS_OT_film_colours, DERMIS_OT_film_twins, DERMIS_OT_film_remove)
