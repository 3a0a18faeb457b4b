"""Base classes and functions that operators share."""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty
from bpy_extras import view3d_utils

from .. import choices, loading, reporting
from .._core import DermisError
from ..devices import active_presets
from ..polls import active_finger


class Work:
    """Runs a piece of work; errors go to the status bar and the findings."""

    subject = ""  # source of an error in the list of findings; if empty, the operator's label

    def work(self, context: bpy.types.Context) -> str | None:
        """Do the work; return words for the status bar."""
        raise NotImplementedError

    def execute(self: Any, context: bpy.types.Context) -> set[str]:
        """Do the work, and report; remove its earlier findings from the list."""
        subject = self.subject or self.bl_label
        loading.settle()
        if context.view_layer is not None:  # after an undo, as in the redo panel, no object's matrix is up to date
            context.view_layer.update()
        if reporting.source() == subject:
            reporting.forget()
        try:
            said = self.work(context)
        except DermisError as error:
            return reporting.report_error(self, error, subject)
        if "UNDO" in getattr(self, "bl_options", ()) and reporting.source() == subject:
            reporting.belong_to_step(context.scene)
        if said:
            self.report({"INFO"}, said)
        return {"FINISHED"}


def listed(patterns: str) -> Any:
    """Declare which files the file browser lists, such as '*.csv;*.txt'."""
    return StringProperty(
        name="Listed",
        description="Names of the files that the file browser lists",
        default=patterns,
        options={"HIDDEN"},
    )


class File(Work):
    """Asks for a file first."""

    suffix = ""  # added to a file name that has none

    filepath: StringProperty(name="File", description="Path of the file", subtype="FILE_PATH")  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def path(self) -> Path:
        """Return the file that was chosen.

        Raises:
            DermisError: no file was chosen.
        """
        path = Path(bpy.path.abspath(self.filepath))
        if not path.name or path.is_dir():  # the file browser's value if no name was chosen
            raise DermisError("no file is chosen", value=self.filepath)
        return path if path.suffix else path.with_suffix(self.suffix)


class Folder(Work):
    """Asks for a folder first."""

    directory: StringProperty(name="Folder", description="Folder to write the files to", subtype="DIR_PATH")  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def folder(self) -> Path:
        """Return the folder that was chosen."""
        return Path(bpy.path.abspath(self.directory))


class Chooser:
    """Reads the presets, then opens a menu that lists them."""

    menu = ""

    def execute(self: Any, context: bpy.types.Context) -> set[str]:
        """Read the presets, then open the menu."""
        if context.window is None or bpy.app.background:  # a menu would crash Blender there
            self.report({"ERROR"}, "A menu needs a window; set the preset by its name instead")
            return {"CANCELLED"}
        choices.refresh()
        bpy.ops.wm.call_menu(name=self.menu)
        return {"FINISHED"}


def active_device(context: bpy.types.Context, family: "active_presets.Family") -> Any | None:
    """Return the settings of the active finger's first enabled device of a family.

    None without one.
    """
    finger = active_finger(context)
    return active_presets.device_of(finger, family) if finger is not None else None


def chosen(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected objects and the active one, if they can be edited.

    Edits of a linked object would not be saved.
    """
    selected, active = list(context.selected_objects), context.object
    both = selected if active is None or active in selected else [*selected, active]
    return [obj for obj in both if obj.is_editable]


def select_only(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make an object the active one, and the only selected."""
    for other in context.selected_objects:
        other.select_set(False)
    obj.select_set(True)
    context.view_layer.objects.active = obj


def zoom(context: bpy.types.Context) -> None:
    """Bring the selected objects into view.

    Blender's first view fits a cube of two metres, in which a new fingertip is hardly seen.
    """
    area = context.area
    if area is None or area.type != "VIEW_3D" or bpy.app.background:
        return
    region = next((r for r in area.regions if r.type == "WINDOW"), None)
    if region is not None:
        with context.temp_override(area=area, region=region):
            bpy.ops.view3d.view_selected()


def follow(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Bring an object into view if it was moved out of it; keep the selection."""
    area = context.area
    if area is None or area.type != "VIEW_3D" or bpy.app.background:
        return
    region, seen = next(r for r in area.regions if r.type == "WINDOW"), area.spaces.active.region_3d
    at = view3d_utils.location_3d_to_region_2d(region, seen, obj.matrix_world.translation)
    if at is not None and 0.0 < at.x < region.width and 0.0 < at.y < region.height:
        return
    others = [other for other in context.selected_objects if other != obj]
    was = obj.select_get()
    for other in others:
        other.select_set(False)
    obj.select_set(True)
    zoom(context)
    obj.select_set(was)
    for other in others:
        other.select_set(True)


def show_image(context: bpy.types.Context, image: bpy.types.Image) -> Any | None:
    """Show an image in an open image editor, or in a new window.

    Returns the window and the editor's area; None where there is no window to show it in.
    """
    manager = context.window_manager
    areas = [(w, a) for w in manager.windows for a in w.screen.areas if a.type == "IMAGE_EDITOR"]
    if not areas:
        if context.window is None or bpy.app.background:
            return None
        bpy.ops.wm.window_new()
        window = manager.windows[-1]
        area = max(window.screen.areas, key=lambda a: a.width * a.height)
        area.type = "IMAGE_EDITOR"
        areas = [(window, area)]
    areas[0][1].spaces.active.image = image
    return areas[0]


def counted(number: int, what: str = "file") -> str:
    """Return '1 file', '2 files'."""
    return f"{number} {what}{'' if number == 1 else 's'}"
